"""What arises along some trajectories of a front, as the explorer's traces have it: as many as there is room for.

The rows with a name come first, then others evenly over the front. Of a long trajectory neighbouring pieces are taken
together: sums and means stay what they are, the worst moment stays the worst.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.problems.evaluation import Trace, claimable, criteria_of, trace
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.view.explorer.corners import Packer, millimetres
from hpop.view.style import label

MOST_PIECES = 160  # of a trajectory: a screen tells hardly more apart
STEPS = 2**14 - 1  # that the largest value of a criterion is told in, so that differences have 16 bits
ADDS: dict[str, str] = {"time-mean": "mean", "max": "max"}  # what else adds up, with memory or without, is a sum
TRACES, ONE_IN, MOST = 10, 400, 30  # rows that are traced: so many, one in so many more, and so many at most
TICKS = 2**22  # that a duration is told in: rates of pieces of milliseconds are right, and differences have few bytes
THOUSANDTHS = 1000.0  # rad


def traced_rows(front: Front, named: Sequence[int]) -> list[int]:
    """Return rows to trace: those with a name, then others evenly over the front."""
    rows = list(dict.fromkeys(named))
    others = max(0, min(TRACES + len(front) // ONE_IN, MOST, len(front)) - len(rows))
    middles = (np.arange(others) + 0.5) * len(front) / max(1, others)
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
    """Return the packed rates along the trajectories of some rows; none for a trajectory that stays."""
    criteria = [criterion for criterion in columns if criterion is not None]
    for row in rows:
        if len(front.trajectories[row]):
            yield {"row": row, **_packed(trace(criteria, front.trajectories[row], problem.world), packer, origin)}


def _packed(found: Trace, packer: Packer, origin: tuple[float, float]) -> dict[str, Any]:
    ends = told_ends(len(found.pieces), MOST_PIECES)
    pose = found.pieces.trajectory.model.pose("camera", found.states)
    x, y, yaw = (np.broadcast_to(column, found.times.shape)[ends] for column in (pose.x, pose.y, pose.yaw))
    places = millimetres(np.stack([x, y], axis=1), origin)
    tick = float(found.times[-1]) / TICKS or 1.0  # s
    several = [_along(found, column, ends) for column in range(len(found.criteria))]
    return {
        "tick": tick,
        "t": packer.integers(np.rint(found.times[ends] / tick), order=1),
        "x": packer.integers(places[:, 0], order=2),
        "y": packer.integers(places[:, 1], order=2),
        "yaw": packer.integers(np.rint(np.unwrap(yaw) * THOUSANDTHS), order=1),
        "steps": [step for step, _ in several],
        "values": packer.short(np.concatenate([np.zeros(0), *(values for _, values in several)])),
    }


def told_ends(pieces: int, most: int) -> IntArray:
    """Return which of the ends (n+1,) of pieces are told: all, or so many evenly."""
    return np.unique(np.linspace(0, pieces, min(pieces, most) + 1).round().astype(np.int64))


def taken_together(found: Trace, column: int, ends: IntArray) -> FloatArray:
    """The rate of a criterion in pieces taken together between some ends (m+1,): the worst of a maximum, else the mean.

    Returns (m,).
    """
    rate, lasts = found.rate[:, column], found.pieces.durations
    if found.criteria[column].aggregate == "max":
        return np.asarray(np.maximum.reduceat(rate, ends[:-1]))
    total, time = np.add.reduceat(rate * lasts, ends[:-1]), np.add.reduceat(lasts, ends[:-1])
    return np.asarray(np.divide(total, time, out=np.zeros_like(total), where=time > 0))


def _along(found: Trace, column: int, ends: IntArray) -> tuple[float, FloatArray]:
    """Return a criterion in pieces between ends (m+1,), as whole numbers (m,) of a step.

    Of a sum, and with memory, by how much it grows in each; of a mean and a worst moment what it is in each.
    """
    if found.criteria[column].aggregate not in ADDS:
        reached = np.concatenate([[0.0], found.running[:, column]])[ends]
        step = _step(reached)
        return step, np.diff(np.rint(reached / step))
    joined = taken_together(found, column, ends)
    step = _step(joined)
    return step, np.rint(joined / step)


def words(criterion: Criterion) -> str:
    """Return the name of a rate: cost a second, or the value at the time.

    >>> from hpop.criteria import Clearance, Length, Turns
    >>> words(Length()), words(Turns()), words(Clearance())
    ('m a second', 'count a second', 'm at the time')
    """
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    unit = label("", criterion.unit, counts).strip(" ()")
    return f"{unit} at the time" if criterion.aggregate in ("time-mean", "max") else f"{unit} a second"


def _step(values: FloatArray) -> float:
    """Return the step of which the largest of some values (N,) has as many as there are."""
    largest = float(np.abs(values).max(initial=0.0))
    return largest / STEPS if largest > 0.0 else 1.0
