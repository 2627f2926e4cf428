"""The contract of a planner, and the candidate trajectories that it returns."""

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
from hpop.base.registry import planners, plugin_from_spec, with_optional_members
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
    """Sequence of trajectories that are built on first use: all at once, or only selected rows.

    number  number of trajectories
    make    function that builds the trajectories of given rows
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
        """Return the trajectories of some rows without building the others."""
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
    """Candidate trajectories of a planner, with their planned costs and the planner's claim.

    objectives    criteria that the planner optimised, in the order of the columns of ``planned``
    filters       criteria that the planner could not optimise, but by which the front is filtered
    trajectories  n trajectories; the sequence may build them on first use
    planned       (n, k) costs as the planner added them up, in the units of the criteria
    tolerance     (n, k) largest difference between a planned and a re-evaluated cost
    status        how the planner ended
    certificate   claim of the planner, as text
    provenance    one dict per trajectory: planner, options and stage; JSON-able
    notes         remarks for the user: an objective that stands in for another, a door that blocks the path
    stats         counts and seconds by name, JSON-able; `hpop plan` prints them
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
        """Return these candidates with the status UNFINISHED, or INTERRUPTED if they were interrupted."""
        status = self.status if self.status is Status.INTERRUPTED else Status.UNFINISHED
        return replace(self, status=status, certificate=f"{self.certificate}; the exact search is not done")

    def spread(self, number: int) -> Candidates:
        """Return at most ``number`` candidates: the best of each planned cost, and others spread over the front.

        The others lie at equal intervals in the lexicographic order of the costs.
        """
        order = np.lexsort(self.planned.T[::-1])
        count = min(max(0, number - self.planned.shape[1]), order.size)
        spaced = order[np.linspace(0, order.size - 1, count).astype(np.int64)]
        return self.subset(np.unique(np.concatenate([self.planned.argmin(axis=0), spaced])))

    def subset(self, indices: Sequence[int] | IntArray) -> Candidates:
        """Return the candidates of some rows, in that order, with the same claim, notes and stats."""
        rows, trajectories = [int(i) for i in indices], self.trajectories
        return replace(
            self,
            trajectories=trajectories.take(np.array(rows, dtype=np.int64))
            if isinstance(trajectories, Deferred)
            else tuple(trajectories[i] for i in rows),
            planned=self.planned[rows],
            tolerance=self.tolerance[rows],
            provenance=tuple(self.provenance[i] for i in rows),
        )

    def __repr__(self) -> str:
        names = ", ".join(criterion.name for criterion in self.objectives)
        return f"<Candidates: {len(self.trajectories):,} by {names}; {self.status}; {self.certificate}>"


UNDECLARED = frozenset({"plane", "turn-move", "rigid", "wheels"})
"""Needs of a planner that declares none: planners of earlier versions could rely on these."""


