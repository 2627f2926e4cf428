"""Planner interface: the protocol that a planner class implements, its registration, and the candidates it returns."""

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
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.family import GraphFamily
    from hpop.problems.problem import Problem


@dataclass(frozen=True, eq=False)
class Deferred(Sequence[Trajectory]):
    """Sequence of trajectories that are built when they are first read.

    Reading one of them builds all; :meth:`take` builds only some.

    number  number of trajectories
    make    function that builds the trajectories with the given indices
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
        """Return the trajectories with the given indices without building the others."""
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
    """Result of a planner: candidate trajectories, their planned costs, and a statement of what is guaranteed.

    A front is made from candidates: all costs are evaluated again, and dominated trajectories are dropped.

    objectives    criteria that the planner minimised, in the order of the columns of ``planned``
    filters       criteria that the planner could not minimise; like the objectives, they are costs of the front
    trajectories  n trajectories; the sequence may build them on first use
    planned       (n, k) costs as the planner added them up, in the units of the criteria
    tolerance     (n, k) largest allowed difference between a planned and a re-evaluated cost
    status        how planning ended: complete, at a limit, interrupted, or without a path
    certificate   statement of what the planner guarantees for these candidates, as text
    provenance    one dict per trajectory: planner, options and stage; JSON-able
    notes         remarks to show to the user, such as that a criterion was replaced or that a door blocks the path
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
        """Return these candidates marked as an early result, which a later exact search will replace.

        The status becomes UNFINISHED; INTERRUPTED stays. The certificate says that the exact search is not done.
        """
        status = self.status if self.status is Status.INTERRUPTED else Status.UNFINISHED
        return replace(self, status=status, certificate=f"{self.certificate}; the exact search is not done")

    def spread(self, number: int) -> Candidates:
        """Return a sample of about ``number`` candidates that represents the front.

        It contains the candidate with the smallest value of each planned cost. The others are taken at equal intervals
        after sorting by the first cost, then the second, and so on.
        """
        order = np.lexsort(self.planned.T[::-1])
        count = min(max(0, number - self.planned.shape[1]), order.size)
        spaced = order[np.linspace(0, order.size - 1, count).astype(np.int64)]
        return self.subset(np.unique(np.concatenate([self.planned.argmin(axis=0), spaced])))

    def subset(self, indices: Sequence[int] | IntArray) -> Candidates:
        """Return the candidates with the given indices, in that order; certificate, notes and stats stay."""
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
    """Interface of a planner: a frozen dataclass with its options as fields, and a method ``solve``.

    Only ``solve`` is required. The decorator :func:`planner` sets ``name``; the other attributes have defaults.

    needs              capabilities that the model must provide (:attr:`hpop.motions.Model.provides`); an empty set for
                       any model (:mod:`hpop.planners.needs`)
    goal_sets          whether the goal may be a list of states, to reach any of them
    any_goal           whether the goal may be of any kind (:class:`hpop.goals.Goal`)
    tours              whether the planner can visit the stops of a tour (:class:`hpop.Tour`)
    speeds             whether the planner chooses among the speeds of a model that has several (``speed_classes`` or
                       ``paces``)
    margin             m  distance that the robot keeps from people
    max_detour         not None if the planner minimises a mean over time itself, rather than its integral; the front
                       then cannot be merged with fronts of other planners
    time_limit         s  after which the planner returns the candidates found so far; None for no limit
    checkpoint         file in which the search saves its state, or None
    warm_start         planner whose trajectories are the initial guesses, as ``{name: options}``, or None
    answers_in_stages  whether ``stages`` may yield an early result before the final one
    needs_kernels      whether the planner runs the compiled code (kernels) of the exact search, which is then compiled
                       in the background during the first stage
    graph_options      names of the options that define its graph, if a robot that follows a path of its front can
                       replan on that graph; () for a planner without a graph
    graph_of_drives    graph family on which a driving robot replans, or None
    time_options       options of planning among moving people, or None
    seed               seed of its random numbers; None if it draws none
    """

    @property
    def name(self) -> str: ...

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Plan and return the candidates.

        Raises QueryError, UnsupportedCriterion or OptionError for a problem that the planner cannot solve.
        """

    def stages(
        self, problem: Problem, progress: ProgressCallback | None = None, **on_executor: Any
    ) -> Iterator[Candidates]:
        """Yield a quick early result, then better ones; by default only the result of ``solve``.

        All results before the last have the status UNFINISHED. The last one is the result of ``solve``, to which a
        planner may add candidates of earlier stages that ``solve`` alone does not find. After Ctrl-C in a stage, its
        candidates have the status INTERRUPTED and no other stage follows. If ``solve`` accepts an executor, ``stages``
        accepts it too.
        """
        return _only_stage(self, problem, progress, **on_executor)

    def budget(self) -> Budget | None:
        """Return the limits of time and memory of a planner whose limits include reading the map; by default None.

        None means that reading the map does not count towards the time limit.
        """
        return None

    def anchored(self) -> Planner:
        """Return a copy of the planner with a graph that does not depend on the start, so that queries can share it.

        By default this is the planner itself.
        """
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
        def speeds(self) -> bool: ...

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

        @property
        def seed(self) -> int | None: ...


PlannerSpec = str | Planner | Mapping[str, Mapping[str, Any] | None]


class SweepingPlanner(Planner, Protocol):
    """Planner that can distribute independent jobs over the workers of an executor.

    The result does not depend on the executor. Without one, the jobs run one by one in this process.
    """

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates: ...


def stages_of(
    planner: Planner, problem: Problem, progress: ProgressCallback | None, executor: Executor | None
) -> Iterator[Candidates]:
    """Yield the early results of a planner and its final result; pass it the executor if it accepts one."""
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
    "speeds": False,
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
    "seed": None,
    "stages": _only_stage,
    "budget": lambda planner: None,
    "anchored": lambda planner: planner,
}
"""Defaults of the attributes that a planner class does not define."""


def joined(before: Candidates | None, now: Candidates) -> Candidates:
    """Add to the result ``now`` of a stage those candidates of earlier stages, ``before``, that it does not replace.

    A later candidate with equal motions replaces an earlier one. In a final result without ``filters``, so does a later
    candidate that is at least as good in every planned cost. So an exact final result usually stays as it is.
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
    """Return a key for sets and dicts that is equal for trajectories with equal motions and states."""
    states = trajectory.states
    return (trajectory.kinds, *(getattr(states, name).tobytes() for name in states.names))


