"""Closing the gap that a tree of the RRT planner leaves: rest exactly at the goal, by the least change at the end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.models.driven import ahead
from hpop.motions import States
from hpop.planners.rrt.query import Base, Query, WheelLimits, of_wheels

if TYPE_CHECKING:
    from hpop.motions import Wheeled

CLOSED = 1e-9  # m, rad, m/s, rad/s
LEAST_CHANGED = 16  # drives
NEWTON = 12  # steps; from such gaps four to six suffice
SLOPE = 1e-6  # m/s²: difference by which slopes are taken; Newton's method corrects for what they are off


def close(query: Query, controls: FloatArray) -> FloatArray | None:
    """Controls (n, 3) that end at rest exactly at the goal, free of collisions; None if no such ones are found.

    As few of the last drives are changed as will do: the last 16, 32 and so on.
    """
    trajectory = query.trajectory(controls)
    n, changed = len(controls), 0
    while changed < n:
        changed = min(n, max(LEAST_CHANGED, 2 * changed))
        kept, last = controls[: n - changed], controls[n - changed :]
        base = Base(*(float(getattr(trajectory.states, name)[n - changed]) for name in Base._fields))
        ending = _ending(query, base, last)
        if ending is not None:
            closed = np.concatenate([kept, ending])
            if _free(query, closed):
                return closed
    return None


def _free(query: Query, controls: FloatArray) -> bool:
    """Whether a trajectory is free of collisions, exactly."""
    collision = query.model.collision(query.world)
    trajectory = query.trajectory(controls)
    return all(bool(collision.motions_free(motions).all()) for _, motions in trajectory.batches(query.world))


def _ending(query: Query, base: Base, controls: FloatArray) -> FloatArray | None:
    """Controls (k, 3) that lead from a state to rest at the goal, near the given ones; None if they break a limit.

    Newton's method on the end state as a function of all wheel accelerations. There are more of these than end states,
    so each step is the one of least norm, which spreads the gap over all drives.
    """
    half, lasts = 0.5 * query.model.wheel_base, controls[:, 2]
    wheels = np.stack([controls[:, 0] - half * controls[:, 1], controls[:, 0] + half * controls[:, 1]], axis=1)
    tried = np.concatenate([np.zeros((1, wheels.size)), SLOPE * np.eye(wheels.size)]).reshape(-1, *wheels.shape)
    goal = np.array([*query.goal[:2], query.goal[2] or 0.0, 0.0, 0.0])
    counts = np.array([1.0, 1.0, query.goal[2] is not None, 1.0, 1.0])
    for _ in range(NEWTON):
        ends = _ends(query.model, base, wheels + tried, lasts)
        off = counts * (ends[0] - goal)
        off[2] = wrap(off[2])
        if np.abs(off).max() < CLOSED:
            return _within_limits(query, base, wheels, lasts)
        slopes = counts[:, None] * (ends[1:] - ends[0]).T / SLOPE  # (5, 2k)
        wheels = wheels - np.linalg.lstsq(slopes, off)[0].reshape(wheels.shape)
    return None


def _ends(model: Wheeled, base: Base, wheels: FloatArray, lasts: FloatArray) -> FloatArray:
    """End states (B, 5) from a state, by k drives each with wheel accelerations (B, k, 2)."""
    acceleration, turn_acceleration = of_wheels(model, wheels[..., 0], wheels[..., 1])
    speed = _summed(base.speed, acceleration * lasts)  # (B, k + 1)
    turn_rate = _summed(base.turn_rate, turn_acceleration * lasts)
    yaw = _summed(base.yaw, 0.5 * (turn_rate[:, 1:] + turn_rate[:, :-1]) * lasts)
    still = np.zeros(acceleration.size)
    columns = {"yaw": yaw, "speed": speed, "turn_rate": turn_rate}
    begins = States(x=still, y=still, clock=still, **{name: c[:, :-1].ravel() for name, c in columns.items()})
    reached = ahead(begins, acceleration.ravel(), turn_acceleration.ravel(), np.tile(lasts, len(wheels)))
    x, y = (column.reshape(acceleration.shape).sum(axis=1) for column in (reached.x, reached.y))
    return np.stack([base.x + x, base.y + y, yaw[:, -1], speed[:, -1], turn_rate[:, -1]], axis=1)


def _within_limits(query: Query, base: Base, wheels: FloatArray, lasts: FloatArray) -> FloatArray | None:
    """Controls (k, 3) of wheel accelerations (k, 2), or None if they break a limit; speeds are extreme at ends."""
    limits = WheelLimits.of(query.model)
    acceleration, turn_acceleration = of_wheels(query.model, wheels[:, 0], wheels[:, 1])
    speed = base.speed + np.cumsum(acceleration * lasts)
    turn_rate = np.abs(base.turn_rate + np.cumsum(turn_acceleration * lasts))
    over = (
        -speed,
        speed - limits.speed,
        turn_rate - limits.turn_rate,
        speed + 0.5 * query.model.wheel_base * turn_rate - limits.wheel_speed,
        np.abs(wheels) - limits.wheel_acceleration,
    )
    if max(float(excess.max()) for excess in over) > CLOSED:
        return None
    return np.stack([acceleration, turn_acceleration, lasts], axis=1)


def _summed(first: float, rows: FloatArray) -> FloatArray:
    """Running sums (B, k + 1) of rows (B, k), from the first value."""
    return np.cumsum(np.concatenate([np.full((len(rows), 1), first), rows], axis=1), axis=1)
