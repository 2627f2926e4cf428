"""Graph families: each builds one kind of graph for a problem, whatever search then runs on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.registry import graphs, made
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, QueryError, UnknownName
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.query import Query, built_query
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
    """Return the shortest path of a graph with its costs in all objectives, as a stage of the planner ``name``.

    Lengths alone are needed of all edges, which take a small part of the time of most other costs; these are evaluated
    along the path. What it takes for a while is given back. Raises Exhausted where a limit is passed.
    """
    spending, length = space.spending, edge_objectives([make_criterion("length")], name)
    held = spending.memory
    graph = space.graph(length.optimised)
    query = Query(space, length, graph, start, goals, build_seconds=spending.seconds())
    paths = first_paths(graph, start, goals, spending.left())
    what = "shortest path"
    found = assemble(name, query, paths, f"the {what} of {space.words}", provenance=[{"stage": what}] * len(paths))
    with limits.within(spending):
        costs = trajectory_costs(objectives.optimised, found.trajectories, space.world)
    spending.release(spending.memory - held)
    return replace(
        found,
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
    problem   the problem that paths of the graph answer; a yaw may be that of the graph's nearest heading
    notes     what the user should know of the graph
    part      what a part, or a smaller graph, is called whose paths come first; "" for the whole graph
    is_large  whether an exact search may take so long that a coarse answer should come first
    status    COMPLETE, or how a search ended from whose paths the graph was built
    stats     counts and seconds of building it, by name
    first     paths found while it was built, which are kept where a limit ends the search before it finds any
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
    """A graph could not be built; the candidates that were found on the way are the planner's answer."""

    def __init__(self, candidates: Candidates) -> None:
        super().__init__("the graph was not built")
        self.candidates = candidates


class GraphFamily:
    """Builds the graph of a problem. A subclass is a frozen dataclass whose fields are the options of the graph.

    Every search runs on every family. A planner with the options of both is a class that inherits from both, as
    ``class Lattice(ExactSearch, LatticeGraph)`` does.

    needs             what the family needs of a model, of what :attr:`hpop.motions.Model.provides` lists
    goal_sets         whether the goal may be a list of states
    any_goal          whether the goal may be of any kind (:class:`hpop.goals.Goal`)
    is_remade         whether the options in a front's provenance make the same graph again, so that it can be driven on
    is_judged         whether every candidate is evaluated again on the exact geometry before it is returned
    answers_by_parts  whether :meth:`graphs` gives parts first even if only the last answer is wanted
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
        """Name and options, as JSON, of which :func:`make_family` makes the family."""
        name, family = next((name, family) for name, family in graphs.items() if family in type(self).__mro__)
        own = [one for one in dataclasses.fields(family) if getattr(self, one.name) != one.default]
        return {name: {one.name: getattr(self, one.name) for one in own}}

    @property
    def family(self) -> GraphFamily:
        """The family itself; what a planner that inherits from it searches."""
        return self

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the graph with the problem's ends; its costs are computed later.

        Raises QueryError for ends that are not usable, Exhausted where a limit of ``spending`` is passed, NotBuilt
        where what was found on the way is all that there is.
        """
        raise NotImplementedError

    def graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield parts of the graph, or smaller ones, if they are wanted, then the whole graph."""
        yield self.build(problem, objectives, spending)

    def has_clock(self, problem: Problem) -> bool:
        """Return whether the graph can be put on a clock, so that people may move."""
        return False

    def first_answer(self, name: str, built: BuiltGraph, objectives: Objectives) -> Candidates | None:
        """Return a path or a few as candidates of the planner ``name``, in case a limit ends the costing of arcs.

        Called if there is a time limit. None where the costs are known already.
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
        """Return the problem on its graph, with all arcs checked and costed: what a search takes.

        Raises QueryError where people move, or no graph can be built, and as :meth:`build` does.
        """
        refuse_moving(problem, f"this search of {self.name}")
        objectives = objectives or edge_objectives(problem.criteria, self.name)
        spending = spending or Spending(Limits(progress=progress))
        built = self._built_or_refused(problem, objectives, spending)
        space, start, goals = built.ends
        checked = replace(built, ends=Ends(space.with_checked_arcs(), start, goals))
        return built_query(checked, objectives)

    def states(self, problem: Problem) -> StateGraph | None:
        """Return the graph of states to which the problem's ends may be joined; None of a graph that has no places."""
        objectives = edge_objectives(problem.criteria, self.name)
        return self._built_or_refused(problem, objectives, Spending()).ends.space.states_alone

    def _built_or_refused(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the graph; QueryError where what was found on the way is all that there is."""
        try:
            return self.build(problem, objectives, spending)
        except NotBuilt as stop:
            if stop.candidates.status is Status.INTERRUPTED:
                raise KeyboardInterrupt from None
            raise QueryError(f"there is no graph {self.name!r}: {'; '.join(stop.candidates.notes)}") from None

    def update(self, before: World, after: World, model: Model, criteria: Sequence[Criterion]) -> None:
        """Let a changed world keep of this family's graphs all that the change leaves as it was; nothing by default."""

    def anchored(self) -> Self:
        """Return a family whose graph depends less on the start, or not at all, so that it can be asked again."""
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
        options = tuple(one.name for one in dataclasses.fields(cls)) if cls.is_remade else ()
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
        return cast(GraphFamily, made(graphs, spec))
    except OptionError as error:
        if isinstance(error, UnknownName) or f"has no {graphs.parameter} " not in str(error):
            raise
        raise OptionError(f"{error}; options of the search stand beside `on`") from None


@dataclass(frozen=True)
class OnGraph:
    """The option of a planner that searches the graph of any family.

    on  the name of a graph family, or ``{name: {option: value}}``
    """

    needs: ClassVar[frozenset[str]] = frozenset()
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True

    on: GraphSpec = "lattice"

    @cached_property
    def family(self) -> GraphFamily:
        """The graph family of ``on``; OptionError for options that it does not have."""
        return make_family(self.on)

    def anchored(self) -> Self:
        """Return a planner on a graph that does not depend on the start, if the family has such a one."""
        return replace(self, on=self.family.anchored().spec)

    def take_needs(self) -> None:
        """Need of a model, and take of goals, what the family does; called once, after the options are set."""
        family = self.family
        for attribute in ("needs", "goal_sets", "any_goal"):
            object.__setattr__(self, attribute, getattr(family, attribute))
