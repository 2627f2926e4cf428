"""The lattice: its graph family, and the planner that searches it exactly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np

from hpop.errors import OptionError
from hpop.options import LEAST, MOST, set_reals, truth
from hpop.planners.base import planner
from hpop.planners.goals import start_of
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends, with_ends
from hpop.planners.lattice.graph import StateLattice
from hpop.planners.lattice.grid import Headings
from hpop.planners.needs import in_plane
from hpop.planners.objectives import Objectives
from hpop.planners.searches.exact import ExactSearch
from hpop.planners.spending import Spending
from hpop.planners.timed.asked import people_move
from hpop.scalars import set_python_values
from hpop.status import ProgressCallback
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.problem import Problem

MOST_FIRST = 5_000  # positions of the first stage: their edges are built in a fifth of a second
LARGE = 2  # times as many: a smaller lattice is built as a whole almost as soon as a part of it, and then a second time
MOST_IN_TIME = 400  # positions of the first stage among people who move: what they cost by the tick is soon known
ANCHORS = ("start", "world")


@graph_family("lattice")
@dataclass(frozen=True)
class LatticeGraph(GraphFamily):
    """The SE(2) lattice of a robot in the plane: grid positions, headings, steps and motions in place.

    step            m      between neighbouring positions
    headings        4, 8 or 16
    corner_cutting  whether a diagonal may pass between two blocked positions
    anchor          "start": the start is one of the positions; "world": the corner of the map with the least x and y
                    is, so that queries with other starts find the same lattice

    A start or goal that is none of its states, in place or heading, is joined to all positions within 1.5 steps from
    which, or to which, the robot can turn, go straight and turn (:mod:`hpop.planners.graphs.joined_ends`). Of a lattice
    of more than 10,000 positions a part comes first: 5,000 positions on the shortest ways, 400 where people move.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move"})
    goal_sets: ClassVar[bool] = True
    is_judged: ClassVar[bool] = False

    step: float = 0.25
    headings: int = 8
    corner_cutting: bool = False
    anchor: Literal["start", "world"] = "start"

    def __post_init__(self) -> None:
        set_python_values(self)
        set_reals(self, "step", least=LEAST, most=MOST, kind="a positive length in m")
        truth("corner_cutting", self.corner_cutting)
        Headings(self.headings)
        if not isinstance(self.anchor, str) or self.anchor not in ANCHORS:
            raise OptionError(f"anchor must be one of {', '.join(ANCHORS)}, got {shown(self.anchor)}")

    def build(
        self, problem: Problem, objectives: Objectives, spending: Spending, progress: ProgressCallback | None = None
    ) -> BuiltGraph:
        """Lay out the lattice and join start and goal to it."""
        lattice = self.lattice(problem, spending)
        return self._built(lattice, problem)

    def graphs(
        self,
        problem: Problem,
        objectives: Objectives,
        spending: Spending,
        progress: ProgressCallback | None = None,
        *,
        in_stages: bool = False,
    ) -> Iterator[BuiltGraph]:
        """Yield the part of a large lattice round the shortest ways, if it is wanted, then the whole lattice."""
        lattice, moving = self.lattice(problem, spending), people_move(problem)
        if in_stages and (moving or not lattice.costed(objectives.optimised)):
            part = self._part(lattice, problem, MOST_IN_TIME if moving else MOST_FIRST)
            if part is not None:
                yield replace(self._built(part, problem), part="shortest ways", is_large=True)
        yield self._built(lattice, problem)

    def _built(self, lattice: StateLattice, problem: Problem) -> BuiltGraph:
        return BuiltGraph(self.ends(lattice, problem), problem, is_large=lattice.cells[0].size > LARGE * MOST_FIRST)

    def has_clock(self, problem: Problem) -> bool:
        """Return True: a lattice can be put on a clock."""
        return True

    def anchored(self) -> Self:
        """Return the lattice whose positions do not depend on the start."""
        return replace(self, anchor="world")

    def states(self, problem: Problem) -> StateLattice:
        """Return the lattice without the problem's ends."""
        return self.lattice(problem)

    def lattice(self, problem: Problem, spending: Spending | None = None) -> StateLattice:
        """Return the lattice of a problem; building it may spend what is in the spending."""
        return StateLattice(
            in_plane(problem.model),
            problem.world,
            start_of(problem)[:2] if self.anchor == "start" else problem.world.bounds[:2],
            float(self.step),
            Headings(self.headings),
            self.corner_cutting,
            anchored_at=self.anchor,
            spending=spending or Spending(),
        )

    def ends(self, lattice: StateLattice, problem: Problem) -> Ends:
        """Return the lattice with the problem's start and goal, joined to it where they are none of its states.

        Raises QueryError where one of them is blocked or out of reach.
        """
        return with_ends(lattice, problem, lattice.reach(problem))

    def _part(self, lattice: StateLattice, problem: Problem, most: int) -> StateLattice | None:
        """Positions of a large lattice on the shortest ways; None of a small one, or if there is no way."""
        if lattice.cells[0].size <= LARGE * most:
            return None
        from hpop.planners.lattice.nearby import nearby  # numba: on first use

        starts, goals = self.ends(lattice, problem).inside
        if not (starts and goals):
            return None
        at = lattice.places(np.array([starts[0], goals[0]]))
        begin, end = zip(*(axis[at].tolist() for axis in lattice.cells), strict=True)
        kept = nearby(lattice.number >= 0, begin, end, most, corner_cutting=lattice.corner_cutting)
        return None if kept is None else replace(lattice, kept=kept)


