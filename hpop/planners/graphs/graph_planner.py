"""Planners on a graph, of which other searches take the graph alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, cast

from hpop.errors import OptionError
from hpop.planners.base import Candidates, Planner, make_planner
from hpop.planners.graphs.query import GraphQuery
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Spending
from hpop.registry import planners
from hpop.status import ProgressCallback

if TYPE_CHECKING:
    from hpop.problem import Problem

GraphSpec = str | Mapping[str, Mapping[str, Any] | None]
"""The name of a planner, or ``{name: options}``."""


class GraphPlanner(Planner, Protocol):
    """A planner that says what a problem is on its graph; ``graph_options`` are those of its options that make it.

    It may have ``first_answer(name, problem, objectives, spending, progress)``: a few paths of a part of a large graph,
    with their costs, as candidates of the planner ``name``; None where the graph is soon built.
    """

    graph_options: ClassVar[tuple[str, ...]]

    def graph_query(
        self, problem: Problem, objectives: Objectives, spending: Spending, progress: ProgressCallback | None = None
    ) -> GraphQuery:
        """The problem on the planner's graph; building it may spend what the limits leave, or raises Exhausted."""


def first_of(
    planner: GraphPlanner,
    name: str,
    problem: Problem,
    objectives: Objectives,
    spending: Spending,
    progress: ProgressCallback | None,
) -> Candidates | None:
    """A first answer to keep, where there is a limit that may be passed before the graph is built; else None."""
    find: Callable[..., Candidates | None] | None = getattr(planner, "first_answer", None)
    if find is None or spending.budget.time_limit is None:
        return None
    return find(name, problem, objectives, spending, progress)


def graph_planner(spec: GraphSpec, option: str) -> GraphPlanner:
    """The planner of a spec, of which the graph is searched; ``option`` has the spec.

    Raises OptionError for a planner without a graph, and for options that say how it is searched.
    """
    made = make_planner(spec)
    if not callable(getattr(made, "graph_query", None)):
        able = ", ".join(name for name, known in planners.items() if hasattr(known, "graph_query"))
        raise OptionError(f"{option} is a planner that has a graph ({able}), with its options, got {made.name!r}")
    planner = cast(GraphPlanner, made)
    taken = planner.graph_options
    strange = [
        each.name
        for each in fields(made)  # type: ignore[arg-type]  # planners are dataclasses
        if each.name not in taken and getattr(made, each.name) != each.default
    ]
    if strange:
        raise OptionError(
            f"{option} takes the graph of {planner.name} alone, and with it {', '.join(taken)}, not "
            f"{', '.join(strange)}, which say how {planner.name} itself searches it"
        )
    return planner
