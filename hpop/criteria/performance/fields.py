"""Measured fields under the camera: time in bad places, the worst place, and how stale the view is where it turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import norm
from hpop.base.options import LEAST, MOST, set_reals
from hpop.base.text import shown
from hpop.criteria.base import criterion
from hpop.errors import CriterionError, MapError
from hpop.motions import Instants, Motions
from hpop.world.fields.field import Field
from hpop.world.fields.measured import MeasuredField, named_field

SECONDS = {"s": 1.0, "ms": 1e-3}


class _OfField:
    """Base class for criteria of one measured field of the world; its parameter ``field`` is the name of the field."""

    field: str

    def _require_field(self) -> None:
        """Check the name of the field, and require this field of the world."""
        if not isinstance(self.field, str):
            raise CriterionError(f"field must be the name of a measured field of the world, got {shown(self.field)}")
        if self.field:
            needs: Any = type(self)
            object.__setattr__(self, "requires", (*needs.requires, f"field {self.field}"))

    @property
    def measured_field(self) -> str:
        """Name of the field, which pictures show; "" for the only field of the world."""
        return self.field

    def _of(self, m: Motions) -> tuple[Field, MeasuredField]:
        """Return the field as the world of motions evaluates it, and as it was measured."""
        try:
            return m.world.field(self.field), named_field(m.world.fields, self.field)
        except MapError as error:
            raise CriterionError(f"criterion {type(self).__name__}: {error}") from None


@dataclass(frozen=True)
class _Graded(_OfField):
    """Base class for criteria that grade values of a field: 0 at ``good`` or better, 1 at ``bad``, more beyond."""

    good: float  # value, in the unit of the field, that counts 0, as all better values do
    bad: float  # value that counts 1, and worse ones more; below good if high values are good, else above
    field: str = ""  # name of the measured field; may be left out if the world has one

    def __post_init__(self) -> None:
        set_reals(self, "good", "bad", least=-MOST, most=MOST, kind="a value of the field", error=CriterionError)
        if abs(self.good - self.bad) < LEAST:
            raise CriterionError(f"good and bad must be two different values of the field, got {self.good!r} twice")
        self._require_field()

    def _grade(self, value: Column) -> Column:
        """Return the grades (N,) of values of the field."""
        return np.maximum((self.good - value) / (self.good - self.bad), 0.0)


@criterion("field_exposure", group="P", unit="s", aggregate="sum", requires=("camera", "fields"))
@dataclass(frozen=True)
class FieldExposure(_Graded):
    """Time in places where a measured field is bad: ∫ g(f(p(t))) dt, with g(f) = ((good - f) / (good - bad))₊.

    f is the measured field, such as the strength of a radio signal, and p the position of the camera. g is a monotone
    function: 0 at ``good`` and better values, 1 at ``bad``, and it goes on growing beyond. A second at ``bad`` costs
    1 s. Unit s; a sum over motions. For a field whose high values are bad, such as noise, give ``bad`` above ``good``.

    Source: quality of video by delay and loss depends on the place (arXiv 2003.10914); radio maps as costs of paths
    (arXiv 1710.09303). The linear form of g is this project's choice.

    The field is bilinear between its samples (:class:`hpop.world.MeasuredField`). Quadrature intervals are at most half
    of the samples' spacing long.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the graded field (M,), s."""
        field, measured = self._of(m)
        return m.integrate(lambda s: self._grade(field(s.camera.x, s.camera.y)), detail=measured.spacing)


@criterion("field_worst", group="P", unit="1", aggregate="max", requires=("camera", "fields"))
@dataclass(frozen=True)
class FieldWorst(_Graded):
    """Worst place on the way in a measured field: max over t of g(f(p(t))), with g as in :class:`FieldExposure`.

    0 means that the field was never worse than ``good``, 1 that it was as bad as ``bad``. Unit 1; the worst moment.

    Accuracy: the maximum is taken over the ends and middles of pieces no longer than c, the smaller of a cell of the
    distance grid and half of the samples' spacing. If the field changes by at most k per metre, the true maximum is
    larger by at most k c / (4 |good - bad|).
    """

    def cost(self, m: Motions) -> Column:
        """Return the largest graded value of the field (M,)."""
        field, measured = self._of(m)
        return m.worst(lambda s: self._grade(field(s.camera.x, s.camera.y)), detail=measured.spacing)


@criterion("time_below", group="P", unit="s", aggregate="sum", requires=("camera", "fields"))
@dataclass(frozen=True)
class TimeBelow(_OfField):
    """Time in which a measured field is below a limit: ∫ h((limit - f(p(t))) / width + 1/2) dt.

    f is the measured field and p the position of the camera. h(u) = 10 u³ - 15 u⁴ + 6 u⁵ for u from 0 to 1, 0 below and
    1 above. So over ``width``, centred at ``limit``, a second counts gradually from 0 to 1 s, and the cost has a
    gradient. A narrow width counts nearly sharply. Unit s; a sum over motions.
    """

    limit: float  # value, in the unit of the field, below which time counts
    width: float  # range of values round the limit over which a second counts gradually
    field: str = ""  # name of the measured field; may be left out if the world has one

    def __post_init__(self) -> None:
        set_reals(self, "limit", least=-MOST, most=MOST, kind="a value of the field", error=CriterionError)
        set_reals(self, "width", least=LEAST, most=MOST, kind="a positive range of values", error=CriterionError)
        self._require_field()

    def cost(self, m: Motions) -> Column:
        """Return the time (M,), s, below the limit."""
        field, measured = self._of(m)

        def rate(s: Instants) -> Column:
            below = (self.limit - field(s.camera.x, s.camera.y)) / self.width + 0.5
            share = np.minimum(np.maximum(below, 0.0), 1.0)
            return share * share * share * (10.0 - share * (15.0 - 6.0 * share))

        return m.integrate(rate, detail=min(measured.spacing, 0.25 * self.width / max(measured.steepest, LEAST)))


@criterion("stale_view", group="P", unit="rad s", aggregate="sum", requires=("camera", "fields"))
@dataclass(frozen=True)
class StaleView(_OfField):
    """Angle by which the delayed picture lags behind the turning camera, over time: ∫ L(p(t)) |ω(t)| dt.

    L is a measured field of the stream's latency, in s or ms, at the position p of the camera. ω is the camera's
    angular velocity. While the camera turns at |ω|, the picture shows the direction of L seconds before, so it is wrong
    by about L |ω|. Turning where the connection is fast is cheap, and driving straight on costs nothing. Unit rad s; a
    sum over motions.

    Source: latencies of streams reach seconds and depend on the place (arXiv 2508.12925). The product is this project's
    choice.
    """

    field: str = ""  # name of the measured field of latency; may be left out if the world has one field

    def __post_init__(self) -> None:
        self._require_field()

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), rad s, of the latency times the angular speed."""
        field, measured = self._of(m)
        if measured.unit not in SECONDS or measured.lowest < 0:
            raise CriterionError(
                f"stale_view needs a field of latency, in s or ms and not negative; {shown(measured.name)} is in "
                f"{measured.unit}, from {measured.lowest:g}; name another field"
            )
        if m.camera.steady:
            return 0.0 * m.duration
        scale = SECONDS[measured.unit]
        return m.integrate(
            lambda s: scale * field(s.camera.x, s.camera.y) * norm(s.twist("camera").rotation), detail=measured.spacing
        )
