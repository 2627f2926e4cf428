"""Charts of the explorer page: the rate at which each criterion grows along some trajectories of a front.

Named rows (such as the knee) come first, then others evenly over the front, up to a limit. Pieces are the short
stretches of motions for which :class:`hpop.problems.evaluation.Trace` has rates. Neighbouring pieces of a long
trajectory are merged so that sums, means and worst moments are kept.
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

MOST_PIECES = 160  # of a trajectory, as many as a screen resolves
STEPS = 2**14 - 1  # resolution of a criterion's largest value, so that differences have 16 bits
ADDS: dict[str, str] = {"time-mean": "mean", "max": "max"}  # all others are sums
TRACES, ONE_IN, MOST = 10, 400, 30  # rows to trace: least number, one per so many rows, most
TICKS = 2**22  # resolution of a duration: exact for pieces of milliseconds, and small differences
THOUSANDTHS = 1000.0  # rad


def traced_rows(front: Front, named: Sequence[int]) -> list[int]:
    """Return the rows that get a chart of rates: the named rows, then others evenly over the front."""
    rows = list(dict.fromkeys(named))
    others = max(0, min(TRACES + len(front) // ONE_IN, MOST, len(front)) - len(rows))
    middles = (np.arange(others) + 0.5) * len(front) / max(1, others)
    return [*rows, *(row for row in dict.fromkeys(middles.astype(int).tolist()) if row not in rows)]


def columns_of(problem: Problem, front: Front) -> list[Criterion | None]:
    """Return the criterion of each column of a front, reported ones included; None if it is no longer registered."""
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
    """Yield a dict for JSON for each of the front's ``rows``: times, camera poses, and rates of the criteria.

    Its columns of numbers are added to ``packer``; positions count from ``origin``, m. Rows without motion are skipped.
    """
    criteria = [criterion for criterion in columns if criterion is not None]
    for row in rows:
        if len(front.trajectories[row]):
            yield {"row": row, **_packed_trace(trace(criteria, front.trajectories[row], problem.world), packer, origin)}


def _packed_trace(found: Trace, packer: Packer, origin: tuple[float, float]) -> dict[str, Any]:
    """Return the times, camera positions and headings, and values of the criteria along one trajectory, for JSON."""
    ends = piece_ends(len(found.pieces), MOST_PIECES)
    pose = found.pieces.trajectory.model.pose("camera", found.states)
    x, y, yaw = (np.broadcast_to(column, found.times.shape)[ends] for column in (pose.x, pose.y, pose.yaw))
    places = millimetres(np.stack([x, y], axis=1), origin)
    tick = float(found.times[-1]) / TICKS or 1.0  # s
    several = [_quantised_values(found, column, ends) for column in range(len(found.criteria))]
    return {
        "tick": tick,
        "t": packer.integers(np.rint(found.times[ends] / tick), order=1),
        "x": packer.integers(places[:, 0], order=2),
        "y": packer.integers(places[:, 1], order=2),
        "yaw": packer.integers(np.rint(np.unwrap(yaw) * THOUSANDTHS), order=1),
        "steps": [step for step, _ in several],
        "values": packer.short(np.concatenate([np.zeros(0), *(values for _, values in several)])),
    }


def piece_ends(pieces: int, most: int) -> IntArray:
    """Return the indices (n+1,) at which groups of consecutive pieces begin and end.

    The number of groups is the smaller of ``pieces``, the number of pieces, and ``most``; their sizes are about equal.
    """
    return np.unique(np.linspace(0, pieces, min(pieces, most) + 1).round().astype(np.int64))


def merged_rates(found: Trace, column: int, ends: IntArray) -> FloatArray:
    """Return the rate (m,) of a criterion in each group of consecutive pieces, between indices ``ends`` (m+1,).

    It is the greatest rate for a criterion that is a maximum, else the mean over time.
    """
    rate, lasts = found.rate[:, column], found.pieces.durations
    if found.criteria[column].aggregate == "max":
        return np.asarray(np.maximum.reduceat(rate, ends[:-1]))
    total, time = np.add.reduceat(rate * lasts, ends[:-1]), np.add.reduceat(lasts, ends[:-1])
    return np.asarray(np.divide(total, time, out=np.zeros_like(total), where=time > 0))


def _quantised_values(found: Trace, column: int, ends: IntArray) -> tuple[float, FloatArray]:
    """Round a criterion's values in merged pieces to multiples of a step; return the step and the multiples (m,).

    The merged pieces lie between the indices ``ends`` (m+1,) of the trace's times. Sums, and criteria of the whole
    trajectory, are given as their growth in each merged piece; means and maxima as their value there.
    """
    if found.criteria[column].aggregate not in ADDS:
        reached = np.concatenate([[0.0], found.running[:, column]])[ends]
        step = _step(reached)
        return step, np.diff(np.rint(reached / step))
    joined = merged_rates(found, column, ends)
    step = _step(joined)
    return step, np.rint(joined / step)


def words(criterion: Criterion) -> str:
    """Return the label of a criterion's rate: cost per second, or the value at the time.

    >>> from hpop.criteria import Clearance, Length, Turns
    >>> words(Length()), words(Turns()), words(Clearance())
    ('m a second', 'count a second', 'm at the time')
    """
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    unit = label("", criterion.unit, counts, criterion.quantity).strip(" ()")
    return f"{unit} at the time" if criterion.aggregate in ("time-mean", "max") else f"{unit} a second"


def _step(values: FloatArray) -> float:
    """Return the step size for rounding values (N,), such that the largest of them is `STEPS` steps."""
    largest = float(np.abs(values).max(initial=0.0))
    return largest / STEPS if largest > 0.0 else 1.0
