"""What every planner takes and gives."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeGuard, TypeVar, cast, overload

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.registry import completed, made, planners
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.errors import OptionError
from hpop.planners.objectives import edge_objectives as edge_objectives
from hpop.runtime.status import ProgressCallback, Status
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.family import GraphFamily
    from hpop.problems.problem import Problem


@dataclass(frozen=True, eq=False)
class Deferred(Sequence[Trajectory]):
    """Trajectories of which all are made together once one is read, or some alone.

    number  of them
    make    the trajectories of some rows
    """

    number: int
    make: Callable[[IntArray], tuple[Trajectory, ...]]

    def __len__(self) -> int:
        return self.number

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Trajectory, ...]: ...
    def __getitem__(self, index: int | slice) -> Trajectory | tuple[Trajectory, ...]:
        return self._all[index]

    def take(self, rows: IntArray) -> tuple[Trajectory, ...]:
        """Those of some rows, made without the others."""
        if "_all" in vars(self):  # made already
            return tuple(self._all[i] for i in rows.tolist())
        return self.make(rows)

    @cached_property
    def _all(self) -> tuple[Trajectory, ...]:
        return self.make(np.arange(self.number))


T = TypeVar("T", bound=type)


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Candidates:
    """What a planner found.

    objectives    the criteria that it optimised, in the order of the columns of ``planned``
    filters       further criteria that it could not optimise, but by which the front shall be filtered
    trajectories  n of them; a sequence may make them when they are asked for
    planned       (n, k) costs as the planner added them up, in the criteria's units
    tolerance     (n, k) by how much a re-evaluated cost may differ from the planned one
    status        how the planner ended
    certificate   what is claimed, in words
    provenance    one JSON-able dict a trajectory
    notes         what the user should know: an objective that stands in for another, what blocks the way
    stats         counts and seconds by name, JSON-able, which `hpop plan` prints
    """

    objectives: tuple[Criterion, ...]
    trajectories: Sequence[Trajectory]
    planned: FloatArray
    tolerance: FloatArray
    status: Status
    certificate: str
    provenance: tuple[dict[str, Any], ...]
    notes: tuple[str, ...] = ()
    stats: Mapping[str, Any] = field(default_factory=dict)
    filters: tuple[Criterion, ...] = ()

    def unfinished(self) -> Candidates:
        """The same as a stage after which the search goes on, unless it was interrupted."""
        status = self.status if self.status is Status.INTERRUPTED else Status.UNFINISHED
        return replace(self, status=status, certificate=f"{self.certificate}; the exact search is not done")

    def spread(self, number: int) -> Candidates:
        """Return the best candidate in each planned cost, and others at equal intervals in the order of the costs.

        ``number`` is how many are returned at most; where there are fewer, all are.
        """
        order = np.lexsort(self.planned.T[::-1])
        others = min(max(0, number - self.planned.shape[1]), order.size)
        every = order[np.linspace(0, order.size - 1, others).astype(np.int64)]
        return self.some(np.unique(np.concatenate([self.planned.argmin(axis=0), every])))

    def some(self, places: Sequence[int] | IntArray) -> Candidates:
        """Those at some places, in the order given; what is claimed and noted of all stays."""
        rows, several = [int(i) for i in places], self.trajectories
        return replace(
            self,
            trajectories=several.take(np.array(rows, dtype=np.int64))
            if isinstance(several, Deferred)
            else tuple(several[i] for i in rows),
            planned=self.planned[rows],
            tolerance=self.tolerance[rows],
            provenance=tuple(self.provenance[i] for i in rows),
        )

    def __repr__(self) -> str:
        names = ", ".join(criterion.name for criterion in self.objectives)
        return f"<Candidates: {len(self.trajectories):,} by {names}; {self.status}; {self.certificate}>"


UNDECLARED = frozenset({"plane", "turn-move", "rigid", "wheels"})
"""What a planner that does not declare its needs is taken to need: it was written when all robots had these."""


class Planner(Protocol):
    """Problem in, candidate trajectories out. A frozen dataclass; its fields are its options.

    Only ``name`` and ``solve`` must be there: :func:`planner` sets the name, and the rest have these defaults.

    needs              what it needs of a model, of what :attr:`hpop.motions.Model.provides` lists; an empty set for any
                       model (:mod:`hpop.planners.needs`)
    goal_sets          whether the goal may be a list of states, of which any will do
    any_goal           whether the goal may be of any kind (:class:`hpop.goals.Goal`)
    margin             m  that it keeps from people
    max_detour         not None where it minimises a time-mean itself, so that its front joins no other
    time_limit         s  after which it returns what it has, or None
    checkpoint         file in which its search is kept, or None
    warm_start         planner whose trajectories it starts from, as ``{name: options}``, or None
    answers_in_stages  whether a first answer may come before the last one, from ``stages``
    needs_kernels      whether it takes the kernels of the exact search, which are compiled beside a first answer
    graph_options      options that make its graph, where fronts may be driven on; () for a planner without a graph
    graph_of_drives    the graph family on which a drive looks for other paths, or None
    time_options       options of planning among people who move, where it has some, or None
    """

    @property
    def name(self) -> str: ...

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Plan; raises QueryError, UnsupportedCriterion or OptionError where the question is wrong."""

    def stages(
        self, problem: Problem, progress: ProgressCallback | None = None, **on_executor: Any
    ) -> Iterator[Candidates]:
        """Yield a first answer soon and better ones later; by default the only one.

        Those before the last are UNFINISHED. The last one is what ``solve`` finds; it may keep the ones before where it
        did not find all. After Ctrl-C in a stage its candidates are INTERRUPTED and no other stage follows. A planner
        that sweeps takes its executor here as well.
        """
        return _solved(self, problem, progress, **on_executor)

    def anchored(self) -> Planner:
        """Return a planner with the same options whose graph does not depend on the start; itself by default."""
        return self

    if TYPE_CHECKING:  # the defaults are set by `_completed`, so that a dataclass may have a field of each name

        @property
        def needs(self) -> frozenset[str]: ...

        @property
        def goal_sets(self) -> bool: ...

        @property
        def any_goal(self) -> bool: ...

        @property
        def margin(self) -> float: ...

        @property
        def max_detour(self) -> Any: ...

        @property
        def time_limit(self) -> float | None: ...

        @property
        def checkpoint(self) -> Any: ...

        @property
        def warm_start(self) -> Any: ...

        @property
        def answers_in_stages(self) -> bool: ...

        @property
        def needs_kernels(self) -> bool: ...

        @property
        def graph_options(self) -> tuple[str, ...]: ...

        @property
        def graph_of_drives(self) -> GraphFamily | None: ...

        @property
        def time_options(self) -> Any: ...


