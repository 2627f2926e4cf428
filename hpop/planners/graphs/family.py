"""Graph families: each builds one kind of graph for a problem, for any search."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.registry import graphs, plugin_from_spec
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, QueryError, UnknownName
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.query import Query, built_query
from hpop.planners.graphs.tour_stops import with_tour
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.needs import refuse_moving
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.spending import Limits, Spending
from hpop.runtime import limits
from hpop.runtime.status import ProgressCallback, Status
from hpop.search.supported.first_paths import first_paths

if TYPE_CHECKING:
    from hpop.criteria.base import Criterion
    from hpop.motions import Model
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.problems.problem import Problem
    from hpop.world import World


def shortest_path(
    name: str, space: TrajectoryGraph, start: int, goals: list[int], objectives: Objectives
) -> Candidates:
    """Return the shortest path of a graph as an early stage of the planner ``name``.

    Lengths are computed for all edges, which is fast; all other costs are evaluated along the path only. The memory is
    released afterwards. Raises Exhausted if a limit is passed.
    """
    spending, length = space.spending, edge_objectives([make_criterion("length")], name)
    held = spending.memory
    graph = space.graph(length.optimised)
    query = Query(space, length, graph, start, goals, build_seconds=spending.seconds())
    paths = first_paths(graph, start, goals, spending.left())
    what = "shortest path"
    shortest = assemble(name, query, paths, f"the {what} of {space.words}", provenance=[{"stage": what}] * len(paths))
    with limits.within(spending):
        costs = trajectory_costs(objectives.optimised, shortest.trajectories, space.world)
    spending.release(spending.memory - held)
    return replace(
        shortest,
        objectives=objectives.optimised,
        planned=costs,
        tolerance=np.zeros_like(costs),
        filters=objectives.filters,
        notes=objectives.notes,
    )


F = TypeVar("F", bound=type)
GraphSpec = str | Mapping[str, Mapping[str, Any] | None]
"""The name of a graph family, or ``{name: options}``."""


@dataclass(frozen=True, eq=False)
class BuiltGraph:
    """A graph of trajectories for a problem, with the problem's start and goals on it.

    ends      the graph, its start and its goals
    problem   problem that the paths solve; its yaws may be those of the nearest headings of the graph
    notes     remarks on the graph, for the user
    part      name of the part, if this is a part or a smaller graph that is searched first; "" for the whole graph
    is_large  whether an exact search may take so long that a coarse result should come first
    status    COMPLETE, or the status of the lattice search that found the paths for the corners
    stats     counts and seconds of building the graph, by name
    first     paths found while the graph was built; the result if a limit ends the search before it finds a path
    """

    ends: Ends
    problem: Problem
    notes: tuple[str, ...] = ()
    part: str = ""
    is_large: bool = False
    status: Status = Status.COMPLETE
    stats: Mapping[str, Any] = field(default_factory=dict)
    first: Candidates | None = None


class NotBuilt(Exception):
    """Exception of a graph that could not be built; the candidates found meanwhile are the planner's result."""

    def __init__(self, candidates: Candidates) -> None:
        super().__init__("the graph was not built")
        self.candidates = candidates


