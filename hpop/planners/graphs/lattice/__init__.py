"""SE(2) lattice, a graph family: positions on a grid with headings, connected by steps and motions in place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np

from hpop.base.options import LEAST, MOST, set_reals, truth
from hpop.base.text import set_python_values, shown
from hpop.criteria.base import Criterion
from hpop.errors import OptionError
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends, with_ends
from hpop.planners.graphs.lattice.changes import update
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.lattice.grid import Headings
from hpop.planners.needs import in_plane, people_move, start_of
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Spending
from hpop.world import World

if TYPE_CHECKING:
    from hpop.motions import Model
    from hpop.problems.problem import Problem

MOST_FIRST = 5_000  # positions in the part of a lattice that is searched first; its edges take a fifth of a second
LARGE = 2  # a part is built first only if the lattice has more than this multiple of the part's positions
MOST_IN_TIME = 400  # positions in that part among moving people, where costs for each time step take longer
ANCHORS = ("start", "world")


@graph_family("lattice")
@dataclass(frozen=True)
class LatticeGraph(GraphFamily):
    """SE(2) lattice of a robot in the plane: positions on a grid with headings, connected by steps and turns.

    step            m  distance between neighbouring positions
    headings        number of headings: 4, 8 or 16
    corner_cutting  whether a diagonal move may pass blocked positions beside it
    anchor          a position of the grid: the start ("start"), or the corner of the map with the least x and y
                    ("world"), so that queries with other starts reuse the lattice

    A start or goal that is no state of the lattice is connected to all positions within 1.5 steps that the robot
    reaches by turning, going straight and turning (:mod:`hpop.planners.graphs.joined_ends`). In a large lattice, a part
    is searched first: the 5,000 positions on the shortest paths, if there are more than 10,000 positions; among moving
    people, 400 positions, if there are more than 800.
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

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Return the lattice with start and goals connected to it."""
        lattice = self.lattice(problem, spending)
        return self._built(lattice, problem)

    def graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the whole lattice; before it, if ``in_stages`` and it is large, the part near the shortest paths.

        Without moving people, this part is left out if the costs of the whole lattice are cached.
        """
        lattice, moving = self.lattice(problem, spending), people_move(problem)
        if in_stages and (moving or not lattice.costed(objectives.optimised)):
            part = self._part(lattice, problem, MOST_IN_TIME if moving else MOST_FIRST)
            if part is not None:
                yield replace(self._built(part, problem), part="shortest paths", is_large=True)
        yield self._built(lattice, problem)

    def _built(self, lattice: StateLattice, problem: Problem) -> BuiltGraph:
        return BuiltGraph(self.ends(lattice, problem), problem, is_large=lattice.cells[0].size > LARGE * MOST_FIRST)

    def has_clock(self, problem: Problem) -> bool:
        """Return True: a lattice can be searched in time steps, since the robot can wait at its positions."""
        return True

    def anchored(self) -> Self:
        """Return a copy whose grid begins at the corner of the map, so that the lattice is equal for all starts."""
        return replace(self, anchor="world")

    def states(self, problem: Problem) -> StateLattice:
        """Return the lattice without the problem's start and goals."""
        return self.lattice(problem)

    def lattice(self, problem: Problem, spending: Spending | None = None) -> StateLattice:
        """Return the lattice of a problem, without start and goals, to be built within the limits of ``spending``."""
        anchor = start_of(problem)[:2] if self.anchor == "start" else problem.world.bounds[:2]
        return self._lattice(problem.model, problem.world, anchor, spending)

    def update(self, before: World, after: World, model: Model, criteria: Sequence[Criterion]) -> None:
        """After the world changed, copy what is still valid of the cached lattice to the new world's cache.

        Does nothing if the lattice depends on the start.
        """
        if self.anchor == "world":
            update(self._lattice(model, before, before.bounds[:2]), after, criteria)

    def _lattice(
        self, model: Model, world: World, anchor: tuple[float, float], spending: Spending | None = None
    ) -> StateLattice:
        return StateLattice(
            in_plane(model),
            world,
            anchor,
            float(self.step),
            Headings(self.headings),
            self.corner_cutting,
            anchored_at=self.anchor,
            spending=spending or Spending(),
        )

    def ends(self, lattice: StateLattice, problem: Problem) -> Ends:
        """Return the lattice with the problem's start and goals, connected to it if they are no states of it.

        Raises QueryError if the start, or every goal, is blocked or cannot be connected.
        """
        return with_ends(lattice, problem, lattice.reach(problem))

    def _part(self, lattice: StateLattice, problem: Problem, most: int) -> StateLattice | None:
        """Return the part of a lattice that has the ``most`` positions nearest to the shortest paths.

        None if the lattice has at most LARGE times ``most`` positions, or if no path leads to the first goal.
        """
        if lattice.cells[0].size <= LARGE * most:
            return None
        from hpop.planners.graphs.lattice.loops import cells_near_shortest_paths  # numba: on first use

        starts, goals = self.ends(lattice, problem).inside
        if not (starts and goals):
            return None
        at = lattice.places(np.array([starts[0], goals[0]]))
        begin, end = zip(*(axis[at].tolist() for axis in lattice.cells), strict=True)
        kept = cells_near_shortest_paths(lattice.number >= 0, begin, end, most, corner_cutting=lattice.corner_cutting)
        return None if kept is None else replace(lattice, kept=kept)
