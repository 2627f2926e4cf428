"""Check candidate trajectories independently of the planner that found them, and reject invalid ones.

A nonlinear program works with interpolated fields, sample points and smoothed corners, so a solution that it accepts
may collide or cost more than it computed. Here each trajectory is checked on the exact geometry, for collisions and for
its start and goal, and its costs are evaluated by the criteria that fronts report.

This file also limits the number of candidates to those that can be evaluated before the time limit.
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
from hpop.goals.approach import misses_line, reached_in
from hpop.motions import States, free_along, is_curve
from hpop.planners.base import Candidates
from hpop.runtime.limits import Status
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

EPSILON_TOLERANCE = 1e-3  # relative: a re-evaluated cost may exceed its bound by this, or by half a quantum


@dataclass(frozen=True, eq=False)
class Judgement:
    """Result of checking n candidates: their re-evaluated costs, and why some are rejected.

    costs    (n, k) re-evaluated costs; NaN for trajectories that miss the start or the goal, or leave the map
    reasons  for each candidate, why it is rejected; "" if it is accepted
    """

    costs: FloatArray
    reasons: tuple[str, ...]

    @property
    def accepted_rows(self) -> IntArray:
        """Indices of the accepted candidates."""
        return np.flatnonzero([not reason for reason in self.reasons])

    @property
    def kept(self) -> IntArray:
        """Indices of the accepted candidates. Deprecated name of :attr:`accepted_rows`."""
        warnings.warn("Judgement.kept is Judgement.accepted_rows now", DeprecationWarning, stacklevel=2)
        return self.accepted_rows

    @property
    def rejection_counts(self) -> dict[str, int]:
        """For each reason of rejection, the number of candidates rejected for it."""
        return dict(Counter(reason for reason in self.reasons if reason))

    def notes(self, planner: str) -> tuple[str, ...]:
        """Return one note with the number of rejected candidates and the reasons, or () if all are accepted."""
        if not self.rejection_counts:
            return ()
        why = ", ".join(f"{reason} ({count})" for reason, count in sorted(self.rejection_counts.items()))
        rejected = len(self.reasons) - self.accepted_rows.size
        return (f"{planner}: {rejected} of {len(self.reasons)} candidates were rejected: {why}",)


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
    """Re-evaluate the costs of candidate trajectories and decide which to reject; one reason is given for each.

    A trajectory is rejected if it misses the start, the goal or the straight approach to it, leaves the map, collides,
    exceeds a bound, or costs other than planned. Collisions are checked on the geometry that the model uses for
    planning, which misses none.

    Parameters
    ----------
    epsilon : (n, k) upper bounds on the costs, to be kept within EPSILON_TOLERANCE or half a quantum; inf for no bound
    planned, tolerance : (n, k) costs as the planner added them up, and their largest allowed errors
    """
    count = len(trajectories)
    costs = np.full((count, len(objectives)), np.nan)
    if not count:
        return Judgement(costs, ())
    table = MotionTable.of(trajectories)
    reasons = _faults_of_ends(problem, table)
    for i in range(count):
        if not reasons[i] and misses_line(problem.target, trajectories[i], problem.world):
            reasons[i] = "does not end with its straight approach"
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
            reasons[i] = f"exceeds the bound on {', '.join(names)}"
        elif planned is not None and tolerance is not None:
            off = ~(np.abs(costs[i] - planned[i]) <= tolerance[i] + 1e-9 * np.abs(costs[i]))
            if off.any():
                names = [c.name for c, wrong in zip(objectives, off, strict=True) if wrong]
                reasons[i] = f"planned and re-evaluated {', '.join(names)} differ too much"
    return Judgement(costs, tuple(reasons))


def trusted(
    candidates: Candidates,
    problem: Problem,
    planner: str,
    *,
    epsilon: FloatArray | None = None,
) -> Candidates:
    """Return only those candidates that :func:`judge` accepts.

    A note and the stats give the number of rejected candidates and the reasons. After Ctrl-C, the check begins again
    and the status becomes INTERRUPTED; a second Ctrl-C raises KeyboardInterrupt.

    Parameters
    ----------
    planner : name of the planner, for the note
    epsilon : (n, k) upper bounds on the costs, as for :func:`judge`
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
    """Return the largest costs (k,) that are accepted for the bounds ``epsilon`` (k,).

    They exceed the bounds by the relative tolerance EPSILON_TOLERANCE or by half a quantum, whichever is larger.
    """
    quanta = np.array([0.5 * criterion.quantum for criterion in objectives])
    return np.asarray(epsilon + np.maximum(EPSILON_TOLERANCE * np.abs(epsilon), quanta))


