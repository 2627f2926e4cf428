"""Pareto front of trajectories: the solution of a planning problem."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Self, cast, overload

import numpy as np

from hpop import frontier
from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, copied
from hpop.base.registry import GROUPS, in_a_view, make_model
from hpop.base.table import facts_html, picture_html, table_html
from hpop.base.text import is_whole, shown
from hpop.errors import DriveError, ModelError, did_you_mean
from hpop.frontier import FrontError, FrontFileError, storage
from hpop.frontier.choices import Preferring
from hpop.frontier.points import as_json
from hpop.frontier.storage import checked_path
from hpop.models import files
from hpop.motions import Model
from hpop.runtime.limits import Status
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world.description import found_from, seen_from, without_places

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.problems.why import WhyNot
    from hpop.world import World

FOR_YOU = "for you"
"""Name of the point that a given person is predicted to prefer."""


@dataclass(frozen=True, eq=False, repr=False)
class Point(frontier.ItemPoint[Trajectory]):
    """Point of a front of trajectories; see :class:`hpop.frontier.ItemPoint`."""

    @property
    def trajectory(self) -> Trajectory:
        """Trajectory that has these costs."""
        return self.item


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Front(frontier.ItemFront[Trajectory]):
    """Pareto front: non-dominated trajectories, one for each cost vector.

    :class:`hpop.frontier.ItemFront` has the methods that choose points and join fronts.
    """

    def _point(self, row: int) -> Point:
        return Point(**self._fields_of(row))

    @cached_property  # type: ignore[misc]  # set by the constructor, or computed on first use after `in_world`
    def problem(self) -> dict[str, Any] | None:
        """Description of the problem for JSON, or None."""
        described: dict[str, Any] = {**vars(self)["_query"], "world": vars(self)["_world"].describe()}
        return as_json("problem", described)

    def in_world(self, world: World) -> Self:
        """Return a copy whose ``problem`` also describes the world; the description is made when it is first read."""
        return copied(self, without={"problem"}, _query=self.problem, _world=world.uncached())

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for pickling, with the whole description of the problem."""
        _ = self.problem
        return {name: value for name, value in vars(self).items() if name not in ("_query", "_world")}

    if TYPE_CHECKING:  # points have trajectories

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

    @classmethod
    def _numbers(cls, n: int) -> Sequence[Trajectory]:
        raise FrontError(
            "items of hpop.Front.of must be trajectories, one for each row of costs, got none; give them, or use "
            "hpop.frontier.ItemFront.of(costs) for a front of other things"
        )

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """Trajectories of the points, in the order of the rows of ``costs``."""
        return self.items

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences of the searches for the user, such as on assumptions, or on obstacles that block the way."""
        several = (run.get("notes") for run in self.runs)
        return tuple(dict.fromkeys(str(note) for notes in several if isinstance(notes, list) for note in notes))

    def _reason(self) -> str:
        if self.status == Status.COMPLETE or "selected from" in self.certificate:  # the choice left no points
            return self.certificate
        return "; ".join(self.notes) or self.certificate

    @property
    def inactive(self) -> tuple[str, ...]:
        """Names of criteria whose cost is equal at all points, so that they decide nothing; () for a single point."""
        if len(self) < 2:
            return ()
        same = (self.integers == self.integers[0]).all(axis=0)
        return tuple(name for name, constant in zip(self.names, same, strict=True) if constant)

    @property
    def evaluated(self) -> tuple[str, ...]:
        """Names of criteria that were computed for the points found, but not optimised.

        Trajectories outside of the front may be better in them.
        """
        known = [names for run in self.runs if isinstance(names := run.get("evaluated"), list)]
        if not known or len(known) < len(self.runs):
            return ()
        return tuple(name for name in self.names if all(name in names for names in known))

    def named(self, preference: Preferring | None = None) -> dict[str, Point]:
        """Return points by name: "knee", and "least NAME" for the point with the smallest cost in each criterion.

        For a criterion that was only evaluated, the name is "least NAME of those found". With the ``preference`` of a
        person, the first entry is the point that this person prefers, "for you".
        """
        if not len(self):
            return {}
        evaluated = self.evaluated
        least = {
            f"least {name}{' of those found' if name in evaluated else ''}": self.best(name) for name in self.names
        }
        preferred = {} if preference is None else {FOR_YOU: self.select(preference=preference)}
        return {**preferred, "knee": self.knee(), **least}

    def _repr_html_(self) -> str:
        """Return HTML for a notebook: named points, status and certificate, and a picture if hpop.view is imported."""
        units = dict(zip(self.names + self.reported_names, self.units + self.reported_units, strict=True))
        headings = [name if unit == "1" else f"{name} ({unit})" for name, unit in units.items()]
        marks: dict[int, list[str]] = {}
        for label, point in self.named().items():
            marks.setdefault(point.index, []).append(label)
        rows = []
        for row in sorted(marks):
            values = (*self[row].costs.values(), *self[row].reported.values())
            rows.append([str(row), *(f"{value:.5g}" for value in values), ", ".join(marks[row])])
        caption = f"{len(self):,} points; the table has the named ones"
        facts = [("status", self.status), ("certificate", self.certificate)]
        return table_html(["#", *headings, ""], rows, caption) + facts_html(facts) + picture_html(self)

    def why_not(
        self,
        region: Any = None,
        *,
        through: str | None = None,
        wish: str | Mapping[str, float] | None = None,
        than: int | str | None = None,
        problem: Problem | None = None,
    ) -> WhyNot:
        """Explain why no path of the front passes somewhere, or has less of a cost; see :func:`hpop.why_not`.

        Parameters
        ----------
        problem : the problem of this front. Default: it is built from its description, so that its graph is built too
        """
        from hpop.problems.problem import Problem  # they import this module
        from hpop.problems.why import why_not

        if problem is None:
            if self.problem is None:
                raise FrontError("the front does not describe its problem; give problem=")
            problem = Problem.from_description(self.problem)
        return why_not(problem, self, region, through=through, wish=wish, than=than)

    @property
    def question(self) -> dict[str, Any] | None:
        """Description of the problem without the paths of its files, whose hashes identify them; None without one."""
        return self.problem and question_of(self.problem)

    def by_group(self) -> dict[str, dict[str, FloatArray]]:
        """Return the costs (n,) by group (P performance, C comfort, R robot, O others), then by criterion.

        A group without criteria is an empty dict.
        """
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
        (:meth:`hpop.trajectories.motion_table.MotionTable.describe`). Paths of the world's files are relative to the
        front's folder, so that front and map can be moved together.

        Parameters
        ----------
        encode : turns each trajectory into JSON values of your own; :meth:`load` reverses it by ``decode``
        problem : description to write in place of the front's own
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
        decode : turns the JSON from ``encode`` back into a trajectory; without ``encode``, the JSON is that of
            :meth:`Trajectory.describe`

        Raises FrontFileError if the file is no front of trajectories.
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
    """Return the description of a problem without the paths of its files, whose hashes identify them.

    Descriptions of one problem are then equal wherever its files lie, and whichever version of hpop wrote them.
    """
    described = _changed(problem, without_places, files.without_paths)
    return {**described, "model": in_a_view(described["model"])} if "model" in described else described


def _stored_model(path: str | os.PathLike[str], problem: Mapping[str, Any] | None) -> Model:
    """Return the robot model of the problem in a saved front; FrontFileError if it cannot be built."""
    if problem is None:
        raise FrontFileError(
            f"{path}: expected a front with its problem and robot model, as `hpop plan` writes it, found a front "
            "without them, such as one of a graph or a table; load it by hpop.frontier.ItemFront.load, with decode= if "
            "its items are no JSON values"
        )
    try:
        return cast(Model, make_model(problem["model"]))
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise FrontFileError(
            f"{path}: expected a front with a robot model, found a model that cannot be built ({error!s:.1200}); plan "
            "again, or, if the front was saved with encode=, pass decode="
        ) from None


def _trajectories(path: str | os.PathLike[str], model: Model, items: dict[str, Any]) -> tuple[Trajectory, ...]:
    """Return the trajectories of a front's file, which are stored together as one table of motions."""
    try:
        return MotionTable.from_description(model, items).trajectories()
    except (ModelError, ValueError) as error:
        raise FrontFileError(
            f"{path}: its trajectories cannot be read: {error!s:.600}; restore the file, or plan again"
        ) from None


