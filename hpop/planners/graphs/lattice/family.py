"""The lattice's graph family, and its lattice in a world that has changed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np

from hpop.base.arrays import BoolArray, IntArray, copied
from hpop.base.options import LEAST, MOST, set_reals, truth
from hpop.base.scalars import set_python_values
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import OptionError
from hpop.motions import lacking
from hpop.planners.graphs.arcs import Arcs
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends, with_ends
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.lattice.grid import Headings
from hpop.planners.needs import in_plane, people_move, start_of
from hpop.planners.objectives import Objectives, quantised
from hpop.planners.spending import Spending
from hpop.world import World

if TYPE_CHECKING:
    from hpop.motions import Model
    from hpop.problems.problem import Problem

TURNED = 1.1  # of a robot's reach: turns are checked by slightly larger hulls
SLACK = 1e-3  # m
TRIED = 512  # sample of arcs that shows which attributes of a world a criterion reads
OF_GROUND = frozenset({"obstruction", "obstruction_field"})  # methods of a world that depend on its ground alone


def update(before: StateLattice, after: World, criteria: Sequence[Criterion]) -> StateLattice:
    """Return a lattice in a changed world, and cache there the parts that the change leaves unchanged.

    States and arcs are checked again where the change may reach them. Costs are computed again for those arcs, and for
    all arcs by criteria that read a changed attribute of the world. All other values are copied, so the result equals a
    lattice that is built from scratch. Nothing is copied if nothing was cached or the extent of the map has changed.
    """
    lattice = replace(before, world=after)
    cached = {name: before.kept_part(name) for name in ("clear", "free", "arcs")}
    if before.key is None or cached["arcs"] is None or before.world.bounds != after.bounds:
        return lattice
    within = TURNED * max(part.reach for part in before.model.platform) + _longest(before) + SLACK
    near = _near(before, lattice, within)
    part = replace(lattice, kept=_near(before, lattice, within + _longest(before) + SLACK))
    lattice.keep_part("clear", _frozen(np.where(near, part.clear, before.clear)))
    if cached["free"] is not None:
        lattice.keep_part("free", _frozen(np.where(near[:, :, None], part.free, before.free)))
    arcs, taken = _joined(before, part, lattice, near)
    lattice.keep_part("arcs", arcs)
    lattice.keep_part("rechecked", int(arcs.heads.size - taken.size))
    away = ~near[lattice.cells][_tails(arcs) // lattice.width]
    for criterion in criteria:
        name = lattice.name_of(criterion)
        counts = None if name is None else before.kept_part(name)
        if counts is not None and not _reads_change(criterion, lattice, before.world):
            column = np.zeros(arcs.heads.size, np.int64)
            column[away] = counts[taken]
            for rows, motions in lattice.motions_of(np.flatnonzero(~away)):
                column[rows] = quantised(motion_costs(criterion, motions), criterion)
            lattice.keep_part(name, _frozen(column.astype(np.min_scalar_type(int(column.max(initial=0))))))
    return lattice


def _longest(lattice: StateLattice) -> float:
    """Return the length, m, of the longest step."""
    return lattice.step * max(math.hypot(*step) for step in lattice.headings.steps)


def _near(before: StateLattice, after: StateLattice, within: float) -> BoolArray:
    """Mark positions (rows, columns) where the world differs from the one before within a distance, m."""
    rows, columns = (index.ravel() for index in np.indices(before.shape))
    x, y = before.position(rows, columns)
    return after.collision.differs(before.collision, x, y, within).reshape(before.shape)


def _joined(before: StateLattice, part: StateLattice, lattice: StateLattice, near: BoolArray) -> tuple[Arcs, IntArray]:
    """Return the arcs after a change, joined from a part near it and the old arcs elsewhere, with their old indices."""
    old = ~near[before.cells][_tails(before.arcs) // before.width]
    new = near[part.cells][_tails(part.arcs) // part.width]
    sources = [(before, np.flatnonzero(old)), (part, np.flatnonzero(new))]
    tails = np.concatenate([_renumbered(of, lattice, _tails(of.arcs)[places]) for of, places in sources])
    heads = np.concatenate([_renumbered(of, lattice, of.arcs.heads[places].astype(np.int64)) for of, places in sources])
    kinds = np.concatenate([of.arcs.kinds[places] for of, places in sources])
    order = np.argsort(tails, kind="stable")
    start = np.zeros(lattice.size + 1, np.int64)
    np.cumsum(np.bincount(tails, minlength=lattice.size), out=start[1:])
    return Arcs(start, heads[order].astype(np.int32), kinds[order]).frozen(), sources[0][1]


def _tails(arcs: Arcs) -> IntArray:
    return np.repeat(np.arange(arcs.start.size - 1), np.diff(arcs.start))


def _renumbered(of: StateLattice, lattice: StateLattice, ids: IntArray) -> IntArray:
    """Return the ids in a lattice of states (N,) of another one with the same grid."""
    place, station = np.divmod(ids, of.width)
    return np.asarray(lattice.number[of.cells][place] * lattice.width + station)


def _frozen(array: Any) -> Any:
    array.setflags(write=False)
    return array


# Attributes of a world that a criterion reads


class _WatchedWorld(World):
    """A stand-in for a world that records which attributes are read."""

    def __getattribute__(self, name: str) -> Any:
        """Record the attribute, and return the world's."""
        own = object.__getattribute__(self, "__dict__")
        if name.startswith("__") or "watched" not in own:
            return object.__getattribute__(self, name)
        own["reads"].add(name)
        return getattr(own["watched"], name)


