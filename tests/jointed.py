"""A robot of three joints without a base, for tests of what asks a model for its camera and its joints alone.

It stands at ``foot``. Joint "swing" turns it about the vertical, "lift" raises the link about its left, "twist" rolls
the camera about the link. The camera is beside the end of the link; nothing stays level, at one height or upright.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from hpop.base.math import smooth_abs
from hpop.criteria.costs import motion_costs, trajectory_cost
from hpop.models.laws import linear, rest_to_rest
from hpop.motions import Leg, States, StateSpace, integrated
from hpop.motions.symbolic import SymbolicMotions
from hpop.trajectories.trajectory import Trajectory

LINK = 0.4  # m
BESIDE = (0.05, 0.02, 0.03)  # m: the camera from the end of the link, ahead, left and up


@dataclass(frozen=True)
class Reach:
    """All joints with one share, from rest to rest."""

    speed: float = 1.0
    acceleration: float = 2.0
    kind = "reach"
    varies = frozenset({"swing", "lift", "twist"})

    def phases(self, start, end):
        farthest = sum(smooth_abs(getattr(end, name) - getattr(start, name)) for name in sorted(self.varies))
        return rest_to_rest(farthest, self.speed, self.acceleration)

    def interpolate(self, name, start, end, share):
        return linear(name, start, end, share)


class Pose:
    def __init__(self, place, axes):
        self.x, self.y, self.z = place
        self.ahead, self.left, self.up = axes

    @property
    def yaw(self):
        return np.arctan2(self.ahead[1], self.ahead[0])

    @property
    def pitch(self):
        return np.arctan2(self.ahead[2], np.hypot(self.ahead[0], self.ahead[1]))

    @property
    def roll(self):
        return np.arctan2(self.left[2], self.up[2])


@dataclass(frozen=True)
class Jointed:
    foot: tuple[float, float, float] = (0.0, 0.0, 0.3)
    yaw: float = 0.0
    field_of_view: tuple[float, float] | None = None
    tool: bool = False

    joints = ("swing", "lift", "twist")

    @property
    def name(self):
        return "jointed"

    @property
    def provides(self):
        return frozenset({"camera", "joints", *(["tool"] if self.tool else [])})

    @cached_property
    def space(self):
        low, high = (-2.5, -1.2, -np.pi), (2.5, 1.2, np.pi)
        return StateSpace(self.joints, ("rad",) * 3, low, high, (1.0,) * 3, frozenset({"twist"}))

    @cached_property
    def laws(self):
        return {"reach": Reach()}

    def _frames(self, s):
        """Axes of the joints, what they turn about, and place and axes of the camera."""
        a, b, c = self.yaw + s.swing, s.lift, s.twist
        zero = 0.0 * a
        link = np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)
        level = -np.sin(a), np.cos(a), zero
        over = -np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)
        left = tuple(np.cos(c) * p + np.sin(c) * q for p, q in zip(level, over, strict=True))
        up = tuple(np.cos(c) * q - np.sin(c) * p for p, q in zip(level, over, strict=True))
        foot = tuple(f + zero for f in self.foot)
        end = tuple(f + LINK * p for f, p in zip(foot, link, strict=True))
        x, y, z = BESIDE
        place = tuple(e + x * p + y * q + z * r for e, p, q, r in zip(end, link, left, up, strict=True))
        right = tuple(-p for p in level)  # turning about it lifts
        return ((zero, zero, 1.0 + zero), right, link), (foot, foot, end), place, (link, left, up)

    def pose(self, body, s):
        *_, place, axes = self._frames(s)
        return Pose(place, axes)

    def twist(self, body, s, rates):
        axes, origins, place, _ = self._frames(s)
        velocity = rotation = (0.0, 0.0, 0.0)
        for name, axis, origin in zip(self.joints, axes, origins, strict=True):
            rate = getattr(rates, name)
            velocity = _sum(velocity, _scaled(rate, _cross(axis, _less(place, origin))))
            rotation = _sum(rotation, _scaled(rate, axis))
        return SimpleNamespace(velocity=velocity, rotation=rotation)

    def twist_rate(self, body, s, rates, changes):
        axes, origins, place, _ = self._frames(s)
        velocity = self.twist(body, s, rates).velocity
        turning, moving = (0.0, 0.0, 0.0), ((0.0,) * 3, (0.0,) * 3, self._end_velocity(s, rates))
        acceleration = rotation = (0.0, 0.0, 0.0)
        for name, axis, origin, moved in zip(self.joints, axes, origins, moving, strict=True):
            rate, change, arm = getattr(rates, name), getattr(changes, name), _less(place, origin)
            tilting = _cross(turning, axis)
            acceleration = _sum(acceleration, _scaled(change, _cross(axis, arm)))
            acceleration = _sum(acceleration, _scaled(rate, _cross(tilting, arm)))
            acceleration = _sum(acceleration, _scaled(rate, _cross(axis, _less(velocity, moved))))
            rotation = _sum(rotation, _sum(_scaled(change, axis), _scaled(rate, tilting)))
            turning = _sum(turning, _scaled(rate, axis))
        return SimpleNamespace(velocity=acceleration, rotation=rotation)

    def _end_velocity(self, s, rates):
        axes, origins, _, _ = self._frames(s)
        velocity = (0.0, 0.0, 0.0)
        for name, axis in zip(("swing", "lift"), axes[:2], strict=True):
            velocity = _sum(velocity, _scaled(getattr(rates, name), _cross(axis, _less(origins[2], origins[0]))))
        return velocity

    def body(self, name, motions):
        return integrated(name, motions)

    def extent(self, motions):
        turned = sum(smooth_abs(getattr(motions.end, name) - getattr(motions.start, name)) for name in self.joints)
        return (LINK + sum(BESIDE)) * turned, turned

    def connect(self, a, b):
        end = self.space.onward(a, b)
        apart = sum(np.abs(getattr(end, name) - getattr(a, name)) for name in self.joints)
        return [Leg("reach", end, apart > 0.0)]

    def collision(self, world):
        return Anywhere()

    judge = collision

    def execution(self, trajectory):
        return trajectory, trajectory.times

    def faults(self, trajectory):
        return iter(())

    def doubtful(self, law, start, end):
        return np.zeros(start.size, dtype=bool)

    def describe(self):
        return {self.name: {"foot": list(self.foot), "yaw": self.yaw}}


class Anywhere:
    """No collision at all."""

    def states_free(self, states):
        return np.ones(states.size, dtype=bool)

    def motions_free(self, motions):
        return np.ones(len(motions), dtype=bool)

    def why_blocked(self, state):
        return ""


def states_of(model, rows):
    """States of rows (N, k) in the order of the model's columns."""
    return States(**dict(zip(model.space.names, np.array(rows, float).T, strict=True)))


