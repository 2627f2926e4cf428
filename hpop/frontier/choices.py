"""Methods of a front that choose one of its points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

from hpop.base.text import shown
from hpop.frontier import choosing
from hpop.frontier.dominance import FloatArray, IntArray
from hpop.frontier.points import FrontError, Point

T = TypeVar("T")


@runtime_checkable
class Preferring(Protocol):
    """Preference of a person over the rows of a front, such as :class:`hpop.study.Preference`."""

    def row(self, front: Any, /) -> int:
        """Return the row of a front that the person prefers."""

    def expected(self, front: Any, costs: FloatArray, /) -> FloatArray:
        """Return the expected dislike (m,), at least 0, of costs (m, k) in the columns of a front; less is better."""


class Choices(Generic[T]):
    """Base class of fronts, with a method for each way to choose a point.

    All methods raise FrontError for a front without points.
    """

    names: tuple[str, ...]
    reported_names: tuple[str, ...]
    costs: FloatArray
    reported: FloatArray
    quanta: FloatArray
    integers: IntArray
    status: str
    certificate: str

    def _point(self, row: int) -> Point[T]:
        """Return the point of a row."""
        raise NotImplementedError

    def ideal(self) -> FloatArray:
        """Return the best value of each criterion over the front, (k,)."""
        self._require_points()
        return cast(FloatArray, self.costs.min(axis=0))

    def nadir(self) -> FloatArray:
        """Return the worst value of each criterion over the front, (k,)."""
        self._require_points()
        return cast(FloatArray, self.costs.max(axis=0))

    def knee(self) -> Point[T]:
        """Return the best compromise: the point deepest below all mixtures of the extreme points.

        The definition is that of :func:`hpop.frontier.choosing.knee`.
        """
        return self._point(choosing.knee(self._counts()))

    def best(self, name: str) -> Point[T]:
        """Return the point with the least value of one criterion; ties go to the other criteria in their order."""
        return self.lexicographic([name])

    def lexicographic(self, order: Sequence[str]) -> Point[T]:
        """Return the best point in the first criterion of ``order``; the second criterion breaks ties, and so on.

        Further criteria follow in the order of the front. Example: ``front.lexicographic(["turns", "length"])``.
        """
        named = isinstance(order, Sequence) and bool(order) and all(isinstance(name, str) for name in order)
        if isinstance(order, str) or not named or len(set(order)) != len(order):
            raise FrontError(f"expected a list of distinct criteria, got {shown(order)}")
        columns = self._columns(order)
        return self._point(choosing.lexicographic(self._counts(), columns))

    def select(self, weights: Mapping[str, float] | None = None, *, preference: Preferring | None = None) -> Point[T]:
        """Return the point with the least weighted sum of normalised costs, or the point that a person prefers.

        Weights are finite, not negative, and not all zero; criteria without a weight do not count:
        ``front.select(weights={"turns": 2, "length": 1})``. The weights of a preference are per unit of a cost, so that
        they mean the same on each front: ``front.select(preference=person)``, see :class:`hpop.study.Preference`.
        """
        if (weights is None) == (preference is None):
            raise FrontError(
                "select takes weights, such as {'turns': 2, 'length': 1}, or a preference: give one of the two"
            )
        if preference is not None:
            if not isinstance(preference, Preferring):
                raise FrontError(f"expected a preference, such as Preference.load(file), got {shown(preference)}")
            self._require_points()
            return self._point(preference.row(self))
        assert weights is not None
        values, vector = choosing.named_numbers("weights", weights), np.zeros(len(self.names))
        vector[self._columns(weights)] = values
        return self._point(choosing.weighted_sum(self._counts(), vector))

    def nearest(self, wishes: Mapping[str, float]) -> Point[T]:
        """Return the point nearest to wished values of criteria or of reported values.

        Only named values count, each scaled by its range over the front. Ties go to the point with the least sum of the
        other criteria. Example: ``front.nearest({"turns": 3})``.
        """
        values = choosing.named_numbers("wishes", wishes)
        columns = [choosing.column_index(name, self.names + self.reported_names) for name in wishes]
        counts = self._counts()
        steps = np.concatenate([self.quanta, np.ones(len(self.reported_names))])
        unnamed = [column for column in range(len(self.names)) if column not in columns]
        table = np.hstack([counts, self.reported])  # (n, k + r)
        return self._point(choosing.nearest(table[:, columns], values / steps[columns], counts[:, unnamed]))

    def reference_point(self, aspirations: Mapping[str, float]) -> Point[T]:
        """Return the point that is best with respect to aspiration levels; it exceeds them where it can.

        Augmented Chebyshev achievement function (Wierzbicki 1980), as in :func:`hpop.frontier.choosing.achievement`.
        Example: ``front.reference_point({"turns": 3, "length": 20.0})``.
        """
        values = choosing.named_numbers("aspirations", aspirations)
        columns = self._columns(aspirations)
        return self._point(choosing.achievement(self._counts(), columns, values / self.quanta[columns]))

    def _columns(self, names: Iterable[str]) -> list[int]:
        """Return the column indices of criteria given by name."""
        return [choosing.column_index(name, self.names, self.reported_names) for name in names]

    def _counts(self) -> FloatArray:
        """Return the costs (n, k) in quanta, as float64."""
        self._require_points()
        return self.integers.astype(np.float64)

    def _require_points(self) -> None:
        """Raise FrontError if the front is empty."""
        if not len(self.costs):
            raise FrontError(
                f"the front has no points to choose from; its status is {self.status!r}, its certificate: "
                f"{self.certificate:.400}"
            )
