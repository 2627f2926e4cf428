"""Methods of a front that choose one of its points, and that select points by conditions, by slices, and by masks.

In conditions such as turns <= 5, costs are compared in whole quanta (smallest differences that count), so a length of
30.000000000000004 m is not longer than 30 m. Reported values have no quanta and count as equal if they differ only by
rounding. If no point meets the conditions, the nearest one is named.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, Self, TypeVar, cast, runtime_checkable

import numpy as np

from hpop.base.text import is_number, shown
from hpop.frontier import choosing
from hpop.frontier.dominance import BoolArray, FloatArray, IntArray
from hpop.frontier.points import SHARE, FrontError, ItemPoint, representative

if TYPE_CHECKING:
    from hpop.frontier.front import ItemFront

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
    """Base class of fronts: one method for each way to choose a point, such as the knee, and to select several.

    Methods that choose a point raise FrontError for a front without points.
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

    def _selected(self, kept: BoolArray, by: str) -> Self:
        """Return the front of the points in a mask (n,); ``by`` says for its certificate how they were selected."""
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

        The distance is Euclidean, in the named columns, each scaled by its range over the front; a better value than
        wished counts as distance too. Ties go to the point with the smallest sum of the other normalised criteria.
        Example: ``front.nearest({"turns": 3})``.
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

    def where(self, conditions_by_name: Mapping[str, Any] | None = None, /, **named: Any) -> Self:
        """Return the front of the points that meet all conditions on criteria and reported values.

        Example: ``front.where(turns="<=5", length="<= 30")``; give a dict if a name is no Python name. A condition is
        one of <=, <, >=, >, ==, != followed by a number in the unit of the column; a number alone means equality. Costs
        are compared in whole quanta. If no point meets the conditions, the new front is empty, and its certificate
        names the nearest point of this front.

        Raises UnknownColumnError for a name that the front does not have, FrontError for an invalid condition.
        """
        wanted = conditions(conditions_by_name, named)
        return self._selected(met(cast(Any, self), wanted), in_words(cast(Any, self), wanted))

    def representative(self, count: int) -> Self:
        """Return the front of up to ``count`` points that represent this one: together they have a large hypervolume.

        At least 63 % of that of the best ``count`` points; see :func:`hpop.frontier.representative`. Points that are
        best in one criterion, and the knee, may be missing.

        Raises FrontError for a count below 1.
        """
        rows = representative(self.integers, count)
        if len(rows) == len(self.costs):
            return self
        kept = np.zeros(len(self.costs), np.bool_)
        kept[rows] = True
        return self._selected(kept, f"greedy hypervolume (at least {SHARE} of that of the best {len(rows):,} points)")

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


OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
    "==": operator.eq,
    "!=": operator.ne,
}
FORM = re.compile(r"\s*([<>=!~]*)(.*)", re.DOTALL)
ALIKE = 8 * float(np.finfo(np.float64).eps)  # relative rounding error of a bound divided by a quantum
INDEX_FORMS = "index a front by a row, a slice such as [:5], or a boolean mask (n,) such as front.costs[:, 0] <= 5"


class ColumnCondition(NamedTuple):
    """Condition on one column: its name, a comparison, and the bound in the unit of the column."""

    name: str
    comparison: str
    bound: float

    @classmethod
    def of(cls, name: str, given: Any) -> ColumnCondition:
        """Parse a condition on a column from a text such as "<=5", or from a number, which means equality.

        >>> print(ColumnCondition.of("turns", "<=5"), ColumnCondition.of("length", "> 2.5e1"), sep=", ")
        turns <= 5, length > 25
        >>> print(ColumnCondition.of("turns", 3))
        turns == 3
        """
        if is_number(given):
            comparison, bound = "==", float(given)
        elif isinstance(given, str) and len(given) < choosing.MOST_LETTERS:
            comparison, bound = _read(name, given)
        else:
            raise FrontError(
                f"a condition on {shown(name)} must be text such as '<=5', or a number, got {shown(given)}"
            )
        if not math.isfinite(bound):
            raise FrontError(f"the bound of a condition must be a finite number, got {shown(given)} for {shown(name)}")
        return cls(name, comparison, bound)

    def __str__(self) -> str:
        return f"{self.name} {self.comparison} {self.bound:.12g}"

    def met(self, values: FloatArray, quantum: float) -> BoolArray:
        """Mark the values (n,) that meet the condition.

        They are compared in whole quanta. For quantum 0, a value that equals the bound up to rounding is equal to it.
        """
        bound, slack = self.bound, choosing.ROUNDING * abs(self.bound)
        if quantum:
            values, bound = np.rint(values / quantum), self.bound / quantum
            slack = ALIKE * max(1.0, abs(bound))
        close = np.where(np.abs(values - bound) <= slack, bound, values)
        return np.asarray(OPERATORS[self.comparison](close, bound), dtype=np.bool_)


