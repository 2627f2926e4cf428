"""The roadmap planner: every optimal trade-off on a probabilistic roadmap, exactly."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.randomness import MaybeRNG
from hpop.planners.base import planner
from hpop.planners.graphs.roadmap.family import RoadmapGraph
from hpop.planners.searches.exact import ExactSearch


@planner("roadmap")
@dataclass(frozen=True)
class Roadmap(ExactSearch, RoadmapGraph):
    """All non-dominated paths of a probabilistic roadmap (Kavraki et al. 1996), found by exact multi-objective search.

    Of a robot that turns and moves and has no states but x, y and yaw, samples are positions, and links straight moves,
    free on the exact geometry; the robot turns in place between any two of them, where it has the room and they differ
    by a degree, the least that counts as a turn (:mod:`.headings`). Of any other model, and to a goal that is no list
    of states, samples are configurations, and links the chains of motions by which the model connects them
    (:meth:`hpop.motions.Model.connect`); near is what its space calls so (:mod:`.configurations`). Start and goal are
    exact, whatever their headings, and linked to each other as well.

    What is chosen by itself depends on whether the model is one of the ``plane``. There uniform samples find ways, and
    to check all edges before takes less than to search several times. Beyond it, as with the joints of an arm, next to
    no uniform sample lies where a way is, the nearest ones alone make ways of many stops, and to check an edge takes
    most time: so there are guides and far links, and edges are checked only where a path on a front takes them
    (:mod:`hpop.search.lazy_paths`).

    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six; a time-mean is
    represented by its integral, and criteria with memory only filter what was found. Guarantees that no path of this
    roadmap (its options up to the seed) is better in one cost and no worse in the others, costs rounded to the
    criteria's quanta edge by edge. With the rule of k-nearest PRM* the shortest path tends to the shortest of all as
    samples grow (Karaman and Frazzoli 2011, doi 10.1177/0278364911406761); how far it still is, this planner does not
    say. Among people who move, a roadmap of positions has a clock, as the lattice has
    (:class:`hpop.planners.lattice.Lattice`), and the robot holds at positions. Positions cost a state for each heading
    of each link, and a turn for each two headings of a position; where a robot that is not round has little room, each
    of these turns is checked by itself, which takes most of the time.
    """

    def __post_init__(self, rng: MaybeRNG) -> None:
        RoadmapGraph.__post_init__(self, rng)
        ExactSearch.__post_init__(self)