class GraphFamily:
    """Kind of graph that can be built for a problem; a subclass is a frozen dataclass with the options as fields.

    Every search runs on every family. A planner that has the options of a search and of a family inherits from both
    classes, as ``class Lattice(ExactSearch, LatticeGraph)`` does.

    needs             capabilities that a model must have, from :attr:`hpop.motions.Model.provides`
    goal_sets         whether the goal may be a list of states
    any_goal          whether the goal may be of any kind (:class:`hpop.goals.Goal`)
    is_remade         whether the options in a front's provenance build the same graph again; replanning during a drive
                      needs this
    is_judged         whether every candidate is checked on the exact geometry before it is returned
    answers_by_parts  whether :meth:`graphs` yields parts of the graph first even if only the final result is requested
    """

    name: ClassVar[str]
    needs: ClassVar[frozenset[str]] = frozenset()
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = False
    is_remade: ClassVar[bool] = True
    is_judged: ClassVar[bool] = True
    answers_by_parts: ClassVar[bool] = False
    graph_options: ClassVar[tuple[str, ...]] = ()

    @property
    def spec(self) -> dict[str, dict[str, Any]]:
        """Name and options as JSON, from which :func:`make_family` makes the family."""
        name, family = next((name, family) for name, family in graphs.items() if family in type(self).__mro__)
        own = [option for option in dataclasses.fields(family) if getattr(self, option.name) != option.default]
        return {name: {option.name: getattr(self, option.name) for option in own}}

    @property
    def family(self) -> GraphFamily:
        """The family itself, the graph of a planner that inherits from it."""
        return self

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the graph with the problem's start and goals; costs of arcs are computed later.

        Raises QueryError for a start or goals that are not usable, Exhausted if a limit of ``spending`` is passed,
        NotBuilt if no graph, but candidates were found.
        """
        raise NotImplementedError

    def graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the whole graph; if ``in_stages``, first yield parts of it or smaller graphs."""
        yield self.build(problem, objectives, spending)

    def toured_graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the graphs of :meth:`graphs`; for a problem with a tour only the whole one, with the tour's layers.

        Parts are left out, since they need not contain the stops.
        """
        if problem.tour is None:
            yield from self.graphs(problem, objectives, spending, in_stages=in_stages)
            return
        for built in self.graphs(problem, objectives, spending):
            yield replace(built, ends=with_tour(built.ends, built.problem, problem.tour))

    def has_clock(self, problem: Problem) -> bool:
        """Return whether the graph can be put on a clock, so that people may move."""
        return False

    def first_answer(self, name: str, built: BuiltGraph, objectives: Objectives) -> Candidates | None:
        """Return a few quick paths as candidates of the planner ``name``; None if the costs of arcs are cached.

        They are the result if a limit ends the computation of costs. Called only if there is a time limit.
        """
        space = built.ends.space
        return None if space.costed(objectives.optimised) else shortest_path(name, *built.ends, objectives)

    def query(
        self,
        problem: Problem,
        objectives: Objectives | None = None,
        spending: Spending | None = None,
        progress: ProgressCallback | None = None,
    ) -> Query:
        """Return the query of the problem on its graph, with all arcs checked and costed.

        Raises QueryError if people move or no graph can be built, and the errors of :meth:`build`.
        """
        refuse_moving(problem, f"this search of {self.name}")
        objectives = objectives or edge_objectives(problem.criteria, self.name)
        spending = spending or Spending(Limits(progress=progress))
        built = self._built_or_refused(problem, objectives, spending)
        space, start, goals = built.ends
        checked = replace(built, ends=Ends(space.with_checked_arcs(), start, goals))
        return built_query(checked, objectives)

    def states(self, problem: Problem) -> StateGraph | None:
        """Return the graph of states without the problem's start and goals; None for a graph without places."""
        objectives = edge_objectives(problem.criteria, self.name)
        return self._built_or_refused(problem, objectives, Spending()).ends.space.states_alone

    def _built_or_refused(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the graph; raise QueryError if no graph, but candidates were found."""
        try:
            *_, built = self.toured_graphs(problem, objectives, spending)
            return built
        except NotBuilt as stop:
            if stop.candidates.status is Status.INTERRUPTED:
                raise KeyboardInterrupt from None
            raise QueryError(f"there is no graph {self.name!r}: {'; '.join(stop.candidates.notes)}") from None

    def update(self, before: World, after: World, model: Model, criteria: Sequence[Criterion]) -> None:
        """Copy the parts of cached graphs that a change of the world leaves unchanged to the cache of the new world.

        By default nothing is copied.
        """

    def anchored(self) -> Self:
        """Return a family with a graph that depends less on the start, or not at all, so that more queries reuse it."""
        return self


@checked_arguments
def graph_family(name: str) -> Callable[[F], F]:
    """Register a graph family: a frozen dataclass that inherits from :class:`GraphFamily` and has a ``build``."""

    def declare(cls: F) -> F:
        if not dataclasses.is_dataclass(cls) or not issubclass(cls, GraphFamily) or cls.build is GraphFamily.build:
            raise OptionError(
                f"graph {name!r} must be a dataclass that inherits from hpop.planners.graphs.GraphFamily and has a "
                "method build(problem, objectives, spending)"
            )
        options = tuple(option.name for option in dataclasses.fields(cls)) if cls.is_remade else ()
        vars_of_class = {"name": name, "graph_options": options}
        for attribute, value in vars_of_class.items():
            setattr(cls, attribute, value)
        graphs.add(name, cls)
        return cls

    return declare


def make_family(spec: GraphSpec) -> GraphFamily:
    """Make a graph family from its name, or from ``{name: {option: value}}``.

    Raises UnknownName for a name that is not registered and OptionError for options that the family does not have.
    """
    try:
        return cast(GraphFamily, plugin_from_spec(graphs, spec))
    except OptionError as error:
        if isinstance(error, UnknownName) or f"has no {graphs.parameter} " not in str(error):
            raise
        raise OptionError(f"{error}; options of the search are given beside `on`") from None


@dataclass(frozen=True)
class OnGraph:
    """The option ``on`` of planners that search the graph of any family.

    on  the name of a graph family, or ``{name: {option: value}}``
    """

    needs: ClassVar[frozenset[str]] = frozenset()
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True

    on: GraphSpec = "lattice"

    @cached_property
    def family(self) -> GraphFamily:
        """The graph family of ``on``; raises OptionError for options that it does not have."""
        return make_family(self.on)

    def anchored(self) -> Self:
        """Return the planner on a graph that does not depend on the start, if the family has one."""
        return replace(self, on=self.family.anchored().spec)

    def take_needs(self) -> None:
        """Copy the family's requirements of models and goals to the planner; called once, after the options are set."""
        family = self.family
        for attribute in ("needs", "goal_sets", "any_goal"):
            object.__setattr__(self, attribute, getattr(family, attribute))
