"""A scalar field over the plane: one array of B-spline coefficients, for numbers and for CasADi symbols.

``f(u, v) = sum_ij C[i, j] B(v - i) B(u - j)`` with the cubic cardinal B-spline B and (u, v) the position in
grid steps. The grid values themselves are the coefficients (no prefilter), so the field is a local weighted
mean of its samples: it stays within their range, is exactly constant where the sixteen neighbours are equal,
and is twice continuously differentiable. The price is a slight smoothing, ``h^2/6 * laplacian(f)`` for a
smooth f sampled at spacing h, and at most ``sqrt(2/3) h Lip(f)`` for any Lipschitz f (the squared spread of
the weights is h^2/3 an axis). Beyond the grid the field keeps the value of the nearest point of its border.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.base.math import is_symbolic
from hpop.base.symbols import lift
from hpop.world.fields.looks import look
from hpop.world.geometry.shapes import rotate

PAD = 2


class Places(NamedTuple):
    """Symbolic points in the steps of a grid, none outside of it.

    u, v    (M, 1) each
    points  (2, M)  both, for MX; None for SX
    shape   of the columns that they were
    """

    u: Any
    v: Any
    points: Any
    shape: tuple[int, ...]


@checked_arguments
@dataclass(frozen=True, eq=False)
class Field:
    """Samples on a uniform grid, seen as a cubic B-spline.

    values   (H, W)        samples; row 0 at the lowest y of the field's frame
    spacing  float         m     distance of neighbouring samples
    origin   (x, y, yaw)   m, m, rad   where values[0, 0] was sampled, and the direction of the rows

    >>> field = Field(np.full((4, 5), 7.0), spacing=0.1)
    >>> field(np.array([0.0, 0.15, 99.0]), np.array([0.0, 0.2, 0.0])).round(12)
    array([7., 7., 7.])
    """

    values: FloatArray
    spacing: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Copy the samples."""
        values = np.asarray(self.values, dtype=np.float64)
        if values.ndim != 2 or values.size == 0 or not np.isfinite(values).all():
            raise ValueError(f"values must be a finite (H, W) array with samples; got shape {values.shape}.")
        coefficients = np.pad(values, PAD, mode="edge")
        coefficients.setflags(write=False)
        object.__setattr__(self, "values", coefficients[PAD:-PAD, PAD:-PAD])
        object.__setattr__(self, "spacing", float(self.spacing))
        object.__setattr__(self, "_range", (values.min(), values.max()))
        object.__setattr__(self, "_coefficients", coefficients)

    @property
    def nbytes(self) -> int:
        """Bytes of the samples."""
        coefficients: FloatArray = self.__dict__["_coefficients"]
        return coefficients.nbytes

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the samples only; the compiled CasADi function is built again when asked for."""
        return {"values": self.values, "spacing": self.spacing, "origin": self.origin}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore from the samples."""
        self.__dict__.update(state)
        self.__post_init__()

    def __call__(self, x: Column, y: Column) -> Column:
        """Values at world points; x and y are (M,) arrays (broadcast) in metres, or CasADi columns."""
        if is_symbolic(x) or is_symbolic(y):
            return self.at(self.places(x, y))
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        # Rounded weights may sum to 1 + 4e-16: keep the range exactly.
        return np.clip(self._evaluate(x, y), *self.__dict__["_range"])

    @property
    def coefficients(self) -> FloatArray:
        """The padded samples (H + 2 PAD, W + 2 PAD), by which places are counted in grid steps."""
        padded: FloatArray = self.__dict__["_coefficients"]
        return padded

    def gradient(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Partial derivatives (df/dx, df/dy), per metre, in the world frame; 0 across the border."""
        from hpop.world.fields._spline import quadratics

        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        u, v = (np.ravel(at) for at in self._grid(x, y))
        coefficients, at = self.coefficients_at(u, v), np.stack([u, v], axis=1)
        last = np.array(coefficients.shape[::-1]) - 2.0
        out = np.empty((u.size, 8))
        quadratics(coefficients, np.clip(at, 1.0, last), out)
        rise = out[:, 3:5] * ((at >= 1.0) & (at <= last)) / self.spacing  # (M, 2)
        du, dv = rise.T.reshape(2, *x.shape)
        slopes: tuple[FloatArray, FloatArray] = rotate(du, dv, self.origin[2])
        return slopes

    def _grid(self, x: Any, y: Any) -> tuple[Any, Any]:
        """World points in grid steps of the padded coefficients."""
        u, v = rotate(x - self.origin[0], y - self.origin[1], -self.origin[2])
        return u / self.spacing + PAD, v / self.spacing + PAD

    def _evaluate(self, x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = self._grid(x, y)
        u, v, shape = np.ravel(u), np.ravel(v), u.shape
        coefficients = self.coefficients_at(u, v)
        rows, columns = coefficients.shape
        (row, up), (column, right) = _step(v, rows), _step(u, columns)
        out = np.zeros(u.size)
        _kernel()(coefficients, row, column, up, right, out)
        return out.reshape(shape)

    def coefficients_at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """The padded samples, of which those that points (M,) in grid steps take are there."""
        return self.coefficients

    def places(self, x: Column, y: Column) -> Places:
        """Where CasADi columns of points lie in this grid; all fields on one grid can be read there."""
        import casadi

        u, v = self._grid(x, y)
        u, v = u + 0.0 * v, v + 0.0 * u  # a number beside a column becomes a column
        rows, columns = self.__dict__["_coefficients"].shape
        u = np.minimum(np.maximum(u, 1.0), columns - 2.0)
        v = np.minimum(np.maximum(v, 1.0), rows - 2.0)
        size = u.shape
        u, v = casadi.vec(u.to_casadi()), casadi.vec(v.to_casadi())
        return Places(u, v, None if isinstance(u, casadi.SX) else casadi.horzcat(u, v).T, size)

    def at(self, places: Places) -> Any:
        """Values at places in this grid, on CasADi symbols."""
        u, v, points, size = places
        if points is None:
            return lift(look(self, u, v), size)
        function = self.__dict__.get("_function")
        if function is None:
            function = self._build()
            self.__dict__["_function"] = function
        values = function.map(u.numel())(points).T
        return lift(values, size)

    def _build(self) -> Any:
        """Give the same coefficients to a CasADi B-spline with uniform knots (3 ms at 160 x 160)."""
        import casadi

        rows, columns = self.coefficients.shape
        knots = [np.arange(-2.0, count + 2.0) for count in (columns, rows)]
        lookup = {"lookup_mode": ["exact", "exact"]}  # the knots are uniform
        return casadi.Function.bspline("field", knots, self.coefficients.ravel(), [3, 3], 1, lookup)


def _step(at: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """The sample (M,) before places along an axis of so many, and the part of a step from there; see `spline`."""
    at = np.minimum(np.maximum(at, 1.0), count - 2.0)
    before = np.fmin(at, count - 3.0).astype(np.int64)  # of NaN too
    return before, at - before


@lru_cache(maxsize=1)
def _kernel() -> Any:
    """Compile, or load from the cache, the NumPy side: the value at each point."""
    from hpop.world.fields._spline import spline

    return spline


def grid_points(bounds: tuple[float, float, float, float], spacing: float) -> tuple[FloatArray, FloatArray]:
    """Sample positions (xs, ys), m, that cover ``bounds`` and one more step all round."""
    x0, y0, x1, y1 = bounds
    columns = math.ceil((x1 - x0) / spacing) + 3
    rows = math.ceil((y1 - y0) / spacing) + 3
    steps = (np.arange(count, dtype=np.float64) - 1.0 for count in (columns, rows))
    xs, ys = (np.asarray(low + spacing * step) for low, step in zip((x0, y0), steps, strict=True))
    return xs, ys
