"""Is a front what it claims? Costs re-evaluated, ends compared, collisions checked in space by python-fcl."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion, trajectory_costs
from hpop.front import Front
from hpop.math import wrap
from hpop.models.collision.solid import SolidCollision
from hpop.motion_table import MotionTable
from hpop.motions import Law, States, is_curve
from hpop.options import MOST
from hpop.planners.base import edge_objectives
from hpop.problem import Problem
from hpop.trajectory import Trajectory

SPACING = 0.05  # m or rad: distance between the states at which collisions are looked for
SAME = 1e-9  # relative: a re-evaluated cost is the same number but for the order of a sum
CLOSE = 1e-5  # m or rad: two states written in decimals are the same
HEADING_CLOSE = 5e-3  # rad: a yaw of three decimals was put on the planner's heading
AXES = ("x", "y", "yaw")
SAMPLES = 2**14  # states that are looked at between two reports
STEPS = 100  # in which a curve is looked at
FASTER = 1e-3  # share by which a wheel may exceed its limits
MOST_TURNED = 1e4  # rad: yaws beyond are no trajectory, and would take for ever to check


def verify(problem: Problem, front: Front, *, say: Callable[[str], None] | None = None) -> list[str]:
    """Faults of a front of this problem, in words; none if it holds what it claims.

    Independent of the planner: costs come from the criteria, collisions from python-fcl at states no further apart
    than 5 cm or 3 degrees, the ends from the problem. What trajectories share is checked once. Fronts of earlier
    versions, whose lattice put the goal on its nearest position, say so in the provenance ("goal_offset"): no more than
    half a diagonal of a "step" is believed.

    Parameters
    ----------
    say : called now and then with what is being checked and how far that is
    """
    lost = lost_trajectories(problem, front)
    if lost or not len(front):
        return lost or [*_declared_faults(problem, front)]
    table = MotionTable.of(front.trajectories)
    faults = [*_declared_faults(problem, front), *_cost_faults(problem, front, table, say)]
    for i in np.flatnonzero(_suspects(problem, table)).tolist():
        trajectory = front.trajectories[i]
        faults += [
            f"trajectory {i} {fault}"
            for fault in (
                *_end_faults(problem, trajectory, _offset(front.provenance[i])),
                *_heading_faults(problem, trajectory),
            )
        ]
    return [*faults, *(f"trajectory {i} collides" for i in np.flatnonzero(~_free(problem, table, say)))]


def lost_trajectories(problem: Problem, front: Front) -> list[str]:
    """The trajectories that leave the map, where nothing of them can be evaluated, or turn without end."""
    return [f"trajectory {i} leaves the map" for i, t in enumerate(front.trajectories) if not _inside(problem, t)]


def _inside(problem: Problem, trajectory: Trajectory) -> bool:
    s = trajectory.states
    x_min, y_min, x_max, y_max = problem.world.bounds
    inside = (s.x >= x_min) & (s.x <= x_max) & (s.y >= y_min) & (s.y <= y_max) & (np.abs(s.yaw) <= MOST_TURNED)
    return bool(inside.all())


def _claimable(problem: Problem) -> dict[str, Criterion]:
    """Criteria whose costs a front of this problem may hold: those asked for, and what stands in for a mean."""
    additive = [c for c in problem.criteria if c.aggregate != "trajectory"]
    optimised = edge_objectives(additive, "front").optimised if additive else ()
    return {criterion.name: criterion for criterion in (*optimised, *problem.criteria)}


def _declared_faults(problem: Problem, front: Front) -> Iterator[str]:
    """Criteria that are not the problem's, or are said to be what they are not."""
    every = _claimable(problem)
    names = [*front.names, *front.reported_names]
    unknown = [name for name in names if name not in every]
    if unknown:
        yield f"costs of {', '.join(unknown)} are saved, which the problem does not ask for"
    lacking = [c.name for c in problem.criteria if c.name not in names]
    if lacking:
        yield f"costs of {', '.join(lacking)} are not saved, which the problem asks for"
    for name, unit in zip(names, [*front.units, *front.reported_units], strict=True):
        if name in every and unit != every[name].unit:
            yield f"{name} is saved in {unit!r}, but its unit is {every[name].unit!r}"
    for name, group, quantum in zip(front.names, front.groups, front.quanta.tolist(), strict=True):
        if name in every and (group, quantum) != (every[name].group, every[name].quantum):
            yield (
                f"{name} is saved with group {group!r} and quantum {quantum}, but has {every[name].group!r} and "
                f"{every[name].quantum}"
            )


