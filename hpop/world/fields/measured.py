"""Measured scalar fields, such as the strength of a radio signal: samples on a grid, joined bilinearly."""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import MapError, did_you_mean
from hpop.world.fields.field import PAD, Field
from hpop.world.geometry.shapes import check_pose, check_positive

if TYPE_CHECKING:
    from hpop.world.ground import Ground

MOST_SAMPLES = 4_000_000
"""Largest number of samples of a measured field, such as 1000 m x 1000 m at 0.5 m."""
CHECKED = 50_000
"""Points of the map at which it is checked whether a field was measured there."""
ROUNDING = 1e-6
"""Tolerance, in grid steps, when deciding whether a point was measured."""


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class MeasuredField(Field):
    """Quantity measured on a grid over the floor, such as the strength of a radio signal; bilinear between samples.

    values   (H, W)        samples in ``unit``; row 0 has the lowest y of the field's frame; NaN: not measured
    spacing  float         m     distance of neighbouring samples
    origin   (x, y, yaw)   m, m, rad   position of values[0, 0], and the direction along a row
    name     name by which criteria and pictures refer to the field
    unit     of the samples, such as "dBm"
    outside  value, in ``unit``, where nothing was measured; None if the field must cover all free space of its world

    A sample stands for the square of one spacing around it; all other places are not measured. With ``outside``, the
    value changes linearly from the outermost samples to ``outside`` within one spacing.

    >>> field = MeasuredField(np.array([[-40.0, -60.0], [-50.0, -70.0]]), 2.0, name="wifi", unit="dBm")
    >>> field(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    array([-40., -50., -55.])
    """

    name: str = field(kw_only=True)
    unit: str = field(kw_only=True)
    outside: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check and copy the samples, and fill the places that were not measured."""
        for key, example in (("name", "wifi"), ("unit", "dBm, or 1 for a share")):
            if not isinstance(getattr(self, key), str) or not getattr(self, key).strip():
                raise MapError(f"a measured field needs a {key}, such as {example}; got {shown(getattr(self, key))}.")
        what = f"field {shown(self.name)}"
        values = np.array(self.values, dtype=np.float64)
        if values.ndim != 2 or values.size == 0:
            raise MapError(f"{what} needs a grid of samples (H, W); got an array of shape {values.shape}.")
        if values.size > MOST_SAMPLES:
            raise MapError(
                f"{what} has {values.shape[1]} x {values.shape[0]} samples; at most {MOST_SAMPLES:,} are read. Take a "
                "larger spacing."
            )
        measured = np.isfinite(values)
        if np.isinf(values).any() or not measured.any() or (np.abs(values[measured]) > MOST).any():
            raise MapError(f"{what} needs samples that are numbers within {MOST:g}, or NaN where nothing was measured.")
        if not measured.all() and self.outside is None:
            row, column = np.argwhere(~measured)[0]
            raise MapError(
                f"{what} has {np.sum(~measured):,} of {values.size:,} samples that are missing or NaN, the first at "
                f"row {row}, column {column} (from 0, lowest y first). Measure them, or give the option outside: the "
                "value that counts there and beyond the grid."
            )
        object.__setattr__(self, "spacing", check_positive(f"{what}: spacing", self.spacing))
        object.__setattr__(self, "origin", check_pose(self.origin))
        values.setflags(write=False)
        filled, ring = values, 0
        if self.outside is not None:
            outside = float(real(f"{what}: outside", self.outside, -MOST, MOST, f"in {self.unit}", error=MapError))
            object.__setattr__(self, "outside", outside)
            filled, ring = np.pad(np.where(measured, values, outside), 1, constant_values=outside), 1
        coefficients = np.pad(filled, PAD - ring, mode="edge")
        coefficients.setflags(write=False)
        self.__dict__.update(values=values, _coefficients=coefficients, _range=(filled.min(), filled.max()))

    def __repr__(self) -> str:
        (rows, columns), (low, high) = self.values.shape, self.__dict__["_range"]
        size = f"{columns} x {rows} samples, {self.spacing:g} m apart"
        return f"<MeasuredField {shown(self.name)}: {size}, {low:.4g} to {high:.4g} {self.unit}>"

    @property
    def lowest(self) -> float:
        """Return the smallest value of the field anywhere."""
        return float(self.__dict__["_range"][0])

    @property
    def steepest(self) -> float:
        """Return the largest change between two neighbouring samples, per metre."""
        changes = (np.abs(np.diff(self.coefficients, axis=axis)).max() for axis in (0, 1))
        return float(max(changes)) / self.spacing

    def is_measured(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return a mask (M,) of the positions, m, that lie in the square of a measured sample."""
        u, v = (np.asarray(at) - PAD for at in self._grid(np.asarray(x, float), np.asarray(y, float)))
        rows, columns = self.values.shape
        near = (np.abs(u - 0.5 * (columns - 1)) <= 0.5 * columns + ROUNDING) & (
            np.abs(v - 0.5 * (rows - 1)) <= 0.5 * rows + ROUNDING
        )
        i, j = (np.clip(np.rint(at), 0, n - 1).astype(np.int64) for at, n in ((v, rows), (u, columns)))
        mask: BoolArray = near & np.isfinite(self.values[i, j])
        return mask

    def _evaluate(self, x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = self._grid(x, y)
        last = np.array(self.coefficients.shape[::-1]) - 2.0
        out = np.empty((u.size, 8))
        self.quadratics(np.clip(np.stack([np.ravel(u), np.ravel(v)], axis=1), 1.0, last), out)
        values: FloatArray = out[:, 2].reshape(u.shape)
        return values

    def quadratics(self, places: FloatArray, out: FloatArray) -> None:
        """Write to ``out`` (M, 8) the bilinear form about points (u, v) (M, 2), in grid steps; the last is always 0.

        A row has u, v, the value, d/du, d/dv, d²/du² (0), d²/dudv and d²/dv² (0).
        """
        c, (u, v) = self.coefficients, places.T
        j, i = (np.fmax(np.fmin(at, n - 2.0), 0.0).astype(np.int64) for at, n in ((u, c.shape[1]), (v, c.shape[0])))
        low, right, above, corner = c[i, j], c[i, j + 1], c[i + 1, j], c[i + 1, j + 1]
        s, t, mixed = u - j, v - i, corner - right - above + low
        out[:, 0], out[:, 1] = u, v
        out[:, 2] = (1 - t) * ((1 - s) * low + s * right) + t * ((1 - s) * above + s * corner)
        out[:, 3], out[:, 4] = right - low + mixed * t, above - low + mixed * s
        out[:, 5], out[:, 6], out[:, 7] = 0.0, mixed, 0.0

    def _build(self) -> Any:
        """Build a CasADi function that evaluates this field."""
        import casadi  # slow to import

        knots = [np.arange(-1.0, count + 1.0) for count in self.coefficients.shape[::-1]]
        return casadi.Function.bspline("field", knots, self.coefficients.ravel(), [1, 1], 1)

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description, from which :meth:`build` builds the field again."""
        return {
            "name": self.name,
            "unit": self.unit,
            "spacing": self.spacing,
            "origin": list(self.origin),
            "outside": self.outside,
            "shape": list(self.values.shape),
            "values": base64.b64encode(zlib.compress(self.values.astype("<f8").tobytes())).decode("ascii"),
        }

    @classmethod
    def build(cls, data: Mapping[str, Any]) -> MeasuredField:
        """Build a field from its description; MapError, TypeError or LookupError if it is malformed."""
        rows, columns = (int(size) for size in data["shape"])
        try:
            raw = zlib.decompressobj().decompress(base64.b64decode(data["values"], validate=True), 8 * MOST_SAMPLES + 1)
        except (zlib.error, binascii.Error) as error:
            raise MapError(
                f"the samples of a described field cannot be unpacked: {error}; describe the world anew."
            ) from None
        if len(raw) != 8 * rows * columns:
            raise MapError(f"a described field must hold {columns} x {rows} samples; describe the world anew.")
        values = np.frombuffer(raw, "<f8").reshape(rows, columns)
        more = {key: data[key] for key in ("name", "unit", "outside")}
        return cls(values, data["spacing"], tuple(data["origin"]), **more)


def named_field(fields: Sequence[MeasuredField], name: str) -> MeasuredField:
    """Return the field with a name; for the name "" the only field. MapError if there is no such field."""
    found = [each for each in fields if name in ("", each.name)]
    if len(found) == 1:
        return found[0]
    known = [each.name for each in fields]
    if not known:
        raise MapError(
            "this world has no measured field; add one by world.with_fields([...]), or by fields of a scenario."
        )
    asked = f"no field is called {shown(name)}.{did_you_mean(name, known)}" if name else "name one of the fields."
    raise MapError(f"{asked} This world has {', '.join(known)}.")


def checked_fields(fields: Iterable[MeasuredField], ground: Ground) -> tuple[tuple[MeasuredField, ...], list[str]]:
    """Return the fields of a world, and notes on the parts of its free space in which they were not measured.

    Raises MapError for two fields with one name, and for a field that leaves free space out without saying what counts
    there (``outside``).
    """
    checked, notes = tuple(fields), []
    if not all(isinstance(each, MeasuredField) for each in checked):
        raise MapError(f"fields must be a list of hpop.world.MeasuredField; got {shown(fields)}.")
    names = [each.name for each in checked]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise MapError(f"each field needs a name of its own; {', '.join(map(shown, twice))} is given more than once.")
    for each in checked:
        share = ground.derived(("measured", each), partial(_share_measured, each, ground))
        percent = f"{min(100 * share, 99.9):.3g} % of the free space"  # of less than all, not rounded to 100
        if share == 0:
            spans = ("{:.4g} to {:.4g} m in x, {:.4g} to {:.4g} m in y".format(*b) for b in _spans(each, ground))
            raise MapError(
                f"field {shown(each.name)} covers no free space of the map: it spans {next(spans)}, the map "
                f"{next(spans)}. Give its origin in the frame of the map."
            )
        if share < 1 and each.outside is None:
            raise MapError(
                f"field {shown(each.name)} covers {percent} of the map; state the value, in {each.unit}, that counts "
                "elsewhere (outside), or measure the rest."
            )
        if share < 1:
            notes.append(
                f"field {shown(each.name)} was measured in {percent}; elsewhere it counts as {each.outside:g} "
                f"{each.unit}, as stated (outside)."
            )
    return checked, notes


def _share_measured(measured: MeasuredField, ground: Ground) -> float:
    """Return the share of the ground's free space in which a field was measured, by a sample of points."""
    x0, y0, x1, y1 = ground.bounds
    if (
        np.isfinite(measured.values).all()
        and measured.is_measured(np.array([x0, x0, x1, x1]), np.array([y0, y1] * 2)).all()
    ):
        return 1.0
    step = max(0.5 * measured.spacing, math.sqrt((x1 - x0) * (y1 - y0) / CHECKED))
    axes = (np.arange(low + min(0.5 * step, 0.5 * (high - low)), high, step) for low, high in ((x0, x1), (y0, y1)))
    x, y = (np.ravel(at) for at in np.meshgrid(*axes))
    free = ground.free_space().clearance(x, y) > 0
    return float(measured.is_measured(x[free], y[free]).mean()) if free.any() else 1.0


def _spans(measured: MeasuredField, ground: Ground) -> Iterable[tuple[float, float, float, float]]:
    """Yield (lowest x, highest x, lowest y, highest y), m, of a field's samples, and then of the map."""
    rows, columns = measured.values.shape
    corners = np.array([[0, 0], [columns - 1, 0], [0, rows - 1], [columns - 1, rows - 1]]) * measured.spacing
    (x, y), yaw = corners.T, measured.origin[2]
    x, y = (
        np.cos(yaw) * x - np.sin(yaw) * y + measured.origin[0],
        np.sin(yaw) * x + np.cos(yaw) * y + measured.origin[1],
    )
    yield x.min(), x.max(), y.min(), y.max()
    x0, y0, x1, y1 = ground.bounds
    yield x0, x1, y0, y1
