"""A robot that is nothing but joints, beyond the plane: what blocks it are balls in the space of their angles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import shapely

import hpop
from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.criteria import criterion
from hpop.models.laws import linear, rest_to_rest
from hpop.motions import Body, Law, Leg, Model, Motions, Phase, Pose, States, StateSpace, Twist
from hpop.trajectories.trajectory import Trajectory

NOWHERE = hpop.World.from_polygons([], extent=shapely.box(0, 0, 1, 1))


@dataclass(frozen=True)
class Reach:
    """All joints at once, from rest to rest, the slowest sets the pace."""

    names: tuple[str, ...]
    kind: str = "reach"

    @property
    def varies(self) -> frozenset[str]:
        return frozenset(self.names)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        largest = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in self.names], axis=0)
        return rest_to_rest(largest, 1.0, 2.0)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return linear(name, start, end, share)


@dataclass(frozen=True, eq=False)
class Balls:
    """Segments that keep out of balls; queries are counted."""

    centres: FloatArray
    radius: float
    asked: list[int] = field(default_factory=list)

    def states_free(self, states: States) -> BoolArray:
        return self.apart(states, states) > self.radius

    def motions_free(self, motions: Motions) -> BoolArray:
        self.asked.append(len(motions))
        return self.apart(motions.start, motions.end) > self.radius

    def why_blocked(self, state: States) -> str:
        return "" if self.states_free(state)[0] else "a ball is there"

    def apart(self, start: States, end: States) -> FloatArray:
        """Least distance (M,) of segments from any centre, in closed form."""
        a, b = (np.stack([getattr(s, name) for name in s.names], axis=1)[:, None] for s in (start, end))
        size = np.maximum(((b - a) ** 2).sum(axis=2), 1e-12)
        share = np.clip(((self.centres - a) * (b - a)).sum(axis=2) / size, 0.0, 1.0)
        return np.linalg.norm(a + share[..., None] * (b - a) - self.centres, axis=2).min(axis=1, initial=np.inf)


@dataclass(frozen=True)
class Joints(Model):
    """Robot of several joints, each within three radians of 0, among random balls; the ends are free."""

    number: int = 4
    balls: int = 0
    radius: float = 1.0
    seed: int = 0
    wall: bool = False

    name = "joints"
    provides = frozenset()

    @cached_property
    def space(self) -> StateSpace:
        n = self.number
        names = tuple(f"q{i}" for i in range(n))
        return StateSpace(names, ("rad",) * n, (-3.0,) * n, (3.0,) * n, (1.0,) * n)

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        return {"reach": Reach(self.space.names)}

    @property
    def start(self) -> tuple[float, ...]:
        return (-2.0,) * self.number

    @property
    def goal(self) -> tuple[float, ...]:
        return (2.0,) * self.number

    def pose(self, body: str, states: States) -> Pose:
        raise NotImplementedError

    def twist(self, body: str, states: States, rates: States) -> Twist:
        raise NotImplementedError

    twist_rate = twist  # type: ignore[assignment]

    def body(self, name: str, motions: Motions) -> Body:
        raise NotImplementedError

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        return 0.0 * motions.duration, 0.0 * motions.duration

    def connect(self, a: States, b: States) -> list[Leg]:
        end = States(**{n: np.where(np.isnan(getattr(b, n)), getattr(a, n), getattr(b, n)) for n in a.names})
        moves = np.any([getattr(end, name) != getattr(a, name) for name in a.names], axis=0)
        return [Leg("reach", end, moves)]

    @cached_property
    def geometry(self) -> Balls:
        rng = np.random.default_rng(self.seed)
        centres = rng.uniform(-3.0, 3.0, (self.balls, self.number))
        ends = np.array([self.start, self.goal])
        apart = np.linalg.norm(centres[:, None] - ends, axis=2).min(axis=1, initial=np.inf)
        return Balls(centres[apart > 1.1 * self.radius], self.radius)

    def collision(self, world: Any) -> Balls:
        return self.geometry

    judge = collision

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        return trajectory, trajectory.times

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        return iter(())

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        return np.zeros(start.size, dtype=bool)

    def describe(self) -> dict[str, Any]:
        return {self.name: {"number": self.number, "balls": self.balls, "radius": self.radius, "seed": self.seed}}


@criterion("sway", group="R", unit="rad", aggregate="sum")
@dataclass(frozen=True)
class Sway:
    """Distance that one joint moves."""

    joint: str = "q0"

    def cost(self, m: Motions) -> Column:
        return np.abs(getattr(m.end, self.joint) - getattr(m.start, self.joint))


@criterion("far_from_rest", group="R", unit="rad s", aggregate="sum")
@dataclass(frozen=True)
class FarFromRest:
    """Distance of the joints from 0, over time."""

    def cost(self, m: Motions) -> Column:
        columns = [(getattr(m.start, name) ** 2 + getattr(m.end, name) ** 2) for name in m.start.names]
        return m.duration * np.sqrt(sum(columns))


def problem(robot: Joints, **changes: Any) -> hpop.Problem:
    """From one corner of the space to the opposite one."""
    asked = {"start": robot.start, "goal": robot.goal, "criteria": ["duration", Sway(), FarFromRest()]} | changes
    return hpop.Problem(NOWHERE, robot, asked["start"], asked["goal"], asked["criteria"])