@planner("lattice")
@dataclass(frozen=True)
class Lattice(ExactSearch, LatticeGraph):
    """All non-dominated paths of an SE(2) lattice (Becerra et al. 2020), found by exact multi-objective search.

    step            m      between neighbouring positions
    headings        4, 8 or 16
    corner_cutting  whether a diagonal may pass between two blocked positions
    anchor          "start": the start is one of the positions; "world": the corner of the map with the least x and y
                    is, so that queries with other starts find the same lattice
    max_detour      longest duration over the least of any path, or ``{"length": 1.3}``: longest length over the least,
                    which needs max_turns as well; a time-mean is then optimised itself
    max_turns       count  paths with more turns are left out; needs the criterion turns
    eps             every optimal cost vector is covered within a factor 1 + eps; 0 finds them all
    tolerance       or within these amounts, by the name of a cost: ``{"length": 0.1}``
    time_limit      s      to read the map, build the lattice and search, not to compile; what is found until then is
                           returned and called incomplete
    max_labels      count  partial paths kept by the search
    max_memory      bytes  of the map that is read, the fields that are made, the lattice's graph and the search
    checkpoint      file in which the search keeps its state, and from which it goes on if it is there
    clock           s  of a tick, where people move; None: 1/20. Where nobody does there is no clock
    hold            s  that the robot stands at least when it waits for people who move; None: it never waits
    arrive_by       s  at the latest, among people who move; None: whenever
    margin          m  to be kept from people, those who stand as well

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

    Among people who move (:mod:`hpop.planners.timed`) costs and free ways depend on when the robot is where, so motions
    last whole ticks of a clock, and the robot may hold at every position. The front is then exact on that clock, for
    people as they are predicted: no path and no holds of the lattice are better in one cost and no worse in the others.
    The robot keeps clear of them by ``margin``, also if it is 0.2 s off the clock; where a prediction is uncertain,
    nobody is nearer than that with more than 5 % at any moment. Planned costs are within their stated tolerance of the
    plan's own, which the certificate says how far it is off the clock. ``max_detour`` is for worlds where nobody moves.
    """

    def __post_init__(self) -> None:
        LatticeGraph.__post_init__(self)
        ExactSearch.__post_init__(self)