def seen_from_file(path: str | os.PathLike[str], problem: Mapping[str, Any]) -> dict[str, Any]:
    """Return a problem's description in which paths of files are relative to the folder of a front's file ``path``."""
    folder = _folder(path)
    return _changed(problem, partial(seen_from, folder), partial(files.with_relative_paths, folder))


def found_from_file(path: str | os.PathLike[str], problem: Mapping[str, Any]) -> dict[str, Any]:
    """Return a problem's description with absolute paths of files, found from the folder of a front's file ``path``."""
    folder = _folder(path)
    return _changed(problem, partial(found_from, folder), partial(files.with_absolute_paths, folder))


def _folder(path: str | os.PathLike[str]) -> str:
    """Return the absolute path of the folder of a front's file."""
    return str(checked_path(path).absolute().parent)


def _changed(problem: Mapping[str, Any], world: Callable[[Any], Any], model: Callable[[Any], Any]) -> dict[str, Any]:
    """Return a problem's description after applying ``world`` to its world, and ``model`` to its model and criteria."""
    changes = {"world": world, "model": model, "criteria": model}
    return {key: changes[key](value) if key in changes else value for key, value in problem.items()}


def chosen_point(front: Front, choice: Any) -> Point:
    """Return the chosen point of a front, given as the point, by its row or by its name; DriveError otherwise."""
    if not len(front):
        raise DriveError(f"a drive needs a front with points, but this one has none: {front.certificate:.400}")
    if isinstance(choice, str):
        named = front.named()
        if choice not in named:
            raise DriveError(
                f"no point of the front is called {shown(choice)}.{did_you_mean(choice, named)} Known: "
                f"{', '.join(named)}"
            )
        return named[choice]
    if isinstance(choice, Point):
        if not any(item is choice.item for item in front.items):
            raise DriveError("the choice is a point of another front; give a point of this front, or its row")
        return choice
    if is_whole(choice) and -len(front) <= choice < len(front):
        return front[int(choice)]
    raise DriveError(f"the choice must be a point of the front, or its row, 0 to {len(front) - 1}; got {shown(choice)}")