def exceeds(costs: FloatArray, epsilon: FloatArray, objectives: Sequence[Criterion]) -> BoolArray:
    """Return whether each cost (k,) exceeds its bound by more than :func:`accepted` allows."""
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
    """Return, for each trajectory, "misses the goal", "misses the start" or "leaves the map"; "" if none applies.

    If several apply, it is the last of them in this order.
    """
    model = problem.model
    reasons = [""] * table.counts.size
    first, last = table.states.take(table.first), table.states.take(table.last)
    for fault, wrong in (
        ("misses the goal", ~reached_in(problem.world, problem.target, model, last)),
        ("misses the start", ~GoalSet((problem.start,)).reached(model, first)),
        ("leaves the map", table.through(~on_map(problem, table.states))),
    ):
        for i in np.flatnonzero(wrong):
            reasons[i] = fault
    return reasons


def _free_trajectories(
    problem: Problem, table: MotionTable, trajectories: Sequence[Trajectory], selected: Sequence[int]
) -> BoolArray:
    """Return whether each trajectory (n,) of a table is free of collisions.

    A motion that several trajectories share is checked once. A curve depends on the motions before and after it, so
    trajectories with curves are checked one by one, as are trajectories without motions. This is done only for the
    indices in ``selected``; for trajectories of these two kinds that are not selected, the result means nothing.
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
    """Return, for each state (M,), whether the robot's base is within the bounds of the map.

    A robot without a base is always within the bounds.
    """
    if "base" not in problem.model.provides:
        return np.ones(states.size, dtype=bool)
    base, (x_min, y_min, x_max, y_max) = problem.model.pose("base", states), problem.world.bounds
    return np.asarray((base.x >= x_min) & (base.x <= x_max) & (base.y >= y_min) & (base.y <= y_max))


# A search may find a hundred thousand trajectories, and building and evaluating one may take milliseconds. So a few are
# evaluated first: this computes the fields that all need, and measures the time per trajectory.


SHARES = (16, 4)  # the first sample has 1 of 16 trajectories, the second 1 of 4
MARGIN = 1.2  # safety factor on the measured time per trajectory
FEW, FEW_WITH_MEMORY = 60, 6  # number of trajectories that are always evaluated, without and with criteria with memory


def evaluable_in_time(
    candidates: Candidates,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float] = perf_counter,
) -> Candidates:
    """Return as many candidates as can be evaluated before the time limit, spread over the front.

    The candidate with the smallest value of each cost is always among them, and a few candidates are returned even if
    no time remains. If some are left out, a note and the certificate say so. Without a time limit, and after Ctrl-C,
    all candidates are returned.

    Parameters
    ----------
    left : function that returns the seconds until the time limit, or None without a limit
    evaluate : function that evaluates candidates; it is called on samples to measure its time
    clock : function that returns the present time, s
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
            f"only {only}; they are spread over all points found. Raise time_limit to get the others",
        ),
    )


def _affordable_number(
    candidates: Candidates,
    few: int,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float],
) -> int:
    """Estimate how many candidates can be evaluated in the remaining time, by timing samples of growing size.

    The first sample has at least ``few`` candidates. The estimate is never below ``few``. Other arguments as for
    :func:`evaluable_in_time`.
    """
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
