"""Evaluation of further criteria: as reported columns of a front, or as a trace along one trajectory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import shown
from hpop.criteria.base import Criterion, CriterionSpec, check_usable, describe_criterion, make_criterion
from hpop.criteria.costs import motion_costs, running_costs, running_values, trajectory_costs
from hpop.errors import CriterionError, QueryError
from hpop.frontier.points import each_claim
from hpop.frontier.strict_json import plain
from hpop.motions import Motions, States, laws_of
from hpop.planners.objectives import edge_objectives
from hpop.problems.front import Front, question_of
from hpop.trajectories.history import PiecesHistory, TrajectoryPieces
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world import World

ALSO = "also"  # key in a front's problem: criteria that were evaluated in addition to those of the problem
PIECE = 0.1  # s: approximate largest duration of a piece of a motion
AGREES = 0.02  # relative difference: if the costs of pieces add up to that of their motion within it, they are used


def evaluated(
    problem: Problem, front: Front, also: Sequence[CriterionSpec], say: Callable[[str], None] | None = None
) -> Front:
    """Return a front with the criteria in ``also`` as further reported columns; see :meth:`hpop.Problem.evaluate`.

    say  called from time to time with a sentence on the progress
    """
    _check_answers(problem, front)
    known = {criterion.name: criterion for criterion in criteria_of(front)} | claimable(problem)
    columns = front.names + front.reported_names
    wanted = requested(problem, also, [criterion for name, criterion in known.items() if name in columns])
    if not wanted:
        return front
    values = trajectory_costs(wanted, front.trajectories, problem.world, say=say)
    names = [criterion.name for criterion in wanted]
    said = f"{{}}; {', '.join(names)} evaluated on what was found, not optimised"
    asked = problem.describe() if front.problem is None else front.problem
    listed = [*asked.get(ALSO, []), *map(describe_criterion, wanted)]
    return replace(
        front,
        reported=np.hstack([front.reported, values]),
        reported_names=(*front.reported_names, *names),
        reported_units=(*front.reported_units, *(criterion.unit for criterion in wanted)),
        certificate=each_claim(front.certificate, said),
        problem={**asked, ALSO: listed},
    )


def requested(problem: Problem, also: Sequence[CriterionSpec], there: Sequence[Criterion]) -> list[Criterion]:
    """Return the criteria that a user requests in ``also``, without repetitions and those already in ``there``.

    Raises CriterionError if robot and world lack something that a criterion requires, or if two criteria have one name
    but different parameters.
    """
    if isinstance(also, str | Mapping) or not isinstance(also, Sequence):
        raise CriterionError(f"also must be a list of criteria such as ['sickness', 'rotation'], got {shown(also)}")
    known, wanted = {criterion.name: criterion for criterion in there}, list[Criterion]()
    for criterion in map(make_criterion, also):
        other = known.setdefault(criterion.name, criterion)
        if other is criterion:
            check_usable(criterion, problem.model, problem.world)
            wanted.append(criterion)
        elif plain(describe_criterion(criterion)) != plain(describe_criterion(other)):
            raise CriterionError(
                f"a criterion must occur once, but {criterion.name!r} already has a column with other parameters, "
                f"{shown(other)}, got {shown(criterion)}; leave one of them out"
            )
    return wanted


def criteria_of(front: Front) -> list[Criterion]:
    """Return the criteria that were evaluated on a front in addition to those of its problem."""
    listed = (front.problem or {}).get(ALSO, [])
    if not isinstance(listed, list):
        raise CriterionError(
            f"{ALSO} in the problem of a front must be a list of criteria, got {shown(listed)}; save the front again"
        )
    return [make_criterion(spec) for spec in listed]


def claimable(problem: Problem) -> dict[str, Criterion]:
    """Return, by name, the criteria that may have columns in a front of this problem.

    These are its criteria, and the sums that searches minimise in place of time-means.
    """
    additive = [c for c in problem.criteria if c.aggregate != "trajectory"]
    optimised = edge_objectives(additive, "front").optimised if additive else ()
    return {criterion.name: criterion for criterion in (*optimised, *problem.criteria)}


def _check_answers(problem: Problem, front: Front) -> None:
    """Raise QueryError if a front is the solution of a problem with another world, robot, criteria or quanta."""
    if front.problem is None:
        return
    asked, answered = question_of(plain(problem.describe())), question_of(front.problem)
    differing = [key for key in ("world", "model", "criteria", "quanta") if asked.get(key) != answered.get(key)]
    if differing:
        raise QueryError(
            f"the front must be one of this problem, but {', '.join(differing)} differ; evaluate it by its own "
            "problem, hpop.Problem.from_description(front.problem)"
        )


FEWEST, MOST = 100, 4000  # number of pieces of a trajectory; pieces of short and long ones differ from PIECE


@dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """Costs along a trajectory: where and when on the way each criterion arises, in n short pieces of its motions.

    pieces      n pieces of the trajectory's motions
    criteria    k criteria
    cost        (k,)    cost of the whole trajectory
    running     (n, k)  cost of the trajectory up to the end of each piece; at the end of a motion it is the cost of all
                        motions so far
    rate        (n, k)  for a sum: cost per second in the piece (0 if it has no duration); for a time-mean: mean over
                        the piece; for a max: worst value in the piece; for a criterion of the whole trajectory: change
                        of the running cost per second
    """

    pieces: TrajectoryPieces
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
        """Times (n+1,), s, at which the pieces begin, and at which the last piece ends."""
        return self.pieces.times

    @property
    def states(self) -> States:
        """States (n+1,) at those times."""
        return self.pieces.states

    def __repr__(self) -> str:
        costs = ", ".join(f"{c.name} {cost:.6g}" for c, cost in zip(self.criteria, self.cost.tolist(), strict=True))
        return f"<Trace: {costs} in {len(self.pieces):,} pieces of {self.pieces.trajectory!r}>"


def trace(criteria: Sequence[Criterion], trajectory: Trajectory, world: World) -> Trace:
    """Compute the costs along a trajectory as it is planned, piece by piece.

    Costs of pieces are scaled slightly so that they add up to the cost of their motion. Some criteria measure whole
    motions, so that costs of pieces do not add up. Then the cost of a motion is spread over its pieces in proportion to
    their durations, and a count is assigned to the last piece of the motion.
    """
    pieces = in_pieces(trajectory)
    cost = trajectory_costs(criteria, [trajectory], world)[0]
    columns = [
        _running_and_rate(criterion, value, pieces, world) for criterion, value in zip(criteria, cost, strict=True)
    ]
    shape = (len(pieces), len(columns))
    running = np.array([column[0] for column in columns]).T.reshape(shape)
    rate = np.array([column[1] for column in columns]).T.reshape(shape)
    return Trace(pieces, tuple(criteria), cost, running, rate)


def in_pieces(trajectory: Trajectory) -> TrajectoryPieces:
    """Cut the motions of a trajectory into short pieces, except for planned turns of the base.

    A planned turn includes waits before and after it, which stand for the slowing down and speeding up of the moves
    beside it. So the time at which a cost arises within a turn means little, and maps show each turn as one dot.
    """
    piece = max(min(PIECE, trajectory.duration / FEWEST), trajectory.duration / MOST) or 1.0
    counts = np.maximum(1, np.ceil(trajectory.durations / piece)).astype(np.int64)
    laws = laws_of(trajectory.model)
    uncut = [laws[kind].varies == {"yaw"} and _has_standstill(trajectory, i) for i, kind in enumerate(trajectory.kinds)]
    return TrajectoryPieces(trajectory, np.where(uncut, 1, counts))


def _has_standstill(trajectory: Trajectory, i: int) -> bool:
    """Return whether motion i of a trajectory has a phase in which the robot stands still."""
    ends = (trajectory.states.take(slice(j, j + 1)) for j in (i, i + 1))
    return any(phase.shape == "hold" for phase in laws_of(trajectory.model)[trajectory.kinds[i]].phases(*ends))


def _running_and_rate(
    criterion: Criterion, value: float, pieces: TrajectoryPieces, world: World
) -> tuple[FloatArray, FloatArray]:
    """Return a criterion's running cost (n,) and rate (n,) as in :class:`Trace`; ``value`` is its cost in all."""
    duration = pieces.durations
    if criterion.aggregate == "trajectory":
        running = _running_with_memory(criterion, value, pieces, world)
        return running, _ratio(np.diff(running, prepend=0.0), duration)
    costs = _piece_costs(criterion, pieces, world)
    if criterion.aggregate == "max":
        return np.maximum.accumulate(costs), costs
    if criterion.aggregate == "time-mean":
        return _ratio(np.cumsum(costs), np.cumsum(duration)), _ratio(costs, duration)
    return np.cumsum(costs), _ratio(costs, duration)