def _cross(a, b):
    return tuple(a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3))


def _sum(a, b):
    return tuple(p + q for p, q in zip(a, b, strict=True))


def _less(a, b):
    return tuple(p - q for p, q in zip(a, b, strict=True))


def _scaled(factor, a):
    return tuple(factor * p for p in a)


def tour(model, rows=((0.0, 0.1, 0.2), (1.1, -0.6, 1.5), (-0.4, 0.9, -0.7), (-0.4, 0.9, 0.8))):
    """Return a trajectory through rows of joints."""
    return Trajectory.through(model, states_of(model, rows))


def moments(trajectory, count=4000):
    """Middles (N,) of equal steps of time, s, the step, and camera places (3, N) and axes (3, 3, N) there."""
    step = trajectory.duration / count
    times = (np.arange(count) + 0.5) * step
    place, axes = camera_at(trajectory, times)
    return times, step, place, axes


def camera_at(trajectory, times):
    """Camera places (3, N) and axes (3, 3, N): ahead, left, up."""
    pose = trajectory.model.pose("camera", trajectory.at(times))

    def columns(vector):
        return np.stack([np.broadcast_to(column, times.shape) for column in vector])

    return columns((pose.x, pose.y, pose.z)), np.stack([columns(axis) for axis in (pose.ahead, pose.left, pose.up)])


def on_symbols(criterion, motions):
    """Costs (M,) and their Jacobian on symbols that stand for the motions' states."""
    symbols = SymbolicMotions.of(replace(motions, panels=3))
    return symbols.values_and_jacobian(criterion.cost(symbols.motions))


def agrees_everywhere(criterion, model, world, *, some=True):
    """Costs are the same on a trajectory, as edges alone and together, and on symbols; there are some."""
    trajectory = tour(model)
    value = trajectory_cost(criterion, trajectory, world)
    assert not some or value > 0.0
    costs = np.zeros(len(trajectory))
    for index, motions in trajectory.batches(world):
        edges = replace(motions, t0=None)
        costs[index] = motion_costs(criterion, edges)
        for i in range(len(edges)):
            alone = replace(edges, start=edges.start.take([i]), end=edges.end.take([i]))
            np.testing.assert_allclose(motion_costs(criterion, alone), costs[index[i]], rtol=1e-9, atol=1e-12)
        if criterion.smooth:
            found, jacobian = on_symbols(criterion, edges)
            panels = replace(edges, panels=3)
            np.testing.assert_allclose(found, motion_costs(criterion, panels), rtol=1e-6, atol=1e-9)
            assert np.isfinite(jacobian).all()
    np.testing.assert_allclose(costs.sum(), value, rtol=1e-9)
    return value


def jacobian(model, body, row, step=1e-6):
    """Jacobian (6, n) of a body by its states, velocity above rotation, by differences of its poses."""
    columns = []
    for j in range(len(row)):
        moved = step * (np.arange(len(row)) == j)
        ends = [model.pose(body, states_of(model, [np.array(row) + sign * moved])) for sign in (-1, 1)]
        places = [np.concatenate([pose.x, pose.y, pose.z]) for pose in ends]
        axes = [
            np.array([[np.ravel(part)[0] for part in axis] for axis in (pose.ahead, pose.left, pose.up)])
            for pose in ends
        ]
        columns.append(np.concatenate([places[1] - places[0], 0.5 * np.cross(*axes).sum(axis=0)]) / (2 * step))
    return np.array(columns).T
