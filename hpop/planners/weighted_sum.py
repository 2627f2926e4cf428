"""Weighted-sum planner: for each vector of weights, the path of a graph with the smallest weighted sum of costs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from hpop.base.text import set_python_values, shown
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
    """Return the option ``weights`` as tuples of floats, or None if it is not set.

    Raises OptionError for invalid weights, and if both ``divisions`` and ``weights`` are set.
    """
    if divisions is not None:
        divisions = checked_divisions(divisions)
    if weights is None:
        return None
    if divisions is not None:
        raise OptionError(
            f"give either divisions or weights, not both; got divisions {shown(divisions)} and weights {shown(weights)}"
        )
    if not isinstance(weights, list | tuple) or not weights:
        raise OptionError(
            f"weights must be a list of weight vectors, each with one number for each cost, got {shown(weights)}"
        )
    for row in weights:
        integer_weights(row)
    return tuple(tuple(float(w) for w in row) for row in weights)


def check_count(weights: Weights | None, criteria: Sequence[Criterion]) -> None:
    """Raise OptionError if a weight vector does not have exactly one weight for each criterion."""
    for row in weights or ():
        if len(row) != len(criteria):
            names = ", ".join(criterion.name for criterion in criteria)
            raise OptionError(
                f"each vector in weights must have {len(criteria)} numbers, for {names} in this order; got "
                f"{len(row)} numbers: {list(row)}"
            )


@planner("weighted-sum")
@dataclass(frozen=True)
class WeightedSum:
    """Supported paths of an SE(2) lattice, or of another graph: exact minima of weighted sums of the costs.

    step            m  distance between neighbouring positions
    headings        number of headings: 4, 8 or 16
    corner_cutting  whether a diagonal move may pass blocked positions beside it
    divisions       makes the vectors of weights: all those of multiples of 1 / divisions that add up to 1
    weights         vectors of weights, each with one number for each cost, in the order of the criteria (none for
                    criteria with memory). Without divisions and weights, weights are chosen adaptively
    time_limit      s  for reading the map, building the graph and searching, without compiling. When it ends, the paths
                    found are returned, and the status says that more may exist
    on              a graph family that replaces the lattice: ``{"roadmap": {"samples": 300}}``

    A path is supported if, for some positive weights, no other path has a smaller weighted sum. Before weighting, each
    cost is normalised: its smallest value over all paths (ideal) becomes 0, and its largest value among the paths that
    minimise one cost (nadir) becomes 1. Ideal and nadir are in the stats, and the provenance of each trajectory has its
    weights. If weights of zero leave a tie, the first criterion decides, then the second, and so on, so every path is
    non-dominated.

    Accepts at most six criteria that add up along edges (sum). The integral replaces a time-mean. Criteria with memory
    are not minimised, only evaluated on the trajectories found. Guarantees that no returned vector is unsupported, and
    that a complete adaptive run finds every extreme supported cost vector of the graph. The graph, the rounding of its
    costs and the models are those of the planner "lattice", or of the family in ``on``, with the same options. Optimal
    points in a non-convex part of the front are missed. Each weight vector takes one A* search: see
    :func:`hpop.search.supported_paths`.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move"})
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = False
    tours: ClassVar[bool] = True
    speeds: ClassVar[bool] = True

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
        """Return the time limit, which reading the map, building the graph and searching share, as a budget."""
        return Budget(self.time_limit)

    def anchored(self) -> WeightedSum:
        """Return a copy of the planner whose graph does not depend on the start, if the graph family has such a graph.

        Several queries can then share the graph.
        """
        return WeightedSum(
            divisions=self.divisions, weights=self.weights, time_limit=self.time_limit, on=self.family.anchored().spec
        )

    @cached_property
    def family(self) -> GraphFamily:
        """Graph family that is searched: the lattice with the planner's options, or the family of ``on``."""
        lattice = LatticeGraph(self.step, self.headings, self.corner_cutting)
        if self.on is None:
            return lattice
        if lattice != LatticeGraph():
            raise OptionError(
                "step, headings and corner_cutting are options of the lattice, which `on` replaces; leave `on` out, or "
                "give only the options of the graph family inside `on`"
            )
        return make_family(self.on)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Find the path with the smallest weighted sum for each weight vector; return all these paths as candidates.

        With an executor, its workers solve the weight vectors in parallel. Raises the errors of :meth:`Lattice.solve`,
        UnsupportedCriterion also for a criterion that takes the worst edge (max), and OptionError for weight vectors
        that do not have one weight for each cost.
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
                query.hold_copies()
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
            note = (
                "weighted-sum: the graph was not built; the paths from which it was to be built are left out, since "
                "they need not be supported"
            )
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
        """Return the certificate: which supported points of the graph the result contains.

        is_complete  whether the search ended without reaching a limit; otherwise ``status`` says why it stopped
        """
        where = f"{query.part} for ({query.names})"
        if not is_complete:
            return f"incomplete ({status}): every point is supported on {where}, others are missing"
        if self.divisions is None and self.weights is None:
            return f"all extreme supported points of {where}, no unsupported ones; {OFF}; {ROUNDED}"
        return f"supported points only: optima of the weights asked for, on {where}; {OFF}; {ROUNDED}"
