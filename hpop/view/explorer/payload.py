"""What the explorer's page is given: ``hpop-page`` version 1, strict JSON; web/src/explorer/payload.ts reads it.

Costs are the floats that front.json holds, bit for bit. Lengths are whole millimetres from an origin. A page of 8,000
trajectories takes 2 MB at most.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hpop.base.text import printable
from hpop.criteria.base import Criterion
from hpop.frontier.choices import Preferring
from hpop.frontier.union import JOINT
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.status import Status
from hpop.view.explorer import along, world
from hpop.view.explorer.corners import MILLIMETRES, corners
from hpop.view.explorer.packed import Packer
from hpop.view.paths import Heights
from hpop.view.style import marks, quantities
from hpop.world.files import by_names

SCHEMA = "hpop-page"
VERSION = 1
SCRIPT = "explorer.js"  # that reads it


def payload(
    problem: Problem,
    front: Front,
    *,
    title: str | None = None,
    saved: str | None = None,
    preference: Preferring | None = None,
) -> dict[str, Any]:
    """All that the page shows of a front.

    title       else what is traded
    saved       the file of the front, as Python code that the page writes shall name it
    preference  of a person, whose best trajectory is marked
    """
    packer = Packer()
    origin = math.floor(problem.world.bounds[0]), math.floor(problem.world.bounds[1])
    drawn = corners(front.trajectories, origin)
    named = marks(front, preference=preference)
    start = float(problem.model.pose("camera", problem.model.space.state(problem.start)).z[0])
    heights = Heights(min(start, drawn.heights[0]), max(start, drawn.heights[1]))
    paths = {
        "x": packer.integers(drawn.places[:, 0], order=1),
        "y": packer.integers(drawn.places[:, 1], order=1),
        "corners": packer.integers(drawn.corners),
        "counts": packer.integers(drawn.counts),
    }
    ground, left_out = world.described(
        problem, front, drawn.places / MILLIMETRES + np.array(origin), heights, packer, origin
    )
    criteria = along.columns_of(problem, front)
    rows = along.traced_rows(front, [mark.row for mark in named])
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "title": printable(title if title is not None else _title(front)),
        "status": printable(front.status),
        "complete": front.status == Status.COMPLETE,
        "certificate": [printable(claim) for claim in front.certificate.split(JOINT)],
        "notes": [printable(by_names(note)) for note in dict.fromkeys((*front.notes, *problem.world.notes, *left_out))],
        "count": len(front),
        "columns": _columns(front, criteria, packer),
        "marks": [
            {"names": list(mark.names), "row": mark.row, "colour": mark.colour, "dashes": list(mark.dashes[1])}
            for mark in named
        ],
        "saved": None if saved is None else printable(saved),
        "origin": list(origin),
        "paths": paths,
        "world": ground,
        "traces": list(along.traces(problem, front, criteria, rows, packer, origin)),
        "data": packer.text(),
    }


def _title(front: Front) -> str:
    """What is traded, or that there is nothing to trade."""
    if not len(front):
        return "No path from start to goal" if front.status == Status.NO_PATH else "No path found"
    *several, last = front.names
    return f"Trade-offs between {', '.join(several)} and {last}" if several else f"The least {last}"


def _columns(front: Front, criteria: Sequence[Criterion | None], packer: Packer) -> list[dict[str, Any]]:
    """The criteria, then what is reported."""
    quanta = [*front.quanta.tolist(), *[0.0] * len(front.reported_names)]
    groups = [*front.groups, *[""] * len(front.reported_names)]
    table, evaluated = np.hstack([front.costs, front.reported]), front.evaluated
    return [
        {
            "name": column.name,
            "label": column.label,
            "unit": column.unit,
            "group": group if group in "PCRO" else "",
            "quantum": quantum,
            "counts": bool(column.counts),
            "reported": place >= len(front.names),
            "evaluated": column.name in evaluated,
            "along": None if criterion is None else along.words(criterion),
            "adds": "sum" if criterion is None else along.ADDS.get(criterion.aggregate, "sum"),
            "values": packer.floats(table[:, place]),
        }
        for place, (column, quantum, group, criterion) in enumerate(
            zip(quantities(front), quanta, groups, criteria, strict=True)
        )
    ]
