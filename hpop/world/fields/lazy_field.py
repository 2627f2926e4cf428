"""A field that is sampled where somebody looks: the first answer in a large building needs a small part of it."""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from typing import Any

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.world.fields.field import PAD, Field

BLOCK = 32  # nodes along a side of a block
AT_ONCE = 256  # blocks that are sampled together


class LazyField(Field):
    """A `Field` of samples that are computed block by block, each when a point in it is first asked for.

    Values are those of the field sampled as a whole. Who takes ``values``, or pickles it gets all.

    >>> asked = []
    >>> def sample(x, y):
    ...     asked.append(x.size)
    ...     return np.full(x.shape, 0.5)
    >>> field = LazyField(np.arange(900.0), np.arange(900.0), 1.0, sample)
    >>> field(np.array([450.0]), np.array([450.0])), asked[0] < 2000
    (array([0.5]), True)
    """

    def __init__(
        self,
        xs: FloatArray,
        ys: FloatArray,
        spacing: float,
        sample: Callable[[FloatArray, FloatArray], FloatArray],
        within: tuple[float, float] = (0.0, 1.0),
    ) -> None:
        """Sample nothing yet; (ys, xs) are the places of the nodes, m, ``sample`` gives the values (N,) at some.

        ``within`` are a lower and an upper bound of all values.
        """
        whole = np.zeros((ys.size + 2 * PAD, xs.size + 2 * PAD))
        shown = whole.view()
        shown.setflags(write=False)
        self.__dict__.update(
            spacing=float(spacing),
            origin=(float(xs[0]), float(ys[0]), 0.0),
            _range=within,
            _whole=whole,
            _coefficients=shown,
            _axes=(xs, ys),
            _sample=sample,
            _done=np.zeros((ys.size, xs.size), dtype=bool),
            _lock=RLock(),
            _asked=np.zeros([-(-size // BLOCK) for size in whole.shape], dtype=bool),
        )

    @property
    def values(self) -> FloatArray:
        """All samples (H, W)."""
        return self.coefficients[PAD:-PAD, PAD:-PAD]

    @property
    def coefficients(self) -> FloatArray:
        """All samples, with the border repeated."""
        self._fill(np.ones_like(self.__dict__["_asked"]))
        return super().coefficients

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle all samples."""
        return Field, (self.values, self.spacing, self.origin)

    def coefficients_at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Sample what the spline takes at points in grid steps."""
        asked: Any = self.__dict__["_asked"]
        if not asked.all():
            rows, columns = self.__dict__["_coefficients"].shape
            # As the spline clamps; fmin and fmax turn NaN into a number.
            j, i = (
                np.fmax(np.fmin(at, count - 3.0), 1.0).astype(np.int64) // BLOCK
                for at, count in ((u, columns), (v, rows))
            )
            wanted = np.zeros_like(asked)
            wanted[i, j] = True
            self._fill(wanted)
        return super().coefficients

    def _fill(self, wanted: Any) -> None:
        """Sample the nodes of blocks (of coefficients) that are wanted and not there; one thread at a time."""
        with self.__dict__["_lock"]:
            self._filled(wanted)

    def _filled(self, wanted: Any) -> None:
        wanted = wanted & ~self.__dict__["_asked"]
        blocks = np.argwhere(wanted)
        for begin in range(0, len(blocks), AT_ONCE):
            self._sampled(blocks[begin : begin + AT_ONCE])

    def _sampled(self, blocks: IntArray) -> None:
        """Sample the nodes of some blocks (B, 2), sorted by row, that are not there."""
        asked, whole = (self.__dict__[name] for name in ("_asked", "_whole"))
        corners = blocks * BLOCK - PAD
        first = max(int(corners[0, 0]) - 1, 0)
        done: BoolArray = self.__dict__["_done"][first : int(corners[-1, 0]) + BLOCK + 2]
        todo = np.zeros_like(done)
        for i, j in (corners - [first, 0]).tolist():
            # A point takes the coefficients from one before its own to two after it.
            todo[max(i - 1, 0) : i + BLOCK + 2, max(j - 1, 0) : j + BLOCK + 2] = True
        todo &= ~done
        rows, columns = np.nonzero(todo)
        rows += first
        xs, ys = self.__dict__["_axes"]
        inside = whole[PAD:-PAD, PAD:-PAD]
        inside[rows, columns] = self.__dict__["_sample"](xs[columns], ys[rows])
        done |= todo
        _repeat_border(whole)
        asked[blocks[:, 0], blocks[:, 1]] = True  # last: neither Ctrl-C nor another thread finds a half of a block


class TiledField(LazyField):
    """A `LazyField` whose nodes are sampled in tiles of a size of their own, such as those of a transform.

    >>> tiles = []
    >>> def sample(rows, columns):
    ...     tiles.append((rows.start, columns.start))
    ...     return np.full((rows.stop - rows.start, columns.stop - columns.start), 0.5)
    >>> field = TiledField((900, 700), 1.0, (0.0, 0.0, 0.0), 200, sample)
    >>> field(np.array([450.0]), np.array([90.0])), tiles
    (array([0.5]), [(0, 400)])
    """

    def __init__(
        self,
        shape: tuple[int, int],
        spacing: float,
        origin: tuple[float, float, float],
        side: int,
        sample: Callable[[slice, slice], FloatArray],
    ) -> None:
        """Sample nothing yet; ``sample`` gives the values of a tile of at most side x side nodes."""
        whole = np.zeros((shape[0] + 2 * PAD, shape[1] + 2 * PAD))
        shown = whole.view()
        shown.setflags(write=False)
        self.__dict__.update(
            spacing=float(spacing),
            origin=origin,
            _range=(0.0, 1.0),
            _whole=whole,
            _coefficients=shown,
            _side=side,
            _sample=sample,
            _made=np.zeros([-(-size // side) for size in shape], dtype=bool),
            _lock=RLock(),
            _asked=np.zeros([-(-size // BLOCK) for size in whole.shape], dtype=bool),
        )

    def _filled(self, wanted: Any) -> None:
        asked, made, side, whole = (self.__dict__[name] for name in ("_asked", "_made", "_side", "_whole"))
        wanted = wanted & ~asked
        if not wanted.any():
            return
        inside = whole[PAD:-PAD, PAD:-PAD]
        # A point takes the coefficients from one before its own to two after it.
        first = np.argwhere(wanted) * BLOCK - PAD - 1
        tiles = {
            (int(i), int(j))
            for low, high in zip(
                _tile(first, side, made.shape), _tile(first + BLOCK + 2, side, made.shape), strict=True
            )
            for i in range(low[0], high[0] + 1)
            for j in range(low[1], high[1] + 1)
        }
        for i, j in sorted(tiles):
            if not made[i, j]:
                rows, columns = (
                    slice(k * side, min((k + 1) * side, size)) for k, size in zip((i, j), inside.shape, strict=True)
                )
                inside[rows, columns] = self.__dict__["_sample"](rows, columns)
                made[i, j] = True
        _repeat_border(whole)
        asked |= wanted


def _tile(nodes: IntArray, side: int, shape: tuple[int, ...]) -> IntArray:
    """Tiles (N, 2) in which nodes are, or those nearest to nodes beyond the grid."""
    return np.clip(nodes // side, 0, np.array(shape) - 1)


def _repeat_border(whole: FloatArray) -> None:
    """Give the padding of samples the values of their border."""
    whole[PAD:-PAD, :PAD], whole[PAD:-PAD, -PAD:] = whole[PAD:-PAD, PAD : PAD + 1], whole[PAD:-PAD, -PAD - 1 : -PAD]
    whole[:PAD], whole[-PAD:] = whole[PAD], whole[-PAD - 1]
