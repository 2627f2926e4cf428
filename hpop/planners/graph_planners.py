"""Planners on graphs: lattice, any-angle, roadmap, and a weighted sum of costs for each vector of weights."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from hpop.base.randomness import MaybeRNG
from hpop.base.text import set_python_values, shown
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.planners.base import Candidates, planner
from hpop.planners.graphs.assemble import OFF, ROUNDED, assemble, checked_edges_text
from hpop.planners.graphs.corners import CornersGraph
from hpop.planners.graphs.family import GraphFamily, GraphSpec, NotBuilt, make_family
from hpop.planners.graphs.lattice import LatticeGraph
from hpop.planners.graphs.query import Query, built_query, refuse_unanswerable
from hpop.planners.graphs.roadmap import RoadmapGraph
from hpop.planners.objectives import edge_objectives
from hpop.planners.searches import QUICK, SHARE, ExactSearch
from hpop.planners.spending import Exhausted, Limits, Spending, stopped
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.search import supported_paths
from hpop.search.supported import checked_divisions, integer_weights

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


@planner("lattice")
@dataclass(frozen=True)
class Lattice(ExactSearch, LatticeGraph):
    """All non-dominated paths of an SE(2) lattice (Becerra et al. 2020), found by exact multi-objective search.

    Accepts at most six criteria that add up along edges or take the worst edge (sum, max). The integral replaces a
    time-mean. Criteria with memory are not minimised, only evaluated on the trajectories found.

    Guarantees that no path of the lattice is better in one cost and no worse in the others, with the cost of each edge
    rounded to the criterion's quantum. Without the rounding, every optimal cost vector is met within one quantum for
    each edge of the path. A start or goal that is no state of the lattice is connected to all positions within 1.5
    steps that the robot reaches by turning, going straight and turning (:mod:`.joined_ends`).

    With ``eps`` or ``tolerance``, the search returns fewer points and does less work. For every optimal cost vector p,
    a returned vector is at most (1 + eps) p + tolerance; it need not be optimal itself. If a search is stopped early,
    its certificate says how much better the missing points may be.

    A ``checkpoint`` is written at intervals, and when the search stops. After Ctrl-C, a limit or kill -9, plan the same
    problem with the same file again: the search continues there and reaches the same front
    (:func:`hpop.search.pareto_paths`). Remove the file when the front is saved.

    With ``max_detour``, one time-mean is itself a cost, beside at most four others. The front is exact among all walks
    within that limit, including walks with loops (:func:`hpop.search.capped_mean_paths`). It cannot be merged with
    fronts that use the integral instead. The search time grows steeply with the limit. A limit on the length needs
    ``max_turns`` too, with length and turns as criteria: turning in place adds no length, so a path could otherwise
    spend unlimited time where the mean is low.

    Among moving people (:mod:`hpop.planners.graphs.timed`), costs and collisions depend on time. Each motion then lasts
    a whole number of clock ticks, and the robot may wait at every position. If people move as predicted, the front is
    exact on that clock: no path with waits on the lattice is better in one cost and no worse in the others. The robot
    keeps the distance ``margin`` from people even if it is 0.2 s early or late. If a prediction is uncertain, the
    probability that any person comes nearer is at most 5 % at any moment. Planned and re-evaluated costs differ by no
    more than the stated tolerance, and the certificate gives the largest difference between planned times and the
    clock. ``max_detour`` needs a world without moving people.
    """

    def __post_init__(self) -> None:
        LatticeGraph.__post_init__(self)
        ExactSearch.__post_init__(self)


@planner("any-angle")
@dataclass(frozen=True)
class AnyAngle(ExactSearch, CornersGraph):
    """All non-dominated paths, at any angles, between the corners of the lattice's non-dominated paths.

    Becerra et al. 2020 (arXiv 2002.10696) leave angles other than multiples of 45 degrees for future work. This planner
    first searches the lattice. The corners of the non-dominated paths found there are the positions at which a path
    turns, and the positions at which it still bends when it is shortened like a taut string. Start, goal and corners
    become a roadmap, with a link wherever the robot can go straight, as in a visibility graph (Lozano-Perez and Wesley
    1979, doi 10.1145/359156.359164). The exact search then runs on this roadmap. The roadmap contains every lattice
    path of that front, its shortened version, and all their recombinations.

    Accepts the criteria of the lattice. Guarantees that no path of the roadmap is better in one cost and no worse in
    the others, with the cost of each edge rounded to the criterion's quantum. So if all corners are used and start and
    goal are on the lattice, no lattice path is better by more than the rounding. If corners are left out, a lattice
    path that turns there may be better. If start or goal is not on the lattice, a lattice path may be better because it
    makes a turn of less than a degree on the way to the goal, which no path of the roadmap does.

    Corners are positions of the lattice, so a smaller step still gives shorter paths. The roadmap has one state for
    each heading of each link, and one turn for each pair of headings at a position. So time and memory grow with the
    square of the number of links.
    """

    def __post_init__(self) -> None:
        CornersGraph.__post_init__(self)
        ExactSearch.__post_init__(self)


@planner("roadmap")
@dataclass(frozen=True)
class Roadmap(ExactSearch, RoadmapGraph):
    """All non-dominated paths of a probabilistic roadmap (Kavraki et al. 1996), found by exact multi-objective search.

    The model decides which of two kinds of roadmap is built:

    - For a robot with states x, y and yaw that turns in place and moves straight, samples are positions and links are
      straight moves without a collision. The robot turns in place from one link to the next if there is room. Headings
      that differ by less than a degree count as one (:mod:`.headings`).
    - For any other model, and for a goal that is not a list of states, samples are configurations, and links are the
      chains of motions by which the model connects them (:meth:`hpop.motions.Model.connect`). The model's space
      defines which configurations are nearest (:mod:`.configurations`).

    Start and goal are exact, with any headings, and are linked to each other as well.

    Default options differ between robots in the plane (models that provide ``plane``) and others. In the plane, uniform
    samples suffice, and checking all edges in advance is faster than searching several times. In other spaces, such as
    the joints of an arm, few uniform samples lie on useful paths, paths along nearest samples have many stops, and
    collision checks take most of the time. There the roadmap adds guides (configurations along quickly found paths) and
    long links, and an edge is checked only when a path of a front uses it (:mod:`hpop.search.lazy_paths`).

    Accepts at most six criteria that add up along edges or take the worst edge (sum, max). The integral replaces a
    time-mean. Criteria with memory are not minimised, only evaluated on the trajectories found. Guarantees that no path
    of this roadmap, which its options and seed determine, is better in one cost and no worse in the others, with the
    cost of each edge rounded to the criterion's quantum. Links follow the rule of k-nearest PRM*: with more samples,
    the shortest path of the roadmap approaches the shortest path of all (Karaman and Frazzoli 2011, doi
    10.1177/0278364911406761). The planner states no bound on the difference.

    Among moving people, a roadmap of positions has a clock, as the lattice has
    (:class:`hpop.planners.graph_planners.Lattice`), and the robot can wait at positions.

    A roadmap of positions has one state for each heading of each link, and one turn for each pair of headings at a
    position. For a robot that is not round and has little room, each turn needs its own collision check; this takes
    most of the time.
    """

    def __post_init__(self, rng: MaybeRNG) -> None:
        RoadmapGraph.__post_init__(self, rng)
        ExactSearch.__post_init__(self)


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
                "step, headings and corner_cutting are options of the default lattice, which `on` replaces: give these "
                'options or `on`, not both. Options of the graph belong inside `on`, such as {"lattice": {"step": 0.5}}'
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
