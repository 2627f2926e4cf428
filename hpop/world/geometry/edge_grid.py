"""Edges by the square buckets of a grid that they cross, which a ray visits one after another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray, IntArray, distinct


@dataclass(frozen=True, eq=False)
class EdgeGrid:
    """Edges filed by the square buckets that they cross.

    edges    (E, 4)    m   x0, y0, x1, y1; at least one
    corner   (x, y)    m   lower-left corner of bucket [0, 0]
    side     float     m   of a bucket
    start    (R C + 1,)    the edges of bucket [i, j] are members[start[i C + j]:start[i C + j + 1]]
    members  (K,)
    shape    (R, C)
    """

    edges: FloatArray
    corner: tuple[float, float]
    side: float
    start: IntArray
    members: IntArray
    shape: tuple[int, int]

    @classmethod
    def build(cls, edges: FloatArray) -> EdgeGrid:
        """File edges (E, 4), m, at about two a bucket."""
        corner = np.minimum(edges[:, :2], edges[:, 2:]).min(axis=0)
        size = np.maximum(edges[:, :2], edges[:, 2:]).max(axis=0) - corner
        least = size.max() * max(2.0 / len(edges), 1.0 / 2000.0)  # of what is flat: one row of buckets, no area
        side = max(math.sqrt(2.0 * size[0] * size[1] / len(edges)), least, 1e-9)
        columns, rows = np.floor(size / side).astype(np.int64) + 1
        bucket, member = _crossings(edges, corner, side, (int(rows), int(columns)))
        start = np.searchsorted(bucket, np.arange(rows * columns + 1))
        return cls(edges, (float(corner[0]), float(corner[1])), side, start, member, (int(rows), int(columns)))


def _crossings(edges: FloatArray, corner: FloatArray, side: float, shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Pairs (bucket, edge), sorted: long edges are cut, and each piece filed where its bounding box is."""
    length = np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1])
    pieces = np.maximum(1, np.ceil(length / side)).astype(np.int64)
    edge = np.repeat(np.arange(len(edges)), pieces)
    number = np.arange(edge.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    step = (edges[edge, 2:] - edges[edge, :2]) / pieces[edge, None]
    ends = edges[edge, :2] + step * number[:, None]
    cells = np.floor((np.stack([ends, ends + step]) - corner) / side).astype(np.int64)  # (2, P, 2)
    cells = np.clip(cells, 0, np.array(shape[::-1]) - 1)
    buckets = [cells[i, :, 1] * shape[1] + cells[j, :, 0] for i in (0, 1) for j in (0, 1)]
    return np.divmod(distinct(np.concatenate(buckets) * len(edges) + np.tile(edge, 4)), len(edges))
