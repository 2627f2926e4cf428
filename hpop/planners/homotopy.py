"""Whether two ways between the same ends pass all obstacles on the same sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from hpop.arrays import FloatArray
from hpop.math import wrap

if TYPE_CHECKING:
    from hpop.world.planar import FreeSpace


def homotopic(one: FloatArray, other: FloatArray, space: FreeSpace) -> bool:
    """Whether a way (N, 2) can be deformed into another (M, 2) with the same ends without crossing an obstacle.

    Together, there and back, the two are a loop. It winds round some of the faces into which the two cut the plane; if
    all of these are free, the loop can be drawn together through them. So yes is always right. No is right wherever
    the loop winds about an obstacle at all, which is everywhere but for loops that undo their own windings in another
    order.

    >>> from hpop.world import World
    >>> room = World.from_polygons([shapely.box(4, 4, 6, 6)], extent=shapely.box(0, 0, 10, 10))
    >>> ways = [np.array([(1.0, 5.0), (5.0, y), (9.0, 5.0)]) for y in (2.0, 3.0, 8.0)]
    >>> [homotopic(ways[0], way, room.free_space((0.0, 1.0))) for way in ways]
    [True, True, False]
    """
    faces = between(one, other)
    return bool(space.shapes_free(faces, 0.0).all()) if faces.size else True


def between(one: FloatArray, other: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.object_]]:
    """Faces, as polygons, about which the loop along one way and back along the other winds."""
    lines = shapely.union_all([shapely.LineString(one), shapely.LineString(other)])
    faces = shapely.get_parts(
        shapely.polygonize([lines] if lines.geom_type == "LineString" else shapely.get_parts(lines))
    )
    loop = np.concatenate([one, other[::-1], one[:1]])
    inside = shapely.get_coordinates(shapely.point_on_surface(faces))
    angles = np.arctan2(*(loop[None] - inside[:, None]).transpose(2, 0, 1)[::-1])  # (faces, points)
    windings = wrap(np.diff(angles, axis=1)).sum(axis=1)
    return np.asarray(faces[np.abs(windings) > np.pi])
