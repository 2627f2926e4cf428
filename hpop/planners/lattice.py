"""Planners on a lattice, and on the corners of its paths, with all optimal trade-offs of these graphs."""

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

    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six; a time-mean is
    represented by its integral, and criteria with memory only filter what was found. Guarantees that no path of the
    lattice is better in one cost and no worse in the others, costs rounded to the criteria's quanta edge by edge;
    every float Pareto vector is covered within quantum times number of edges. A start or goal off the lattice is joined
    to all positions within 1.5 steps that the robot reaches by turning, going straight and turning
    (:mod:`.joined_ends`).

    With ``eps`` or ``tolerance`` every optimal cost vector p is covered by a returned one of at most
    (1 + eps) p + tolerance, which need not be optimal itself: far fewer points, and less work. A search that was
    stopped says how much better the points that it misses may be.

    A ``checkpoint`` is written at intervals, and when the search stops. Planning again with the same problem and file
    goes on from there, after Ctrl-C, a limit or kill -9, to the same front (:func:`hpop.search.pareto_paths`).
    Remove the file when the front is saved.

    With ``max_detour`` one time-mean is a cost itself, beside at most four others, and the front is exact among all
    walks, loops allowed, that keep the cap (:func:`hpop.search.capped_mean_paths`). It cannot be merged with fronts
    that use the integral instead. The search time grows steeply with the cap. A cap on the length (then a criterion,
    as turns are) does not bound the mean unless turns are bounded too: turning in place costs no length, so a path
    could spend unlimited time where the mean is low.

    Among moving people (:mod:`hpop.planners.graphs.timed`) costs and free paths depend on time, so motions last whole
    ticks of a clock, and the robot may hold at every position. The front is then exact on that clock, for people as
    predicted: no path with holds on the lattice is better in one cost and no worse in the others. The robot keeps
    ``margin`` from people, also if it is 0.2 s off the clock; if a prediction is uncertain, the probability that any
    person is nearer is at most 5 % at any moment. Planned costs are within their stated tolerance of the re-evaluated
    ones; the certificate says how far the plan is off the clock. ``max_detour`` needs a world without moving people.
    """

    def __post_init__(self) -> None:
        LatticeGraph.__post_init__(self)
        ExactSearch.__post_init__(self)


@planner("any-angle")
@dataclass(frozen=True)
class AnyAngle(ExactSearch, CornersGraph):
    """All non-dominated paths, at any angles, between the corners of the lattice's non-dominated paths.

    Becerra et al. 2020 (arXiv 2002.10696) leave angles other than multiples of 45 degrees open. Here the positions at
    which the lattice's non-dominated paths turn, and those at which they bend when pulled taut, with start and goal,
    become a roadmap: two are linked if the robot can go straight between them, as in a visibility graph (Lozano-Perez
    and Wesley 1979, doi 10.1145/359156.359164), and the exact search runs on it. The roadmap contains each lattice
    path, also pulled taut, and every recombination of them.

    Accepts the criteria of the lattice. Guarantees that no path of the roadmap is better in one cost and no worse in
    the others, costs rounded to the criteria's quanta edge by edge. So if all corners are used and start and goal are
    on the lattice, no lattice path is better by more than the rounding; otherwise a lattice path may turn by less than
    a degree on its way to the goal, which no roadmap does. Corners are positions of the lattice, so a smaller step
    still gives shorter paths. Has a state for each heading of each link, and a turn for each two headings of a
    position: time and memory grow with the square of the links.
    """

    def __post_init__(self) -> None:
        CornersGraph.__post_init__(self)
        ExactSearch.__post_init__(self)