class Planner(Protocol):
    """Planner: a frozen dataclass with options as fields, and a method ``solve`` that returns candidate trajectories.

    Only ``solve`` is required. :func:`planner` sets ``name``; the other attributes have defaults.

    needs              capabilities that the model must provide (:attr:`hpop.motions.Model.provides`); an empty set for
                       any model (:mod:`hpop.planners.needs`)
    goal_sets          whether the goal may be a list of states, to reach any of them
    any_goal           whether the goal may be of any kind (:class:`hpop.goals.Goal`)
    tours              whether the problem may have a tour (:class:`hpop.Tour`), all stops of which it visits
    margin             m  of distance kept from people
    max_detour         not None if it minimises a time-mean itself; its front then cannot be merged with others
    time_limit         s  after which it returns the candidates found so far, or None
    checkpoint         file that saves its search, or None
    warm_start         planner that gives the trajectories it starts from, as ``{name: options}``, or None
    answers_in_stages  whether ``stages`` may yield a first answer before the final one
    needs_kernels      whether it uses the kernels of the exact search, which are compiled during a first answer
    graph_options      options that define its graph, if its fronts can be driven on; () for a planner without a graph
    graph_of_drives    graph family on which a drive looks for other paths, or None
    time_options       options of planning among moving people, or None
    """

    @property
    def name(self) -> str: ...

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Plan; raises QueryError, UnsupportedCriterion or OptionError for a problem that it cannot take."""

    def stages(
        self, problem: Problem, progress: ProgressCallback | None = None, **on_executor: Any
    ) -> Iterator[Candidates]:
        """Yield a first answer soon and better ones later; by default only the result of ``solve``.

        Answers before the last are UNFINISHED. The last one is the result of ``solve``; it may include earlier
        candidates that ``solve`` did not find. After Ctrl-C in a stage its candidates are INTERRUPTED and no other
        stage follows. A planner that sweeps takes its executor here as well.
        """
        return _only_stage(self, problem, progress, **on_executor)

    def anchored(self) -> Planner:
        """Return a planner with these options on a graph that does not depend on the start; itself by default."""
        return self

    if TYPE_CHECKING:  # the defaults are set by `_with_defaults`, so that a dataclass may have a field of each name

        @property
        def needs(self) -> frozenset[str]: ...

        @property
        def goal_sets(self) -> bool: ...

        @property
        def any_goal(self) -> bool: ...

        @property
        def tours(self) -> bool: ...

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
    """Planner of independent jobs, with the same result on any executor; without one, jobs run in this process."""

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates: ...


def stages_of(
    planner: Planner, problem: Problem, progress: ProgressCallback | None, executor: Executor | None
) -> Iterator[Candidates]:
    """Yield the stages of a planner, on an executor if it takes one."""
    parameters = inspect.signature(planner.stages).parameters.values()
    takes_executor = any(
        parameter.name == "executor" or parameter.kind is parameter.VAR_KEYWORD for parameter in parameters
    ) and (sweeps(planner) or planner.answers_in_stages)
    on_executor = {"executor": executor} if executor is not None and takes_executor else {}
    yield from planner.stages(problem, progress, **on_executor)


def _only_stage(
    self: Planner, problem: Problem, progress: ProgressCallback | None = None, **on_executor: Any
) -> Iterator[Candidates]:
    """Yield the result of ``solve`` as the only stage: the default of :meth:`Planner.stages`."""
    yield self.solve(problem, progress, **on_executor)


_DEFAULTS: dict[str, Any] = {
    "needs": UNDECLARED,
    "goal_sets": False,
    "any_goal": False,
    "tours": False,
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
    "stages": _only_stage,
    "anchored": lambda planner: planner,
}
"""Defaults of the attributes that a planner class does not define."""


def joined(before: Candidates | None, now: Candidates) -> Candidates:
    """Return the candidates of a stage, ``now``, together with those of earlier stages, ``before``.

    An exact final answer stands alone. If it is approximate, or if criteria filter the front, an earlier candidate may
    be better in some cost, and the earlier candidates that the answer does not cover are added.
    """
    if before is None or not before.trajectories:
        return now
    final = now.status.is_final
    motions = {motions_key(trajectory) for trajectory in now.trajectories}
    new = [i for i, trajectory in enumerate(before.trajectories) if motions_key(trajectory) not in motions]
    if final and not now.filters:
        new = [i for i in new if not (now.planned <= before.planned[i]).all(axis=1).any()]
    if not new:
        return now
    stages = {str(origin["stage"]): None for origin in before.provenance if "stage" in origin}
    earlier = before.subset(new)
    names = f" ({', '.join(stages)})" if stages else ""
    better = f", which may be better in {', '.join(c.name for c in now.filters)}" if final and now.filters else ""
    return replace(
        now,
        trajectories=(*now.trajectories, *earlier.trajectories),
        planned=np.concatenate([now.planned, earlier.planned]),
        tolerance=np.concatenate([now.tolerance, earlier.tolerance]),
        provenance=now.provenance + earlier.provenance,
        certificate=f"{now.certificate}; with the points of earlier stages{names}{better}",
    )


def motions_key(trajectory: Trajectory) -> tuple[Any, ...]:
    """Return a hashable key that is equal for trajectories with equal motions and states."""
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
        planners.add(name, _with_defaults(cls))
        return checked_arguments(cls)

    return declare


def _with_defaults(cls: Any) -> Any:
    """Add the defaults of the contract to a planner class."""
    with_optional_members(cls, _DEFAULTS)
    if not isinstance(cls.needs, frozenset | property):
        cls.needs = frozenset(cls.needs)
    return cls


@checked_arguments
def make_planner(spec: PlannerSpec, options: Mapping[str, Any] | None = None) -> Planner:
    """Return the planner that a spec names: a name with options, ``{name: {option: value}}``, or a planner.

    Raises UnknownName for a name that is not registered and OptionError for unknown options.
    """
    if isinstance(spec, str):
        return cast(Planner, plugin_from_spec(planners, {spec: options}))
    if options:
        raise OptionError(f"options {sorted(options)} go into the planner {shown(spec)} itself")
    if isinstance(spec, Mapping):
        return cast(Planner, plugin_from_spec(planners, spec))
    if isinstance(spec, type) or not callable(getattr(spec, "solve", None)):
        raise OptionError(
            f"a planner is a name, one name with its options such as {{'lattice': {{'step': 0.5}}}}, or an object with "
            f"solve(problem), got {shown(spec)}"
        )
    if not all(hasattr(spec, attribute) for attribute in _DEFAULTS):
        _with_defaults(type(spec))
    return spec
