"""The ride: one page in which one sees what the viewer of a trajectory would see, and compares trajectories.

It needs no network and no programme but a browser. Its view is drawn by three.js, which is in the page.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.text import printable
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, OutputError
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow, named_rows
from hpop.problems.problem import Problem
from hpop.view.explorer.along import columns_of, words
from hpop.view.ride.bodies import links_of, tilted_solids
from hpop.view.ride.scene import Scene
from hpop.view.ride.track import rates, track
from hpop.view.single_page import page_file, single_page
from hpop.view.style import quantities, written

SCHEMA, VERSION = "hpop-ride", 1
NAMES = "ABCDEFGH"
"""Of the trajectories of a page, in the order in which they are asked for."""


@checked_arguments
def save_ride(
    problem: Problem,
    front: Front,
    path: str | os.PathLike[str] = "ride.html",
    *,
    rows: Sequence[int | str] = ("knee",),
    blind: bool = False,
) -> Path:
    """Write a page that rides along trajectories of a front; its path.

    The page shows what the camera sees as the trajectory is executed, from rest to rest, with people where they are
    predicted to be; a map; and how the criteria arise. Trajectories are called A, B, ... in the order of ``rows``.

    Parameters
    ----------
    path : of the page, one file that needs no other; its folder is made if it is missing
    rows : up to eight, by number or by name: "knee", "least turns", or "turns" for the least of a criterion
    blind : leave numbers, criteria and names of trajectories out of the page, for choices by what is seen

    Raises OptionError for rows that cannot be or a name that does not end in .html, UnknownName for names of none,
    OutputError where the page cannot be written; nothing is then half-written.
    """
    target = page_file(path)
    text = ride_page(problem, front, rows=rows, blind=blind)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(text.encode())
    except OSError as error:
        raise OutputError(
            f"the ride cannot be written to {target}: {error.strerror or error}; choose another file"
        ) from None
    return target


def ride_page(problem: Problem, front: Front, *, rows: Sequence[int | str] = ("knee",), blind: bool = False) -> str:
    """The text of the page that `save_ride` writes."""
    return single_page("ride.js", "A ride" if blind else "The ride", ride_payload(problem, front, rows, blind=blind))


def ride_payload(problem: Problem, front: Front, rows: Sequence[int | str], *, blind: bool = False) -> dict[str, Any]:
    """What the page is given, as JSON: `hpop-ride` version 1, read by web/src/ride/model.ts."""
    chosen = named_rows(front, rows)
    if not 1 <= len(chosen) <= len(NAMES):
        raise OptionError(f"a ride is along 1 to {len(NAMES)} trajectories of a front, got {len(chosen)}")
    scene = Scene.of(problem)
    fov = problem.model.field_of_view
    columns = [] if blind else columns_of(problem, front)[: len(front.names)]
    told: dict[str, Criterion] = {c.name: c for c in columns if c is not None}
    first = chosen[0].point.trajectory
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "blind": blind,
        "scene": scene.description(),
        "solids": tilted_solids(scene),
        "links": links_of(first.model, first.states),
        "field_of_view": None if fov is None else list(fov),
        "criteria": [{"name": printable(c.name), "unit": printable(words(c)), "group": c.group} for c in told.values()],
        "tracks": [
            _track(problem, front, name, row, told, blind=blind) for name, row in zip(NAMES, chosen, strict=False)
        ],
        "notes": [] if blind else list(scene.notes),
        "licence": licence(),
    }


def _track(
    problem: Problem, front: Front, name: str, row: NamedRow, told: dict[str, Criterion], *, blind: bool
) -> dict[str, Any]:
    """One trajectory; on a blind page nothing of it but how it moves."""
    trajectory = row.point.trajectory
    columns = {column.name: column for column in quantities(front)}
    shown = [columns[printable(c)] for c in told]
    return {
        "name": name,
        "label": "" if blind else _label(front, row),
        **track(trajectory),
        "rates": rates(list(told.values()), trajectory, problem.world),
        "costs": [written(float(column.values[row.number]), column.unit, column.counts) for column in shown],
    }


def licence() -> str:
    """That of three.js, parts of which are in the page: it goes where they go."""
    return resources.files("hpop.view").joinpath("web", "three_license.txt").read_text(encoding="utf-8")


def _label(front: Front, row: NamedRow) -> str:
    """The number of a row and what it is: "row 70: knee, least turns"."""
    names = [name for name, point in front.named().items() if point.index == row.number]
    return f"row {row.number}" + (f": {printable(', '.join(names))}" if names else "")
