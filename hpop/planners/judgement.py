"""Judgement of what a continuous solver returns: re-evaluated, exact ends, free of collisions between all samples.

A nonlinear program knows fields, samples and smoothed corners; what it calls feasible need not be. So every candidate
is judged on its trajectory alone: by the criteria as fronts report them, and on the exact geometry.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.goals import GoalSet
from hpop.motions import States, free_along, is_curve
from hpop.planners.base import Candidates
from hpop.runtime.status import Status
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

EPSILON_TOLERANCE = 1e-3  # relative: a re-evaluated cost may exceed its bound by this, or by half a quantum


@dataclass(frozen=True, eq=False)
class Judgement:
    """What was found wrong with each candidate.

    costs    (n, k) re-evaluated; NaN where the trajectory does not even lie on the map
    reasons  n, "" for those to be trusted
    """

    costs: FloatArray
    reasons: tuple[str, ...]

    @property
    def kept(self) -> IntArray:
        """Places of the candidates to be trusted."""
        return np.flatnonzero([not reason for reason in self.reasons])

    @property
    def dropped(self) -> dict[str, int]:
        """How many were dropped, by reason."""
        return dict(Counter(reason for reason in self.reasons if reason))

    def notes(self, planner: str) -> tuple[str, ...]:
        """One line that says how many were dropped and why; none if all are kept."""
        if not self.dropped:
            return ()
        why = ", ".join(f"{reason} ({count})" for reason, count in sorted(self.dropped.items()))
        return (f"{planner}: {len(self.reasons) - self.kept.size} of {len(self.reasons)} candidates dropped: {why}",)


@checked_arguments
def judge(
    problem: Problem,
    objectives: Sequence[Criterion],
    trajectories: Sequence[Trajectory],
    *,
    epsilon: FloatArray | None = None,
    planned: FloatArray | None = None,
    tolerance: FloatArray | None = None,
) -> Judgement:
    """Re-evaluate candidates and name what is wrong with each, the gravest first.

    Collisions are looked for on the geometry that the model plans by, which is never too kind.

    Parameters
    ----------
    epsilon : (n, k) bounds that the costs had to keep, within EPSILON_TOLERANCE or half a quantum; inf bounds nothing
    planned, tolerance : (n, k) costs as the planner added them up, and by how much they may be off
    """
    count = len(trajectories)
    costs = np.full((count, len(objectives)), np.nan)
    if not count:
        return Judgement(costs, ())
    table = MotionTable.of(trajectories)
    reasons = _faults_of_ends(problem, table)
    usable = [i for i in range(count) if not reasons[i]]
    costs[usable] = trajectory_costs(
        objectives,
        [trajectories[i] for i in usable],
        problem.world,
        table=table if len(usable) == count > 1 else None,
    )
    free = _free(problem, table, trajectories, usable)
    for i in usable:
        if not free[i]:
            reasons[i] = "collides"
        elif epsilon is not None and exceeds(costs[i], epsilon[i], objectives).any():
            names = [
                c.name for c, over in zip(objectives, exceeds(costs[i], epsilon[i], objectives), strict=True) if over
            ]
            reasons[i] = f"exceeds its bound in {', '.join(names)}"
        elif planned is not None and tolerance is not None:
            off = ~(np.abs(costs[i] - planned[i]) <= tolerance[i] + 1e-9 * np.abs(costs[i]))
            if off.any():
                names = [c.name for c, wrong in zip(objectives, off, strict=True) if wrong]
                reasons[i] = f"was planned with too coarse a sum in {', '.join(names)}"
    return Judgement(costs, tuple(reasons))


def trusted(
    candidates: Candidates,
    problem: Problem,
    planner: str,
    *,
    epsilon: FloatArray | None = None,
) -> Candidates:
    """Those candidates of a planner that are to be trusted; a note and the stats say what was dropped, and why.

    Ctrl-C while they are judged is told by the status: what was found is worth the time. A second one is obeyed.

    Parameters
    ----------
    epsilon : (n, k) bounds that the costs had to keep, as for :func:`judge`
    """
    asked = {"epsilon": epsilon, "planned": candidates.planned, "tolerance": candidates.tolerance}
    try:
        judged = judge(problem, candidates.objectives, candidates.trajectories, **asked)
    except KeyboardInterrupt:
        candidates = replace(candidates, status=Status.INTERRUPTED)
        judged = judge(problem, candidates.objectives, candidates.trajectories, **asked)
    return replace(
        candidates.some(judged.kept),
        notes=(*candidates.notes, *judged.notes(planner)),
        stats={**candidates.stats, "dropped": judged.dropped},
    )


def accepted(epsilon: FloatArray, objectives: Sequence[Criterion]) -> FloatArray:
    """The most (k,) that costs with bounds may be: the tolerance and half a quantum above them."""
    quanta = np.array([0.5 * criterion.quantum for criterion in objectives])
    return np.asarray(epsilon + np.maximum(EPSILON_TOLERANCE * np.abs(epsilon), quanta))


def exceeds(costs: FloatArray, epsilon: FloatArray, objectives: Sequence[Criterion]) -> BoolArray:
    """Whether each cost (k,) is above its bound by more than the tolerance and half a quantum."""
    return np.asarray(costs > accepted(epsilon, objectives))


def is_free(problem: Problem, trajectory: Trajectory) -> bool:
    """Whether a trajectory is free of collisions all along, on the exact geometry."""
    collision = problem.model.collision(problem.world)
    if not len(trajectory):
        return bool(collision.states_free(trajectory.states).all())
    return all(bool(free_along(collision, motions).all()) for _, motions in trajectory.batches(problem.world))


def are_free(problem: Problem, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Return whether each trajectory (n,) is free of collisions all along, on the exact geometry."""
    if not len(trajectories):
        return np.zeros(0, dtype=bool)
    return _free(problem, MotionTable.of(trajectories), trajectories, range(len(trajectories)))


