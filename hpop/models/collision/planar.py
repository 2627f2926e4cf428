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
from numpy.typing import NDArray

from hpop.arrays import BoolArray, FloatArray
from hpop.models.collision.parts import Part
from hpop.models.differential_drive.model import DifferentialDrive
from hpop.motions import Curve, Motions, States

if TYPE_CHECKING:
    from hpop.world import World
    from hpop.world.planar import FreeSpace

TOUCH = 1e-9  # m: a disc may touch
TURN_SAMPLE = math.radians(5.0)  # rad: a turn is covered by hulls of outlines at most this far apart
CURVE_MARGIN = 2e-3  # m: a curve is covered by hulls of outlines so near to each other that they are grown by this


@dataclass(frozen=True, eq=False)
class PlanarCollision:
    """Tells which states and motions of a robot are free in a world.

    Straight moves are exact. Turns of parts off the axis are covered by hulls that are never too small, and too large
    by at most 4.5 % of the part's reach: 2 sin(1.25 degrees) for the hull of two outlines 5 degrees apart, and the
    sagitta. Curves are covered in the same way, by hulls too large by 2 mm and what an outline turns between samples.
    """

    model: DifferentialDrive
    world: World

    @property
    def yaw_matters(self) -> bool:
        """Whether a position that is not :meth:`clear` can still be free at some yaw."""
        return not all(part.on_axis for part in self.model.parts)

    def clear(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether the circles that the parts sweep about positions (P,) are free: then every yaw and turn is."""
        free = np.ones(x.size, dtype=bool)
        for part in self.model.parts:
            left = np.flatnonzero(free)
            free[left] = self._space(part).clearance(x[left], y[left]) >= part.reach - TOUCH
        return free

    def states_free(self, states: States) -> BoolArray:
        """Whether the robot is free in each state (N,)."""
        return self._every_part(lambda part, at: self.part_free(part, states.take(at)), states.size)

    def part_free(self, part: Part, states: States) -> BoolArray:
        """Whether one part of the robot is free in each state (N,)."""
        return self._hulls_free(part, part.placed(states), part.radius)

    def motions_free(self, motions: Motions) -> BoolArray:
        """Whether the robot is free all along each motion (M,), ends included."""
        if isinstance(motions.law, Curve):
            return self._every_part(lambda part, at: self._curves_free(part, motions, at), len(motions))
        turning = "yaw" in motions.law.varies

        def free(part: Part, at: BoolArray) -> BoolArray:
            start, end = motions.start.take(at), motions.end.take(at)
            if turning and not part.on_axis:
                return self._turns_free(part, start, end)
            return self._hulls_free(part, np.concatenate([part.placed(start), part.placed(end)], axis=1), part.radius)

        return self._every_part(free, len(motions))

    def _space(self, part: Part) -> FreeSpace:
        return self.world.free_space((part.z_min, part.z_max))

    def _every_part(self, test: Callable[[Part, BoolArray], BoolArray], size: int) -> BoolArray:
        free = np.ones(size, dtype=bool)
        for part in self.model.parts:
            left = free.copy()
            free[left] = test(part, left)
        return free

    def _hulls_free(self, part: Part, corners: FloatArray, margin: float) -> BoolArray:
        """Whether the convex hulls of corners (N, c, 2), grown by a margin, are free: cheap tests decide most."""
        space = self._space(part)
        centre = corners.mean(axis=1)
        round_it = np.hypot(*(corners - centre[:, None]).transpose(2, 0, 1)).max(axis=1, initial=0.0)
        distance = space.clearance(centre[:, 0], centre[:, 1])
        free: BoolArray = distance >= margin + round_it + TOUCH
        open_ = np.flatnonzero(~free & (distance >= margin - TOUCH))
        free[open_] = space.shapes_free(_hulls(corners[open_], straight=bool((round_it[open_] > 0).all())), margin)
        return free

    def _turns_free(self, part: Part, start: States, end: States) -> BoolArray:
        """Cover each turn by hulls of outlines at neighbouring yaws, grown by the sagitta of the arcs between."""
        turned = np.abs(end.yaw - start.yaw)
        pieces = np.maximum(1, np.ceil(turned / TURN_SAMPLE)).astype(np.int64)
        owner = np.repeat(np.arange(start.size), pieces)
        piece = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        step = ((end.yaw - start.yaw) / pieces)[owner]
        yaw = start.yaw[owner] + piece * step
        ends = [States(x=start.x[owner], y=start.y[owner], yaw=y) for y in (yaw, yaw + step)]
        sagitta = part.reach * (1.0 - math.cos(TURN_SAMPLE / 2))
        corners = np.concatenate([part.placed(states) for states in ends], axis=1)
        free = np.ones(start.size, dtype=bool)
        np.logical_and.at(free, owner, self._hulls_free(part, corners, part.radius + sagitta))
        return free

    def _curves_free(self, part: Part, motions: Motions, at: BoolArray) -> BoolArray:
        """Cover curves by hulls of outlines at neighbouring moments, grown by what points of the robot bend between.

        A point at distance r from the axis accelerates by no more than |a| + |v ω| + r (|α| + ω²), A, and so leaves the
        chord of its way in a time Δ by no more than A Δ²/8.
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
        owner = np.repeat(np.arange(start.size), pieces)
        piece = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        begin, finish = start.take(owner), end.take(owner)
        corners = []
        for number in (piece, piece + 1):
            share = number / pieces[owner]
            columns = {name: law.interpolate(name, begin, finish, share) for name in ("x", "y", "yaw")}
            corners.append(part.placed(States(**columns)))
        free = np.ones(start.size, dtype=bool)
        outlines = np.concatenate(corners, axis=1)
        np.logical_and.at(free, owner, self._hulls_free(part, outlines, part.radius + CURVE_MARGIN))
        return free


def _hulls(corners: FloatArray, *, straight: bool) -> NDArray[np.object_]:
    """Convex hulls of corners (N, c, 2); of two that differ (``straight``) the line, made in a tenth of the time."""
    size, count, _ = corners.shape
    if count == 2 and straight:
        return np.asarray(shapely.linestrings(corners), dtype=object)
    points = shapely.multipoints(corners.reshape(-1, 2), indices=np.repeat(np.arange(size), count))
    return np.asarray(shapely.convex_hull(points), dtype=object)


def why_blocked(model: DifferentialDrive, world: World, x: float, y: float, yaw: float) -> str:
    """What blocks a state and what helps, in words without the last full stop; empty when it is free."""
    collision = PlanarCollision(model, world)
    one = States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw]))
    if collision.states_free(one)[0]:
        return ""
    here = shapely.Point(x, y)
    if not shapely.covers(world.extent, here):
        x_min, y_min, x_max, y_max = world.bounds
        spans = f"x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"
        return f"it is outside the map, which spans {spans}. Move it"
    if shapely.covers(world.closed, here):
        return "it is in a keep-out zone or in a person who stands there. Move it"
    part = next(part for part in model.parts if not collision.part_free(part, one)[0])
    if shapely.covers(world.solid(part.z_min, part.z_max), here):
        return "it is inside an obstacle. Move it"
    distance = float(world.clearance(one.x, one.y, z=(part.z_min, part.z_max))[0])
    return (
        f"the nearest obstacle, keep-out zone or map border is {distance:.3f} m away and the robot reaches "
        f"{part.reach:.3f} m. Move it, or take a smaller robot"
    )
