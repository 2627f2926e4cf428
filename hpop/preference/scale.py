"""Scale of costs for a preference: costs as shares of a front's range, with an extra column for each threshold.

The scale is that of the front about which a person was asked, and is kept by units: on another front a metre has the
weight that it had there, however wide the other front is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.text import counted, shown
from hpop.errors import StudyError, did_you_mean
from hpop.frontier import ItemFront
from hpop.frontier.choosing import ROUNDING

LOG = "log"
BENT = 9.0
"""Curvature of a logarithmic cost: at the ideal a unit counts 1 + BENT times as much as at the nadir."""
Feature = str | float
"""Nonlinearity of a cost: "log", or a threshold in the cost's unit, above which the cost counts more."""


class Measure(NamedTuple):
    """Column of a scale: the name of a cost, its unit, and its range on the front in that unit (0 if constant)."""

    name: str
    unit: str
    size: float


@dataclass(frozen=True, eq=False)
class CostScale:
    """Scale that maps the costs of a front to numbers from 0 to 1; costs of other fronts may lie outside.

    names     of the k costs
    units     of the k costs
    ideal     (k,)   least value of each cost on the front
    span      (k,)   range of each cost on the front; 0 for a constant cost, which has no effect on a preference
    features  nonlinearities by name of a cost: "log" lets a unit near the ideal count more; a number in the cost's unit
              is a threshold, and the excess above it is a further column with a share of its own
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    ideal: FloatArray
    span: FloatArray
    features: Mapping[str, Feature]

    def __post_init__(self) -> None:
        for name, feature in self.features.items():
            self._check_feature(name, feature)

    @classmethod
    def of(cls, front: ItemFront[Any], features: Mapping[str, Feature] | None = None) -> CostScale:
        """Return the scale of a front's costs; StudyError for fewer than two points, or an invalid feature."""
        if not isinstance(front, ItemFront):
            raise StudyError(f"a preference needs a front, such as problem.solve() returns, got {shown(front)}")
        if len(front) < 2:
            raise StudyError(
                f"a preference needs a front of at least two points, got {counted(len(front), 'point')}; plan one with "
                "other criteria or planners"
            )
        low, high = front.ideal(), front.nadir()
        varies = high - low > ROUNDING * np.maximum(np.abs(low), np.abs(high))
        if features is not None and not isinstance(features, Mapping):
            raise StudyError(
                f"features must be a dict by name of a cost, such as {{'turns': 6}}, got {shown(features)}"
            )
        return cls(front.names, front.units, low, np.where(varies, high - low, 0.0), dict(features or {}))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns that have shares of their own: the costs, and their excesses above thresholds."""
        above = [f"{name} above {bound:g}" for name, bound in self._thresholds]
        return (*self.names, *above)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Name, unit and range of each column; the unit of a logarithmic cost is marked as such."""
        found = []
        for name, unit, span in zip(self.names, self.units, self.span.tolist(), strict=True):
            found.append(Measure(name, f"{LOG} {unit}" if self.features.get(name) == LOG else unit, span))
        for column, (name, bound) in zip(self.columns[len(found) :], self._thresholds, strict=True):
            j = self.names.index(name)
            room = float(self.ideal[j] + self.span[j]) - bound
            found.append(Measure(column, self.units[j], max(room, 0.0)))
        return tuple(found)

    def scaled(self, costs: FloatArray) -> FloatArray:
        """Scale costs (n, k), given in their units; return (n, f), one column for each of :attr:`columns`."""
        plain = self._range_shares(costs)
        columns = [
            self._log_scaled(plain[:, j]) if self.features.get(n) == LOG else plain[:, j]
            for j, n in self._column_sources
        ]
        for name, bound in self.features.items():
            if not isinstance(bound, str):
                j = self.names.index(name)
                room = self.ideal[j] + self.span[j] - bound
                columns.append(np.maximum(costs[:, j] - bound, 0.0) / room if room > 0 else np.zeros(len(costs)))
        return np.column_stack(columns)

    def column_indices(self, front: ItemFront[Any]) -> list[int]:
        """Return the indices of this scale's costs among the costs of a front; StudyError that names a missing cost."""
        places = []
        for name, unit in zip(self.names, self.units, strict=True):
            if name not in front.names:
                raise StudyError(
                    f"the preference weighs {shown(name)}, which the front does not have"
                    f"{' but reported' * (name in front.reported_names)}.{did_you_mean(name, front.names)} Its costs "
                    f"are {', '.join(front.names)}; plan with {shown(name)} as a criterion, or answer the questions "
                    "for this front again"
                )
            j = front.names.index(name)
            if front.units[j] != unit:
                raise StudyError(
                    f"the preference has {shown(name)} in {shown(unit)}, the front in {shown(front.units[j])}; "
                    "convert the front's costs to the same unit, or answer the questions for this front again"
                )
            places.append(j)
        return places

    def costs_on(self, front: ItemFront[Any]) -> FloatArray:
        """Return the costs (n, k) of a front in the order of this scale; StudyError that names a missing cost."""
        return np.asarray(front.costs[:, self.column_indices(front)])

    def rows_on(self, front: ItemFront[Any]) -> FloatArray:
        """Return the scaled costs (n, f) of the points of a front."""
        return self.scaled(self.costs_on(front))

    @property
    def _thresholds(self) -> list[tuple[str, float]]:
        """Names of costs that have a threshold, with the threshold."""
        return [(name, bound) for name, bound in self.features.items() if not isinstance(bound, str)]

    @cached_property
    def _column_sources(self) -> list[tuple[int, str]]:
        """Index and name of each cost."""
        return list(enumerate(self.names))

    def _range_shares(self, costs: FloatArray) -> FloatArray:
        """Return costs (n, k) as shares of their ranges; 0 for constant costs."""
        varies = self.span > 0
        shares = (costs - self.ideal) / np.where(varies, self.span, 1.0)
        return np.asarray(np.where(varies, shares, 0.0))

    @staticmethod
    def _log_scaled(share: FloatArray) -> FloatArray:
        """Return shares of a logarithmic cost: 0 at the ideal, 1 at the nadir, linear below the ideal."""
        below = np.minimum(share, 0.0)
        return np.asarray((BENT * below + np.log1p(BENT * np.maximum(share, 0.0))) / np.log1p(BENT))

    def _check_feature(self, name: str, feature: Any) -> None:
        """Raise StudyError for a feature of an unknown cost, or a threshold outside the range of the cost."""
        if name not in self.names:
            raise StudyError(f"no cost is called {shown(name)}.{did_you_mean(name, self.names)} There are: "
                             f"{', '.join(self.names)}")  # fmt: skip
        if feature == LOG:
            return
        bound = real(f"the feature of {name}", feature, -MOST, MOST, "'log' or a number in its unit", error=StudyError)
        j = self.names.index(name)
        if not self.ideal[j] < bound < self.ideal[j] + self.span[j]:
            raise StudyError(
                f"the feature of {name} must be a number between its least and greatest value on the front, "
                f"{self.ideal[j]:g} to {self.ideal[j] + self.span[j]:g} {self.units[j]}, got {bound:g}"
            )


def fingerprint(front: ItemFront[Any]) -> str:
    """Return the SHA-256 of a front's names, units and costs, by which files refer to the front."""
    text = json.dumps([front.names, front.units, front.costs.tolist()], allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
