"""Graph families: each builds one kind of graph for a problem, such as a lattice or a roadmap, for any search."""

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
from hpop.planners.graphs.run_speeds import with_run_speeds
from hpop.planners.graphs.speeds import with_speeds
from hpop.planners.graphs.tour_stops import with_tour
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.needs import people_move, refuse_moving
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.spending import Limits, Spending
from hpop.runtime import limits
from hpop.runtime.limits import ProgressCallback, Status
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
    """Return the shortest path of a graph as a quick early result of the planner ``name``.

    Lengths are computed for all edges, which is fast. All other costs are evaluated along this path only. The memory
    is released afterwards. Raises Exhausted if a limit is passed.
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
"""How a user selects a graph family: its name, or ``{name: {option: value}}``."""


@dataclass(frozen=True, eq=False)
class BuiltGraph:
    """Graph that was built for a problem, with the nodes of the problem's start and goals.

    ends      the graph, and the nodes of the start and the goals
    problem   problem that the paths solve; yaws of start and goals may be replaced by the nearest headings of the graph
    notes     remarks on the graph, for the user
    part      name of this graph if it is only a part of the whole graph, or a smaller one, that is searched first; ""
              for the whole graph
    is_large  whether an exact search may take so long that an approximate result should come first
    status    COMPLETE; for a graph built from the paths of a lattice search, the status of that search
    stats     counts and seconds of building the graph, by name
    first     paths found while the graph was built; the planner returns them if a limit ends the search before it
              finds a path
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
    """Raised if a graph could not be built; its ``candidates``, found meanwhile, become the planner's result."""

    def __init__(self, candidates: Candidates) -> None:
        super().__init__("the graph was not built")
        self.candidates = candidates


