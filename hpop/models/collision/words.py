"""Why a robot is blocked where it stands, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from hpop.base.text import shown
from hpop.models.collision.parts import Part
from hpop.world.geometry.shapes import overlaps

if TYPE_CHECKING:
    from hpop.world import World


def reason(world: World, part: Part, x: float, y: float) -> str:
    """What blocks a part of a robot at a position of its axis and what helps, without the last full stop."""
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
    """What the obstacle within a distance (m) is called, of those a part of a robot meets; "" where it has no name."""
    met = (o for o in world.obstacles if o.name and overlaps(o.heights, (part.z_min, part.z_max)))
    return next(
        (f"the obstacle {shown(o.name)}" for o in met if shapely.distance(o.polygon, here) <= distance + 1e-9), ""
    )
