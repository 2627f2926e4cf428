"""A trace: each criterion's rate and running value along one trajectory, so that one sees where comfort is lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.arrays import FloatArray
from hpop.criteria.base import Criterion, motion_costs, running_costs, trajectory_costs
from hpop.motions import States
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World

PIECE = 0.1  # s: motions at constant speed, and curves, are cut into pieces of about this duration
MOST_PIECES = 4000
AGREES = 0.02  # a criterion whose pieces add up to something else, as a share of its value, is traced motion by motion


@dataclass(frozen=True, eq=False)
class Trace:
    """Criteria along a trajectory, piece by piece.

    trajectory  cut into pieces: short motions at constant speed or along curves, and whole turns
    criteria    k
    cost        (k,)    value on the whole trajectory
    running     (n, k)  value over everything up to the end of each piece: total, mean, worst, or value with memory
    rate        (n, k)  sum: cost a second in the piece (of an instantaneous piece, 0); time-mean: mean over the piece;
                        max: worst in the piece; with memory: growth of the running value a second
    """

    trajectory: Trajectory
    criteria: tuple[Criterion, ...]
    cost: FloatArray
    running: FloatArray
    rate: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the criteria, in the order of the columns."""
        return tuple(criterion.name for criterion in self.criteria)

    @property
    def times(self) -> FloatArray:
        """Times (n+1,), s, at which the pieces begin, and the end of the last."""
        return self.trajectory.times

    @property
    def states(self) -> States:
        """States (n+1,) at those times: where on the map each piece is."""
        return self.trajectory.states


def trace(criteria: Sequence[Criterion], trajectory: Trajectory, world: World) -> Trace:
    """Trace criteria along a trajectory under the planning law.

    Where a criterion counts motions, so that pieces of a motion would not add up to it, its cost is spread over the
    pieces of the motion in proportion to their duration.
    """
    fine = in_pieces(trajectory)
    cost = trajectory_costs(criteria, [trajectory], world)[0]
    columns = [
        _along(criterion, value, fine, trajectory, world) for criterion, value in zip(criteria, cost, strict=True)
    ]
    shape = (len(fine), len(columns))
    running = np.array([column[0] for column in columns]).T.reshape(shape)
    rate = np.array([column[1] for column in columns]).T.reshape(shape)
    return Trace(fine, tuple(criteria), cost, running, rate)


def in_pieces(trajectory: Trajectory) -> Trajectory:
    """Cut motions at constant speed and curves into short ones, as a finer lattice would have them."""
    if not len(trajectory):
        return trajectory
    steady = np.zeros(len(trajectory), dtype=bool)
    for i, kind in enumerate(trajectory.kinds):
        ends = trajectory.states.take(slice(i, i + 1)), trajectory.states.take(slice(i + 1, i + 2))
        shapes = [phase.shape for phase in trajectory.model.laws[kind].phases(*ends)]
        steady[i] = shapes in (["cruise"], ["drive"])
    piece = max(PIECE, trajectory.duration / MOST_PIECES)
    pieces = np.where(steady, np.maximum(1, np.ceil(trajectory.durations / piece)), 1).astype(int)
    return trajectory.cut(pieces)


def _along(
    criterion: Criterion, value: float, fine: Trajectory, whole: Trajectory, world: World
) -> tuple[FloatArray, FloatArray]:
    """Running value (n,) and rate (n,) of one criterion over the pieces."""
    duration = fine.durations
    if criterion.aggregate == "trajectory":
        running = np.interp(fine.times[1:], whole.times, np.append(0.0, running_costs(criterion, whole, world)))
        return running, _ratio(np.diff(running, prepend=0.0), duration)
    costs = _motion_by_motion(criterion, fine, world)
    if criterion.aggregate == "max":
        return np.maximum.accumulate(costs), costs
    total = costs.sum() / (duration.sum() or 1.0) if criterion.aggregate == "time-mean" else costs.sum()
    if not np.isclose(total, value, rtol=AGREES, atol=0.5 * criterion.quantum):
        owner = np.searchsorted(whole.times[1:-1], 0.5 * (fine.times[1:] + fine.times[:-1]), side="right")
        costs = _motion_by_motion(criterion, whole, world)[owner] * _ratio(duration, whole.durations[owner])
    if criterion.aggregate == "time-mean":
        return _ratio(np.cumsum(costs), np.cumsum(duration)), _ratio(costs, duration)
    return np.cumsum(costs), _ratio(costs, duration)


def _motion_by_motion(criterion: Criterion, trajectory: Trajectory, world: World) -> FloatArray:
    costs = np.zeros(len(trajectory))
    for place, motions in trajectory.batches(world):
        costs[place] = motion_costs(criterion, motions)
    return costs


def _ratio(total: FloatArray, duration: FloatArray) -> FloatArray:
    return np.divide(total, duration, out=np.zeros_like(total), where=duration > 0)
