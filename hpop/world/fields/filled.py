"""Which share of a ball bodies fill, as a function of where the ball is: read from a grid made where somebody looks.

The share changes slowly, by no more than 3/4 where its centre moves by the radius. So it is found by rays at the nodes
of a grid, a tenth of the radius apart, and interpolated by cubics (Catmull and Rom 1974) that have no kinks. Each node
is asked for once, however many places are near it, and is the same whoever asks: so are all values.
"""

from __future__ import annotations

from itertools import product
from threading import RLock
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.world.geometry.rays_in_space import Surfaces, surfaces_of

if TYPE_CHECKING:
    from hpop.world.world import World

PER_RADIUS = 10  # nodes
RAYS = 1000  # of each node, over the ball: an edge or a corner is met to a thousandth or two
MOST = 1 << 22  # nodes that are kept, 64 MB
SIDE = 1 << 20  # nodes on either side of the middle, of what a key has room for
STRIDES = np.array([1 << 42, 1 << 21, 1], np.int64)
AROUND = np.array([*product(range(-1, 3), repeat=3)], np.int64) @ STRIDES  # nodes by which a cell is interpolated
CUBICS = 0.5 * np.array([[0.0, 2.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [2.0, -5.0, 4.0, -1.0], [-1.0, 3.0, -3.0, 1.0]])


class Filled:
    """The share of the ball of ``radius`` m round a place that bodies fill.

    >>> from hpop.world.geometry.solids import Box, Solid, pose_at
    >>> wall = Solid(Box((9.0, 99.0, 99.0)), pose_at((5.5, 0.0, 0.0)))  # its face is 1 m away
    >>> Filled(Surfaces.of([wall]), 2.0)(np.array([[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])).round(2)  # 5/32, 0
    array([0.16, 0.  ])
    """

    def __init__(self, surfaces: Surfaces, radius: float) -> None:
        self._surfaces, self._radius, self._spacing = surfaces, radius, radius / PER_RADIUS
        self._middle = surfaces.rounds[:, :3].mean(axis=0) if len(surfaces) else np.zeros(3)
        self._keys, self._values = np.empty(0, np.int64), np.empty(0)
        self._lock = RLock()

    @property
    def nbytes(self) -> int:
        """Bytes of the nodes that are known."""
        return self._keys.nbytes + self._values.nbytes

    def __call__(self, places: FloatArray) -> FloatArray:
        """Shares (N,), in [0, 1], round places (N, 3), m."""
        if not len(self._surfaces):
            return np.zeros(len(places))
        scaled = np.clip((places - self._middle) / self._spacing, 4.0 - SIDE, SIDE - 4.0)
        corner = np.floor(scaled)
        cells, which = np.unique((corner.astype(np.int64) + SIDE) @ STRIDES, return_inverse=True)
        share = self._at(cells[:, None] + AROUND).reshape(-1, 4, 4, 4)[which]  # (N, 4, 4, 4)
        powers = (scaled - corner)[..., None] ** np.arange(4)
        for weights in np.einsum("nik,kj->inj", powers, CUBICS)[::-1]:
            share = np.einsum("n...j,nj->n...", share, weights)
        return np.clip(share, 0.0, 1.0)

    def _at(self, nodes: IntArray) -> FloatArray:
        """The shares at nodes; those that are not known are made by one thread while others wait."""
        some, which = np.unique(nodes, return_inverse=True)
        with self._lock:
            place = np.minimum(np.searchsorted(self._keys, some), max(0, self._keys.size - 1))
            new = some[self._keys[place] != some] if self._keys.size else some
            if new.size:
                made = self._surfaces.filled(self._places(new), self._radius, RAYS)
                if self._keys.size + new.size > MOST:
                    known = np.isin(self._keys, some, assume_unique=True)
                    self._keys, self._values = self._keys[known], self._values[known]
                keys, values = np.append(self._keys, new), np.append(self._values, made)
                order = np.argsort(keys, kind="stable")
                self._keys, self._values = keys[order], values[order]
                place = np.searchsorted(self._keys, some)
            found: FloatArray = self._values[place][which.reshape(nodes.shape)]
        return found

    def _places(self, nodes: IntArray) -> FloatArray:
        """Where (N, 3), m, nodes are."""
        numbers = np.stack([nodes >> 42, nodes >> 21 & 2 * SIDE - 1, nodes & 2 * SIDE - 1], axis=1) - SIDE
        return self._middle + self._spacing * numbers


def filled(world: World, radius: float) -> Filled:
    """Of what is solid in a world; kept with its ground."""
    ground = world.ground
    return ground.derived(("filled balls", radius), lambda: Filled(surfaces_of(world), radius))
