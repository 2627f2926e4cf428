"""A camera's view by shapely: rays in the plane cut obstacles in intervals, and heights decide along each."""

import math

import numpy as np
import shapely

import hpop

FAR = 200.0


def seen(world: hpop.World, position, bearings, elevations, storey: float = 3.0):
    """Return the place, from 1, of the obstacle that each line of sight (N,) meets first; 0 for floor and sky."""
    x, y, h = position
    ends = np.stack([x + FAR * np.cos(bearings), y + FAR * np.sin(bearings)], axis=1)
    starts = np.broadcast_to([x, y], ends.shape)
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    nearest, found = np.full(len(lines), np.inf), np.zeros(len(lines), int)
    slopes = np.tan(elevations)
    obstacles = [o.polygon for o in world.obstacles]
    for i, k in shapely.STRtree(obstacles).query(lines, predicate="intersects").T:
        obstacle = world.obstacles[k]
        low = max(obstacle.z_min, -FAR) if math.isfinite(obstacle.z_min) else 0.0
        high = obstacle.z_max if math.isfinite(obstacle.z_max) else storey
        for part in shapely.get_parts(lines[i].intersection(obstacle.polygon)):
            along = np.hypot(*(shapely.get_coordinates(part) - (x, y)).T)
            if len(along) < 2:
                continue
            t0, t1 = along.min(), along.max()
            if slopes[i]:  # where it is between both heights
                cuts = sorted(((low - h) / slopes[i], (high - h) / slopes[i]))
                t0, t1 = max(t0, cuts[0]), min(t1, cuts[1])
            elif not low <= h <= high:
                continue
            on_floor = -h / slopes[i] if slopes[i] < 0 else np.inf
            if t0 <= t1 and t0 < nearest[i] and t0 <= on_floor:
                nearest[i], found[i] = t0, k + 1
    return found


def angles(width: int, rows, columns, yaw: float):
    """Bearings and elevations, rad, of the middles of pixels."""
    height = width // 2
    bearings = yaw + (width / 2 - np.asarray(columns) - 0.5) * 2 * math.pi / width
    return bearings, (height / 2 - np.asarray(rows) - 0.5) * math.pi / height