def _reads_change(criterion: Criterion, lattice: StateLattice, before: World) -> bool:
    """Return whether a criterion may read an attribute of a lattice's world that has changed.

    A sample of arcs shows the attributes that hpop's own criteria read. A user's criterion may read more on other arcs,
    so its costs are always computed again.
    """
    after, reads = lattice.world, set[str]()
    if not type(criterion).__module__.startswith("hpop.") or lacking(criterion.requires, lattice.model, after):
        return True
    watched = copied(after.stand_in(_WatchedWorld), watched=after, reads=reads)
    size = lattice.arcs.heads.size
    tried = np.unique(np.linspace(0, size - 1, min(size, TRIED)).astype(np.int64))
    try:
        for _, motions in lattice.motions_of(tried):
            motion_costs(criterion, replace(motions, world=watched))
    except Exception:  # a plugin's criterion may use the world in a way that the stand-in does not support
        return True
    return any(_differs(name, before, after) for name in reads - {"contents"})


def _differs(name: str, before: World, after: World) -> bool:
    """Return whether an attribute of two worlds differs; most methods count as different."""
    if name in OF_GROUND:
        return before.ground is not after.ground
    return bool(getattr(before, name) != getattr(after, name))


MOST_FIRST = 5_000  # positions of the first stage, with edges built in a fifth of a second
LARGE = 2  # multiple of these from which on a part is built first; building all of a smaller lattice is as fast
MOST_IN_TIME = 400  # positions of the first stage among moving people, where tables of costs by tick take time
ANCHORS = ("start", "world")


@graph_family("lattice")
@dataclass(frozen=True)
class LatticeGraph(GraphFamily):
    """The SE(2) lattice of a robot in the plane: grid positions, headings, steps and motions in place.

    step            m      between neighbouring positions
    headings        4, 8 or 16
    corner_cutting  whether a diagonal may pass between two blocked positions
    anchor          position of the grid: the start ("start"), or the corner of the map with the least x and y
                    ("world"), so that queries with other starts reuse the lattice

    A start or goal beside its states is joined to all positions within 1.5 steps to which the robot can turn, go
    straight and turn (:mod:`hpop.planners.graphs.joined_ends`). Of a lattice of more than 10,000 positions a part is
    searched first: 5,000 positions on the shortest paths, 400 where people move.
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
        """Lay out the lattice and join start and goal to it."""
        lattice = self.lattice(problem, spending)
        return self._built(lattice, problem)

    def graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the whole lattice; ``in_stages``: the part of a large lattice round the shortest paths before."""
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
        """Return the lattice anchored at the world, which does not depend on the start."""
        return replace(self, anchor="world")

    def states(self, problem: Problem) -> StateLattice:
        """Return the lattice without the problem's ends."""
        return self.lattice(problem)

    def lattice(self, problem: Problem, spending: Spending | None = None) -> StateLattice:
        """Return the lattice of a problem, to be built within the limits of ``spending``."""
        anchor = start_of(problem)[:2] if self.anchor == "start" else problem.world.bounds[:2]
        return self._lattice(problem.model, problem.world, anchor, spending)

    def update(self, before: World, after: World, model: Model, criteria: Sequence[Criterion]) -> None:
        """Let a changed world reuse the unchanged parts of a lattice that is anchored at the world."""
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
        """Return the lattice with the problem's start and goal, joined to it where they are beside its states.

        Raises QueryError where one of them is blocked or out of reach.
        """
        return with_ends(lattice, problem, lattice.reach(problem))

    def _part(self, lattice: StateLattice, problem: Problem, most: int) -> StateLattice | None:
        """Return the part of a large lattice on the shortest paths; None for a small one, or if there is no path."""
        if lattice.cells[0].size <= LARGE * most:
            return None
        from hpop.planners.graphs.lattice.nearby import nearby  # numba: on first use

        starts, goals = self.ends(lattice, problem).inside
        if not (starts and goals):
            return None
        at = lattice.places(np.array([starts[0], goals[0]]))
        begin, end = zip(*(axis[at].tolist() for axis in lattice.cells), strict=True)
        kept = nearby(lattice.number >= 0, begin, end, most, corner_cutting=lattice.corner_cutting)
        return None if kept is None else replace(lattice, kept=kept)
