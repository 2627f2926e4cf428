"""Robots whose camera rises: a lift on a base, and an arm without a base that holds the camera in its hand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.models.base import Mount, Part, PlanarModel, plane_space
from hpop.models.laws import rest_to_rest
from hpop.models.rigid import RigidPose, RigidTwist, RigidTwistRate
from hpop.motions import Body, Law, Leg, Model, Motions, Phase, States, StateSpace, integrated
from hpop.motions.states import Vector
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World


@dataclass(frozen=True)
class Together:
    """All columns of a space at one share of their ways, from rest to rest; 1 m/s and 1 rad/s at most."""

    kind: str
    varies: frozenset[str]

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        farthest = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in sorted(self.varies)], axis=0)
        return rest_to_rest(farthest, 1.0, 2.0)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return getattr(start, name) + (getattr(end, name) - getattr(start, name)) * share


def connected(space: StateSpace, kind: str, a: States, b: States) -> list[Leg]:
    """One motion; what is free stays as it is."""
    kept = States(**{n: np.where(np.isnan(getattr(b, n)), getattr(a, n), getattr(b, n)) for n in space.names})
    to = space.onward(a, kept)
    return [Leg(kind, to, space.apart(a, to) > 1e-9)]


class Raised(RigidPose):
    """The camera on a lift."""

    @property
    def z(self) -> Column:
        return self.mount.height + self.states.lift


class RaisedTwist(RigidTwist):
    @property
    def velocity(self) -> Vector:
        return (*super().velocity[:2], self.rates.lift)


class RaisedTwistRate(RigidTwistRate):
    @property
    def velocity(self) -> Vector:
        return (*super().velocity[:2], self.changes.lift)


@dataclass(frozen=True)
class Lift(PlanarModel):
    """A disc that slides in any direction; a lift raises its camera by up to 1.2 m from 0.8 m above the floor."""

    field_of_view: tuple[float, float] | None = (math.radians(90), math.radians(60))

    name = "lift"

    @cached_property
    def space(self) -> StateSpace:
        plane = plane_space(1.0)
        return StateSpace(
            (*plane.names, "lift"), (*plane.units, "m"), (*plane.low, 0.0), (*plane.high, 1.2), (*plane.weights, 1.0),
            plane.turning,
        )  # fmt: skip

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        return {"go": Together("go", frozenset(self.space.names))}

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part(((0.0, 0.0),), 0.25, 0.0, 0.8),)

    @property
    def mounts(self) -> Mapping[str, Mount]:
        return {"base": Mount(), "camera": Mount(height=0.8)}

    def pose(self, body: str, states: States) -> RigidPose:
        return Raised(self._mount(body), states) if body == "camera" else RigidPose(self._mount(body), states)

    def twist(self, body: str, states: States, rates: States) -> RigidTwist:
        return (RaisedTwist if body == "camera" else RigidTwist)(self._mount(body), states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> RigidTwistRate:
        kind = RaisedTwistRate if body == "camera" else RigidTwistRate
        return kind(self._mount(body), states, rates, changes)

    def connect(self, a: States, b: States) -> list[Leg]:
        return connected(self.space, "go", a, b)


@dataclass(frozen=True)
class HandPose:
    """At the end of an arm of 0.6 m, 0.5 m above the floor; it looks 40 degrees below the arm."""

    s: States

    @property
    def reach(self) -> Column:
        return 0.6 * np.cos(self.s.shoulder)

    @property
    def x(self) -> Column:
        return self.reach * np.cos(self.s.waist)

    @property
    def y(self) -> Column:
        return self.reach * np.sin(self.s.waist)

    @property
    def z(self) -> Column:
        return 0.5 + 0.6 * np.sin(self.s.shoulder)

    @property
    def yaw(self) -> Column:
        return self.s.waist

    @property
    def pitch(self) -> Column:
        return self.s.shoulder - math.radians(40)

    @property
    def roll(self) -> Column:
        return 0.0 * self.s.waist

    @property
    def ahead(self) -> Vector:
        level = np.cos(self.pitch)
        return level * np.cos(self.yaw), level * np.sin(self.yaw), np.sin(self.pitch)

    @property
    def left(self) -> Vector:
        return -np.sin(self.yaw), np.cos(self.yaw), 0.0 * self.yaw

    @property
    def up(self) -> Vector:
        rise = np.sin(self.pitch)
        return -rise * np.cos(self.yaw), -rise * np.sin(self.yaw), np.cos(self.pitch)


@dataclass(frozen=True)
class HandTwist:
    velocity: Vector
    rotation: Vector


class Nowhere:
    """Nothing is hit."""

    def states_free(self, states: States) -> BoolArray:
        return np.ones(states.size, dtype=bool)

    def motions_free(self, motions: Motions) -> BoolArray:
        return np.ones(len(motions), dtype=bool)

    def why_blocked(self, state: States) -> str:
        return ""


@dataclass(frozen=True)
class Reacher(Model):
    """An arm of two joints, a waist without end stops and a shoulder, with a camera at its end; it has no base."""

    field_of_view: tuple[float, float] | None = (math.radians(60), math.radians(45))

    name = "reacher"
    provides = frozenset({"camera", "joints"})
    space = StateSpace(
        ("waist", "shoulder"), ("rad", "rad"), (-math.pi, -0.8), (math.pi, 1.4), (0.6, 0.6), frozenset({"waist"})
    )
    laws = {"reach": Together("reach", frozenset({"waist", "shoulder"}))}  # noqa: RUF012

    def pose(self, body: str, states: States) -> HandPose:
        return HandPose(states)

    def twist(self, body: str, states: States, rates: States) -> HandTwist:
        pose = HandPose(states)
        outward = -0.6 * np.sin(states.shoulder) * rates.shoulder
        velocity = (
            outward * np.cos(states.waist) - pose.y * rates.waist,
            outward * np.sin(states.waist) + pose.x * rates.waist,
            0.6 * np.cos(states.shoulder) * rates.shoulder,
        )
        tilt = rates.shoulder
        return HandTwist(velocity, (tilt * np.sin(states.waist), -tilt * np.cos(states.waist), rates.waist))

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> HandTwist:
        raise NotImplementedError

    def body(self, name: str, motions: Motions) -> Body:
        return integrated(name, motions)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        m = motions
        turned = np.abs(m.end.waist - m.start.waist) + np.abs(m.end.shoulder - m.start.shoulder)
        return 0.6 * turned, turned

    def connect(self, a: States, b: States) -> list[Leg]:
        return connected(self.space, "reach", a, b)

    def collision(self, world: World) -> Nowhere:
        return Nowhere()

    judge = collision

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        return trajectory, trajectory.times

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        return iter(())

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        return np.zeros(start.size, dtype=bool)

    def describe(self) -> dict[str, Any]:
        return {self.name: {"field_of_view": list(self.field_of_view) if self.field_of_view else None}}
