"""The front of trajectories: what a problem's solution is."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self, cast, overload

import numpy as np

from hpop import frontier
from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.registry import GROUPS, make_model
from hpop.base.table import facts_html, picture_html, table_html
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.frontier import FrontError, FrontFileError, storage
from hpop.frontier.choices import Preferring
from hpop.frontier.storage import checked_path
from hpop.frontier.union import JOINT
from hpop.models import files
from hpop.motions import Model
from hpop.runtime.status import Status
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world.description import found_from, seen_from, without_places

FOR_YOU = "for you"
"""What a person prefers goes by, beside the knee."""


@dataclass(frozen=True, eq=False, repr=False)
class Point(frontier.Point[Trajectory]):
    """One point of a front of trajectories; see :class:`hpop.frontier.Point`."""

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory that has these costs."""
        return self.item


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Front(frontier.Front[Trajectory]):
    """Non-dominated trajectories, one a cost vector; see :class:`hpop.frontier.Front` for choosing and union."""

    def _point(self, row: int) -> Point:
        return Point(**self._fields_of(row))

    if TYPE_CHECKING:  # each point that is given out has a trajectory

        @overload
        def __getitem__(self, index: int | np.integer[Any], /) -> Point: ...
        @overload
        def __getitem__(self, index: slice | BoolArray | Sequence[bool], /) -> Self: ...
        def __getitem__(self, index: Any, /) -> Any: ...
        def __iter__(self) -> Iterator[Point]: ...
        def knee(self) -> Point: ...
        def best(self, name: str) -> Point: ...
        def lexicographic(self, order: Sequence[str]) -> Point: ...
        def select(
            self, weights: Mapping[str, float] | None = None, *, preference: Preferring | None = None
        ) -> Point: ...
        def nearest(self, wishes: Mapping[str, float]) -> Point: ...
        def reference_point(self, aspirations: Mapping[str, float]) -> Point: ...

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = set(self.status.split(JOINT)) - set(Status)
        if unknown:  # a union has those of both
            known = ", ".join(Status)
            raise FrontError(f"status must be one of {known} (a member of hpop.Status), got {shown(self.status)}")

    @classmethod
    def _numbers(cls, n: int) -> Sequence[Trajectory]:
        raise FrontError(
            "hpop.Front holds trajectories: give one a row, or take hpop.frontier.Front.of(costs) for a front of "
            "anything else"
        )

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """The trajectories, in the order of the rows of ``costs``."""
        return self.items

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of the runs: a stand-in objective, what blocks the way."""
        several = (run.get("notes") for run in self.runs)
        return tuple(dict.fromkeys(str(note) for notes in several if isinstance(notes, list) for note in notes))

    @property
    def inactive(self) -> tuple[str, ...]:
        """Criteria whose cost is the same all over the front, so that they decide nothing; none of a single point."""
        if len(self) < 2:
            return ()
        same = (self.integers == self.integers[0]).all(axis=0)
        return tuple(name for name, constant in zip(self.names, same, strict=True) if constant)

    @property
    def evaluated(self) -> tuple[str, ...]:
        """Criteria that no run searched for: evaluated on what was found, in which other trajectories may be better."""
        known = [names for run in self.runs if isinstance(names := run.get("evaluated"), list)]
        if not known or len(known) < len(self.runs):
            return ()
        return tuple(name for name in self.names if all(name in names for names in known))

    def named(self, preference: Preferring | None = None) -> dict[str, Point]:
        """The points worth a name: the knee and the least in each criterion, of those found if only evaluated.

        With the ``preference`` of a person first of all what is best "for you".
        """
        if not len(self):
            return {}
        found = self.evaluated
        least = {f"least {name}" + " of those found" * (name in found): self.best(name) for name in self.names}
        yours = {} if preference is None else {FOR_YOU: self.select(preference=preference)}
        return {**yours, "knee": self.knee(), **least}

    def _repr_html_(self) -> str:
        """What a notebook shows: the points worth a name, what is claimed, a picture where hpop.view is imported."""
        units = dict(zip(self.names + self.reported_names, self.units + self.reported_units, strict=True))
        headings = [name if unit == "1" else f"{name} ({unit})" for name, unit in units.items()]
        marks: dict[int, list[str]] = {}
        for label, point in self.named().items():
            marks.setdefault(point.index, []).append(label)
        rows = []
        for row in sorted(marks):
            values = (*self[row].costs.values(), *self[row].reported.values())
            rows.append([str(row), *(f"{value:.5g}" for value in values), ", ".join(marks[row])])
        caption = f"{len(self):,} points, those worth a name"
        facts = [("status", self.status), ("certificate", self.certificate)]
        return table_html(["#", *headings, ""], rows, caption) + facts_html(facts) + picture_html(self)

    @property
    def question(self) -> dict[str, Any] | None:
        """The problem, wherever its files lie: what is in them is known by its hash."""
        return self.problem and question_of(self.problem)

    def by_group(self) -> dict[str, dict[str, FloatArray]]:
        """Costs (n,) by group and criterion: performance P, comfort C, robot R, others O; a group may be empty."""
        columns = dict(zip(self.names, self.costs.T, strict=True))
        group_of = dict(zip(self.names, self.groups, strict=True))
        return {group: {name: columns[name] for name in self.names if group_of[name] == group} for group in GROUPS}

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        encode: Callable[[Trajectory], Any] | None = None,
        problem: Mapping[str, Any] | None = None,
    ) -> None:
        """Write the front with its trajectories and the problem's description to a JSON file.

        States and motions that several trajectories share are written once
        (:meth:`hpop.trajectories.motion_table.MotionTable.describe`). The files of the world are named as seen from the
        front's folder, not by whole paths: moved together, the front and its map are found again.

        Parameters
        ----------
        encode : turns a trajectory into JSON values of your own, one by one, to be read back by ``decode``
        """
        asked = self.problem if problem is None else problem
        placed = asked and seen_from_file(path, asked)
        if encode is not None or not len(self):
            super().save(path, encode=encode, problem=placed)
        else:
            self._save(path, MotionTable.of(self.trajectories).describe(), placed)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, decode: Callable[[Any], Trajectory] | None = None) -> Front:
        """Read a front that :meth:`save` wrote; the robot model is rebuilt from the problem's description.

        Parameters
        ----------
        decode : turns what ``encode`` made of a trajectory back into it; without ``encode``, what
            :meth:`Trajectory.describe` says of it

        Raises FrontFileError when the file does not hold a front of trajectories.
        """
        stored = storage.read(path)
        if stored["problem"] is not None:
            stored["problem"] = found_from_file(path, stored["problem"])
        items: Sequence[Any] | dict[str, Any] = stored["items"]
        if decode is None or isinstance(items, dict):
            model = _stored_model(path, stored["problem"])
        if isinstance(items, dict):
            items = _trajectories(path, model, items)
            if decode is not None:
                items = [trajectory.describe() for trajectory in items]
        elif decode is None:
            decode = partial(Trajectory.from_description, model)
        return cls._of_stored(path, stored, items, decode)


def question_of(problem: Mapping[str, Any]) -> dict[str, Any]:
    """The description of a problem without the places of its files: these are known by their hashes."""
    return _changed(problem, without_places, files.without_places)


def _stored_model(path: str | os.PathLike[str], problem: Mapping[str, Any] | None) -> Model:
    """The robot of a saved problem."""
    if problem is None:
        raise FrontFileError(
            f"{path}: expected a front with its problem and model, as `hpop plan` writes it; this one has none, as "
            "fronts of graphs and tables: hpop.frontier.Front.load reads it, with decode= for items unknown to JSON"
        )
    try:
        return cast(Model, make_model(problem["model"]))
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise FrontFileError(
            f"{path}: expected a front with its problem and model, found none that can be built ({error!s:.1200}); "
            "plan again, or pass decode= for another kind of front"
        ) from None


def _trajectories(path: str | os.PathLike[str], model: Model, items: dict[str, Any]) -> tuple[Trajectory, ...]:
    """The trajectories that are stored together."""
    try:
        return MotionTable.from_description(model, items).trajectories()
    except (ModelError, ValueError) as error:
        raise FrontFileError(f"{path}: {error!s:.600}; plan again, or pass decode= for other items") from None


def seen_from_file(path: str | os.PathLike[str], problem: Mapping[str, Any]) -> dict[str, Any]:
    """A problem whose files, of world, model and criteria, are also named as seen from the folder of a front's file."""
    folder = _folder(path)
    return _changed(problem, partial(seen_from, folder), partial(files.seen_from, folder))


def found_from_file(path: str | os.PathLike[str], problem: Mapping[str, Any]) -> dict[str, Any]:
    """A problem whose files are found from the folder of a front's file."""
    folder = _folder(path)
    return _changed(problem, partial(found_from, folder), partial(files.found_from, folder))


def _folder(path: str | os.PathLike[str]) -> str:
    return str(checked_path(path).absolute().parent)


def _changed(problem: Mapping[str, Any], world: Callable[[Any], Any], model: Callable[[Any], Any]) -> dict[str, Any]:
    """A problem with what is made of the descriptions of its world, and of its model, as of criteria."""
    changes = {"world": world, "model": model, "criteria": model}
    return {key: changes[key](value) if key in changes else value for key, value in problem.items()}
