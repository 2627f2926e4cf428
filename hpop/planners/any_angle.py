"""The any-angle planner: every optimal trade-off on the visibility roadmap of the lattice's corners, exactly."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.planners.base import planner
from hpop.planners.graphs.corners import CornersGraph
from hpop.planners.searches.exact import ExactSearch


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