def _cost_faults(
    problem: Problem, front: Front, table: MotionTable, say: Callable[[str], None] | None
) -> Iterator[str]:
    every = _claimable(problem)
    names = [*front.names, *front.reported_names]
    known = [j for j, name in enumerate(names) if name in every]
    criteria = [every[names[j]] for j in known]
    again = trajectory_costs(criteria, front.trajectories, problem.world, table=table, say=say)
    saved: FloatArray = np.hstack([front.costs, front.reported])[:, known]
    wrong = np.abs(again - saved) > SAME * np.maximum(1.0, np.abs(saved))
    for i, j in np.argwhere(wrong):
        yield f"trajectory {i}: {names[known[j]]} is saved as {saved[i, j]:.9g}, re-evaluated {again[i, j]:.9g}"


def _suspects(problem: Problem, table: MotionTable) -> BoolArray:
    """Trajectories (n,) to look at one by one: ends that are not the problem's, motions astray, curves."""
    first, last = table.states.take(table.first), table.states.take(table.last)
    (x, y, yaw), goal = problem.start, problem.goal
    suspects = np.maximum(np.abs(first.x - x), np.abs(first.y - y)) > CLOSE
    suspects |= np.abs(wrap(first.yaw - yaw)) > HEADING_CLOSE
    suspects |= np.hypot(last.x - goal[0], last.y - goal[1]) > CLOSE
    if goal[2] is not None:
        suspects |= np.abs(wrap(last.yaw - goal[2])) > HEADING_CLOSE
    astray = table.curved.copy()
    for index, law, start, end in table.by_law():
        if {"x", "y"} <= law.varies:
            astray[index] |= _astray(start, end)
    found: BoolArray = suspects | table.having(astray)
    return found


def _astray(start: States, end: States) -> BoolArray:
    """Straight motions (M,) that slide sideways or go back."""
    dx, dy, ahead, left = end.x - start.x, end.y - start.y, np.cos(start.yaw), np.sin(start.yaw)
    astray: BoolArray = (np.abs(dy * ahead - dx * left) > CLOSE) | (dx * ahead + dy * left < -CLOSE)
    return astray


def _offset(provenance: Mapping[str, Any]) -> float:
    """How far from the goal the planner says that it ended, m, within what its step allows."""
    offset, step = (provenance.get(key) for key in ("goal_offset", "step"))
    if not (isinstance(offset, int | float) and isinstance(step, int | float) and max(abs(offset), abs(step)) <= MOST):
        return 0.0
    return min(float(offset), abs(step) / math.sqrt(2.0))


def _end_faults(problem: Problem, trajectory: Trajectory, offset: float) -> Iterator[str]:
    s, goal = trajectory.states, problem.goal
    start = problem.start
    apart = max(abs(s.x[0] - start[0]), abs(s.y[0] - start[1]))
    if apart > CLOSE or abs(wrap(s.yaw[0] - start[2])) > HEADING_CLOSE:
        yield "does not begin at the start"
    off = np.hypot(s.x[-1] - goal[0], s.y[-1] - goal[1])
    if off > offset + CLOSE:
        yield f"ends {off:.3f} m from the goal"
    if goal[2] is not None and abs(wrap(s.yaw[-1] - goal[2])) > HEADING_CLOSE:
        yield "does not end with the goal's heading"


def _heading_faults(problem: Problem, trajectory: Trajectory) -> Iterator[str]:
    """Motions that slide sideways or go back: a differential drive only goes where it looks."""
    s, laws = trajectory.states, trajectory.model.laws
    curved = _curved(trajectory)
    straight = np.array([{"x", "y"} <= laws[kind].varies for kind in trajectory.kinds], dtype=bool) & ~curved
    wrong = np.flatnonzero(straight & _astray(s.take(slice(None, -1)), s.take(slice(1, None))))
    if wrong.size:
        yield f"does not go ahead in motion {wrong[0]}, a {trajectory.kinds[wrong[0]]}"
    yield from _curve_faults(problem, trajectory, np.flatnonzero(curved))


