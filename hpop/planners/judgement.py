"""Checks of the trajectories of a continuous solver: costs re-evaluated, ends exact, no collision between samples.

A nonlinear program sees fields, samples and smoothed corners, so its feasible solutions need not be feasible. Every
candidate is therefore judged by its trajectory alone: by the criteria that fronts report, on the exact geometry.
"""

from __future__ import annotations

import warnings
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
    """Result of judging n candidates.

    costs    (n, k) re-evaluated costs; NaN for trajectories that miss an end or leave the map
    reasons  for each candidate the reason of its rejection; "" if it is accepted
    """

    costs: FloatArray
    reasons: tuple[str, ...]

    @property
    def accepted_rows(self) -> IntArray:
        """Indices of the accepted candidates."""
        return np.flatnonzero([not reason for reason in self.reasons])

    @property
    def kept(self) -> IntArray:
        """Indices of the accepted candidates. Deprecated: :attr:`accepted_rows`."""
        warnings.warn("Judgement.kept is Judgement.accepted_rows now", DeprecationWarning, stacklevel=2)
        return self.accepted_rows

    @property
    def rejection_counts(self) -> dict[str, int]:
        """Numbers of rejected candidates, by reason."""
        return dict(Counter(reason for reason in self.reasons if reason))

    def notes(self, planner: str) -> tuple[str, ...]:
        """Return one note with the number of rejected candidates and the reasons, or () if all are accepted."""
        if not self.rejection_counts:
            return ()
        why = ", ".join(f"{reason} ({count})" for reason, count in sorted(self.rejection_counts.items()))
        rejected = len(self.reasons) - self.accepted_rows.size
        return (f"{planner}: {rejected} of {len(self.reasons)} candidates dropped: {why}",)


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
    """Re-evaluate candidates and reject those with a fault; the gravest fault of each is reported.

    Collisions are checked on the model's planning geometry, which never misses one.

    Parameters
    ----------
    epsilon : (n, k) bounds that the costs had to keep, within EPSILON_TOLERANCE or half a quantum; inf bounds nothing
    planned, tolerance : (n, k) costs as the planner added them up, and their tolerance
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
    free = _free_trajectories(problem, table, trajectories, usable)
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
    """Return the accepted candidates of a planner; a note and the stats give the rejected ones and the reasons.

    After a Ctrl-C here, judging begins again and the status becomes INTERRUPTED; a second Ctrl-C is raised.

    Parameters
    ----------
    epsilon : (n, k) bounds that the costs had to keep, as for :func:`judge`
    """
    limits = {"epsilon": epsilon, "planned": candidates.planned, "tolerance": candidates.tolerance}
    try:
        judged = judge(problem, candidates.objectives, candidates.trajectories, **limits)
    except KeyboardInterrupt:
        candidates = replace(candidates, status=Status.INTERRUPTED)
        judged = judge(problem, candidates.objectives, candidates.trajectories, **limits)
    return replace(
        candidates.subset(judged.accepted_rows),
        notes=(*candidates.notes, *judged.notes(planner)),
        stats={**candidates.stats, "dropped": judged.rejection_counts},
    )


def accepted(epsilon: FloatArray, objectives: Sequence[Criterion]) -> FloatArray:
    """Return the largest accepted costs (k,) for bounds ``epsilon`` (k,): a tolerance or half a quantum more."""
    quanta = np.array([0.5 * criterion.quantum for criterion in objectives])
    return np.asarray(epsilon + np.maximum(EPSILON_TOLERANCE * np.abs(epsilon), quanta))


def exceeds(costs: FloatArray, epsilon: FloatArray, objectives: Sequence[Criterion]) -> BoolArray:
    """Return whether each cost (k,) exceeds its bound by more than the tolerance and half a quantum."""
    return np.asarray(costs > accepted(epsilon, objectives))


def is_free(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether a trajectory is free of collisions throughout, on the exact geometry."""
    collision = problem.model.collision(problem.world)
    if not len(trajectory):
        return bool(collision.states_free(trajectory.states).all())
    return all(bool(free_along(collision, motions).all()) for _, motions in trajectory.batches(problem.world))


