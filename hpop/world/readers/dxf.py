"""Reader for floor plans in DXF: lines are walls, solid fills are obstacles. It needs the extra ``plans`` (ezdxf)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hpop.apart.child import Answer
from hpop.errors import MapError
from hpop.world.files import extract, file_source, read_bytes
from hpop.world.readers import drawing
from hpop.world.readers.drawing import WALL_WIDTH, DoorArcs
from hpop.world.readers.placement import Placement
from hpop.world.world import World

MOST_BYTES = 100_000_000
"""Largest file, bytes: a minute or so."""
METRES = {
    1: ("inches", 0.0254),
    2: ("feet", 0.3048),
    4: ("millimetres", 0.001),
    5: ("centimetres", 0.01),
    6: ("metres", 1.0),
    10: ("yards", 0.9144),
    14: ("decimetres", 0.1),
    21: ("US survey feet", 1200 / 3937),
}
"""What ``$INSUNITS`` of a drawing's header says of units in which buildings are drawn, and their metres."""


def read(
    path: str | Path,
    *,
    scale: float | None = None,
    layers: str | Sequence[str] | None = None,
    wall_width: float = WALL_WIDTH,
    inside: tuple[float, float] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
    door_arcs: DoorArcs = "closed",
) -> World:
    """Read the model space of a DXF drawing, ASCII or binary, as a `World`.

    Parameters
    ----------
    path : path of the file
    scale : float, optional
        Metres per unit of the drawing; without it the drawing's header must say its units (``$INSUNITS``).
    layers : name or names, optional
        The layers that are read; all that are neither off nor frozen without it.
    wall_width : float
        Thickness of the walls along lines, m.
    inside : (x, y), optional
        A point of the free space, m: what cannot be reached from it is solid, such as the inside of walls that are
        drawn as two lines, and all outside of the building. Without it the extent is the bounding box of the walls.
    origin : (x, y)
        The drawing's point that becomes (0, 0), in its units.
    door_arcs : "closed" or "open"
        Whether arcs that look like the swing of a door (0.4 to 1.6 m, about a quarter of a circle) are walls, or left
        out. ``world.notes`` say where they are.

    Lines, polylines, arcs, circles, ellipses, splines and the lines of MLINEs are walls, and so are those of blocks
    where these are inserted; wide polylines, solid hatches, solids and traces are obstacles. What is invisible, or on
    layers that are off or frozen, is left out. That and all else is counted in ``world.notes``, which name the
    layers. A curve is a polyline within a two thousandth of its size.

    Raises
    ------
    MapError
        If the file is missing or no drawing, says no units, has no lines or not the layers asked for, or takes more
        time or memory than `hpop.world.files` allows.
    """
    asked = drawing.options(wall_width, layers, inside, door_arcs)
    Placement(1.0 if scale is None else scale, origin)  # checked before the file is read
    content = read_bytes(path, "DXF drawing", limit=MOST_BYTES)
    found = extract("dxf", path, content, {"layers": asked.layers})
    elsewhere = found.words["elsewhere"]
    nothing = "its model space is empty" + f", {elsewhere:,} things are on its sheets" * bool(elsewhere)
    unit, metres = ("units", scale) if scale is not None else _units(path, found)
    world = drawing.build(path, found, Placement(metres, origin), asked, nothing=nothing)
    note = f"{path}: drawn in {unit} of {metres:g} m{' by its header; scale says otherwise' * (scale is None)}."
    options = {"scale": scale, **asked._asdict(), "origin": list(origin)}
    return World(world.ground, notes=(note, *world.notes)).read_from(file_source("dxf", path, options, content))


def _units(path: str | Path, found: Answer) -> tuple[str, float]:
    """The units of a drawing by its header, and their metres."""
    code = found.words["insunits"]
    if code in METRES:
        return METRES[code]
    if not len(found.arrays["points"]):
        return "no units", 1.0  # that there are no lines is worse
    width, height = np.ptp(found.arrays["points"], axis=0)
    says = "does not say its units ($INSUNITS is 0)" if code == 0 else f"has $INSUNITS {code}, no unit of a building"
    raise MapError(
        f"{path} {says}; it spans {width:.5g} x {height:.5g} units. Give scale, metres a unit: 0.001 where they are "
        "millimetres, 0.01 centimetres, 1 metres, 0.0254 inches."
    )
