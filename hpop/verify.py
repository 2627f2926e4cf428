"""Is a front what it claims? Costs re-evaluated, ends compared, collisions checked in space by python-fcl."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion, trajectory_costs
from hpop.front import Front
from hpop.math import wrap
from hpop.models.solid import SolidCollision
from hpop.motions import Curve, States
from hpop.options import MOST
from hpop.planners.base import edge_objectives
from hpop.problem import Problem
from hpop.trajectory import Trajectory

SPACING = 0.05  # m or rad: distance between the states at which collisions are looked for
SAME = 1e-9  # relative: a re-evaluated cost is the same number but for the order of a sum
CLOSE = 1e-5  # m or rad: two states written in decimals are the same
HEADING_CLOSE = 5e-3  # rad: a yaw of three decimals was put on the planner's heading
STEPS = 100  # in which a curve is looked at
FASTER = 1e-3  # share by which a wheel may exceed its limits
MOST_TURNED = 1e4  # rad: yaws beyond are no trajectory, and would take for ever to check


def verify(problem: Problem, front: Front) -> list[str]:
    """Faults of a front of this problem, in words; none if it holds what it claims.

    Independent of the planner: costs come from the criteria, collisions from python-fcl at states no further apart
    than 5 cm or 3 degrees, the ends from the problem. Fronts of earlier versions, whose lattice put the goal on its
    nearest position, say so in the provenance ("goal_offset"): no more than half a diagonal of a "step" is believed.
    """
    lost = [f"trajectory {i} leaves the map" for i, t in enumerate(front.trajectories) if not _inside(problem, t)]
    if lost:
        return lost
    faults = [*_declared_faults(problem, front), *_cost_faults(problem, front)]
    for i, trajectory in enumerate(front.trajectories):
        faults += [
            f"trajectory {i} {fault}"
            for fault in (
                *_end_faults(problem, trajectory, _offset(front.provenance[i])),
                *_heading_faults(problem, trajectory),
            )
        ]
    free = collision_free(problem, front.trajectories)
    return [*faults, *(f"trajectory {i} collides" for i in np.flatnonzero(~free))]


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


def _cost_faults(problem: Problem, front: Front) -> Iterator[str]:
    every = _claimable(problem)
    names = [*front.names, *front.reported_names]
    known = [j for j, name in enumerate(names) if name in every]
    again = trajectory_costs([every[names[j]] for j in known], front.trajectories, problem.world)
    saved: FloatArray = np.hstack([front.costs, front.reported])[:, known]
    wrong = np.abs(again - saved) > SAME * np.maximum(1.0, np.abs(saved))
    for i, j in np.argwhere(wrong):
        yield f"trajectory {i}: {names[known[j]]} is saved as {saved[i, j]:.9g}, re-evaluated {again[i, j]:.9g}"


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
    dx, dy = np.diff(s.x), np.diff(s.y)
    side = dy * np.cos(s.yaw[:-1]) - dx * np.sin(s.yaw[:-1])
    ahead = dx * np.cos(s.yaw[:-1]) + dy * np.sin(s.yaw[:-1])
    curved = _curved(trajectory)
    straight = np.array([{"x", "y"} <= laws[kind].varies for kind in trajectory.kinds], dtype=bool) & ~curved
    wrong = np.flatnonzero(straight & ((np.abs(side) > CLOSE) | (ahead < -CLOSE)))
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
    return np.array([isinstance(trajectory.model.laws[kind], Curve) for kind in trajectory.kinds], dtype=bool)


def collision_free(problem: Problem, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Whether each trajectory (n,) is free at densely sampled states; states that many share are checked once."""
    free = np.ones(len(trajectories), dtype=bool)
    if not trajectories:
        return free
    samples, owners = [], []
    for i, trajectory in enumerate(trajectories):
        states = _dense(trajectory)
        samples.append(states)
        owners.append(np.full(len(states), i))
    rows, inverse = np.unique(np.round(np.concatenate(samples), 9), axis=0, return_inverse=True)
    checker = SolidCollision(problem.model, problem.world)
    good = checker.free(States(x=rows[:, 0], y=rows[:, 1], yaw=rows[:, 2]))
    np.logical_and.at(free, np.concatenate(owners), good[inverse.ravel()])
    return free


def _dense(trajectory: Trajectory) -> FloatArray:
    """States (N, 3) along the geometry of a trajectory, the yaw in [0, 2 pi)."""
    if _curved(trajectory).any():
        trajectory = _straightened(trajectory)
    corners = np.stack([trajectory.states.x, trajectory.states.y, trajectory.states.yaw], axis=1)
    steps = np.diff(corners, axis=0)
    counts = np.maximum(1, np.ceil(np.abs(steps).max(axis=1, initial=0.0) / SPACING - 1e-9)).astype(int)
    pieces = [a + step * np.arange(n)[:, None] / n for a, step, n in zip(corners, steps, counts, strict=False)]
    states = np.concatenate([*pieces, corners[-1:]])
    states[:, 2] %= 2 * np.pi
    return states


def _straightened(trajectory: Trajectory) -> Trajectory:
    """The trajectory with its curves cut into pieces no longer than SPACING."""
    s, pieces = trajectory.states, np.ones(len(trajectory), dtype=np.int64)
    curved, lasts = _curved(trajectory), trajectory.durations
    for rate in (s.speed, s.turn_rate):
        most = np.maximum(np.abs(rate[:-1]), np.abs(rate[1:])) * lasts  # m or rad: what is linear is largest at an end
        pieces = np.where(curved, np.maximum(pieces, np.ceil(most / SPACING)), pieces).astype(np.int64)
    return trajectory.cut(pieces)