PlannerSpec = str | Planner | Mapping[str, Mapping[str, Any] | None]


class SweepingPlanner(Planner, Protocol):
    """A planner of many independent jobs: they run on any executor, with the same results; None runs them here."""

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates: ...


def stages_of(
    planner: Planner, problem: Problem, progress: ProgressCallback | None, executor: Executor | None
) -> Iterator[Candidates]:
    """Yield the stages of a planner, on an executor if it takes one."""
    taken = inspect.signature(planner.stages).parameters.values()
    takes_executor = any(one.name == "executor" or one.kind is one.VAR_KEYWORD for one in taken) and (
        sweeps(planner) or planner.answers_in_stages
    )
    on_executor = {"executor": executor} if executor is not None and takes_executor else {}
    yield from planner.stages(problem, progress, **on_executor)


def _solved(
    self: Planner, problem: Problem, progress: ProgressCallback | None = None, **on_executor: Any
) -> Iterator[Candidates]:
    """What a planner without stages has as its only one."""
    yield self.solve(problem, progress, **on_executor)


_DEFAULTS: dict[str, Any] = {
    "needs": UNDECLARED,
    "goal_sets": False,
    "any_goal": False,
    "margin": 0.0,
    "max_detour": None,
    "checkpoint": None,
    "time_limit": None,
    "warm_start": None,
    "answers_in_stages": False,
    "needs_kernels": False,
    "graph_options": (),
    "graph_of_drives": None,
    "time_options": None,
    "stages": _solved,
    "anchored": lambda planner: planner,
}
"""What a planner's class has of the contract without saying so."""