def conditions(given: Mapping[str, Any] | None, named: Mapping[str, Any]) -> tuple[ColumnCondition, ...]:
    """Parse the conditions that a user gives as a dict (``given``), as keyword arguments (``named``), or both.

    Raises FrontError for an invalid condition, or if there is none.
    """
    if given is not None and not isinstance(given, Mapping):
        raise FrontError(f"conditions must be keywords such as turns='<=5', or a dict, got {shown(given)}")
    wanted = [*(given or {}).items(), *named.items()]
    if not wanted:
        raise FrontError("at least one condition must be given, such as turns='<=5', got none")
    if len({name for name, _ in wanted}) < len(wanted):
        raise FrontError(
            f"each name must have one condition, got two for {shown(sorted(set(given or {}) & set(named)))}; "
            "give one of them"
        )
    return tuple(ColumnCondition.of(name, bound) for name, bound in wanted)


def met(front: ItemFront[Any], wanted: Sequence[ColumnCondition]) -> BoolArray:
    """Return the mask (n,) of the points that meet all conditions; UnknownColumnError for an unknown name."""
    kept = np.ones(len(front), dtype=np.bool_)
    for condition in wanted:
        kept &= condition.met(*_column(front, condition.name))
    return kept


def nearest(front: ItemFront[Any], wanted: Sequence[ColumnCondition]) -> int:
    """Return the row that misses the conditions least, by Euclidean distance with columns scaled by their ranges."""
    gaps = []
    for condition in wanted:
        values, quantum = _column(front, condition.name)
        off = np.where(condition.met(values, quantum), 0.0, np.abs(values - condition.bound))
        gaps.append(off / (np.ptp(values) or 1.0))
    return choosing.least(np.linalg.norm(gaps, axis=0))


def in_words(front: ItemFront[Any], wanted: Sequence[ColumnCondition]) -> str:
    """Return the conditions as a text for a certificate; if no point meets them, the text names the nearest point."""
    words = " and ".join(map(str, wanted))
    if not len(front) or met(front, wanted).any():
        return words
    row = nearest(front, wanted)
    values = (f"{c.name} {_column(front, c.name)[0][row]:.6g}" for c in wanted)
    return f"{words}, which no point meets: the nearest, point {row}, has {', '.join(dict.fromkeys(values))}"


def _read(name: str, text: str) -> tuple[str, float]:
    """Split the text of a condition on a column into its comparison and its number; FrontError if it is invalid."""
    comparison, number = FORM.fullmatch(text).groups()  # type: ignore[union-attr]  # it takes any text
    if comparison not in OPERATORS:
        given = f"{comparison!r} in {shown(text)}" if comparison else shown(text)
        raise FrontError(
            f"a condition on {shown(name)} must begin with one of {', '.join(OPERATORS)}, as in '<=5', got {given}"
        )
    try:
        return comparison, float(number)
    except ValueError:
        raise FrontError(
            f"a condition on {shown(name)} must end with a number, as in '<=5', got {shown(text)}"
        ) from None


def _column(front: ItemFront[Any], name: str) -> tuple[FloatArray, float]:
    """Return the values (n,) of a criterion and its quantum; for a reported value the quantum is 0."""
    column = choosing.column_index(name, front.names + front.reported_names)
    k = len(front.names)
    return (front.costs[:, column], float(front.quanta[column])) if column < k else (front.reported[:, column - k], 0.0)


def kept(index: Any, size: int) -> tuple[BoolArray, str]:
    """Return a mask (n,) of the rows that a user's index (a slice or a mask) selects, and a text for the certificate.

    Raises TypeError for an invalid index, IndexError for a mask of another length or a slice that goes backwards.

    >>> kept(slice(1, None), 3)
    (array([False,  True,  True]), 'rows 1:')
    """
    if isinstance(index, slice):
        if index.step is not None and index.step < 0:
            raise IndexError(
                "the step of a slice must be positive, because points of a front keep their order, got "
                f"{index.step}; use reversed(list(front))"
            )
        mask = np.zeros(size, dtype=np.bool_)
        mask[index] = True
        ends = ["" if end is None else str(end) for end in (index.start, index.stop, index.step)]
        return mask, f"rows {':'.join(ends[: 2 + bool(ends[2])])}"
    try:
        mask = np.asarray(index)
    except ValueError:  # rows of several lengths
        mask = np.zeros((0, 0), dtype=np.bool_)
    if mask.dtype != np.bool_ or mask.ndim != 1:
        raise TypeError(f"{INDEX_FORMS}; got {shown(index)}")
    if mask.size != size:
        raise IndexError(f"a mask must have True or False for each of {size:,} points, got length {mask.size:,}")
    return mask, "a mask"
