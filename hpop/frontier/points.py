"""Points of a front, checks of its values, names and provenance, unions of fronts, and indicators to compare them.

The indicators (hypervolume, additive epsilon) are in the units of the costs. So scale criteria of different units
first, with one ideal and one nadir for both fronts (:func:`hpop.frontier.choosing.normalised`).
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arguments import checked_arguments
from hpop.base.lazy import on_first_use
from hpop.base.text import is_whole, python_value, shown
from hpop.frontier.dominance import FloatArray, IntArray, cost_matrix, filter, finite_costs, is_nondominated
from hpop.frontier.strict_json import plain

if TYPE_CHECKING:
    from hpop.frontier.front import ItemFront


T = TypeVar("T")


class FrontError(ValueError):
    """Error for fronts that cannot be joined, and for invalid choices of a point."""


class UnknownColumnError(FrontError, LookupError):
    """Error for a name that is neither a criterion nor a reported value of the front."""


class FrontFileError(FrontError):
    """Error for a front that cannot be written as JSON, and for a file that is not a saved front."""


def names_of(costs: ArrayLike, names: Sequence[str] | None, *, letter: str = "f") -> tuple[str, ...]:
    """Return the names of columns of costs: the given names, those of a pandas table, or "f1", "f2", ...

    >>> names_of([[1.0, 2.0]], None)
    ('f1', 'f2')
    """
    if names is not None:
        return (names,) if isinstance(names, str) else tuple(names)
    columns = getattr(costs, "columns", None)
    if columns is not None:
        return tuple(str(name) for name in columns)
    return tuple(f"{letter}{j + 1}" for j in range(cost_matrix(costs).shape[1]))


def minimised(
    matrix: FloatArray, names: tuple[str, ...], maximise: Sequence[str] | Sequence[bool]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return costs and names in which columns that are to be maximised are negated and named "-name".

    maximise  names of these columns, or a bool for each column

    >>> minimised(np.array([[1.0, 2.0]]), ("length", "view"), ["view"])
    (array([[ 1., -2.]]), ('length', '-view'))
    """
    choices: Any = [maximise] if isinstance(maximise, str) else maximise
    try:
        values = [python_value(choice) for choice in choices]
        flags = values if all(isinstance(value, bool) for value in values) else None
    except TypeError:
        flags, choices = None, [maximise]
    if flags is None:
        strange = [choice for choice in choices if choice not in names]
        if strange:
            raise FrontError(
                f"maximise must be names of costs, or a bool for each of {', '.join(names)}, got {shown(maximise)}"
            )
        flags = [name in choices for name in names]
    if flags and len(flags) != len(names):
        raise FrontError(f"maximise must have one bool for each of {', '.join(names)}, got {len(flags)} bools")
    if not any(flags):
        return matrix, names
    sign = np.where(flags, -1.0, 1.0)
    signed_names = tuple(f"-{name}" if flag else name for name, flag in zip(names, flags, strict=True))
    return matrix * sign + 0.0, signed_names


