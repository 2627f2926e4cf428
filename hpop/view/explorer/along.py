"""What arises along some trajectories of a front, as the explorer's traces have it: as many as there is room for.

The rows with a name come first, then others evenly over the front. Of a long trajectory neighbouring pieces are taken
together: sums and means stay what they are, the worst moment stays the worst.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.front import Front
from hpop.further import claimable, criteria_of
from hpop.problem import Problem
from hpop.trace import Trace, trace
from hpop.view.explorer.corners import millimetres
from hpop.view.explorer.packed import Packer
from hpop.view.style import label

MOST_PIECES = 160  # of a trajectory: a screen tells hardly more apart
STEPS = 2**15 - 1  # that the largest rate of a criterion is told in
TRACES = 12  # rows that are traced, those with a name among them
THOUSANDTHS = 1000.0  # s, rad


def traced_rows(front: Front, named: Sequence[int], most: int = TRACES) -> list[int]:
    """Rows to trace: those with a name, then others evenly over the front, the first of these in its middle."""
    rows = list(dict.fromkeys(named))
    middles = (np.arange(max(0, most - len(rows))) + 0.5) * len(front) / max(1, most - len(rows))
    return [*rows, *(row for row in dict.fromkeys(middles.astype(int).tolist()) if row not in rows)]


def columns_of(problem: Problem, front: Front) -> list[Criterion | None]:
    """The criterion of each column of a front, criteria and what is reported; None of what is no longer known."""
    known = {criterion.name: criterion for criterion in criteria_of(front)} | claimable(problem)
    return [known.get(name) for name in front.names + front.reported_names]


def traces(
    problem: Problem,
    front: Front,
    columns: Sequence[Criterion | None],
    rows: Sequence[int],
    packer: Packer,
    origin: tuple[float, float],
) -> Iterator[dict[str, Any]]:
    """What arises along the trajectories of some rows, packed; of one that stays where it is there is nothing."""
    criteria = [criterion for criterion in columns if criterion is not None]
    for row in rows:
        if len(front.trajectories[row]):
            yield {"row": row, **_packed(trace(criteria, front.trajectories[row], problem.world), packer, origin)}


def _packed(found: Trace, packer: Packer, origin: tuple[float, float]) -> dict[str, Any]:
    ends = _ends(len(found.pieces))
    pose = found.pieces.trajectory.model.pose("camera", found.states)
    x, y, yaw = (np.broadcast_to(column, found.times.shape)[ends] for column in (pose.x, pose.y, pose.yaw))
    places = millimetres(np.stack([x, y], axis=1), origin)
    several = [several for column in range(len(found.criteria)) for several in _along(found, column, ends)]
    steps = [_step(values) for values in several]
    counts = [np.rint(values / step) for values, step in zip(several, steps, strict=True)]
    return {
        "t": packer.integers(np.rint(found.times[ends] * THOUSANDTHS), order=1),
        "x": packer.integers(places[:, 0], order=2),
        "y": packer.integers(places[:, 1], order=2),
        "yaw": packer.integers(np.rint(np.unwrap(yaw) * THOUSANDTHS), order=1),
        "steps": [list(pair) for pair in zip(steps[::2], steps[1::2], strict=True)],
        "values": packer.short(np.concatenate([np.zeros(0), *counts])),
    }


def _ends(pieces: int) -> IntArray:
    """Which of the ends (n+1,) of pieces are told: all, or so many evenly."""
    return np.unique(np.linspace(0, pieces, min(pieces, MOST_PIECES) + 1).round().astype(np.int64))


def _along(found: Trace, column: int, ends: IntArray) -> tuple[FloatArray, FloatArray]:
    """Rate (m,) and running value (m+1,) of a criterion, of pieces that are taken together between some ends (m+1,)."""
    criterion = found.criteria[column]
    rate, running, lasts = found.rate[:, column], found.running[:, column], found.pieces.durations
    if criterion.aggregate == "max":
        joined = np.maximum.reduceat(rate, ends[:-1])
    else:
        total, time = np.add.reduceat(rate * lasts, ends[:-1]), np.add.reduceat(lasts, ends[:-1])
        joined = np.divide(total, time, out=np.zeros_like(total), where=time > 0)
    first = 0.0 if criterion.aggregate in ("sum", "trajectory") else running[0]
    return joined, np.concatenate([[first], running])[ends]


def words(criterion: Criterion) -> str:
    """What a rate is: cost a second, or the value at the time.

    >>> from hpop.criteria import Clearance, Length, Turns
    >>> words(Length()), words(Turns()), words(Clearance())
    ('m a second', 'count a second', 'm at the time')
    """
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    unit = label("", criterion.unit, counts).strip(" ()")
    return f"{unit} at the time" if criterion.aggregate in ("time-mean", "max") else f"{unit} a second"


def _step(values: FloatArray) -> float:
    """The step of which the largest of some values (N,) has as many as there are."""
    largest = float(np.abs(values).max(initial=0.0))
    return largest / STEPS if largest > 0.0 else 1.0
