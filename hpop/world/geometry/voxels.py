"""Boxes that cover points in space: cubic cells (voxels) of a grid that contain points, merged into larger boxes."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import FARTHEST
from hpop.errors import MapError
from hpop.world.geometry.solids import MOST_SOLIDS, Box, Solid

FINEST = 1e-3
"""Smallest side of a cell, m."""


def voxels_of(points: FloatArray, resolution: float) -> IntArray:
    """Return the cells (n, 3) that contain points (N, 3), m, each once.

    Cell (i, j, k) reaches from (i, j, k) times the resolution, m, to (i + 1, j + 1, k + 1) times the resolution.
    """
    if points.size and not np.abs(points).max() <= FARTHEST:
        raise MapError(
            f"points must be within {FARTHEST:,.0f} m of the origin, got one with the coordinate "
            f"{points.flat[np.abs(points).argmax()]:.4g}; give them in m."
        )
    cells = np.floor(points / resolution).astype(np.int64)
    return np.unique(cells, axis=0).reshape(-1, 3)


def boxes_of(cells: IntArray, resolution: float) -> list[Solid]:
    """Return boxes that together cover exactly these cells (n, 3), each given once.

    Adjacent cells in a row along x become one box. Then boxes of equal cross-section that touch along y are joined, and
    finally along z.
    """
    low, high = cells.astype(np.int64), cells.astype(np.int64) + 1
    for axis in range(3):
        low, high = _joined(low, high, axis)
    if len(low) > MOST_SOLIDS:
        coarser = resolution
        while True:
            coarser *= 2.0
            few = np.unique(np.floor(cells * (resolution / coarser)).astype(np.int64), axis=0)
            ends = few, few + 1
            for axis in range(3):
                ends = _joined(*ends, axis)
            if len(ends[0]) <= MOST_SOLIDS:
                break
        raise MapError(
            f"the points fill {len(cells):,} cells of {resolution:g} m, which make {len(low):,} boxes, expected at "
            f"most {MOST_SOLIDS:,}. Give a resolution of {coarser:g} m, or crop the points to the arm's surroundings."
        )
    return [_box(start, end, resolution) for start, end in zip(low, high, strict=True)]


def _joined(low: IntArray, high: IntArray, axis: int) -> tuple[IntArray, IntArray]:
    """Join boxes of cells (n, 3), from low to high, that touch along an axis and are equal in the others."""
    if not len(low):
        return low, high
    others = [i for i in range(3) if i != axis]
    keys = [low[:, axis], *(ends[:, i] for i in others for ends in (low, high))]
    order = np.lexsort(keys)
    low, high = low[order], high[order]
    same = np.all([(ends[1:, i] == ends[:-1, i]) for i in others for ends in (low, high)], axis=0)
    begins = np.append(True, ~(same & (low[1:, axis] == high[:-1, axis])))
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(low)) - 1
    ends = high[first].copy()
    ends[:, axis] = high[last, axis]
    return low[first], ends


def _box(low: IntArray, high: IntArray, resolution: float) -> Solid:
    pose = np.eye(4)
    pose[:3, 3] = 0.5 * resolution * (low + high)
    x, y, z = (resolution * (high - low)).tolist()
    return Solid(Box((x, y, z)), pose, "points")
