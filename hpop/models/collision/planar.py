"""Collision in the plane: a robot made of upright prisms against obstacles made of upright prisms.

Prisms collide where their height ranges overlap and their outlines do, so each part of the robot is checked against the
obstacles at its own height: a flat robot passes under a high table, its mast does not. Every part must also stay in the
extent and off the keep-out zones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray, numbered
from hpop.base.text import shown
from hpop.models.collision.parts import Part, joints_of
from hpop.motions import Motions, PlaneCollision, States, is_curve
from hpop.runtime import limits
from hpop.world.geometry.shapes import overlaps

if TYPE_CHECKING:
    from hpop.world import World
    from hpop.world.geometry.planar import FreeSpace

TOUCH = 1e-9  # m: a disc may touch
TURN_SAMPLE = math.radians(5.0)  # rad: a turn is covered by hulls of outlines at most this far apart
LONG = 4.0  # m: longer straight moves are halved, so that few edges of the map are in the bounding box of a piece
TOGETHER = 4096  # number of hulls tested between two checks of the limits
LEVEL = 0.01  # m: heights of parts on joints are rounded to multiples
CURVE_MARGIN = 2e-3  # m: margin of the hulls that cover a curve, which sets their spacing


def blocking_reason(world: World, part: Part, x: float, y: float) -> str:
    """Return what blocks a part of a robot whose axis is at (x, y), and a remedy, without the final full stop."""
    here = shapely.Point(x, y)
    if not shapely.covers(world.extent, here):
        x_min, y_min, x_max, y_max = world.bounds
        spans = f"x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"
        return f"it is outside the map, which spans {spans}. Move it"
    if shapely.covers(world.closed, here):
        return "it is in a keep-out zone or in a person who stands there. Move it"
    if shapely.covers(world.solid(part.z_min, part.z_max), here):
        return f"it is inside {_name(world, part, here, 0.0) or 'an obstacle'}. Move it"
    distance = float(world.clearance(np.array([x]), np.array([y]), z=(part.z_min, part.z_max))[0])
    nearest = _name(world, part, here, distance) or "the nearest obstacle, keep-out zone or map border"
    return (
        f"{nearest} is {distance:.3f} m away and the robot reaches {part.reach:.3f} m. Move it, or take a smaller robot"
    )


def _name(world: World, part: Part, here: shapely.Point, distance: float) -> str:
    """Return the name of the obstacle within a distance (m) at the height of a part, as text; "" without a name."""
    met = (o for o in world.obstacles if o.name and overlaps(o.heights, (part.z_min, part.z_max)))
    return next(
        (f"the obstacle {shown(o.name)}" for o in met if shapely.distance(o.polygon, here) <= distance + 1e-9), ""
    )


@dataclass(frozen=True, eq=False)
class PlanarCollision:
    """Collision test of a robot of upright prisms in a world, for states and whole motions.

    parts  upright prisms in the frame of the base
    world

    Straight moves are exact. Turns of parts off the axis are covered by hulls that are never too small, and too large
    by at most 4.5 % of the part's reach: 2 sin(1.25 degrees) for the hull of two outlines 5 degrees apart, and the
    sagitta. Moves that turn are covered likewise, and so are parts on joints, with heights rounded outwards. Hulls of
    curves are too large by 2 mm and the rotation of an outline between samples; the states of curves have a ``speed``
    and a ``turn_rate``, which change linearly with time.
    """

    parts: tuple[Part, ...]
    world: World

    @property
    def yaw_matters(self) -> bool:
        """True if a position that is not :meth:`clear` can still be free at some yaw."""
        return not all(part.on_axis and not part.on for part in self.parts)

    @property
    def posture_matters(self) -> bool:
        """True if collisions depend on joints that carry parts, beside x, y and yaw."""
        return any(part.on for part in self.parts)

    @property
    def turn_part(self) -> float:
        """Angle, rad, between the outlines whose hulls cover a turn: so its parts have the same hulls as the whole."""
        return TURN_SAMPLE

    def clear(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return whether the circles that the parts sweep about positions (P,) are free.

        Then every yaw and turn is free.
        """
        reaches: dict[FreeSpace, float] = {}  # of the widest part in each: mostly all parts have one in common
        for part in (part.swept for part in self.parts):
            space = self._free_space(part)
            reaches[space] = max(part.reach, reaches.get(space, 0.0))
        free = np.ones(x.size, dtype=bool)
        for space, reach in reaches.items():
            left = np.flatnonzero(free)
            free[left] = space.clearance(x[left], y[left]) >= reach - TOUCH
        return free

    def differs(self, before: PlaneCollision, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return a mask (P,) of positions where collisions within ``within`` m may differ from an earlier world's."""
        if not isinstance(before, PlanarCollision) or before.parts != self.parts or self.posture_matters:
            return np.ones(x.shape, dtype=np.bool_)
        spaces = {self._free_space(part): before._free_space(part) for part in self.parts}
        found = np.zeros(x.shape, dtype=np.bool_)
        for now, then in spaces.items():
            found |= now.differs(then, x, y, within)
        return found

    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""
        return self._every_part(lambda part, at: self.part_free(part, states.take(at)), states.size)

    def part_free(self, part: Part, states: States) -> BoolArray:
        """Return whether one part of the robot is free in each state (N,)."""
        return self._outlines_free(part, part.placed(states), part.radius, states)

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), ends included."""
        if is_curve(motions.law):
            return self._every_part(lambda part, at: self._curves_free(part, motions, at), len(motions))
        turning, moving = "yaw" in motions.law.varies, bool({"x", "y"} & motions.law.varies)

        def free(part: Part, at: BoolArray) -> BoolArray:
            start, end = motions.start.take(at), motions.end.take(at)
            if part.on:
                return self._carried_free(part, start, end)
            if turning and not part.on_axis:
                return self._turns_free(part, start, end, moving=moving)
            return self._straight_free(part, part.placed(start), part.placed(end))

        return self._every_part(free, len(motions))

    def why_blocked(self, state: States) -> str:
        """Return what blocks one state and a remedy, without the final full stop; "" if the state is free."""
        blocked = next((part for part in self.parts if not self.part_free(part, state)[0]), None)
        if blocked is None:
            return ""
        lift = float(blocked.lift(state)[0])
        blocked = blocked.between(blocked.z_min + lift, blocked.z_max + lift) if blocked.on else blocked
        return blocking_reason(self.world, blocked, float(state.x[0]), float(state.y[0]))

    def _free_space(self, part: Part) -> FreeSpace:
        return self.world.free_space((part.z_min, part.z_max))

    def _every_part(self, test: Callable[[Part, BoolArray], BoolArray], size: int) -> BoolArray:
        free = np.ones(size, dtype=bool)
        for part in self.parts:
            left = free.copy()
            free[left] = test(part, left)
        return free

    def _outlines_free(self, part: Part, corners: FloatArray, margin: float, *ends: States) -> BoolArray:
        """Return whether hulls of corners (N, c, 2), grown by a margin, are free at the heights of a part.

        ends  states at which joints determine these heights; they are rounded outwards, so that few differ
        """
        if not part.on:
            return self._hulls_free(part, corners, margin)
        lifts = [part.lift(states) for states in ends]
        low, high = part.z_min + np.minimum.reduce(lifts), part.z_max + np.maximum.reduce(lifts)
        spans = np.stack([np.floor(low / LEVEL), np.ceil(high / LEVEL)], axis=1) * LEVEL
        each, which = np.unique(spans, axis=0, return_inverse=True)
        free = np.zeros(len(corners), dtype=bool)
        for i, (z_min, z_max) in enumerate(each.tolist()):
            at = which.ravel() == i
            free[at] = self._hulls_free(part.between(z_min, z_max), corners[at], margin)
        return free

    def _carried_free(self, part: Part, start: States, end: States) -> BoolArray:
        """Return whether a part carried by joints is free, by hulls of its outlines at neighbouring states.

        All states change evenly. In a piece in which base and hinges turn by Δ together and slides go S, a point at
        distance r from their axes leaves its chord by no more than (r Δ² + 2 Δ S)/8.
        """
        names = ("x", "y", "yaw", *joints_of([part]))
        change = {name: getattr(end, name) - getattr(start, name) for name in names}
        hinges = [joint for joint in part.on if joint.along == "round"]
        slides = [joint.name for joint in part.on if joint.along in ("ahead", "left")]
        turned = sum(np.abs(change[name]) for name in ("yaw", *(joint.name for joint in hinges)))
        pieces = _turn_pieces(turned)
        owner, piece = numbered(pieces)
        ends = [
            States(**{n: getattr(start, n)[owner] + number / pieces[owner] * change[n][owner] for n in names})
            for number in (piece, piece + 1)
        ]
        turn = float((turned / pieces).max(initial=0.0))
        slid = float(sum(np.abs(change[name] / pieces) for name in slides).max(initial=0.0)) if slides else 0.0
        lever = part.reach + max((joint.lever for joint in hinges), default=0.0)
        margin = part.radius + (lever * turn + 2.0 * slid) * turn / 8.0
        outlines = np.concatenate([part.placed(states) for states in ends], axis=1)
        free = np.ones(start.size, dtype=bool)
        np.logical_and.at(free, owner, self._outlines_free(part, outlines, margin, *ends))
        return free

    def _hulls_free(self, part: Part, corners: FloatArray, margin: float) -> BoolArray:
        """Return whether convex hulls of corners (N, c, 2), grown by a margin, are free: cheap tests decide most."""
        space = self._free_space(part)
        centre = corners.mean(axis=1)
        round_it = np.hypot(*(corners - centre[:, None]).transpose(2, 0, 1)).max(axis=1, initial=0.0)
        distance = space.clearance(centre[:, 0], centre[:, 1])
        free: BoolArray = distance >= margin + round_it + TOUCH
        open_ = np.flatnonzero(~free & (distance >= margin - TOUCH))
        for begin in range(0, open_.size, TOGETHER):
            limits.check("motions were checked for collisions")
            some = open_[begin : begin + TOGETHER]
            free[some] = space.hulls_free(corners[some], margin)
        return free

    def _straight_free(self, part: Part, start: FloatArray, end: FloatArray) -> BoolArray:
        """Return whether a part is free on straight moves, from corners (N, c, 2) ``start`` to corners ``end``.

        A long move is halved until its middle is found blocked or its pieces are short. The pieces together sweep the
        area of the move.
        """
        free, owner = np.ones(len(start), dtype=bool), np.arange(len(start))
        while (long := np.hypot(*(end - start)[:, 0].T) > LONG).any():
            limits.check("straight moves were checked for collisions")
            middle = (start[long] + end[long]) / 2
            centre = middle.mean(axis=1)
            away = np.hypot(*(np.concatenate([start, end], axis=1)[long] - centre[:, None]).transpose(2, 0, 1))
            distance = self._free_space(part).clearance(centre[:, 0], centre[:, 1])
            free[owner[long][distance < part.radius - TOUCH]] = False
            settled = np.zeros(len(start), dtype=bool)
            settled[long] = distance >= part.radius + away.max(axis=1) + TOUCH
            halved = ~settled[long]
            start, end, owner = (
                np.concatenate([start, middle[halved]]),
                np.concatenate([end, end[long][halved]]),
                np.concatenate([owner, owner[long][halved]]),
            )
            end[np.flatnonzero(long)] = middle
            left = free[owner] & ~np.append(settled, np.zeros(halved.sum(), dtype=bool))
            start, end, owner = start[left], end[left], owner[left]
        np.logical_and.at(free, owner, self._hulls_free(part, np.concatenate([start, end], axis=1), part.radius))
        return free

    def _turns_free(self, part: Part, start: States, end: States, *, moving: bool) -> BoolArray:
        """Return whether a part is free on turns, in place or moving, by hulls of outlines at neighbouring yaws.

        Hulls are grown by the bulge of the arcs between. In place, a point leaves the chord of its arc by no more than
        the sagitta, r (1 - cos(Δ/2)). On a straight path the arc moves evenly along, and the point leaves its chord by
        no more than r Δ²/8.
        """
        turned = np.abs(end.yaw - start.yaw)
        pieces = _turn_pieces(turned)
        owner, piece = numbered(pieces)
        corners = []
        begin = {name: getattr(start, name)[owner] for name in ("x", "y", "yaw")}
        steps = {name: ((getattr(end, name) - getattr(start, name)) / pieces)[owner] for name in ("x", "y", "yaw")}
        yaw = begin["yaw"] + piece * steps["yaw"]
        for number, turned_to in ((piece, yaw), (piece + 1, yaw + steps["yaw"])):
            x, y = (begin[axis] + number * steps[axis] if moving else begin[axis] for axis in ("x", "y"))
            corners.append(part.placed(States(x=x, y=y, yaw=turned_to)))
        bulge = TURN_SAMPLE * TURN_SAMPLE / 8 if moving else 1.0 - math.cos(TURN_SAMPLE / 2)
        free = np.ones(start.size, dtype=bool)
        outlines = np.concatenate(corners, axis=1)
        np.logical_and.at(free, owner, self._hulls_free(part, outlines, part.radius + part.reach * bulge))
        return free

    def _curves_free(self, part: Part, motions: Motions, at: BoolArray) -> BoolArray:
        """Return whether a part is free on curves, by covering hulls of outlines at neighbouring times.

        Hulls are grown by the bulge of paths between. A point at distance r from the axis accelerates by no more than
        A = |a| + |v ω| + r (|α| + ω²), so within a time Δ it leaves its chord by no more than A Δ²/8.
        """
        start, end, law = motions.start.take(at), motions.end.take(at), motions.law
        lasts = motions.duration[at]
        per_second = np.divide(1.0, lasts, out=np.zeros(lasts.shape), where=lasts > 0)
        speed, turning = (
            np.maximum(np.abs(getattr(start, n)), np.abs(getattr(end, n))) for n in ("speed", "turn_rate")
        )
        gain, bend = (np.abs(getattr(end, n) - getattr(start, n)) * per_second for n in ("speed", "turn_rate"))
        most = gain + speed * turning + part.reach * (bend + turning * turning)
        pieces = np.maximum(1, np.ceil(lasts * np.sqrt(most / (8.0 * CURVE_MARGIN)))).astype(np.int64)
        owner, piece = numbered(pieces)
        begin, finish = start.take(owner), end.take(owner)
        corners = []
        for number in (piece, piece + 1):
            share = number / pieces[owner]
            columns = {name: law.interpolate(name, begin, finish, share) for name in ("x", "y", "yaw")}
            columns |= {name: getattr(begin, name) for name in joints_of([part])}  # no curve moves a joint
            corners.append(part.placed(States(**columns)))
        free = np.ones(start.size, dtype=bool)
        outlines = np.concatenate(corners, axis=1)
        np.logical_and.at(free, owner, self._outlines_free(part, outlines, part.radius + CURVE_MARGIN, begin))
        return free


def _turn_pieces(turned: FloatArray) -> IntArray:
    """Return the number of pieces (N,) that cover turns by angles (N,), rad; rounding of an angle adds none."""
    return np.maximum(1, np.ceil(turned / TURN_SAMPLE - 1e-6)).astype(np.int64)
