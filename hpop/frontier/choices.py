"""Methods of a front that choose one of its points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

from hpop.base.text import shown
from hpop.frontier import choosing
from hpop.frontier.dominance import FloatArray, IntArray
from hpop.frontier.points import FrontError, ItemPoint

T = TypeVar("T")


@runtime_checkable
class Preferring(Protocol):
    """Model of which points of a front a person prefers, such as :class:`hpop.study.Preference`."""

    def row(self, front: Any, /) -> int:
        """Return the row of a front that the person prefers."""

    def expected(self, front: Any, costs: FloatArray, /) -> FloatArray:
        """Return how much the person is expected to dislike costs (m, k), as numbers (m,) >= 0; less is better.

        The k columns are those of the front.
        """


class Choices(Generic[T]):
    """Base class of fronts: one method for each way to choose a point, such as the knee.

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

    def _point(self, row: int) -> ItemPoint[T]:
        """Return the point in a row of the front."""
        raise NotImplementedError

    def ideal(self) -> FloatArray:
        """Return the best value of each criterion over the front, (k,)."""
        self._require_points()
        return cast(FloatArray, self.costs.min(axis=0))

    def nadir(self) -> FloatArray:
        """Return the worst value of each criterion over the front, (k,)."""
        self._require_points()
        return cast(FloatArray, self.costs.max(axis=0))

    def knee(self) -> ItemPoint[T]:
        """Return the knee, the best compromise: the point that bulges most towards the ideal.

        :func:`hpop.frontier.choosing.knee` has the definition.
        """
        return self._point(choosing.knee(self._counts()))

    def best(self, name: str) -> ItemPoint[T]:
        """Return the point with the smallest cost in one criterion; the other criteria break ties, in their order."""
        return self.lexicographic([name])

    def lexicographic(self, order: Sequence[str]) -> ItemPoint[T]:
        """Return the best point in the first criterion of ``order``; the second criterion breaks ties, and so on.

        Further criteria follow in the order of the front. Example: ``front.lexicographic(["turns", "length"])``.
        """
        named = isinstance(order, Sequence) and bool(order) and all(isinstance(name, str) for name in order)
        if isinstance(order, str) or not named or len(set(order)) != len(order):
            raise FrontError(
                f"order must be a list of distinct criteria, such as ['turns', 'length'], got {shown(order)}"
            )
        columns = self._columns(order)
        return self._point(choosing.lexicographic(self._counts(), columns))

    def select(
        self, weights: Mapping[str, float] | None = None, *, preference: Preferring | None = None
    ) -> ItemPoint[T]:
        """Return the point with the smallest weighted sum of normalised costs, or the point that a person prefers.

        Weights are finite, not negative, and not all zero; criteria without a weight do not count. An example is
        ``front.select(weights={"turns": 2, "length": 1})``. A preference (:class:`hpop.study.Preference`) has weights
        per unit of cost, which do not depend on the front: ``front.select(preference=person)``.
        """
        if (weights is None) == (preference is None):
            raise FrontError(
                "select needs either weights, such as {'turns': 2, 'length': 1}, or a preference, but got "
                f"{'neither' if weights is None else 'both'}; give exactly one"
            )
        if preference is not None:
            if not isinstance(preference, Preferring):
                raise FrontError(
                    f"preference must be a preference, such as Preference.load(file), got {shown(preference)}"
                )
            self._require_points()
            return self._point(preference.row(self))
        assert weights is not None
        values, vector = choosing.named_numbers("weights", weights), np.zeros(len(self.names))
        vector[self._columns(weights)] = values
        return self._point(choosing.weighted_sum(self._counts(), vector))

    def nearest(self, wishes: Mapping[str, float]) -> ItemPoint[T]:
        """Return the point nearest to the values that a user wishes for, in criteria or reported values.

        Only the named columns count, each scaled by its range over the front. Ties go to the point with the smallest
        sum of the other criteria. Example: ``front.nearest({"turns": 3})``.
        """
        values = choosing.named_numbers("wishes", wishes)
        columns = [choosing.column_index(name, self.names + self.reported_names) for name in wishes]
        counts = self._counts()
        steps = np.concatenate([self.quanta, np.ones(len(self.reported_names))])
        unnamed = [column for column in range(len(self.names)) if column not in columns]
        table = np.hstack([counts, self.reported])  # (n, k + r)
        return self._point(choosing.nearest(table[:, columns], values / steps[columns], counts[:, unnamed]))

    def reference_point(self, aspirations: Mapping[str, float]) -> ItemPoint[T]:
        """Return the point that comes closest to aspiration levels (desired costs), or is furthest below them.

        It minimises the augmented Chebyshev achievement function (:func:`hpop.frontier.choosing.achievement`).
        Example: ``front.reference_point({"turns": 3, "length": 20.0})``.
        """
        values = choosing.named_numbers("aspirations", aspirations)
        columns = self._columns(aspirations)
        return self._point(choosing.achievement(self._counts(), columns, values / self.quanta[columns]))

    def _columns(self, names: Iterable[str]) -> list[int]:
        """Return the column indices of criteria given by name."""
        return [choosing.column_index(name, self.names, self.reported_names) for name in names]

    def _counts(self) -> FloatArray:
        """Return the costs (n, k) as whole numbers of quanta, in float64."""
        self._require_points()
        return self.integers.astype(np.float64)

    def _require_points(self) -> None:
        """Raise FrontError if the front is empty."""
        if not len(self.costs):
            raise FrontError(
                f"a point can only be chosen from a front with points, but this one has none; its status is "
                f"{self.status!r}: {self._reason():.600}"
            )

    def _reason(self) -> str:
        """Return what is known about why a front has no points."""
        return self.certificate
