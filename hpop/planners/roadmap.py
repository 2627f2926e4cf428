"""The roadmap planner: all optimal trade-offs on a probabilistic roadmap."""

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

    For a robot with states x, y and yaw that turns and moves, samples are positions and links are straight moves, free
    on the exact geometry. The robot turns in place between two links if there is room and their headings differ by at
    least a degree, the least that counts as a turn (:mod:`.headings`). For any other model, and for a goal that is no
    list of states, samples are configurations and links are the chains of motions by which the model connects them
    (:meth:`hpop.motions.Model.connect`); the model's space defines the nearest ones (:mod:`.configurations`). Start and
    goal are exact, whatever their headings, and linked to each other as well.

    Defaults depend on whether the model provides ``plane``. In the plane, uniform samples find paths, and checking all
    edges in advance is faster than several searches. In other spaces, such as the joints of an arm, hardly any uniform
    sample lies on a path, links to nearest samples alone give paths of many stops, and checking edges takes most of the
    time. There the roadmap adds guides and far links, and edges are checked only when a path on a front uses them
    (:mod:`hpop.search.lazy_paths`).

    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six; a time-mean is
    represented by its integral, and criteria with memory only filter what was found. Guarantees that no path of this
    roadmap (its options up to the seed) is better in one cost and no worse in the others, costs rounded to the
    criteria's quanta edge by edge. With the rule of k-nearest PRM* the shortest path tends to the shortest of all as
    samples grow (Karaman and Frazzoli 2011, doi 10.1177/0278364911406761); the planner does not bound the distance.
    Among moving people, a roadmap of positions has a clock, as the lattice has
    (:class:`hpop.planners.lattice.Lattice`), and the robot holds at positions. A roadmap of positions has a state for
    each heading of each link, and a turn for each two headings of a position. If a robot that is not round has little
    room, each of these turns is checked by itself, which takes most of the time.
    """

    def __post_init__(self, rng: MaybeRNG) -> None:
        RoadmapGraph.__post_init__(self, rng)
        ExactSearch.__post_init__(self)