def sweeps(planner: Planner) -> TypeGuard[SweepingPlanner]:
    """Return whether the ``solve`` of a planner accepts an executor, to distribute its jobs."""
    return "executor" in inspect.signature(planner.solve).parameters


@checked_arguments
def planner(name: str) -> Callable[[T], T]:
    """Return a class decorator that registers a planner under a name.

    The class must be a frozen dataclass with a method ``solve(problem, progress)``.
    """

    def declare(cls: T) -> T:
        if not dataclasses.is_dataclass(cls) or not callable(getattr(cls, "solve", None)):
            raise OptionError(f"planner {name!r} must be a dataclass with a method solve(problem, progress)")
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        planners.add(name, _with_defaults(cls))
        return checked_arguments(cls)

    return declare


def _with_defaults(cls: Any) -> Any:
    """Set the attributes of :class:`Planner` that a planner class does not define to their defaults."""
    with_optional_members(cls, _DEFAULTS)
    if not isinstance(cls.needs, frozenset | property):
        cls.needs = frozenset(cls.needs)
    return cls


@checked_arguments
def make_planner(spec: PlannerSpec, options: Mapping[str, Any] | None = None) -> Planner:
    """Return a planner from its name with ``options``, from ``{name: {option: value}}``, or a planner as it is.

    Raises UnknownName for a name that is not registered and OptionError for unknown options.
    """
    if isinstance(spec, str):
        return cast(Planner, plugin_from_spec(planners, {spec: options}))
    if options:
        raise OptionError(
            f"options can be given beside the name of a planner only, got options {sorted(options)} beside "
            f"{shown(spec)}; set them in the planner itself"
        )
    if isinstance(spec, Mapping):
        return cast(Planner, plugin_from_spec(planners, spec))
    if isinstance(spec, type) or not callable(getattr(spec, "solve", None)):
        raise OptionError(
            f"a planner must be a name, a name with options such as {{'lattice': {{'step': 0.5}}}}, or an object with "
            f"a method solve(problem), got {shown(spec)}"
        )
    if not all(hasattr(spec, attribute) for attribute in _DEFAULTS):
        _with_defaults(type(spec))
    return spec
