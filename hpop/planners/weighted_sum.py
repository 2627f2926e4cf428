"""The weighted-sum planner: supported trade-offs of a graph, one shortest path per weight."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from hpop.base.scalars import set_python_values
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.planners.base import Candidates, planner
from hpop.planners.graphs.assemble import OFF, ROUNDED, assemble, checked_edges_text
from hpop.planners.graphs.family import GraphFamily, GraphSpec, NotBuilt, make_family
from hpop.planners.graphs.lattice.family import LatticeGraph
from hpop.planners.graphs.query import Query, built_query, refuse_unanswerable
from hpop.planners.objectives import edge_objectives
from hpop.planners.searches.exact import QUICK, SHARE
from hpop.planners.spending import Exhausted, Limits, Spending, stopped
from hpop.runtime.status import Budget, ProgressCallback, Status
from hpop.search import supported_paths
from hpop.search.supported.weights import checked_divisions, integer_weights

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

Weights = tuple[tuple[float, ...], ...]


def checked_weights(divisions: int | None, weights: Any) -> Weights | None:
    """Return rows of weights as floats, or None; raise OptionError for invalid weights, or weights and divisions."""
    if divisions is not None:
        divisions = checked_divisions(divisions)
    if weights is None:
        return None
    if divisions is not None:
        raise OptionError(f"give divisions or weights, not both; got {shown(divisions)} and {shown(weights)}")
    if not isinstance(weights, list | tuple) or not weights:
        raise OptionError(f"weights is a list of lists of numbers, one number a cost, got {shown(weights)}")
    for row in weights:
        integer_weights(row)
    return tuple(tuple(float(w) for w in row) for row in weights)


def check_count(weights: Weights | None, criteria: Sequence[Criterion]) -> None:
    """Raise OptionError if a row does not have one weight for each criterion."""
    for row in weights or ():
        if len(row) != len(criteria):
            names = ", ".join(criterion.name for criterion in criteria)
            raise OptionError(
                f"weights has one number for each of {names}, in this order; got {len(row)} numbers: {list(row)}"
            )


@planner("weighted-sum")
@dataclass(frozen=True)
class WeightedSum:
    """Supported paths of an SE(2) lattice, or of another graph: the optima of weighted sums of the costs, exactly.

    step            m  distance between neighbouring positions
    headings        number of headings: 4, 8 or 16
    corner_cutting  whether a diagonal move may pass between two blocked positions
    divisions       makes the weights: all multiples of 1 / divisions that add up to 1
    weights         vectors of weights, each with one number for each cost, in the order of the criteria (none for
                    criteria with memory). Without divisions and weights, weights are chosen adaptively
    time_limit      s  for reading the map, building the graph and sweeping, without compiling. When it ends, the paths
                    found are returned, and the status says that more may exist
    on              a graph family that replaces the lattice: ``{"roadmap": {"samples": 300}}``

    A path is supported if no other has a smaller weighted sum for some positive weights. Weights are those of costs
    normalised from ideal to nadir, which are in the stats; each trajectory carries its weights. Ties under zero
    weights are broken in the order of the criteria, so every path is efficient.

    Accepts criteria that add up along edges (sum), at most six; a time-mean is represented by its integral, and
    criteria with memory only filter the paths. Guarantees that the complete adaptive sweep has every extreme supported
    cost vector of the graph that the planner "lattice", or the family in ``on``, has with the same options, and that no
    returned vector is unsupported; costs rounded as there. Points in a dent of the front are missed. Serves the models
    of that planner. Costs one A* search per weight: see :func:`hpop.search.supported_paths`.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move"})
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = False
    tours: ClassVar[bool] = True

    step: float = 0.25
    headings: int = 8
    corner_cutting: bool = False
    divisions: int | None = None
    weights: Weights | None = None
    time_limit: float | None = None
    on: GraphSpec | None = None

    def __post_init__(self) -> None:
        set_python_values(self)
        for attribute in ("needs", "goal_sets", "any_goal"):
            object.__setattr__(self, attribute, getattr(self.family, attribute))
        self.budget()
        object.__setattr__(self, "weights", checked_weights(self.divisions, self.weights))

    def budget(self) -> Budget:
        """Return the limits, which reading the map, building and searching share."""
        return Budget(self.time_limit)

    def anchored(self) -> WeightedSum:
        """Return the planner on a graph that does not depend on the start, if its family has such a graph."""
        return WeightedSum(
            divisions=self.divisions, weights=self.weights, time_limit=self.time_limit, on=self.family.anchored().spec
        )

    @cached_property
    def family(self) -> GraphFamily:
        """Graph family that is searched."""
        lattice = LatticeGraph(self.step, self.headings, self.corner_cutting)
        if self.on is None:
            return lattice
        if lattice != LatticeGraph():
            raise OptionError("give on, or step, headings and corner_cutting, which are those of the lattice, not both")
        return make_family(self.on)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan on the graph; each job of the executor solves some weights.

        Raises the errors of :meth:`Lattice.solve`, UnsupportedCriterion also for a worst edge (max), and OptionError
        for rows that do not have one weight per cost.
        """
        objectives, family = edge_objectives(problem.criteria, "weighted-sum"), self.family
        worst = [criterion.name for criterion in objectives.optimised if criterion.aggregate == "max"]
        if worst:
            raise UnsupportedCriterion(
                f"weighted-sum needs criteria that add up along edges; {', '.join(worst)} takes the worst edge "
                f"(aggregate 'max'). Leave it out, or use planner {family.name!r}."
            )
        check_count(self.weights, objectives.optimised)
        refuse_unanswerable(problem, objectives, "weighted-sum")
        limits = Limits(self.time_limit, progress=progress)
        spending = Spending(limits, spent=problem.read_seconds, memory=problem.read_memory)
        first: Candidates | None = None
        began = time.perf_counter()
        try:
            in_stages = spending.limits.time_limit is not None
            for built in family.toured_graphs(problem, objectives, spending, in_stages=in_stages):
                if in_stages and not built.part and (first is None or not first.trajectories):
                    first = family.first_answer("weighted-sum", built, objectives)
                query = built_query(built, objectives, began)
                if built.part:
                    share = spending.share(max(QUICK, SHARE * query.build_seconds))
                    found = query.first_answer("weighted-sum", share)
                    query.drop_ties()
                    first = found if found.trajectories or first is None else first
                    if found.status is Status.INTERRUPTED:
                        return found
            budget = spending.left()
        except Exhausted as stop:
            return stopped("weighted-sum", objectives, stop, spending, first)
        except NotBuilt as stop:
            note = "weighted-sum: the paths from which the graph is built are left out, they need not be supported"
            return replace(stop.candidates.subset([]), notes=(*stop.candidates.notes, note))
        paths = supported_paths(
            query.graph,
            query.start,
            query.goals,
            divisions=self.divisions,
            weights=self.weights,
            budget=budget,
            progress=progress,
            executor=executor,
            free=query.free,
        )
        if not len(paths) and paths.status is Status.TIME_LIMIT and first is not None and first.trajectories:
            claim = f"weighted-sum: incomplete ({paths.status}): no weight was solved; {first.certificate}"
            return replace(first, status=paths.status, certificate=claim)
        stats: dict[str, Any] = {
            "objectives": [criterion.name for criterion in objectives.optimised],
            "ideal": (paths.ideal * query.quanta).tolist(),
            "nadir": (paths.nadir * query.quanta).tolist(),
            "weights_solved": paths.solved,
            "supported_points": len(paths),
        }
        found = assemble(
            "weighted-sum",
            query,
            paths,
            self._claim(paths.status.is_final, str(paths.status), query) + checked_edges_text(query, paths),
            provenance=[{"weights": rows.tolist()} for rows in paths.weights],
            notes=paths.notes,
            stats=stats,
        )
        return found if built.status.is_final else replace(found, status=built.status)

    def _claim(self, is_complete: bool, status: str, query: Query) -> str:
        """Return the certificate."""
        where = f"{query.part} for ({query.names})"
        if not is_complete:
            return f"incomplete ({status}): every point is supported on {where}, others are missing"
        if self.divisions is None and self.weights is None:
            return f"all extreme supported points of {where}, no unsupported ones; {OFF}; {ROUNDED}"
        return f"supported points only: optima of the weights asked for, on {where}; {OFF}; {ROUNDED}"
