"""Planners on a lattice, and on the corners of its paths: every optimal trade-off of these graphs, exactly."""

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
    every float Pareto vector is covered within quantum times number of edges. A
    start or goal that is none of its states, in place or heading, is joined to all positions within 1.5 steps from
    which, or to which, the robot can turn, go straight and turn (:mod:`.joined_ends`).

    With ``eps`` or ``tolerance`` a cost vector p that is optimal is covered by a returned one of at most
    (1 + eps) p + tolerance, which need not be optimal itself: far fewer points, and less work. A search that was
    stopped says how much better the points that it misses may be.

    A ``checkpoint`` is written now and then, and when the search is stopped: the same question with the same file goes
    on from there, after Ctrl-C, a limit or kill -9, to the same front (:func:`hpop.search.pareto_paths`).
    Remove the file when the front is safe.

    With ``max_detour`` one time-mean is a cost itself, beside at most four others, and the front is exact among all
    walks, loops allowed, that keep the cap (:func:`hpop.search.capped_mean_paths`); it cannot be joined with
    fronts in which the integral stands in. The cost grows steeply with the cap. A cap on the length (a criterion then,
    as turns are) leaves the mean without a bound unless the turns have one: turning in place costs no length, so time
    without end could be spent where the mean is low.

    Among people who move (:mod:`hpop.planners.graphs.timed`) costs and free ways depend on when the robot is where, so
    motions last whole ticks of a clock, and the robot may hold at every position. The front is then exact on that
    clock, for people as they are predicted: no path and no holds of the lattice are better in one cost and no worse in
    the others. The robot keeps clear of them by ``margin``, also if it is 0.2 s off the clock; where a prediction is
    uncertain, nobody is nearer than that with more than 5 % at any moment. Planned costs are within their stated
    tolerance of the plan's own, which the certificate says how far it is off the clock. ``max_detour`` is for worlds
    where nobody moves.
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
    become a roadmap: two are linked wherever the robot can go straight, as in a visibility graph (Lozano-Perez and
    Wesley 1979, doi 10.1145/359156.359164), and the exact search runs on it. Each lattice path is a path of this
    roadmap, pulled taut too, and so is everything that recombines them.

    Accepts what the lattice accepts. Guarantees that no path of the roadmap is better in one cost and no worse in the
    others, costs rounded to the criteria's quanta edge by edge. So if all corners are taken and start and goal are on
    the lattice, nothing on the lattice is better by more than that; elsewhere the lattice's path may turn by less than
    a degree on its way to the goal, as no roadmap does. Corners are positions of the lattice, so a smaller step still
    gives shorter paths. Costs a state for each heading of each link, and a turn for each two headings of a position:
    the square of what it sees.
    """

    def __post_init__(self) -> None:
        CornersGraph.__post_init__(self)
        ExactSearch.__post_init__(self)