class GraphFamily:
    """Base class of the kinds of graphs; a subclass is a frozen dataclass with its options as fields.

    Every search runs on every family. A planner with the options of both a search and a family inherits from both, as
    ``class Lattice(ExactSearch, LatticeGraph)`` does.

    needs             capabilities that a model must have, from :attr:`hpop.motions.Model.provides`
    goal_sets         whether the goal may be a list of states
    any_goal          whether the goal may be of any kind (:class:`hpop.goals.Goal`)
    is_remade         whether the options stored with a front suffice to build the same graph again, as replanning on a
                      driving robot requires
    is_judged         whether every candidate is checked on the exact geometry before it is returned
    answers_by_parts  whether parts of the graph are searched first even if only the final result is requested
    graph_options     names of the options from which a driving robot builds the same graph again; set on registration
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
        """Name and options of the family, ``{name: {option: value}}``; :func:`make_family` makes the family from it.

        Options with their default values are left out.
        """
        name, family = next((name, family) for name, family in graphs.items() if family in type(self).__mro__)
        own = [option for option in dataclasses.fields(family) if getattr(self, option.name) != option.default]
        return {name: {option.name: getattr(self, option.name) for option in own}}

    @property
    def family(self) -> GraphFamily:
        """The family itself; other planners have an attribute ``family`` with the family that they search."""
        return self

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the graph for a problem, with nodes for its start and goals; costs of arcs are computed later.

        Raises QueryError if the start or the goals cannot be used, and Exhausted if a limit of ``spending`` is passed.
        Raises NotBuilt if there is no graph but candidates were found.
        """
        raise NotImplementedError

    def graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the whole graph; if ``in_stages``, first yield parts of it or smaller graphs, for quick results."""
        yield self.build(problem, objectives, spending)

    def toured_graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the graphs of :meth:`graphs`, extended for the model's speeds and the problem's tour.

        With several speeds, each graph has a copy (layer) at rest and one for each speed, or two for each speed if
        people move.

        With a tour, only the whole graph is yielded, with a copy (layer) for each set of visited stops. Parts of the
        graph are left out, since they need not contain the stops.
        """
        if problem.tour is None:
            for built in self.graphs(problem, objectives, spending, in_stages=in_stages):
                if people_move(problem):
                    yield replace(built, ends=with_run_speeds(built.ends, problem.model))
                else:
                    yield replace(built, ends=with_speeds(built.ends, problem.model, objectives.optimised))
            return
        for built in self.graphs(problem, objectives, spending):
            yield replace(built, ends=with_tour(built.ends, built.problem, problem.tour, objectives.optimised))

    def has_clock(self, problem: Problem) -> bool:
        """Return whether the graph can be searched in time steps, so that people may move; by default it cannot."""
        return False

    def first_answer(self, name: str, built: BuiltGraph, objectives: Objectives) -> Candidates | None:
        """Return paths that are found quickly, before the costs of all arcs are computed; None if the costs are cached.

        Planners call this if there is a time limit, and return these paths if the limit ends the computation of costs.
        By default it is the shortest path. ``name`` is the planner's name.
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
        """Build the graph of a problem and compute all its costs; return the query that searches can answer.

        All arcs are checked for collisions. Raises QueryError if people move or no graph can be built, and the errors
        of :meth:`build`.
        """
        refuse_moving(problem, f"this search of {self.name}")
        objectives = objectives or edge_objectives(problem.criteria, self.name)
        spending = spending or Spending(Limits(progress=progress))
        built = self._built_or_refused(self.toured_graphs(problem, objectives, spending))
        space, start, goals = built.ends
        checked = replace(built, ends=Ends(space.with_checked_arcs(), start, goals))
        return built_query(checked, objectives)

    def states(self, problem: Problem) -> StateGraph | None:
        """Build the graph of a problem and return it without start, goals and stops; None if it is not in the plane."""
        objectives = edge_objectives(problem.criteria, self.name)
        return self._built_or_refused(self.graphs(problem, objectives, Spending())).ends.space.states_alone

    def _built_or_refused(self, graphs: Iterator[BuiltGraph]) -> BuiltGraph:
        """Return the last graph, which is whole; raise QueryError instead of NotBuilt if it cannot be built.

        After Ctrl-C while building, raises KeyboardInterrupt.
        """
        try:
            *_, built = graphs
            return built
        except NotBuilt as stop:
            if stop.candidates.status is Status.INTERRUPTED:
                raise KeyboardInterrupt from None
            raise QueryError(
                f"the graph {self.name!r} could not be built for this problem: {'; '.join(stop.candidates.notes)}"
            ) from None

    def update(self, before: World, after: World, model: Model, criteria: Sequence[Criterion]) -> None:
        """After the world changed, copy those parts of cached graphs that are still valid to the new world's cache.

        By default nothing is copied. Cached graphs are those for ``model`` and ``criteria``; ``before`` and ``after``
        are the two worlds.
        """

    def anchored(self) -> Self:
        """Return a copy of the family whose graph depends less on the start, or not at all; queries can share it.

        By default this is the family itself.
        """
        return self


@checked_arguments
def graph_family(name: str) -> Callable[[F], F]:
    """Return a class decorator that registers a graph family under a name.

    The class must be a frozen dataclass that inherits from :class:`GraphFamily` and has a method ``build``.
    """

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
        raise OptionError(
            f"{error}; inside `on`, give options of the graph only; options of the search stand beside `on`"
        ) from None


@dataclass(frozen=True)
class OnGraph:
    """Base class of planners with an option ``on``, which selects the graph family that is searched.

    on  the name of a graph family, or ``{name: {option: value}}``
    """

    needs: ClassVar[frozenset[str]] = frozenset()
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True

    on: GraphSpec = "lattice"

    @cached_property
    def family(self) -> GraphFamily:
        """Graph family that ``on`` selects.

        Raises UnknownName if there is no such family, OptionError for options that the family does not have.
        """
        return make_family(self.on)

    def anchored(self) -> Self:
        """Return a copy of the planner whose graph does not depend on the start, if the family has such a graph."""
        return replace(self, on=self.family.anchored().spec)

    def take_needs(self) -> None:
        """Set the planner's ``needs``, ``goal_sets`` and ``any_goal`` to those of its graph family.

        Called once, after the options are set.
        """
        family = self.family
        for attribute in ("needs", "goal_sets", "any_goal"):
            object.__setattr__(self, attribute, getattr(family, attribute))
