"""A trace: each criterion's rate and running value along one trajectory, so that one sees where comfort is lost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion, motion_costs, running_costs, running_values, trajectory_costs
from hpop.motions import Motions, States, laws_of
from hpop.trajectories.pieces import Pieces, PiecesHistory
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World

PIECE = 0.1  # s: motions are cut into pieces of at most about this duration,
FEWEST, MOST = 100, 4000  # and into more where the trajectory is short, and into fewer where it is long
AGREES = 0.02  # a criterion whose pieces add up to something else, as a share of its value, is traced motion by motion


@dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """Criteria along a trajectory, piece by piece.

    pieces      n, short ones of the motions of the trajectory
    criteria    k
    cost        (k,)    value on the whole trajectory
    running     (n, k)  value over everything up to the end of each piece: total, mean, worst, or value with memory;
                        where each motion ends, what its motions cost so far
    rate        (n, k)  sum: cost a second in the piece (of an instantaneous piece, 0); time-mean: mean over the piece;
                        max: worst in the piece; with memory: growth of the running value a second
    """

    pieces: Pieces
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
        return self.pieces.times

    @property
    def states(self) -> States:
        """States (n+1,) at those times: where on the map each piece is."""
        return self.pieces.states

    def __repr__(self) -> str:
        costs = ", ".join(f"{c.name} {cost:.6g}" for c, cost in zip(self.criteria, self.cost.tolist(), strict=True))
        return f"<Trace: {costs} in {len(self.pieces):,} pieces of {self.pieces.trajectory!r}>"


def trace(criteria: Sequence[Criterion], trajectory: Trajectory, world: World) -> Trace:
    """Trace criteria along a trajectory under the planning law.

    What the pieces of a motion cost is scaled, a little, to what the motion costs. Where a criterion says something of
    whole motions, so that pieces do not add up to it, its cost is spread over the pieces in proportion to their
    duration, and what it counts is counted where the motion ends.
    """
    pieces = in_pieces(trajectory)
    cost = trajectory_costs(criteria, [trajectory], world)[0]
    columns = [_along(criterion, value, pieces, world) for criterion, value in zip(criteria, cost, strict=True)]
    shape = (len(pieces), len(columns))
    running = np.array([column[0] for column in columns]).T.reshape(shape)
    rate = np.array([column[1] for column in columns]).T.reshape(shape)
    return Trace(pieces, tuple(criteria), cost, running, rate)


def in_pieces(trajectory: Trajectory) -> Pieces:
    """Motions cut into short pieces, as a finer lattice would have them; planned turns of the base stay whole.

    Those stand before they turn and after, for what stopping and starting costs the moves beside them: when something
    arises within one means little, and maps show each as one dot.
    """
    piece = max(min(PIECE, trajectory.duration / FEWEST), trajectory.duration / MOST) or 1.0
    counts = np.maximum(1, np.ceil(trajectory.durations / piece)).astype(np.int64)
    laws = laws_of(trajectory.model)
    whole = [laws[kind].varies == {"yaw"} and _stands(trajectory, i) for i, kind in enumerate(trajectory.kinds)]
    return Pieces(trajectory, np.where(whole, 1, counts))


def _stands(trajectory: Trajectory, i: int) -> bool:
    """Whether a motion stands for a while."""
    ends = (trajectory.states.take(slice(j, j + 1)) for j in (i, i + 1))
    return any(phase.shape == "hold" for phase in laws_of(trajectory.model)[trajectory.kinds[i]].phases(*ends))


def _along(criterion: Criterion, value: float, pieces: Pieces, world: World) -> tuple[FloatArray, FloatArray]:
    """Running value (n,) and rate (n,) of one criterion over the pieces."""
    duration = pieces.durations
    if criterion.aggregate == "trajectory":
        running = _remembered(criterion, value, pieces, world)
        return running, _ratio(np.diff(running, prepend=0.0), duration)
    costs = _piece_costs(criterion, pieces, world)
    if criterion.aggregate == "max":
        return np.maximum.accumulate(costs), costs
    if criterion.aggregate == "time-mean":
        return _ratio(np.cumsum(costs), np.cumsum(duration)), _ratio(costs, duration)
    return np.cumsum(costs), _ratio(costs, duration)


def _remembered(criterion: Criterion, value: float, pieces: Pieces, world: World) -> FloatArray:
    """Running values (n,) of a criterion with memory; evenly between motions' ends, if it does not agree on pieces."""
    running: FloatArray = running_values(criterion, PiecesHistory(world, pieces.trajectory, pieces))
    if np.isclose(running[-1:], value, rtol=1e-9, atol=1e-3 * criterion.quantum).all():
        return running
    whole = pieces.trajectory
    return np.asarray(np.interp(pieces.times[1:], whole.times, np.append(0.0, running_costs(criterion, whole, world))))


def _piece_costs(criterion: Criterion, pieces: Pieces, world: World) -> FloatArray:
    """Costs (n,) of pieces that add up to those of the motions, or the worst of which is theirs."""
    whole, owner = pieces.trajectory, pieces.owner
    costs = _each(criterion, pieces.batches(world), len(pieces))
    motions = _each(criterion, whole.batches(world), len(whole))
    found = np.zeros(len(whole))
    if criterion.aggregate == "max":
        np.maximum.at(found, owner, costs)
        agrees, share = np.ones(len(whole), dtype=bool), np.ones(len(pieces))
    else:
        np.add.at(found, owner, costs)
        lasts = whole.duration if criterion.aggregate == "time-mean" else 1.0
        least = 0.5 * criterion.quantum * lasts
        agrees = np.isclose(found, motions, AGREES, least) | np.isclose(found.sum(), motions.sum(), AGREES, least)
        share = _shares(pieces, counts=criterion.unit == "1" and criterion.quantum == 1.0)
    scaled = _ratio(motions, found)[owner] * costs
    return np.where((agrees & (found > 0))[owner], scaled, motions[owner] * share)


def _each(criterion: Criterion, batches: Iterator[tuple[IntArray, Motions]], count: int) -> FloatArray:
    costs = np.zeros(count)
    for place, motions in batches:
        costs[place] = motion_costs(criterion, motions)
    return costs


def _shares(pieces: Pieces, *, counts: bool) -> FloatArray:
    """Share (n,) of each piece in its motion: of its duration, or all that is counted in the last."""
    last = np.diff(pieces.owner, append=len(pieces.trajectory)) > 0
    lasts = pieces.trajectory.durations[pieces.owner]
    return np.where(last if counts else last & (lasts == 0), 1.0, 0.0 if counts else _ratio(pieces.durations, lasts))


def _ratio(total: FloatArray, duration: FloatArray) -> FloatArray:
    return np.divide(total, duration, out=np.zeros_like(total), where=duration > 0)
