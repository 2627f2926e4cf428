"""Exact distances from many points to many edges: a tree of boxes, of which the nearer ones are looked into.

The time of a point grows with the logarithm of the edges, and with their square root at the most: in the middle of a
circle of very many points all are about as near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray, IntArray

LEAF = 4  # pieces of edges in a leaf
ROUNDING = 8  # units in the last place by which boxes are wider: none is passed over for its rounding
BITS = 16  # of each coordinate, by which pieces are put in order


@dataclass(frozen=True, eq=False)
class EdgeTree:
    """Edges in a binary tree of boxes; the children of node i are 2 i + 1 and 2 i + 2.

    edges    (E, 4)     m   x0, y0, x1, y1; at least one
    members  (L, LEAF)      the edges in each leaf, some of them again to fill it; L is a power of two
    boxes    (2 L - 1, 4)   m   x_min, y_min, x_max, y_max of each node; the last L are the leaves
    """

    edges: FloatArray
    members: IntArray
    boxes: FloatArray

    @classmethod
    def build(cls, edges: FloatArray) -> EdgeTree:
        """File edges (E, 4), m. Long ones are cut, so that boxes are small; near pieces go into one leaf."""
        edge, pieces = _pieces(edges)
        middle = 0.5 * (pieces[:, :2] + pieces[:, 2:])
        order = np.argsort(_curve(middle), kind="stable")
        leaves = 1 << max(0, math.ceil(order.size / LEAF) - 1).bit_length()
        filled = np.minimum(np.arange(leaves * LEAF), order.size - 1)
        members = edge[order[filled]].reshape(leaves, LEAF)
        low, high = (
            reach(pieces[:, :2], pieces[:, 2:])[order[filled]].reshape(leaves, LEAF, 2)
            for reach in (np.minimum, np.maximum)
        )
        slack = ROUNDING * np.spacing(np.abs(edges).max())
        boxes = np.empty((2 * leaves - 1, 4))
        boxes[leaves - 1 :] = np.concatenate([low.min(axis=1) - slack, high.max(axis=1) + slack], axis=1)
        while leaves > 1:
            leaves //= 2
            below = boxes[2 * leaves - 1 : 4 * leaves - 1].reshape(leaves, 2, 4)
            boxes[leaves - 1 : 2 * leaves - 1] = np.concatenate(
                [below[:, :, :2].min(axis=1), below[:, :, 2:].max(axis=1)], axis=1
            )
        return cls(edges, members, boxes)

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Distance (M,), m, of points to the nearest edge (under 1 us a point in a building at 0.05 m)."""
        from hpop.world.geometry._nearest import nearest

        out, levels = np.empty(x.shape), len(self.members).bit_length() + 1
        nearest(self.edges, self.members, self.boxes, np.empty(2 * levels, np.int64), np.empty(2 * levels), x, y, out)
        return out


def _pieces(edges: FloatArray) -> tuple[IntArray, FloatArray]:
    """The edge (P,) of each piece, and its ends (P, 4), m: about as long as edges would be apart, spread evenly."""
    size = edges.reshape(-1, 2).max(axis=0) - edges.reshape(-1, 2).min(axis=0)
    most = max(math.sqrt(2.0 * size[0] * size[1] / len(edges)), size.max() * 2.0 / len(edges), 1e-9)
    slanting = (edges[:, :2] != edges[:, 2:]).all(axis=1)  # what is parallel to an axis fills its box
    length = np.where(slanting, np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]), 0.0)
    count = np.maximum(1, np.ceil(length / most)).astype(np.int64)
    edge = np.repeat(np.arange(len(edges)), count)
    number = np.arange(edge.size) - np.repeat(np.cumsum(count) - count, count)
    begin, end = (share[:, None] / count[edge][:, None] for share in (number, number + 1))
    first, last = edges[edge, :2], edges[edge, 2:]
    return edge, np.concatenate([first + begin * (last - first), first + end * (last - first)], axis=1)


def _curve(points: FloatArray) -> IntArray:
    """Places (P,) of points on a curve of Morton through the square that holds them."""
    low = points.min(axis=0)
    side = max(float((points.max(axis=0) - low).max()), 1e-9)
    cells = np.minimum((points - low) / side * 2**BITS, 2**BITS - 1).astype(np.int64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << shift)) & mask
    return np.asarray(cells[:, 0] | (cells[:, 1] << 1))