def floats(values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a copy of an array as float64, with 0.0 for -0.0; an empty array gets the expected shape."""
    array = np.array(values, dtype=np.float64) + 0.0
    return array.reshape(shape) if array.size == 0 and 0 in shape else array


def origins(provenance: Sequence[Mapping[str, Any]]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return provenance entries (how each point was found) as plain JSON values, and as texts of JSON.

    Equal entries become one object, which saves memory.
    """
    copies: dict[str, dict[str, Any]] = {}
    texts: list[str] = []
    text_of: dict[int, str] = {}
    for origin in provenance:
        text = text_of.get(id(origin))
        if text is None:
            copy = as_json("provenance", origin)
            text = text_of[id(origin)] = json.dumps(copy, sort_keys=True)
            copies.setdefault(text, copy)
        texts.append(text)
    return [copies[text] for text in texts], texts


def as_json(name: str, value: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a mapping as plain JSON values, which are equal after saving and loading.

    Raises ValueError, which calls the mapping ``name``, for anything that JSON cannot hold.
    """
    try:
        return cast(dict[str, Any], plain(dict(value)))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{name} must be a dict of JSON values, got {shown(value)} ({error}); convert it") from error


@dataclass(frozen=True, eq=False, repr=False)
class ItemPoint(Generic[T]):
    """Point of a front: its costs, and the item that has them.

    index       row in the front
    costs       cost by the name of each criterion, in the units of the front
    reported    further values by name, which were not optimised
    item        object that has these costs, such as a trajectory
    provenance  how the point was found, as JSON
    """

    index: int
    costs: dict[str, float]
    reported: dict[str, float]
    item: T
    provenance: dict[str, Any]

    def __repr__(self) -> str:
        costs, reported = (
            ", ".join(f"{name} {value:.6g}" for name, value in values.items()) for values in (self.costs, self.reported)
        )
        more = f" (reported: {reported})" if reported else ""
        return f"<Point {self.index} of its front: {costs}{more}; {shown(self.item)}>"


__getattr__ = on_first_use(__name__, {}, former={"Point": "ItemPoint"})  # former name, in pickles


F = TypeVar("F", bound="ItemFront[Any]")

# Separator between the statuses and certificates of the fronts in a union.
JOINT = " | "
BEYOND = 0.1  # share of the range: the default reference is that far beyond the nadir


def join(first: F, second: F) -> F:
    """Return the union of two fronts of one problem: the points that no point of either front dominates.

    In costs the union is commutative, associative and idempotent. If both fronts have an equal status, it is that of
    the union; otherwise the union has both, joined by " | ". Certificates are treated alike. Each certificate still
    holds for the search space that it names, because each cost vector of its front is matched or dominated by a point
    of the union. It says nothing about the points of the other front.

    Raises
    ------
    FrontError
        If the criteria, their units, groups or quanta, the reported values or the problems differ.
    """
    for name in ("names", "units", "groups"):
        _require_same(name, getattr(first, name), getattr(second, name))
    _require_same("quanta", first.quanta.tolist(), second.quanta.tolist())
    mine = dict(zip(first.reported_names, first.reported_units, strict=True))
    theirs = dict(zip(second.reported_names, second.reported_units, strict=True))
    _require_same("reported values", sorted(mine.items()), sorted(theirs.items()))
    question, second_question = first.question, second.question
    if question is not None and second_question is not None:
        keys = sorted(question.keys() | second_question.keys())
        differing = [k for k in keys if question.get(k, ...) != second_question.get(k, ...)]
        _require_same("problems", *({k: p.get(k) for k in differing} for p in (question, second_question)))
    columns = [second.reported_names.index(name) for name in first.reported_names]
    runs = first.runs + second.runs
    return type(first).of(
        np.concatenate([first.costs, second.costs]),
        first.items + second.items,
        names=first.names,
        units=first.units,
        quanta=first.quanta,
        groups=first.groups,
        reported=np.concatenate([first.reported, second.reported[:, columns]]),
        reported_names=first.reported_names,
        reported_units=first.reported_units,
        status=_joined(first.status, second.status),
        certificate=_joined(first.certificate, second.certificate),
        provenance=first.provenance + second.provenance,
        problem=second.problem if first.problem is None else first.problem,
        runs=[run for i, run in enumerate(runs) if run not in runs[:i]],
    )


def each_claim(certificate: str, words: str) -> str:
    """Return a certificate in which each statement is put into ``words``, in place of the braces.

    >>> each_claim("exact | supported", "of 9 points: {}")
    'of 9 points: exact | of 9 points: supported'
    """
    return JOINT.join(words.replace("{}", part) for part in certificate.split(JOINT))


def _require_same(name: str, mine: object, theirs: object) -> None:
    """Raise FrontError if two fronts that are to be joined differ in a property, called ``name``."""
    if mine != theirs:
        raise FrontError(
            f"the {name} of two fronts must be equal for a union, got {mine!s:.400} and {theirs!s:.400}; plan both "
            "fronts with equal ones"
        )


def _joined(first: str, second: str) -> str:
    """Return all statements of two certificates (or statuses), each once, in alphabetical order, joined by " | "."""
    return JOINT.join(sorted({*first.split(JOINT), *second.split(JOINT)}))


@checked_arguments
def hypervolume(Y: ArrayLike, reference: ArrayLike | None = None) -> float:
    """Return the volume of the cost space between the front and a reference point: larger is better.

    It is the volume of ``{z <= reference : some row of Y is <= z}`` (Zitzler and Thiele 1998), computed exactly.
    Rows that are not below the reference in every criterion add nothing.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs; dominated rows do not matter.
    reference : (k,) array, optional
        A cost vector worse than all that should count. Default: :func:`default_reference` of ``Y``, which suits the
        observation of one front. To compare two fronts, give one reference for both.

    Examples
    --------
    >>> hypervolume([[1, 2], [2, 1]], reference=[3, 3])
    3.0
    >>> default_reference([[1, 2], [2, 1]]), round(hypervolume([[1, 2], [2, 1]]), 9)
    (array([2.1, 2.1]), 0.21)
    """
    if reference is None:
        reference = default_reference(Y)
    matrix = filter(finite_costs(Y)).astype(np.float64)  # dominated rows would change the last digits
    corner = finite_costs(np.atleast_2d(np.asarray(reference)))
    _same_columns(matrix, corner)
    import moocore  # slow to import

    return float(moocore.hypervolume(matrix, ref=corner[0]))


@checked_arguments
def default_reference(Y: ArrayLike) -> FloatArray:
    """Return a reference point (k,) for hypervolumes: beyond the nadir of the front by a tenth of its range.

    So the end points of the front count too. In a constant column it is beyond by 1, so that the column contributes a
    factor of 1. Without rows the reference is zero.

    Examples
    --------
    >>> default_reference([[0.0, 7.0], [10.0, 7.0], [99.0, 99.0]])  # the second and third are dominated
    array([1., 8.])
    >>> default_reference([[0.0, 20.0], [10.0, 10.0], [99.0, 99.0]])
    array([11., 21.])
    """
    front = filter(finite_costs(Y)).astype(np.float64)
    if not len(front):
        return np.zeros(front.shape[1])
    nadir, span = front.max(axis=0), np.ptp(front, axis=0)
    return np.asarray(nadir + np.where(span > 0, BEYOND * span, 1.0), dtype=np.float64)


@checked_arguments
def additive_epsilon(Y: ArrayLike, reference: ArrayLike) -> float:
    """Return the additive epsilon indicator: how much a reference must be shifted so that a front is nowhere worse.

    Smaller is better; if it is at most 0, the front is nowhere worse than the reference. It is the smallest ``e`` such
    that every row ``r`` of ``reference`` has a row ``y`` of ``Y`` with ``y <= r + e`` in every criterion (Zitzler et
    al. 2003). For an empty ``Y`` it is infinity.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs of the front that is assessed.
    reference : (m, k) array
        Finite costs of the front with which it is compared, at least one row.

    Examples
    --------
    >>> additive_epsilon([[1, 4], [3, 2]], [[1, 3], [3, 1]])
    1.0
    """
    matrix, target = finite_costs(Y), finite_costs(reference)
    _same_columns(matrix, target)
    if len(target) == 0:
        raise ValueError("reference must have at least one row, got none; give the front to compare with")
    if len(matrix) == 0:
        return float("inf")
    import moocore  # slow to import

    return float(moocore.epsilon_additive(matrix, ref=target))


def _same_columns(matrix: FloatArray, other: FloatArray) -> None:
    """Raise ValueError if two cost spaces have different dimensions."""
    if matrix.shape[1] != other.shape[1]:
        raise ValueError(
            f"both cost arrays must have equally many criteria (columns), got {matrix.shape[1]} and {other.shape[1]}"
        )


BOX = 1.1  # reference point of scaled costs, so that the best of each criterion counts as well
SHARE = "63 %"  # 1 - 1/e, rounded down


@checked_arguments
def representative(Y: ArrayLike, count: int) -> IntArray:
    """Return the rows of up to ``count`` cost vectors with a large joint hypervolume, in ascending order.

    Costs are scaled to 0 ... 1 over the non-dominated rows, with reference point 1.1. Rows are added one by one, each
    time the row that adds most hypervolume. Since hypervolume is submodular, the result has at least 1 - 1/e (63 %) of
    the hypervolume of the best ``count`` rows (Nemhauser, Wolsey and Fisher 1978, doi 10.1007/BF01588971; Guerreiro,
    Fonseca and Paquete 2016, doi 10.1162/EVCO_a_00188).

    Of equal rows only the first is returned, and dominated rows never are, so the result may be shorter than ``count``.

    Raises FrontError for a count below 1.

    >>> representative([[0, 10], [1, 9], [5, 5], [9, 1], [10, 0], [6, 6]], 3).tolist()
    [1, 2, 3]
    """
    if not is_whole(count) or python_value(count) < 1:
        raise FrontError(f"count must be a whole number of points, at least 1, got {shown(count)}")
    number = int(python_value(count))
    costs = finite_costs(Y).astype(np.float64)
    rows = np.flatnonzero(is_nondominated(costs))
    if len(rows) <= number:
        return rows
    costs = costs[rows]
    span = np.ptp(costs, axis=0)
    scaled = (costs - costs.min(axis=0))[:, span > 0] / span[span > 0]
    return rows[_greedy(scaled, number)]


def _greedy(scaled: FloatArray, count: int) -> IntArray:
    """Return the rows, in ascending order, that add most hypervolume, one after the other.

    Gains only shrink as rows are added. So an old gain is an upper bound, and only the largest is computed anew.
    """
    import moocore  # slow to import

    def volume(rows: list[int]) -> float:
        return float(moocore.hypervolume(scaled[rows], ref=np.full(scaled.shape[1], BOX)))

    bounds = [(-gain, row) for row, gain in enumerate(np.prod(BOX - scaled, axis=1).tolist())]
    heapq.heapify(bounds)
    chosen: list[int] = []
    reached, fresh = 0.0, -1
    while len(chosen) < count:
        _, row = heapq.heappop(bounds)
        if row == fresh:
            chosen.append(row)
            reached, fresh = volume(chosen), -1
            continue
        gain = volume([*chosen, row]) - reached
        heapq.heappush(bounds, (-gain, row))
        fresh = bounds[0][1] if bounds[0] == (-gain, row) else -1
    return np.sort(np.array(chosen, np.int64))
