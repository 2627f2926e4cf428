"""Leaving contact with a standing person: a robot that touches a person may move where the gap does not shrink.

A robot that touches a wall is stuck, or its map is wrong. Contact with a standing person is different: trackers are off
by centimetres, and people step up to a robot. So contact may be left by motions along which the gap grows or stays,
until the robot is free. From then on the person blocks the robot like any other obstacle. No motion leads into contact,
so motions that begin free stay free, however they are combined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.collision import Part
from hpop.models.collision.planar import PlanarCollision
from hpop.motions import Motions, States
from hpop.world import World

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

FAR = 4e5  # m: distance of the border in `world_of_area`, beyond any robot
SHARES = np.append(np.array([0.0, 1e-4]), np.linspace(0.0, 1.0, 65)[1:])
"""Shares of a motion at which the gap is tested, densest at its beginning: along a straight move the gap is convex."""
AT_ONCE = 500
"""Number of motions that are tested together: each needs some kB for the outline at every share."""
SHRINKS = 1e-7  # m: tolerance for a shrinking gap, from rounding errors
HAIR = 1e-3  # m: a motion that begins nearer to a body is tested on samples, as the exact test of turns has a tolerance


@dataclass(frozen=True, eq=False)
class Leaving:
    """Collision test with one standing person: motions must keep clear of the person's body, or leave the contact.

    A motion that begins in contact passes if the gap does not shrink until the robot is clear; it may end in contact.

    parts  collision parts of the robot
    place  (x, y) m, centre of the person's body
    body   ordinary collision test of the robot with this body alone
    size   m, radius of the body
    """

    parts: Sequence[Part]
    place: tuple[float, float]
    body: Any
    size: float

    @classmethod
    def of(cls, parts: Sequence[Part], place: tuple[float, float], area: BaseGeometry, body: Any) -> Leaving:
        """Return the test with the body of a person that covers an area, m."""
        return cls(parts, place, body, float(np.sqrt(area.area / np.pi)))

    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is clear of the body in each state (N,)."""
        free: BoolArray = self.body.states_free(states)
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether each motion (M,) keeps clear of the body, or begins in contact and does not shrink the gap.

        Once the robot is clear of the body, it must stay clear. A motion may also end in contact. A motion that begins
        within `HAIR` of the body may keep clear of it by less than the tolerance of its test.
        """
        free: BoolArray = self.body.motions_free(motions)
        some = np.flatnonzero(~free)
        some = some[self.gap(motions.start.take(some)) < self.size + HAIR]
        for first in range(0, some.size, AT_ONCE):
            rows = some[first : first + AT_ONCE]
            free[rows] = self._leads_out(motions, rows)
        return free

    def why_blocked(self, state: States) -> str:
        """Return a text: what blocks one state (1,) and a remedy; "" if the state is free."""
        return str(self.body.why_blocked(state))

    def gap(self, states: States) -> FloatArray:
        """Return the distance (N,), m, from the centre of the person's body to the robot in each state.

        If the robot covers the centre, it is 0; for a round robot it is negative.
        """
        nearest = np.full(states.size, np.inf)
        here = shapely.Point(self.place)
        for part in self.parts:
            corners = part.placed(states)  # (N, c, 2)
            points = shapely.multipoints(
                corners.reshape(-1, 2), indices=np.repeat(np.arange(states.size), corners.shape[1])
            )
            nearest = np.minimum(nearest, shapely.distance(shapely.convex_hull(points), here) - part.radius)
        return np.asarray(np.maximum(nearest, 0.0) if len(self.parts[0].corners) > 1 else nearest)

    def _leads_out(self, motions: Motions, rows: IntArray) -> BoolArray:
        """Return whether the motions with indices ``rows`` (n,), which begin in contact, are allowed to leave it.

        They are if the gap does not shrink until the robot is clear of the body, and the robot then stays clear.
        """
        law, owner = motions.law, np.repeat(rows, SHARES.size)
        share = np.tile(SHARES, rows.size)
        start, end = motions.start.take(owner), motions.end.take(owner)
        states = States(
            **{
                name: law.interpolate(name, start, end, share) if name in law.varies else getattr(start, name)
                for name in ("x", "y", "yaw")
            }
        )
        gap = self.gap(states).reshape(-1, SHARES.size)
        clear = self.body.states_free(states).reshape(-1, SHARES.size)
        out = np.logical_or.accumulate(clear, axis=1)
        grows: BoolArray = np.diff(gap, axis=1) >= -SHRINKS
        return np.asarray(((grows | out[:, :-1]) & (clear | ~out)[:, 1:]).all(axis=1))


@dataclass(frozen=True, eq=False)
class LeavingCollision(PlanarCollision):
    """Collision test of a robot that starts in contact with standing people, and may leave the contact.

    States in contact with these people count as free. Motions that begin in contact do if the gap does not shrink until
    the robot is clear of the person, and it then stays clear; they may end in contact.

    left  one test for each of these people; they are not obstacles in ``world``
    """

    left: tuple[Leaving, ...] = ()

    @property
    def yaw_matters(self) -> bool:
        """True: at a position that is not :meth:`clear`, the yaw decides whether a motion leaves contact."""
        return True

    @property
    def turn_part(self) -> float:
        """0: turns must not be cut into pieces, since a turn may be free although a piece of it is not."""
        return 0.0

    def clear(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> BoolArray:
        """Return whether the robot is free at each position (P,) at every yaw, and clear of the people in contact."""
        free = super().clear(x, y, beyond)
        for leaving in self.left:
            free &= leaving.body.clear(x, y, beyond)
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), or leaves its contact with people."""
        free = super().motions_free(motions)
        for leaving in self.left:
            free &= leaving.motions_free(motions)
        return free


