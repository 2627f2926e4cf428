"""Scalar fields over the plane: an array of B-spline coefficients, evaluated with numbers or CasADi symbols.

``f(u, v) = sum_ij C[i, j] B(v - i) B(u - j)`` with the cubic cardinal B-spline B and (u, v) the position in grid steps.
The grid values themselves are the coefficients (no prefilter), so the field is a local weighted mean of its samples: it
stays within their range, is exactly constant where the sixteen neighbours are equal, and is twice continuously
differentiable. Its error is a slight smoothing: ``h^2/6 * laplacian(f)`` for a smooth f sampled at spacing h, and at
most ``sqrt(2/3) h Lip(f)`` for a Lipschitz f (the variance of the weights is h^2/3 along each axis). Beyond the grid
the field keeps the value of the nearest point of its border.

A lazy field samples a block when a point in it is first read, so a plan in a large building samples a small part.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import RLock
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray, marked
from hpop.base.math import is_symbolic
from hpop.base.symbols import lift
from hpop.base.text import shown
from hpop.world import fields
from hpop.world.geometry.shapes import rotate

PAD = 2
BLOCK = 32  # nodes along a side of a block of samples
AT_ONCE = 256  # blocks computed together


class GridPoints(NamedTuple):
    """Points as CasADi symbols, in grid steps (column and row of the padded samples), clamped to the grid.

    u, v    (M, 1) each: column and row
    points  (2, M)  u and v as one matrix, for CasADi's MX; None for SX
    shape   of the input columns
    """

    u: Any
    v: Any
    points: Any
    shape: tuple[int, ...]


@checked_arguments
@dataclass(frozen=True, eq=False)
class Field:
    """Scalar field over the plane: samples on a uniform grid, joined and slightly smoothed by a cubic B-spline.

    values   (H, W)        samples; row 0 has the lowest y of the field's frame
    spacing  float         m     distance of neighbouring samples
    origin   (x, y, yaw)   m, m, rad   position of values[0, 0], and the direction along a row

    >>> field = Field(np.full((4, 5), 7.0), spacing=0.1)
    >>> field(np.array([0.0, 0.15, 99.0]), np.array([0.0, 0.2, 0.0])).round(12)
    array([7., 7., 7.])
    """

    values: FloatArray
    spacing: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Copy the samples, and pad their border."""
        values = np.asarray(self.values, dtype=np.float64)
        if values.ndim != 2 or values.size == 0 or not np.isfinite(values).all():
            raise ValueError(f"values must be a finite (H, W) array with samples; got {shown(self.values)}.")
        coefficients = np.pad(values, PAD, mode="edge")
        coefficients.setflags(write=False)
        object.__setattr__(self, "values", coefficients[PAD:-PAD, PAD:-PAD])
        object.__setattr__(self, "spacing", float(self.spacing))
        object.__setattr__(self, "_range", (values.min(), values.max()))
        object.__setattr__(self, "_coefficients", coefficients)

    @property
    def nbytes(self) -> int:
        """Return the memory of the samples, bytes."""
        coefficients: FloatArray = self.__dict__["_coefficients"]
        return coefficients.nbytes

    def __getstate__(self) -> dict[str, Any]:
        """Return samples, spacing and origin; a copy builds its CasADi function again on first use."""
        return {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the field from its samples."""
        self.__dict__.update(state)
        self.__post_init__()

    def __call__(self, x: Column, y: Column) -> Column:
        """Return the values at world points; x and y are (M,) arrays (broadcast) in metres, or CasADi columns.

        From one step beyond the border of the samples on, the values are those at the border.
        """
        if is_symbolic(x) or is_symbolic(y):
            return self.at(self.places(x, y))
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        # Rounded weights may sum to 1 + 4e-16: keep the range exactly.
        return np.clip(self._evaluate(x, y), *self.__dict__["_range"])

    @property
    def coefficients(self) -> FloatArray:
        """Return the samples, padded on each side with PAD copies of the outermost ones, (H + 2 PAD, W + 2 PAD)."""
        padded: FloatArray = self.__dict__["_coefficients"]
        return padded

    def gradient(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the partial derivatives (df/dx, df/dy), per metre, in the world frame; 0 beyond the border."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        u, v = (np.ravel(at) for at in self._grid(x, y))
        at = np.stack([u, v], axis=1)
        last = np.array(self.__dict__["_coefficients"].shape[::-1]) - 2.0
        out = np.empty((u.size, 8))
        self.quadratics(np.clip(at, 1.0, last), out)
        rise = out[:, 3:5] * ((at >= 1.0) & (at <= last)) / self.spacing  # (M, 2)
        du, dv = rise.T.reshape(2, *x.shape)
        slopes: tuple[FloatArray, FloatArray] = rotate(du, dv, self.origin[2])
        return slopes

    def _grid(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Convert world points, m, to grid steps (u, v): column and row in the padded coefficients."""
        u, v = rotate(x - self.origin[0], y - self.origin[1], -self.origin[2])
        return u / self.spacing + PAD, v / self.spacing + PAD

    def _evaluate(self, x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = self._grid(x, y)
        u, v, shape = np.ravel(u), np.ravel(v), u.shape
        coefficients = self.coefficients_at(u, v)
        rows, columns = coefficients.shape
        (row, up), (column, right) = _step(v, rows), _step(u, columns)
        out = np.zeros(u.size)
        fields._kernels.spline(coefficients, row, column, up, right, out)
        return out.reshape(shape)

    def coefficients_at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return the padded samples. A lazy field first computes those near the points (M,), given in grid steps."""
        return self.coefficients

    def quadratics(self, places: FloatArray, out: FloatArray) -> None:
        """Write to ``out`` (M, 8) the expansions about points (M, 2), in grid steps, within the clamped grid.

        See :func:`hpop.world.fields._kernels.quadratics` and :meth:`places`.
        """
        fields._kernels.quadratics(self.coefficients_at(*places.T), places, out)

    def places(self, x: Column, y: Column) -> GridPoints:
        """Convert CasADi columns, m, to points in grid steps. Fields with equal grids can share the result."""
        import casadi  # slow to import

        u, v = self._grid(x, y)
        u, v = u + 0.0 * v, v + 0.0 * u  # a number beside a column becomes a column
        rows, columns = self.__dict__["_coefficients"].shape
        u = np.minimum(np.maximum(u, 1.0), columns - 2.0)
        v = np.minimum(np.maximum(v, 1.0), rows - 2.0)
        size = u.shape
        u, v = casadi.vec(u.to_casadi()), casadi.vec(v.to_casadi())
        return GridPoints(u, v, None if isinstance(u, casadi.SX) else casadi.horzcat(u, v).T, size)

    def at(self, places: GridPoints) -> Any:
        """Return the values at points from `places`, as a CasADi expression of the shape of the columns given there."""
        u, v, points, size = places
        if points is None:
            return lift(fields.symbols.look(self, u, v), size)
        function = self.__dict__.get("_function")
        if function is None:
            function = self._build()
            self.__dict__["_function"] = function
        values = function.map(u.numel())(points).T
        return lift(values, size)

    def _build(self) -> Any:
        """Build a CasADi function that evaluates this spline."""
        import casadi  # slow to import

        rows, columns = self.coefficients.shape
        knots = [np.arange(-2.0, count + 2.0) for count in (columns, rows)]
        lookup = {"lookup_mode": ["exact", "exact"]}  # the knots are uniform
        return casadi.Function.bspline("field", knots, self.coefficients.ravel(), [3, 3], 1, lookup)


def _step(at: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Return the sample (index) before each position (M,) on an axis of ``count`` samples, and the distance beyond it.

    Positions and distances are in grid steps. A position beyond the second or the last but one sample is moved there.
    """
    at = np.minimum(np.maximum(at, 1.0), count - 2.0)
    before = np.fmin(at, count - 3.0).astype(np.int64)  # fmin also bounds NaN
    return before, at - before


def grid_points(bounds: tuple[float, float, float, float], spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return sample positions along x and along y, m, that cover ``bounds`` and one more step on each side."""
    x0, y0, x1, y1 = bounds
    columns = math.ceil((x1 - x0) / spacing) + 3
    rows = math.ceil((y1 - y0) / spacing) + 3
    steps = (np.arange(count, dtype=np.float64) - 1.0 for count in (columns, rows))
    xs, ys = (np.asarray(low + spacing * step) for low, step in zip((x0, y0), steps, strict=True))
    return xs, ys


class LazyField(Field):
    """Field that computes its samples block by block, when a point in a block is first read.

    Values equal those of a `Field` with all samples. Reading ``values``, or pickling, computes all samples.

    >>> sizes = []
    >>> def sample(x, y):
    ...     sizes.append(x.size)
    ...     return np.full(x.shape, 0.5)
    >>> field = LazyField(np.arange(900.0), np.arange(900.0), 1.0, sample)
    >>> field(np.array([450.0]), np.array([450.0])), sizes[0] < 2000
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
        """Set up a field without samples; ``sample(x, y)`` returns the values (N,) at grid points (x, y), m.

        ``within`` is a lower and an upper bound of all values.
        """
        origin = float(xs[0]), float(ys[0]), 0.0
        shape = ys.size, xs.size
        self._begin(shape, spacing, origin, within, _axes=(xs, ys), _sample=sample, _done=np.zeros(shape, dtype=bool))

    def _begin(
        self,
        shape: tuple[int, int],
        spacing: float,
        origin: tuple[float, float, float],
        within: tuple[float, float],
        **attributes: Any,
    ) -> None:
        """Set the attributes of a field without samples."""
        whole = np.zeros((shape[0] + 2 * PAD, shape[1] + 2 * PAD))
        shown = whole.view()
        shown.setflags(write=False)
        self.__dict__.update(
            spacing=float(spacing),
            origin=origin,
            _range=within,
            _whole=whole,
            _coefficients=shown,
            _lock=RLock(),
            _asked=np.zeros([-(-size // BLOCK) for size in whole.shape], dtype=bool),
            **attributes,
        )

    @property
    def values(self) -> FloatArray:
        """Compute all samples and return them (H, W)."""
        return self.coefficients[PAD:-PAD, PAD:-PAD]

    @property
    def coefficients(self) -> FloatArray:
        """Compute all samples and return them padded, (H + 2 PAD, W + 2 PAD)."""
        self._fill(np.ones_like(self.__dict__["_asked"]))
        return super().coefficients

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as a `Field` with all samples."""
        return Field, (self.values, self.spacing, self.origin)

    def coefficients_at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Compute the missing samples that the spline needs at points (M,) in grid steps; return all padded samples.

        Samples of other blocks are 0 until they are computed.
        """
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
        """Compute the missing samples of the blocks that the mask ``wanted`` marks, one thread at a time."""
        with self.__dict__["_lock"]:
            self._filled(wanted)

    def _filled(self, wanted: Any) -> None:
        wanted = wanted & ~self.__dict__["_asked"]
        blocks = np.argwhere(wanted)
        for begin in range(0, len(blocks), AT_ONCE):
            self._sampled(blocks[begin : begin + AT_ONCE])

    def _sampled(self, blocks: IntArray) -> None:
        """Compute the missing samples of blocks (B, 2), which are given by row and column and sorted by row."""
        asked, whole = (self.__dict__[name] for name in ("_asked", "_whole"))
        corners = blocks * BLOCK - PAD
        first = max(int(corners[0, 0]) - 1, 0)
        done: BoolArray = self.__dict__["_done"][first : int(corners[-1, 0]) + BLOCK + 2]
        todo = np.zeros_like(done)
        for i, j in (corners - [first, 0]).tolist():
            # A point takes the coefficients from one before its own to two after it.
            todo[max(i - 1, 0) : i + BLOCK + 2, max(j - 1, 0) : j + BLOCK + 2] = True
        todo &= ~done
        rows, columns = marked(todo)
        rows += first
        xs, ys = self.__dict__["_axes"]
        inside = whole[PAD:-PAD, PAD:-PAD]
        inside[rows, columns] = self.__dict__["_sample"](xs[columns], ys[rows])
        done |= todo
        _repeat_border(whole)
        asked[blocks[:, 0], blocks[:, 1]] = True  # last, so that Ctrl-C and other threads never see half a block


class TiledField(LazyField):
    """Lazy field that computes its samples in large square tiles, because one Fourier transform yields a whole tile.

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
        reads: Callable[[slice, slice], Sequence[tuple[float, float]]] | None = None,
    ) -> None:
        """Set up a field without samples; ``sample(rows, columns)`` returns the values of a tile, at most side x side.

        ``reads`` returns the ranges of rows and columns of the inputs on which a tile depends, for :meth:`take_over`.
        """
        made = np.zeros([-(-size // side) for size in shape], dtype=bool)
        self._begin(shape, spacing, origin, (0.0, 1.0), _side=side, _sample=sample, _reads=reads, _made=made)

    def take_over(self, before: TiledField, boxes: IntArray) -> None:
        """Copy to this field the tiles of ``before``, the field before a change, that do not depend on changed inputs.

        Tiles that ``before`` has not computed are not copied.
        ``boxes`` (B, 4) enclose the changed inputs: first row and column, last row + 1 and last column + 1.
        """
        inside, old = (field.__dict__["_whole"][PAD:-PAD, PAD:-PAD] for field in (self, before))
        for i, j in np.argwhere(before.__dict__["_made"] & ~self.__dict__["_made"]).tolist():
            part = self._tile_of(i, j)
            (row, last_row), (column, last_column) = self.__dict__["_reads"](*part)
            met = (boxes[:, 2:] > (row, column)) & (boxes[:, :2] < (last_row, last_column))
            if not met.all(axis=1).any():
                inside[part] = old[part]
                self.__dict__["_made"][i, j] = True

    def _tile_of(self, i: int, j: int) -> tuple[slice, slice]:
        """Return the rows and columns of the samples in tile [i, j]."""
        side, shape = self.__dict__["_side"], self.__dict__["_whole"][PAD:-PAD, PAD:-PAD].shape
        rows, columns = (slice(k * side, min((k + 1) * side, n)) for k, n in zip((i, j), shape, strict=True))
        return rows, columns

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
                rows, columns = self._tile_of(i, j)
                inside[rows, columns] = self.__dict__["_sample"](rows, columns)
                made[i, j] = True
        _repeat_border(whole)
        asked |= wanted


def _tile(nodes: IntArray, side: int, shape: tuple[int, ...]) -> IntArray:
    """Return row and column (N, 2) of the tile that holds each sample (N, 2), or of the nearest tile if none does."""
    return np.clip(nodes // side, 0, np.array(shape) - 1)


def _repeat_border(whole: FloatArray) -> None:
    """Repeat the outermost samples in the padding round them."""
    whole[PAD:-PAD, :PAD], whole[PAD:-PAD, -PAD:] = whole[PAD:-PAD, PAD : PAD + 1], whole[PAD:-PAD, -PAD - 1 : -PAD]
    whole[:PAD], whole[-PAD:] = whole[PAD], whole[-PAD - 1]