def _running_with_memory(criterion: Criterion, value: float, pieces: TrajectoryPieces, world: World) -> FloatArray:
    """Return the running cost (n,) of a criterion of whole trajectories at the end of each piece.

    If it does not end at ``value``, the cost of the whole trajectory, values at the ends of motions are interpolated.
    """
    running: FloatArray = running_values(criterion, PiecesHistory(world, pieces.trajectory, pieces))
    if np.isclose(running[-1:], value, rtol=1e-9, atol=1e-3 * criterion.quantum).all():
        return running
    whole = pieces.trajectory
    return np.asarray(np.interp(pieces.times[1:], whole.times, np.append(0.0, running_costs(criterion, whole, world))))


def _piece_costs(criterion: Criterion, pieces: TrajectoryPieces, world: World) -> FloatArray:
    """Return the costs (n,) of pieces; the sum (or maximum) over the pieces of a motion is the motion's cost.

    Each piece is first evaluated by itself. If the sum of these costs nearly agrees with the motion's cost, they are
    scaled to agree; else the motion's cost is spread over its pieces, as in :func:`trace`. Maxima are always scaled.
    """
    whole, owner = pieces.trajectory, pieces.owner
    costs = _costs_of_batches(criterion, pieces.batches(world), len(pieces))
    motions = _costs_of_batches(criterion, whole.batches(world), len(whole))
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


def _costs_of_batches(criterion: Criterion, batches: Iterator[tuple[IntArray, Motions]], count: int) -> FloatArray:
    """Return the costs (count,) of motions that come in batches with their indices."""
    costs = np.zeros(count)
    for place, motions in batches:
        costs[place] = motion_costs(criterion, motions)
    return costs


def _shares(pieces: TrajectoryPieces, *, counts: bool) -> FloatArray:
    """Return the share (n,) of its motion's cost that each piece gets: its share of the motion's duration.

    With ``counts``, for criteria that count, and for a motion without duration, the last piece gets all of it.
    """
    last = np.diff(pieces.owner, append=len(pieces.trajectory)) > 0
    lasts = pieces.trajectory.durations[pieces.owner]
    return np.where(last if counts else last & (lasts == 0), 1.0, 0.0 if counts else _ratio(pieces.durations, lasts))


def _ratio(total: FloatArray, duration: FloatArray) -> FloatArray:
    """Return total/duration, with 0 where the duration is 0."""
    return np.divide(total, duration, out=np.zeros_like(total), where=duration > 0)