def _faults_of_ends(problem: Problem, table: MotionTable) -> list[str]:
    """Return where each trajectory of a table leaves the map or misses an end, in words, or ""."""
    model = problem.model
    reasons = [""] * table.counts.size
    first, last = table.states.take(table.first), table.states.take(table.last)
    for fault, wrong in (
        ("misses the goal", ~problem.target.reached(model, last)),
        ("misses the start", ~GoalSet((problem.start,)).reached(model, first)),
        ("leaves the map", table.through(~on_map(problem, table.states))),
    ):
        for i in np.flatnonzero(wrong):
            reasons[i] = fault
    return reasons


def _free(problem: Problem, table: MotionTable, trajectories: Sequence[Trajectory], asked: Sequence[int]) -> BoolArray:
    """Return whether each trajectory of a table is free; only those asked for are looked at one by one.

    A motion that several trajectories share is checked once. Curves depend on their neighbours, and so are checked with
    their trajectory, as is one that goes nowhere.
    """
    collision = problem.model.collision(problem.world)
    colliding = np.zeros(len(table), dtype=bool)
    alone = table.having(table.curved) | (table.counts == 0)
    if not alone.all():
        for index, motions in table.batches(problem.world):
            if not is_curve(motions.law):
                colliding[index] = ~free_along(collision, motions)
    free: BoolArray = ~table.having(colliding)
    for i in asked:
        if alone[i]:
            free[i] = is_free(problem, trajectories[i])
    return free


def on_map(problem: Problem, states: States) -> BoolArray:
    """Whether the base (M,) is within the bounds of the world, if there is a base."""
    if "base" not in problem.model.provides:
        return np.ones(states.size, dtype=bool)
    base, (x_min, y_min, x_max, y_max) = problem.model.pose("base", states), problem.world.bounds
    return np.asarray((base.x >= x_min) & (base.x <= x_max) & (base.y >= y_min) & (base.y <= y_max))


# To make and evaluate a trajectory takes a tenth of a millisecond, or several where criteria have memory, and a search
# may find a hundred thousand. So a few points are evaluated first: they make the fields, and tell what a point takes.


SHARES = (16, 4)  # of all points, one of so many, in the first sample and in the second
MARGIN = 1.2  # what all points may take, beyond what the samples tell
FEW, FEW_WITH_MEMORY = 60, 6  # points that are evaluated in any case, without memory and where criteria have memory


def evaluable_in_time(
    candidates: Candidates,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float] = perf_counter,
) -> Candidates:
    """Return the candidates that can be evaluated in the seconds left, spread over all, with a note on the others.

    The best point in each cost is always among them, and a few are returned where no time is left. Without a limit, and
    after Ctrl-C, all are returned.

    Parameters
    ----------
    left : seconds until the limit, None without one
    evaluate : what takes the time, for some of the candidates
    clock : s, that the evaluation is timed by
    """
    few = FEW_WITH_MEMORY if any(c.aggregate == "trajectory" for c in candidates.filters) else FEW
    if left() is None or len(candidates.trajectories) <= few:
        return candidates
    try:
        number = _number(candidates, few, left, evaluate, clock)
    except KeyboardInterrupt:
        return replace(candidates, status=Status.INTERRUPTED)
    if number >= len(candidates.trajectories):
        return candidates
    some, count = candidates.spread(number), len(candidates.trajectories)
    only = f"{len(some.trajectories):,} of the {count:,} points found could be evaluated before the time limit"
    return replace(
        some,
        status=Status.TIME_LIMIT if some.status.is_final else some.status,
        certificate=f"{some.certificate}; only {only}, and the others are left out",
        notes=(*some.notes, f"only {only}; they are spread over all points found. Raise time_limit to have the others"),
    )


def _number(
    candidates: Candidates,
    few: int,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float],
) -> int:
    """Return how many points can be evaluated in the seconds left, judging by some of them."""
    count = len(candidates.trajectories)
    evaluate(candidates.spread(1))  # makes fields, which take their time once
    size, took = 0, 0.0
    for share in SHARES:
        more = min(count, max(few, count // share))
        if more <= size or (took / max(1, size)) * more > (left() or 0.0) / 2:
            break
        began = clock()
        evaluate(candidates.spread(more))
        now = clock() - began
        each = MARGIN * max(0.0, now - took) / (more - size)
        size, took = more, now
        remaining = (left() or 0.0) - MARGIN * took
        if remaining >= each * (count - size):
            return count
    else:
        return max(few, min(count, size + int(remaining / each) if each else count))
    if not size or (left() or 0.0) <= 0.0:
        return few
    return max(few, min(count, int((left() or 0.0) * size / (MARGIN * took))))