def _curve_faults(problem: Problem, trajectory: Trajectory, curved: IntArray) -> Iterator[str]:
    """Curves along which the robot slides or goes back, or whose wheels are faster than the model's.

    Told by differences of places and headings over hundredths of each motion.
    """
    model, lasts = problem.model, trajectory.durations[curved]
    times = trajectory.times[curved][:, None] + lasts[:, None] * np.linspace(0.0, 1.0, STEPS + 1)  # (c, STEPS + 1)
    s = trajectory.at(times.ravel())
    x, y, yaw = (np.reshape(column, times.shape) for column in (s.x, s.y, s.yaw))
    dx, dy, turned, heading = np.diff(x), np.diff(y), np.diff(yaw), 0.5 * (yaw[:, 1:] + yaw[:, :-1])
    ahead, side = dx * np.cos(heading) + dy * np.sin(heading), dy * np.cos(heading) - dx * np.sin(heading)
    wheels = np.stack([ahead + sign * 0.5 * model.wheel_base * turned for sign in (-1.0, 1.0)])  # (2, c, STEPS), m
    fastest = np.abs(wheels).max(axis=(0, 2), initial=0.0) * STEPS
    hardest = np.abs(np.diff(wheels)).max(axis=(0, 2), initial=0.0) * STEPS**2
    for wrong, fault in (
        ((np.abs(side) > CLOSE).any(axis=1) | (ahead < -CLOSE).any(axis=1), "does not go ahead"),
        (fastest > model.wheel_speed * lasts * (1 + FASTER) + CLOSE, "drives faster than its wheels can turn"),
        (
            hardest > model.wheel_acceleration * lasts**2 * (1 + FASTER) + CLOSE,
            "speeds up or turns harder than its wheels can",
        ),
    ):
        if wrong.any():
            i = curved[np.argmax(wrong)]
            yield f"{fault} in motion {i}, a {trajectory.kinds[i]}"


def _curved(trajectory: Trajectory) -> BoolArray:
    """Which motions (n,) go along curves."""
    return np.array([is_curve(trajectory.model.laws[kind]) for kind in trajectory.kinds], dtype=bool)


def collision_free(problem: Problem, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Whether each trajectory (n,) is free at densely sampled states; motions that many share are checked once."""
    return _free(problem, MotionTable.of(trajectories)) if trajectories else np.ones(0, dtype=bool)


def _free(problem: Problem, table: MotionTable, say: Callable[[str], None] | None = None) -> BoolArray:
    """Whether each trajectory (n,) of a table is free."""
    checker = SolidCollision(problem.model, problem.world)
    colliding = np.zeros(len(table), dtype=bool)
    done = 0
    for block, law, start, end in table.by_law():
        counts = _sample_counts(law, start, end)
        together = np.cumsum(counts) // SAMPLES
        for part in (np.flatnonzero(together == number) for number in np.unique(together)):
            if say is not None:
                say(f"collisions of {done:,} of {len(table):,} motions")
            done += part.size
            samples, owner = _dense(law, start.take(part), end.take(part), counts[part])
            rows, inverse = np.unique(samples, axis=0, return_inverse=True)
            free = checker.free(States(x=rows[:, 0], y=rows[:, 1], yaw=rows[:, 2]))
            colliding[block[part]] = np.bincount(owner, ~free[inverse.ravel()], minlength=part.size) > 0
    first = table.states.take(table.first)
    begins, which = np.unique(np.stack([first.x, first.y, first.yaw], axis=1), axis=0, return_inverse=True)
    free = checker.free(States(x=begins[:, 0], y=begins[:, 1], yaw=begins[:, 2]))  # of those that go nowhere as well
    result: BoolArray = free[which.ravel()] & ~table.having(colliding)
    return result


def _sample_counts(law: Law, start: States, end: States) -> IntArray:
    """How many states (M,) of motions of one law, both ends included, are no further apart than SPACING."""
    if is_curve(law):
        (phase,) = law.phases(start, end)
        rates = ((start.speed, end.speed), (start.turn_rate, end.turn_rate))  # what is linear is largest at an end
        longest = np.max([np.maximum(np.abs(rate), np.abs(to)) for rate, to in rates], axis=0) * phase.duration
    else:
        longest = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in AXES], axis=0)
    pieces: IntArray = np.maximum(1, np.ceil(longest / SPACING - 1e-9)).astype(np.int64)
    return pieces + 1


def _dense(law: Law, start: States, end: States, counts: IntArray) -> tuple[FloatArray, IntArray]:
    """So many states (N, 3) along each of some motions (M,), the yaw in [0, 2 pi); and their motions (N,)."""
    owner = np.repeat(np.arange(counts.size), counts)
    u = (np.arange(owner.size) - np.repeat(np.cumsum(counts) - counts, counts)) / (counts - 1)[owner]
    begin, stop = start.take(owner), end.take(owner)
    if is_curve(law):
        (phase,) = law.phases(begin, stop)
        share = phase.share(u)
        columns = [law.interpolate(name, begin, stop, share) for name in AXES]
    else:
        columns = [getattr(begin, n) + u * (getattr(stop, n) - getattr(begin, n)) for n in AXES]
    states = np.stack(columns, axis=1)
    states[:, 2] %= 2 * np.pi
    return np.round(states, 9), owner
