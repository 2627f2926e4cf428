"""Lattice planner and any-angle planner: exact multi-objective search on a grid, and on the corners of grid paths."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.planners.base import planner
from hpop.planners.graphs.corners import CornersGraph
from hpop.planners.graphs.lattice.family import LatticeGraph
from hpop.planners.searches.exact import ExactSearch


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
