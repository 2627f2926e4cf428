"""Roadmap planner: exact multi-objective search on a probabilistic roadmap."""

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
    (:class:`hpop.planners.lattice.Lattice`), and the robot can wait at positions.

    A roadmap of positions has one state for each heading of each link, and one turn for each pair of headings at a
    position. For a robot that is not round and has little room, each turn needs its own collision check; this takes
    most of the time.
    """

    def __post_init__(self, rng: MaybeRNG) -> None:
        RoadmapGraph.__post_init__(self, rng)
        ExactSearch.__post_init__(self)