def world_of_area(area: BaseGeometry) -> World:
    """Return an otherwise empty world in which one area, m, is closed to the robot."""
    x_min, y_min, x_max, y_max = area.bounds
    extent = shapely.box(x_min - FAR, y_min - FAR, x_max + FAR, y_max + FAR)
    return World.from_polygons([], extent=extent, keep_out=area)


def planar_collision(parts: tuple[Part, ...], world: World) -> PlanarCollision:
    """Return the collision test of a robot with some parts in a world.

    If the world marks people as in contact with the robot at its start, motions may leave this contact.
    """
    if not world.content.left:
        return PlanarCollision(parts, world.for_robots)
    tests = [
        Leaving.of(
            parts,
            (world.content.people[i].x, world.content.people[i].y),
            body,
            PlanarCollision(parts, world_of_area(body)),
        )
        for i, body in world.content.bodies.items()
        if i in world.content.left
    ]
    return LeavingCollision(parts, world.for_robots, tuple(tests))


def touched(parts: tuple[Part, ...], world: World, state: States) -> tuple[int, ...]:
    """Return the indices of the standing people within the required clearance of a robot in a state (1,)."""
    near = max((part.reach for part in parts), default=0.0)
    here = shapely.Point(float(state.x[0]), float(state.y[0]))
    return tuple(
        i
        for i, body in world.content.bodies.items()
        if shapely.distance(body, here) <= near
        and not PlanarCollision(parts, world_of_area(body)).states_free(state)[0]
    )


def world_with_leaving(world: World, model: Any, state: States) -> tuple[World, tuple[str, ...]]:
    """Mark the standing people that a robot touches in its start state (1,), so that it may leave the contact.

    Returns the world with these marks, and notes for the user (one that names the people, or none). For a model without
    upright parts in the plane no contact is looked for.
    """
    if "plane" not in model.provides or not world.content.bodies:
        return world.keeping(world.content.kept), ()
    places = touched(model.parts, world, state)
    if not places:
        return world.keeping(world.content.kept), ()
    who = ", ".join(repr(person.name) if (person := world.content.people[i]).name else f"number {i}" for i in places)
    near = f"within {world.content.kept:g} m of" if world.content.kept else "in contact with"
    note = (
        f"the robot starts {near} standing people: {who}; it may move away from them, as long as the gap to each does "
        "not shrink"
    )
    return world.keeping(world.content.kept, places), (note,)
