"""Collision test for planning: a robot made of upright prisms against obstacles made of upright prisms.

Two prisms collide if their height ranges overlap and their outlines overlap. Each part of the robot is therefore tested
with the obstacles at its own height: a flat robot passes under a high table, its mast does not. Every part must also
stay within the border of the map and out of keep-out zones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray, numbered
from hpop.base.text import shown
from hpop.models.collision import Part, joints_of
from hpop.motions import Motions, PlaneCollision, States, is_curve
from hpop.runtime import limits
from hpop.world.geometry.shapes import overlaps

if TYPE_CHECKING:
    from hpop.models.rigid import PlanarCurve
    from hpop.world import World
    from hpop.world.geometry.planar import FreeSpace

TOUCH = 1e-9  # m: tolerance, so that a disc may touch an obstacle
INNER = 1e-6  # m by which the border must reach into the disc about the axis within a part, more than any rounding
TURN_SAMPLE = math.radians(5.0)  # rad: largest angle between the outlines whose hulls cover a turn
LONG = 4.0  # m: longer straight moves are halved, so that few edges of the map are in the bounding box of a piece
TOGETHER = 4096  # number of hulls tested between two checks of the time limit
LEVEL = 0.01  # m: heights of parts on joints are rounded to multiples of this
CURVE_MARGIN = 2e-3  # m: by how much hulls that cover a curve are grown; it determines their spacing


def blocking_reason(world: World, part: Part, x: float, y: float) -> str:
    """Return a text, without final full stop: what blocks a part of a robot whose axis is at (x, y), and a remedy."""
    here = shapely.Point(x, y)
    if not shapely.covers(world.extent, here):
        x_min, y_min, x_max, y_max = world.bounds
        spans = f"x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"
        return f"it is outside the map, which spans {spans}. Move it"
    if shapely.covers(world.closed, here):
        return "it is in a keep-out zone or in a standing person. Move it"
    if shapely.covers(world.solid(part.z_min, part.z_max), here):
        return f"it is inside {_name(world, part, here, 0.0) or 'an obstacle'}. Move it"
    distance = float(world.clearance(np.array([x]), np.array([y]), z=(part.z_min, part.z_max))[0])
    nearest = _name(world, part, here, distance) or "the nearest obstacle, keep-out zone or map border"
    return (
        f"{nearest} is {distance:.3f} m away and the robot reaches {part.reach:.3f} m. Move it, or take a smaller robot"
    )


def _name(world: World, part: Part, here: shapely.Point, distance: float) -> str:
    """Return "the obstacle NAME" for the first named obstacle within a distance, m, of a point, or "" if there is none.

    Only obstacles at the height of the part count.
    """
    met = (o for o in world.obstacles if o.name and overlaps(o.heights, (part.z_min, part.z_max)))
    return next(
        (f"the obstacle {shown(o.name)}" for o in met if shapely.distance(o.polygon, here) <= distance + 1e-9), ""
    )


@dataclass(frozen=True, eq=False)
class PlanarCollision:
    """Collision test of a robot made of upright prisms in a world, for states and whole motions.

    parts  collision parts of the robot: upright prisms in the frame of the base
    world  obstacles and zones

    The test of straight moves is exact. The area that a turn sweeps with a part off the axis is covered by convex hulls
    of the part's outlines, 5 degrees apart. They are never too small, and too large by at most 4.5 % of the part's
    reach: 2 sin(1.25 degrees) for the hull, plus the bulge of the arc beyond its chord. Moves that turn and parts on
    joints are covered in the same way; heights of parts on joints are rounded outwards. Hulls that cover a curve are
    too large by 2 mm plus the rotation of an outline between two samples. Laws of curves must follow
    :class:`hpop.models.rigid.PlanarCurve`.
    """

    parts: tuple[Part, ...]
    world: World

    @property
    def yaw_matters(self) -> bool:
        """True if a position that is not :meth:`clear` can still be free at some yaw; False for discs on the axis."""
        return not all(part.on_axis and not part.on for part in self.parts)

    @property
    def posture_matters(self) -> bool:
        """True if collisions depend not only on x, y and yaw but also on joints that carry parts."""
        return any(part.on for part in self.parts)

    @property
    def turn_part(self) -> float:
        """Largest angle, rad, that one convex hull covers when a turn is tested: a turn is tested as a row of hulls.

        A turn that is cut at multiples of this angle is covered by the same hulls as the whole turn.
        """
        return TURN_SAMPLE

    def clear(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> BoolArray:
        """Return whether the circles that the parts sweep about positions (P,), ``beyond`` m larger, are free.

        Then every yaw and turn is free, and every move within ``beyond``.
        """
        reaches: dict[FreeSpace, float] = {}  # largest reach of the parts at the heights of each free space
        for part in (part.swept for part in self.parts):
            space = self._free_space(part)
            reaches[space] = max(part.reach, reaches.get(space, 0.0))
        free = np.ones(x.size, dtype=bool)
        for space, reach in reaches.items():
            left = np.flatnonzero(free)
            free[left] = space.clearance(x[left], y[left]) >= reach + beyond - TOUCH
        return free

    def differs(self, before: PlaneCollision, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return a mask (P,) of the positions near which collisions may have changed since an earlier world.

        before  collision test in the earlier world; for another robot, or one with joints, the mask is True everywhere
        x, y    m, positions (P,)
        within  m, distance from each position within which changes count
        """
        if not isinstance(before, PlanarCollision) or before.parts != self.parts or self.posture_matters:
            return np.ones(x.shape, dtype=np.bool_)
        spaces = {self._free_space(part): before._free_space(part) for part in self.parts}
        found = np.zeros(x.shape, dtype=np.bool_)
        for now, then in spaces.items():
            found |= now.differs(then, x, y, within)
        return found

    @checked_arguments
    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""
        return self._every_part(lambda part, at: self.part_free(part, states.take(at)), states.size)

    def part_free(self, part: Part, states: States) -> BoolArray:
        """Return whether one part of the robot is free in each state (N,).

        Where the clearance at the axis is less than the part's inner reach, it is blocked at every yaw. Consecutive
        states at one position, as those of a lattice, take one look-up.
        """
        if part.inner_reach <= INNER:
            return self._outlines_free(part, part.placed(states), part.radius, states)
        moved = (np.diff(states.x, prepend=np.nan) != 0) | (np.diff(states.y, prepend=np.nan) != 0)
        first = np.flatnonzero(moved)
        clearance = self._free_space(part).clearance(states.x[first], states.y[first])
        free: BoolArray = (clearance >= part.inner_reach - INNER)[np.cumsum(moved) - 1]
        open_ = states.take(np.flatnonzero(free))
        free[free] = self._outlines_free(part, part.placed(open_), part.radius, open_)
        return free

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

    @checked_arguments
    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        blocked = next((part for part in self.parts if not self.part_free(part, state)[0]), None)
        if blocked is None:
            return ""
        lift = float(blocked.lift(state)[0])
        blocked = blocked.between(blocked.z_min + lift, blocked.z_max + lift) if blocked.on else blocked
        return blocking_reason(self.world, blocked, float(state.x[0]), float(state.y[0]))

    def _free_space(self, part: Part) -> FreeSpace:
        """Return the free space of the world at the heights of a part."""
        return self.world.free_space((part.z_min, part.z_max))

    def _every_part(self, test: Callable[[Part, BoolArray], BoolArray], size: int) -> BoolArray:
        """Return which of ``size`` states or motions are free for all parts.

        ``test`` takes a part and the mask of those that are free for all parts before it, and tests only these.
        """
        free = np.ones(size, dtype=bool)
        for part in self.parts:
            left = free.copy()
            free[left] = test(part, left)
        return free

    def _outlines_free(self, part: Part, corners: FloatArray, margin: float, *ends: States) -> BoolArray:
        """Return whether convex hulls of corners (N, c, 2), grown by ``margin`` m, are free at the heights of a part.

        ends  states (N,) at both ends of a motion, which give the heights of a part on joints. Heights are rounded
              outwards to multiples of 1 cm, so that few of them differ
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
        """Return whether a part carried by joints is free all along each motion from states ``start`` to ``end`` (N,).

        A motion is cut into pieces, and each piece is covered by the convex hull of the part's outlines at its ends.
        All states change evenly. If base and hinges together turn by Δ in a piece, and slides move by S, a point at
        distance r from their axes is at most (r Δ² + 2 Δ S)/8 from its chord; hulls are grown by that.
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
        """Return whether convex hulls of corners (N, c, 2), grown by ``margin`` m, are free at the heights of a part.

        Distances from the centre of each hull decide most cases; the exact test is made for the others.
        """
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
        """Return whether a part is free on straight moves, which move its corners (N, c, 2) from ``start`` to ``end``.

        A long move is halved repeatedly, until its middle is blocked or its pieces are short. The pieces together sweep
        exactly the area of the move.
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
        """Return whether a part is free during turns in place, or (``moving``) during straight moves that turn.

        Each turn is cut into pieces of at most Δ = 5 degrees, and each piece is covered by the convex hull of the
        part's outlines at its ends, grown by the bulge of the arcs in it. In place, a point at distance r from the axis
        is at most r (1 - cos(Δ/2)) from the chord of its arc. On a straight move that turns, it is at most r Δ²/8 from
        the chord.
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
        """Return whether a part is free on those curves of a batch that the mask ``at`` selects.

        Each curve is cut into equal shares, and each piece is covered by the convex hull of the part's outlines at its
        ends, grown by the bulge of the paths in it, which the law bounds.
        """
        start, end, law = motions.start.take(at), motions.end.take(at), cast("PlanarCurve", motions.law)
        pieces = np.maximum(1, law.pieces(start, end, part.reach, CURVE_MARGIN)).astype(np.int64)
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
    """Return into how many pieces (N,) turns by angles (N,), rad, are cut, so that none exceeds 5 degrees.

    Rounding errors of an angle add no piece.
    """
    return np.maximum(1, np.ceil(turned / TURN_SAMPLE - 1e-6)).astype(np.int64)