def joined(before: Candidates | None, now: Candidates) -> Candidates:
    """What is found once a stage is done: its candidates and those of the stages before.

    With a final answer only those that it does not cover: where it is within a precision, or where criteria filter, in
    which an earlier path may be better.
    """
    if before is None or not before.trajectories:
        return now
    final = now.status.is_final
    known = {driven(trajectory) for trajectory in now.trajectories}
    new = [i for i, trajectory in enumerate(before.trajectories) if driven(trajectory) not in known]
    if final and not now.filters:
        new = [i for i in new if not (now.planned <= before.planned[i]).all(axis=1).any()]
    if not new:
        return now
    stages = {str(origin["stage"]): None for origin in before.provenance if "stage" in origin}
    earlier = before.some(new)
    what = f" ({', '.join(stages)})" if stages else ""
    better = f", which may be better in {', '.join(c.name for c in now.filters)}" if final and now.filters else ""
    return replace(
        now,
        trajectories=(*now.trajectories, *earlier.trajectories),
        planned=np.concatenate([now.planned, earlier.planned]),
        tolerance=np.concatenate([now.tolerance, earlier.tolerance]),
        provenance=now.provenance + earlier.provenance,
        certificate=f"{now.certificate}; with the points of earlier stages{what}{better}",
    )


def driven(trajectory: Trajectory) -> tuple[Any, ...]:
    """What tells a trajectory from others: its motions and states."""
    states = trajectory.states
    return (trajectory.kinds, *(getattr(states, name).tobytes() for name in states.names))


def sweeps(planner: Planner) -> TypeGuard[SweepingPlanner]:
    """Return whether a planner takes an executor."""
    return "executor" in inspect.signature(planner.solve).parameters


@checked_arguments
def planner(name: str) -> Callable[[T], T]:
    """Register a planner class: a frozen dataclass with a method ``solve(problem, progress)``."""

    def declare(cls: T) -> T:
        if not dataclasses.is_dataclass(cls) or not callable(getattr(cls, "solve", None)):
            raise OptionError(f"planner {name!r} must be a dataclass with a method solve(problem, progress)")
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        planners.add(name, _completed(cls))
        return checked_arguments(cls)

    return declare


def _completed(cls: Any) -> Any:
    """Give a class of planners the defaults of the contract that it does not have."""
    completed(cls, _DEFAULTS)
    if not isinstance(cls.needs, frozenset | property):
        cls.needs = frozenset(cls.needs)
    return cls


@checked_arguments
def make_planner(spec: PlannerSpec, options: Mapping[str, Any] | None = None) -> Planner:
    """A planner from its name and options, from ``{name: {option: value}}`` as in a scenario, or itself.

    Raises UnknownName for a name nobody registered and OptionError for options it does not have.
    """
    if isinstance(spec, str):
        return cast(Planner, made(planners, {spec: options}))
    if options:
        raise OptionError(f"options {sorted(options)} go into the planner {shown(spec)} itself")
    if isinstance(spec, Mapping):
        return cast(Planner, made(planners, spec))
    if isinstance(spec, type) or not callable(getattr(spec, "solve", None)):
        raise OptionError(
            f"a planner is a name, one name with its options such as {{'lattice': {{'step': 0.5}}}}, or an object with "
            f"solve(problem), got {shown(spec)}"
        )
    if not all(hasattr(spec, attribute) for attribute in _DEFAULTS):
        _completed(type(spec))
    return spec
