"""Pareto front: non-dominated points, one for each cost vector, with a status and a certificate."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import index as as_index
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arguments import checked_arguments
from hpop.base.lazy import on_first_use
from hpop.base.status import Status
from hpop.base.text import printable, shown
from hpop.frontier import choices, points, storage
from hpop.frontier.choices import Choices
from hpop.frontier.dominance import (
    BoolArray,
    FloatArray,
    IntArray,
    cost_matrix,
    default_quanta,
    is_nondominated,
    quantised,
)
from hpop.frontier.points import (
    FrontError,
    FrontFileError,
    ItemPoint,
    as_json,
    floats,
    minimised,
    names_of,
    origins,
)

if TYPE_CHECKING:
    import pandas
    import xarray

T = TypeVar("T")
MOST_CLAIMED = 200  # largest number of characters of a certificate in a repr


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class ItemFront(Choices[T], Generic[T]):
    """Mutually non-dominated cost vectors, each with the item that has these costs. All costs are minimised.

    Costs are compared after rounding to whole multiples of a quantum per criterion (:func:`hpop.frontier.quantised`).
    So costs that differ by rounding errors only are equal. The front stores the exact costs. Its rows are in the
    lexicographic order of the rounded costs. Build a front with :meth:`of`, which filters and sorts. The constructor
    takes rows that already are a front, and checks this. A front may have no points.

    costs           (n, k)    read-only, one row for each point
    items           n         objects that have these costs, such as trajectories
    names           k         names of the criteria; all different, and different from reported_names
    units           k         their units: "m", "rad", "1", ...
    quanta          (k,)      smallest difference of each criterion that counts, in its unit
    groups          k         group of each criterion ("P", "C", "R", "O"), or ""
    reported        (n, r)    further values of each point, which were not optimised
    reported_names  r         their names
    reported_units  r         their units
    status                    how the search ended, a value of hpop.Status; "complete" if it ran to its end. In a union
                              of fronts, the different values are joined by " | "
    certificate               sentence that says what is proved about the points, and for which search space
    provenance      n         how each point was found, as JSON
    problem                   description of the problem, as JSON, or None
    runs                      reports of the searches that made the front (notes, counts, seconds), as JSON
    integers        (n, k)    costs as whole numbers of quanta, int64

    Examples
    --------
    >>> front = ItemFront.of([[2.0, 0.3], [3.0, 0.1 + 0.2], [1.0, 5.0]], ["a", "b", "c"],
    ...     names=("turns", "length"), units=("1", "m"), quanta=(1.0, 1e-6),
    ...     status="complete", certificate="exact")
    >>> front
    <Front: 2 points of turns [1], length [m]; complete; exact>
    >>> [point.item for point in front]
    ['c', 'a']
    >>> front.best("length").costs
    {'turns': 2.0, 'length': 0.3}
    """

    costs: FloatArray
    items: tuple[T, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    quanta: FloatArray
    groups: tuple[str, ...]
    reported: FloatArray
    reported_names: tuple[str, ...]
    reported_units: tuple[str, ...]
    status: str
    certificate: str
    provenance: tuple[dict[str, Any], ...]
    problem: dict[str, Any] | None = None
    runs: tuple[dict[str, Any], ...] = ()
    integers: IntArray = field(init=False)

    def __post_init__(self) -> None:
        for name in ("items", "names", "units", "groups", "reported_names", "reported_units"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        n, k, r = len(self.items), len(self.names), len(self.reported_names)
        columns = self.names + self.reported_names
        if k == 0 or len(set(columns)) != k + r:
            raise ValueError(
                f"names (with reported_names) must be one or more names, all different, got {columns}; rename columns"
            )
        object.__setattr__(self, "status", str(self.status))
        if not self.status or not self.certificate:
            raise ValueError(
                "status (how the search ended) and certificate (what is proved) must not be empty, got "
                f"{self.status!r} and {self.certificate!r}; give both"
            )
        if not set(self.status.split(points.JOINT)) <= set(Status):  # a union of fronts has the statuses of both
            raise FrontError(f"status must be one of {', '.join(Status)} (in hpop.Status), got {shown(self.status)}")
        for name, expected in (("units", k), ("groups", k), ("reported_units", r), ("provenance", n)):
            if len(getattr(self, name)) != expected:
                raise ValueError(f"{name} must have {expected} entries, got {len(getattr(self, name))}")
        for name, shape in (("costs", (n, k)), ("quanta", (k,)), ("reported", (n, r))):
            array = floats(getattr(self, name), shape)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(f"{name} must be finite numbers of shape {shape}, got {shown(array)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        integers = quantised(self.costs, self.quanta)
        in_order = np.array_equal(np.lexsort(integers.T[::-1]), np.arange(n))
        if not (in_order and is_nondominated(integers).all()):
            raise ValueError(
                "costs must be sorted and without dominated or equal rows, but are not; build the front by ItemFront.of"
            )
        integers.setflags(write=False)
        object.__setattr__(self, "integers", integers)
        object.__setattr__(self, "provenance", tuple(origins(self.provenance)[0]))
        object.__setattr__(self, "runs", tuple(as_json("runs", run) for run in self.runs))
        if self.problem is not None:
            object.__setattr__(self, "problem", as_json("problem", self.problem))

    @classmethod
    def of(
        cls,
        costs: ArrayLike,
        items: Sequence[T] | None = None,
        *,
        names: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
        quanta: ArrayLike | None = None,
        status: str = "complete",
        certificate: str | None = None,
        maximise: Sequence[str] | Sequence[bool] = (),
        groups: Sequence[str] | None = None,
        reported: ArrayLike | None = None,
        reported_names: Sequence[str] = (),
        reported_units: Sequence[str] | None = None,
        provenance: Sequence[Mapping[str, Any]] | None = None,
        problem: Mapping[str, Any] | None = None,
        runs: Sequence[Mapping[str, Any]] = (),
    ) -> Self:
        """Build the front of any candidates: drop dominated ones, keep one for each cost vector, and sort.

        Of candidates with equal costs in whole quanta, the one with the lexicographically smallest exact costs is kept,
        then the smallest reported values (in the order of their names), then the smallest provenance text. So the front
        does not depend on the order of the candidates, unless some are equal in all of these.

        Parameters
        ----------
        costs : (n, k) array
            Finite costs of the candidates.
        items : sequence of n, optional
            The candidates, or labels of them; default: their row numbers.
        names : sequence of k, optional
            Names of the criteria. Default: the columns of a pandas table, or "f1", "f2", ...
        units : sequence of k, optional
            Default: "1".
        quanta : (k,) array, optional
            Default: 1 for a column of whole numbers, else a billionth of its largest value, as a power of ten.
        certificate : str, optional
            Default: a sentence saying that these are the non-dominated ones of n candidates.
        maximise : names, or k bools, optional
            Columns in which more is better. A front minimises, so it gets the negative values, named "-name".
        status, groups, reported, reported_names, reported_units, provenance, problem, runs
            As the fields of the front, with a row or an entry for each candidate. Defaults: groups "", no reported
            values, their names from a pandas table or "r1", "r2", ..., their units "1", provenance {}.

        >>> ItemFront.of([[3, 0.5], [1, 0.2], [4, 0.1]], "abc", names=["cost", "yield"], maximise=["yield"])
        <Front: 2 points of cost [1], -yield [1]; complete; the non-dominated ones of 3 candidates>
        """
        if items is None:
            items = cls._numbers(len(cost_matrix(costs)))
        names = names_of(costs, names)
        n, k = len(items), len(names)
        matrix, names = minimised(floats(costs, (n, k)), names, maximise)
        units = ("1",) * k if units is None else units
        quanta = default_quanta(matrix) if quanta is None else quanta
        if certificate is None:
            certificate = f"the non-dominated ones of {n:,} candidates"
        if reported is not None and not len(reported_names) and np.size(reported):
            reported_names = names_of(reported, None, letter="r")
        reported_names = tuple(reported_names)
        table = floats([] if reported is None else reported, (n, len(reported_names)))
        entries: Sequence[Mapping[str, Any]] = [{}] * n if provenance is None else provenance
        plain_origins, texts = origins(entries)
        if matrix.shape != (n, k) or table.shape != (n, len(reported_names)) or len(plain_origins) != n:
            raise ValueError(
                f"costs must have shape {(n, k)}, reported {(n, len(reported_names))} and provenance ({n},), for {n} "
                f"items and {k} names, got {matrix.shape}, {table.shape} and ({len(plain_origins)},)"
            )
        integers = quantised(matrix, quanta)
        rank = {text: position for position, text in enumerate(sorted(set(texts)))}
        by_name = sorted(range(len(reported_names)), key=lambda column: reported_names[column])
        keys = [*integers.T, *matrix.T, *table[:, by_name].T, np.array([rank[text] for text in texts])]
        order = np.lexsort(keys[::-1])
        kept = order[is_nondominated(integers[order])]
        return cls(
            costs=matrix[kept],
            items=tuple(items[i] for i in kept),
            names=tuple(names),
            units=tuple(units),
            quanta=np.asarray(quanta, dtype=np.float64),
            groups=("",) * k if groups is None else tuple(groups),
            reported=table[kept],
            reported_names=tuple(reported_names),
            reported_units=("1",) * len(reported_names) if reported_units is None else tuple(reported_units),
            status=status,
            certificate=certificate,
            provenance=tuple(plain_origins[i] for i in kept),
            problem=None if problem is None else dict(problem),
            runs=tuple(dict(run) for run in runs),
        )

    @classmethod
    def _numbers(cls, n: int) -> Sequence[T]:
        """Return default items for n candidates that come without items: their row numbers."""
        return cast(Sequence[T], range(n))

    def __len__(self) -> int:
        return len(self.items)

    @overload
    def __getitem__(self, index: int | np.integer[Any], /) -> ItemPoint[T]: ...

    @overload
    def __getitem__(self, index: slice | BoolArray | Sequence[bool], /) -> Self: ...

    def __getitem__(self, index: Any, /) -> ItemPoint[T] | Self:
        """Return the point in a row; for a slice or a boolean mask (n,), return the front of these points, in order."""
        try:
            row = as_index(index)
        except TypeError:
            return self._selected(*choices.kept(index, len(self)))
        if not -len(self) <= row < len(self):
            if not len(self):
                raise IndexError(f"a front without points has no row {row}")
            raise IndexError(
                f"an index must be from {-len(self)} to {len(self) - 1} in a front of {len(self)} points, got {row}"
            )
        return self._point(row % len(self))

    def _point(self, row: int) -> ItemPoint[T]:
        return ItemPoint(**self._fields_of(row))

    def _fields_of(self, row: int) -> dict[str, Any]:
        """Return the fields of the point in a row."""
        return {
            "index": row,
            "costs": dict(zip(self.names, self.costs[row].tolist(), strict=True)),
            "reported": dict(zip(self.reported_names, self.reported[row].tolist(), strict=True)),
            "item": self.items[row],
            "provenance": self.provenance[row],
        }

    def __iter__(self) -> Iterator[ItemPoint[T]]:
        return (self._point(row) for row in range(len(self)))

    def __repr__(self) -> str:
        criteria = ", ".join(f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True))
        claimed = self.certificate
        if len(claimed) > MOST_CLAIMED:
            claimed = f"{claimed[: MOST_CLAIMED - 3]}..."
        return printable(f"<Front: {len(self)} points of {criteria}; {self.status}; {claimed}>")

    def _selected(self, kept: BoolArray, by: str) -> Self:
        """Return the front of the points in a mask (n,); its certificate begins with "selected from 9 points by"."""
        rows = np.flatnonzero(kept)
        return replace(
            self,
            costs=self.costs[rows],
            items=tuple(self.items[row] for row in rows),
            reported=self.reported[rows],
            provenance=tuple(self.provenance[row] for row in rows),
            certificate=points.each_claim(self.certificate, f"selected from {len(self):,} points by {by}: {{}}"),
        )

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the front as a pandas table, with a row for each point.

        The columns are the costs, the reported values, and how the point was found: one column for each key of the
        provenance. The table's ``attrs`` have the units by column, the status and the certificate. Install pandas with
        ``hpop[tables]``.
        """
        return storage.dataframe(self)

    def to_xarray(self) -> xarray.Dataset:
        """Return the front as an xarray dataset along the dimension "point", with the unit of each variable."""
        return storage.dataset(self)

    @property
    def question(self) -> dict[str, Any] | None:
        """Part of the problem's description that two fronts must share for a union; None for a front without one."""
        return self.problem

    def __or__(self, other: Self) -> Self:
        """Return the union of two fronts of one problem, their non-dominated points (:func:`.points.join`).

        Raises FrontError if their criteria, units, groups, quanta, reported values or problems differ.
        """
        return points.join(self, other) if isinstance(other, ItemFront) else NotImplemented

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        encode: Callable[[T], Any] | None = None,
        problem: Mapping[str, Any] | None = None,
    ) -> None:
        """Write the front to a JSON file, completely or not at all; floats are equal after loading.

        Parameters
        ----------
        path : path
            The file; an existing one is replaced.
        encode : callable, optional
            Turns an item into JSON values (lists, dicts, strings, finite numbers); by default items are such values.
        problem : mapping, optional
            Description of the problem, as JSON; by default the front's own ``problem``.
        """
        self._save(path, [item if encode is None else encode(item) for item in self.items], problem)

    def _save(
        self, path: str | os.PathLike[str], items: list[Any] | dict[str, Any], problem: Mapping[str, Any] | None
    ) -> None:
        """Write the front to a file, with its items encoded one by one (a list) or all together (a JSON object)."""
        fields: dict[str, Any] = {name: getattr(self, name) for name in storage.StoredFront.__annotations__}
        question = self.problem if problem is None else as_json("problem", problem)
        storage.write(path, cast(storage.StoredFront, fields | {"items": items, "problem": question}))

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, decode: Callable[[Any], T] | None = None) -> Self:
        """Read a front that :meth:`save` wrote.

        Parameters
        ----------
        path : path
            The file.
        decode : callable, optional
            Turns the JSON from ``encode`` back into the item; by default items stay as JSON.

        Raises
        ------
        FrontFileError
            If the file is no front; the message says what was expected, what was found, and what to do.
        """
        stored = storage.read(path)
        items = stored["items"]
        if isinstance(items, dict):
            raise FrontFileError(
                f"{path}: expected one entry for each item, found all items in one object, which only the class that "
                "saved the front can read; load it by that class, such as hpop.Front"
            )
        return cls._of_stored(path, stored, items, decode)

    @classmethod
    def _of_stored(
        cls,
        path: str | os.PathLike[str],
        stored: storage.StoredFront,
        items: Sequence[Any],
        decode: Callable[[Any], T] | None,
    ) -> Self:
        """Return the front from the contents of a file; its items are decoded one by one."""
        decoded: list[Any] = []
        for row, item in enumerate(items):
            try:
                decoded.append(item if decode is None else decode(item))
            except Exception as error:
                raise FrontFileError(
                    f"{path}: the item of points[{row}] cannot be decoded ({type(error).__name__}: {error!s:.400}); "
                    "pass the function decode= that reverses the encode= with which the front was saved"
                ) from error
        try:
            return cls(**{**cast(dict[str, Any], stored), "items": tuple(decoded)})
        except ValueError as error:
            raise FrontFileError(f"{path}: expected a front, but {error!s:.600}") from error


__getattr__ = on_first_use(__name__, {}, former={"Front": "ItemFront"})  # former name, in pickles