def are_free(problem: Problem, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Return whether each trajectory (n,) is free of collisions throughout, on the exact geometry."""
    if not len(trajectories):
        return np.zeros(0, dtype=bool)
    return _free_trajectories(problem, MotionTable.of(trajectories), trajectories, range(len(trajectories)))


def _faults_of_ends(problem: Problem, table: MotionTable) -> list[str]:
    """Return the fault of each trajectory that misses an end or leaves the map; "" for the others."""
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


def _free_trajectories(
    problem: Problem, table: MotionTable, trajectories: Sequence[Trajectory], selected: Sequence[int]
) -> BoolArray:
    """Return whether each trajectory of a table is free, (n,).

    A motion that several trajectories share is checked once. Curves depend on their neighbours, so trajectories with
    curves, and those without motions, are checked one by one, and only if ``selected`` lists them.
    """
    collision = problem.model.collision(problem.world)
    colliding = np.zeros(len(table), dtype=bool)
    alone = table.having(table.curved) | (table.counts == 0)
    if not alone.all():
        for index, motions in table.batches(problem.world):
            if not is_curve(motions.law):
                colliding[index] = ~free_along(collision, motions)
    free: BoolArray = ~table.having(colliding)
    for i in selected:
        if alone[i]:
            free[i] = is_free(problem, trajectories[i])
    return free


def on_map(problem: Problem, states: States) -> BoolArray:
    """Return whether the base is within the bounds of the world in each state (M,); True for a robot without a base."""
    if "base" not in problem.model.provides:
        return np.ones(states.size, dtype=bool)
    base, (x_min, y_min, x_max, y_max) = problem.model.pose("base", states), problem.world.bounds
    return np.asarray((base.x >= x_min) & (base.x <= x_max) & (base.y >= y_min) & (base.y <= y_max))


# A search may find a hundred thousand trajectories, and building and evaluating one takes up to some milliseconds. So
# a sample is evaluated first: it computes the fields and measures the time per point.


SHARES = (16, 4)  # the first sample has one of 16 points, the second one of 4
MARGIN = 1.2  # factor on the time per point that the samples measure
FEW, FEW_WITH_MEMORY = 60, 6  # points that are always evaluated; the second if criteria have memory


def evaluable_in_time(
    candidates: Candidates,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float] = perf_counter,
) -> Candidates:
    """Return as many candidates, spread over the front, as can be evaluated in the remaining time; note the omission.

    The best candidate of each cost is always returned, and a few candidates even if no time remains. Without a limit,
    and after Ctrl-C, all candidates are returned.

    Parameters
    ----------
    left : returns the seconds until the limit, None without one
    evaluate : the evaluation of candidates, which is timed
    clock : s, times the evaluation
    """
    few = FEW_WITH_MEMORY if any(c.aggregate == "trajectory" for c in candidates.filters) else FEW
    if left() is None or len(candidates.trajectories) <= few:
        return candidates
    try:
        number = _affordable_number(candidates, few, left, evaluate, clock)
    except KeyboardInterrupt:
        return replace(candidates, status=Status.INTERRUPTED)
    if number >= len(candidates.trajectories):
        return candidates
    spread, count = candidates.spread(number), len(candidates.trajectories)
    only = f"{len(spread.trajectories):,} of the {count:,} points found could be evaluated before the time limit"
    return replace(
        spread,
        status=Status.TIME_LIMIT if spread.status.is_final else spread.status,
        certificate=f"{spread.certificate}; only {only}, and the others are left out",
        notes=(
            *spread.notes,
            f"only {only}; they are spread over all points found. Raise time_limit to have the others",
        ),
    )


def _affordable_number(
    candidates: Candidates,
    few: int,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float],
) -> int:
    """Return the number of candidates that can be evaluated in the remaining time, estimated from ``few`` and more."""
    count = len(candidates.trajectories)
    evaluate(candidates.spread(1))  # computes the fields, a cost that occurs once
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
