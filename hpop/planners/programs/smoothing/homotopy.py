"""Whether two ways between the same ends pass all obstacles on the same sides, in the same order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from hpop.base.arrays import FloatArray

if TYPE_CHECKING:
    from hpop.world.geometry.planar import FreeSpace


def homotopic(one: FloatArray, other: FloatArray, space: FreeSpace) -> bool:
    """Whether a way (N, 2) can be deformed into another (M, 2) with the same ends without crossing an obstacle.

    Both lie in the free space. Together, there and back, they are a loop. From a point in each hole of the free space a
    ray goes up; which rays the loop crosses, and from which side, is a word, in which a crossing and the next back over
    the same ray cancel. The loop can be drawn together if and only if nothing is left of it: the plane without some
    points has a free group of loops, one generator a point. Winding numbers tell less: a loop round two obstacles, then
    back round each of them, winds about neither and yet is caught.

    >>> from hpop.world import World
    >>> room = World.from_polygons([shapely.box(4, 4, 6, 6)], extent=shapely.box(0, 0, 10, 10))
    >>> ways = [np.array([(1.0, 5.0), (5.0, y), (9.0, 5.0)]) for y in (2.0, 3.0, 8.0)]
    >>> [homotopic(ways[0], way, room.free_space((0.0, 1.0))) for way in ways]
    [True, True, False]
    """
    loop = np.concatenate([one, other[::-1], one[:1]])
    return not word(loop, holes(loop, space))


def holes(loop: FloatArray, space: FreeSpace) -> FloatArray:
    """A point (H, 2), m, in each hole of a free space about which a loop may go: those in the loop's box."""
    (x_min, y_min), (x_max, y_max) = loop.min(axis=0), loop.max(axis=0)
    parts = shapely.get_parts(space.region)
    inner = [shapely.get_interior_ring(part, i) for part in parts for i in range(shapely.get_num_interior_rings(part))]
    rings = np.array(inner, dtype=object)
    left, below, right, above = shapely.bounds(rings).reshape(-1, 4).T
    inside = np.flatnonzero((left > x_min) & (right < x_max) & (below > y_min) & (above < y_max))
    return shapely.get_coordinates(shapely.point_on_surface(shapely.polygons(rings[inside])))


def word(loop: FloatArray, points: FloatArray) -> list[int]:
    """Which rays, up from points (H, 2), a loop (L, 2) crosses, reduced: i + 1 to the right over ray i, -i - 1 back."""
    (x, y), (px, py) = loop.T[:, :, None], points.T[:, None, :]
    ahead = (x[:-1] <= px) & (px < x[1:])
    aback = (x[1:] <= px) & (px < x[:-1])
    segment, ray = np.nonzero(ahead | aback)
    begin, end, at = x[segment, 0], x[segment + 1, 0], px[0, ray]
    share = (at - begin) / (end - begin)
    over = y[segment, 0] + share * (y[segment + 1, 0] - y[segment, 0]) > py[0, ray]
    letter = np.where(ahead[segment, ray], ray + 1, -ray - 1)
    # Of rays that stand in one line each is a little to the right of those before it.
    order = np.lexsort((letter, share, segment))
    left: list[int] = []
    for one in letter[order[over[order]]].tolist():
        if left and left[-1] == -one:
            left.pop()
        else:
            left.append(one)
    return left
