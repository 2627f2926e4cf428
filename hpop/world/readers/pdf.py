"""Reader for floor plans in PDF: lines are walls, dark fills obstacles. It needs the extra ``plans`` (pypdfium2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hpop.base.options import whole
from hpop.errors import MapError
from hpop.world.files import extract, file_source, read_bytes
from hpop.world.geometry.shapes import check_positive
from hpop.world.readers import drawing
from hpop.world.readers.drawing import WALL_WIDTH, DoorArcs
from hpop.world.readers.placement import Placement
from hpop.world.world import World

MOST_BYTES = 100_000_000
"""Largest file, bytes."""
MOST_PAGES = 100_000
POINT = 0.0254 / 72
"""A point of a page, m on paper."""


def read(
    path: str | Path,
    *,
    scale: float | None = None,
    ratio: float | None = None,
    page: int = 1,
    layers: str | Sequence[str] | None = None,
    wall_width: float = WALL_WIDTH,
    inside: tuple[float, float] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
    door_arcs: DoorArcs = "closed",
) -> World:
    """Read a page of a PDF with lines, as drawing programs write it, as a `World`; exactly one of scale and ratio.

    Parameters
    ----------
    path : path of the file
    scale : float
        Metres per point of the page (1/72 inch on paper).
    ratio : float
        The ratio that the plan states: 100 where it says 1:100, and the page has its true size.
    page : int
        Which page, from 1.
    layers : name or names, optional
        The layers (optional content) that are read; all that are on when the file is opened without it.
    wall_width, inside
        As `hpop.world.readers.dxf.read` has them.
    origin : (x, y)
        The point that becomes (0, 0), in points from the lower left corner of the page as it is shown.
    door_arcs : "closed" or "open"
        As `hpop.world.readers.dxf.read` has it.

    Dark lines are walls; those of more than 1 mm on paper are as thick as they are drawn. Dark fills are obstacles,
    lighter ones colour rooms and are left out, as are texts, images, annotations, and what lies outside of the page or
    of a clip path. All that is counted in ``world.notes``. A page whose unit is no point (UserUnit) is as large as it
    says.

    Raises
    ------
    MapError
        If the file is missing or no PDF, has no such page, no lines or not the layers asked for, or takes more time or
        memory than `hpop.world.files` allows.
    """
    asked = drawing.options(wall_width, layers, inside, door_arcs)
    page = whole("page", page, 1, MOST_PAGES, error=MapError)
    if (scale is None) == (ratio is None):
        raise MapError(
            f"{path}: a PDF does not say its scale. Give ratio, 100 for a plan at 1:100 on paper of its true size, or "
            f"scale, metres a point (1/72 inch on paper); got {'none' if scale is None else 'both'} of them."
        )
    metres = check_positive("ratio", ratio) * POINT if scale is None else check_positive("scale", scale)
    placement = Placement(metres, origin)
    content = read_bytes(path, "PDF", limit=MOST_BYTES)
    found = extract("pdf", path, content, {"layers": asked.layers, "page": page})
    nothing = f"page {page} of {found.words['pages']:,} is empty"
    try:
        world = drawing.build(path, found, placement, asked, nothing=nothing)
    except MapError as error:
        if not found.words["left_out"].get("images") or len(found.arrays["points"]):
            raise
        raise MapError(
            f"{error} Is it scanned? Save the page as an image, such as by pdftoppm -r 150 -gray -png, and read that "
            f"by image with resolution {metres * 72 / 150:.4g}."
        ) from None
    options = {"scale": metres, "page": page, **asked._asdict(), "origin": list(origin)}
    if (unit := found.words["unit"]) != 1.0:
        note = f"{path}: a unit of page {page} is {unit:g} points by its UserUnit."
        world = replace(world, notes=(note, *world.notes))
    return world.read_from(file_source("pdf", path, options, content))
