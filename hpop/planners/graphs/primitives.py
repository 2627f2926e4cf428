"""Graph family "primitives": a lattice of a car-like base, whose arcs are motion primitives made of clothoids."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, distinct
from hpop.base.options import LEAST, MOST, set_reals
from hpop.base.text import set_python_values
from hpop.errors import OptionError
from hpop.models.ackermann.model import Ackermann
from hpop.models.ackermann.primitives import HEADING_ANGLES, HEADINGS, LEGS, Primitives, primitives
from hpop.motions import Motions, States
from hpop.planners.graphs.arcs import Arcs, MotionChains, blocks
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.lattice.arcs import RecordedMotions
from hpop.planners.graphs.primitive_runs import PrimitiveRuns
from hpop.planners.graphs.roadmap.configurations import PIECES, ConfigurationRoadmap
from hpop.planners.graphs.roadmap.links import START
from hpop.planners.graphs.roadmap.survey import concatenated_states, survey
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.criteria.base import Criterion
    from hpop.models.collision.planar import PlanarCollision
    from hpop.problems.problem import Problem

REACH = 6.0  # steps: distance within which lattice states are linked to a goal
MOST_STATES = 4_000_000
COARSE = 1.5  # times the smallest step: longer steps are remarked on
ROOM = 1e-6  # m beside a primitive in open space, more than any rounding


@dataclass(frozen=True, eq=False)
class PrimitiveLattice(ConfigurationRoadmap):
    """Lattice of a car-like base: the start, free states on the grid, then the goals.

    cells       (n, 3)  of the start and of the grid states: column and row, counted from the start, and number of the
                heading (:data:`hpop.models.ackermann.primitives.HEADING_ANGLES`)
    step        m, distance between neighbouring positions
    turned_by   rad, angle by which the grid is turned against the map
    """

    cells: IntArray = field(kw_only=True)
    step: float = field(kw_only=True)
    turned_by: float = field(kw_only=True)

    kinds = ("clothoid", "arc")

    @property
    def primitives(self) -> Primitives:
        """Motion primitives on a lattice of step 1."""
        return primitives()

    @cached_property
    def _known(self) -> tuple[IntArray, IntArray]:
        """Sorted keys (:func:`_keys`) of all primitives, and the number of the primitive of each key."""
        p = self.primitives
        keys = _keys(p.tail, p.step, p.head)
        order = np.argsort(keys)
        return keys[order], order

    def _numbers(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return the numbers (N,) of the primitives between nodes; -1 where there is none."""
        keys, numbers = self._known
        inside = np.maximum(tails, heads) < len(self.cells)
        a, b = (self.cells[np.where(inside, ends, 0)] for ends in (tails, heads))
        wanted = _keys(a[:, 2], b[:, :2] - a[:, :2], b[:, 2])
        place = np.clip(np.searchsorted(keys, wanted), 0, keys.size - 1)
        return np.where(inside & (keys[place] == wanted), numbers[place], -1)

    def directions(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return how primitives lead from nodes ``tails`` to ``heads`` (N,): 1 forwards, -1 backwards, 0 for none."""
        return np.where(self._numbers(tails, heads) >= 0, 1, np.where(self._numbers(heads, tails) >= 0, -1, 0))

    def with_runs(self) -> PrimitiveRuns:
        """Return the graph for plans among moving people, in which each stop and each start takes its time."""
        return PrimitiveRuns(cast(Ackermann, self.model), self.world, self, spending=self.spending)

    def chains(self, tails: IntArray, heads: IntArray) -> MotionChains:
        """Return the chains (N,) from nodes ``tails`` to ``heads``: primitives, and shortest paths to goals.

        A primitive leads forwards from tail to head, or is driven backwards if it leads from head to tail.
        """
        forwards, backwards = self._numbers(tails, heads), self._numbers(heads, tails)
        back = (forwards < 0) & (backwards >= 0)
        number = np.where(back, backwards, forwards)
        words = np.flatnonzero(number < 0)
        a, b = self.states(tails), self.states(heads)
        origin = States(**{n: np.where(back, getattr(b, n), getattr(a, n)) for n in a.names})
        knots = self.primitives.knots[number]  # (N, LEGS + 1, 3)
        knots[back] = knots[back][:, ::-1]
        cos, sin = self.step * np.cos(self.turned_by), self.step * np.sin(self.turned_by)
        x = origin.x[:, None] + cos * knots[..., 0] - sin * knots[..., 1]
        y = origin.y[:, None] + sin * knots[..., 0] + cos * knots[..., 1]
        yaw = knots[..., 2] - knots[:, :1, 2] + a.yaw[:, None]
        present = np.broadcast_to(self.primitives.lengths[number] > 0, (tails.size, LEGS)).copy()
        present[back] = present[back][:, ::-1]
        x[:, 0], y[:, 0], x[words], y[words], yaw[words] = (
            a.x,
            a.y,
            a.x[words, None],
            a.y[words, None],
            a.yaw[words, None],
        )
        x[:, -1], y[:, -1] = np.where(number < 0, x[:, -1], b.x), np.where(number < 0, y[:, -1], b.y)
        present[words] = False
        corners = [States(x=x[:, i], y=y[:, i], yaw=yaw[:, i]) for i in range(LEGS + 1)]
        kinds, shown = ["clothoid"] * LEGS, [present[:, i] for i in range(LEGS)]
        for leg in self.model.connect(a.take(words), b.take(words)) if words.size else []:
            columns = {n: getattr(corners[-1], n).copy() for n in a.names}
            for name, column in columns.items():
                column[words] = getattr(leg.end, name)
            is_present = np.zeros(tails.size, dtype=np.bool_)
            is_present[words] = leg.present
            kinds.append(leg.kind)
            corners.append(States(**columns))
            shown.append(is_present)
        return self.driven(MotionChains(self, tails, heads, tuple(kinds), tuple(corners), tuple(shown), 0 * tails))

    @cached_property
    def arcs(self) -> Arcs:
        """All collision-free arcs; a primitive is checked once for both directions."""
        tails, heads = self.links.T
        forwards = self._numbers(tails, heads) >= 0
        checked = forwards | (self._numbers(heads, tails) < 0)
        free = np.zeros(tails.size, dtype=np.bool_)
        rows = np.flatnonzero(checked)

        def are_free(part: slice) -> BoolArray:
            return self._free(tails[rows[part]], heads[rows[part]])

        doing = f"{self.words} was built"
        free[rows] = np.concatenate(list(self.spending.each(are_free, blocks(rows.size, PIECES), doing)))
        keys, wanted = tails[forwards] * self.size + heads[forwards], heads[~checked] * self.size + tails[~checked]
        order = np.argsort(keys)
        free[~checked] = free[forwards][order][np.searchsorted(keys[order], wanted)]
        return Arcs.sorted(self.size, [(tails[free], heads[free])])

    def _free(self, tails: IntArray, heads: IntArray) -> BoolArray:
        """Return which chains (N,) end at their head and are free; legs in open space need no exact test."""
        chains = self.chains(tails, heads)
        free, lengths = chains.reach(self.states(heads)), self.primitives.lengths[self._numbers(tails, heads)]
        for i, (rows, motions) in enumerate(chains.motions()):
            left = rows[free[rows]]
            if i < LEGS:
                begin, end = (chains.corners[j].take(left) for j in (i, i + 1))
                half = 0.5 * self.step * float(lengths[left, i].max(initial=0.0)) + ROOM
                middle = 0.5 * (begin.x + end.x), 0.5 * (begin.y + end.y)  # of an ellipse that contains the leg
                left = left[~cast("PlanarCollision", self.collision).clear(*middle, half)]
            some = np.searchsorted(rows, left)
            part = Motions(self.world, self.model, motions.law, motions.start.take(some), motions.end.take(some))
            free[left] = self.collision.motions_free(part)
        return free

    def chain_costs(
        self,
        tails: IntArray,
        heads: IntArray,
        criteria: Sequence[Criterion],
        chains: Callable[..., MotionChains],
        *classes: IntArray,
    ) -> IntArray:
        """Return the costs (N, k) of chains, in quanta (smallest cost steps).

        A criterion that depends neither on the world nor on the place is computed once for each primitive.
        """
        forwards, backwards = self._numbers(tails, heads), self._numbers(heads, tails)
        number = np.where(forwards >= 0, forwards, np.where(backwards >= 0, backwards + self.primitives.tail.size, -1))
        known, first, which = np.unique(number, return_index=True, return_inverse=True)
        rows = np.flatnonzero(number >= 0)
        one_each = self.chains(tails[first[known >= 0]], heads[first[known >= 0]])
        anywhere = np.array([not classes and _is_placeless(criterion, one_each) for criterion in criteria], dtype=bool)
        parts = (rows, anywhere), (rows, ~anywhere), (np.flatnonzero(number < 0), anywhere | True)
        costs = np.zeros((tails.size, len(criteria)), np.int64)
        for part, columns in parts:
            some = [criterion for criterion, kept in zip(criteria, columns, strict=True) if kept]
            if not some or not part.size:
                continue
            if columns is anywhere:
                costs[np.ix_(part, np.flatnonzero(columns))] = one_each.costs(some)[which[part] - (known[0] < 0)]
            else:
                own = super().chain_costs(tails[part], heads[part], some, chains, *(each[part] for each in classes))
                costs[np.ix_(part, np.flatnonzero(columns))] = own
        return costs

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason, as text, why no path leads from the start to the goals."""
        heads = self.arcs.heads
        entered = [goal for goal in goals if (heads == goal).any()]
        if not entered:
            return (
                "no path: no manoeuvre of the car reaches the goal in its heading without a collision, from any state "
                f"of {self.words} within {REACH:g} steps; turn or move the goal, or leave its heading free (any)"
            )
        off = self._other_headings(start, goals)
        if off.size:
            degrees = np.degrees(off.min())
            return (
                "no path: the car gets to the position of the goal, but not in its heading (the nearest is "
                f"{degrees:.0f} degrees off): it cannot turn around between; leave the heading of the goal free (any), "
                "let the car go backwards (reverse_speed), or take a car with a smaller turning radius"
            )
        return (
            super()
            .what_separates(start, goals)
            .replace(
                "; take more samples", "; take a smaller step or a smaller car, or check that passages are wide enough"
            )
        )

    def _other_headings(self, start: int, goals: list[int]) -> FloatArray:
        """Return by how much (N,), rad, the headings differ from a goal's in which the start reaches its position."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import breadth_first_order

        arcs = csr_array((np.ones(self.arcs.heads.size, np.int8), self.arcs.heads, self.arcs.start), (self.size,) * 2)
        reached = self.states(breadth_first_order(arcs, start, return_predecessors=False).astype(np.int64))
        found = []
        for goal in goals:
            there = self.states(np.array([goal]))
            near = np.hypot(reached.x - there.x, reached.y - there.y) <= self.step
            found.append(np.abs(np.angle(np.exp(1j * (reached.yaw - there.yaw))))[near])
        return np.concatenate(found)


def _is_placeless(criterion: Criterion, chains: MotionChains) -> bool:
    """Return True if the cost of a chain does not depend on where it begins: it reads no place and no world."""
    if criterion.world_frame:
        return False
    for _, motions in chains.motions():
        recorded = RecordedMotions.of(replace(motions, panels=1))  # the usual number of panels is read from the world
        try:
            criterion.cost(recorded)
        except Exception:  # the costs of all arcs raise it again, with its reason
            return False
        if "world" in recorded.recorded:
            return False
    return True


def _keys(tail: IntArray, step: IntArray, head: IntArray) -> IntArray:
    """Return one number (N,) for each heading at the start, step (N, 2) and heading at the end; -1 for long steps."""
    wide = 64
    near = (np.abs(step) < wide // 2).all(axis=1)
    keys = ((step[:, 0] + wide // 2) * wide + step[:, 1] + wide // 2) * HEADINGS**2 + tail * HEADINGS + head
    return np.where(near, keys, -1)


@graph_family("primitives")
@dataclass(frozen=True)
class PrimitivesGraph(GraphFamily):
    """Lattice of a car-like base (``ackermann``), whose arcs are motion primitives that the car drives without a stop.

    step  m, distance between neighbouring positions; None for the smallest at which the car can drive all primitives at
          its cruise speed

    Positions are on a grid through the start, in 16 headings; the grid is parallel to the map, or turned so that the
    start has one of the headings. A primitive is a straight step, a turn by one, two or four headings, or a shift to
    the side, and begins and ends with wheels straight ahead. A car that reverses also drives all of them backwards.
    Goals are exact: shortest paths of arcs and straight moves lead there from the start and from all states within six
    steps, and on these the car stands while it steers.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "steering"})
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True

    step: float | None = None

    def __post_init__(self) -> None:
        set_python_values(self)
        if self.step is not None:
            set_reals(self, "step", least=LEAST, most=MOST, kind="a positive length in m, or None")

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the lattice with the problem's start and goals."""
        lattice = self.lattice(problem, spending)
        return BuiltGraph(
            Ends(lattice, lattice.start, lattice.goals), problem, _notes(lattice.step, cast(Ackermann, problem.model))
        )

    def has_clock(self, problem: Problem) -> bool:
        """Return True: with people who move, the car drives runs from rest to rest, and may wait between them."""
        return True

    def lattice(self, problem: Problem, spending: Spending | None = None) -> PrimitiveLattice:
        """Return the lattice of a problem; raise QueryError if the start or every goal is blocked."""
        spending, car, known = spending or Spending(), cast(Ackermann, problem.model), primitives()
        least = known.least_step(car)
        step = least if self.step is None else float(self.step)
        if step < least * (1.0 - 1e-9):
            raise OptionError(
                f"the car cannot drive the primitives of a lattice of step {step:g} m: its steering allows steps of "
                f"{least:.4g} m or more; take a larger step, or leave it out"
            )
        found = survey(problem, 0, 0, spending)
        begin = float(found.start.yaw[0])
        nearest = int(np.argmin(np.abs(np.angle(np.exp(1j * (HEADING_ANGLES - begin))))))
        turned_by = float(np.angle(np.exp(1j * (begin - HEADING_ANGLES[nearest]))))
        turned_by = turned_by if abs(turned_by) > 1e-9 else 0.0
        cells, states = self._states(problem, found.start, nearest, turned_by, step, spending)
        nodes = concatenated_states(car.space, [found.start, states, found.goals])
        links = _links(cells, reverses=car.reverse_speed > 0)
        goals = []
        for i in range(found.goals.size):
            away = np.hypot(nodes.x[: len(cells)] - found.goals.x[i], nodes.y[: len(cells)] - found.goals.y[i])
            near = np.flatnonzero(away <= REACH * step)
            near = distinct(np.append(near, START))
            goals.append(np.stack([near, np.full(near.size, len(cells) + i)], axis=1))
        every = np.concatenate([links, *goals])
        return PrimitiveLattice(
            car,
            problem.world,
            nodes,
            every[np.argsort(every[:, 0], kind="stable")],
            found.target_nodes(len(cells) - 1),
            name=f"the lattice of primitives of step {step:.4g} m and {HEADINGS} headings",
            chosen={"step": step},
            cells=cells,
            step=step,
            turned_by=turned_by,
            spending=spending,
        )

    @staticmethod
    def _states(
        problem: Problem, start: States, heading: int, turned_by: float, step: float, spending: Spending
    ) -> tuple[IntArray, States]:
        """Return the cells (n, 3) of the start and of all free states on the grid, and the states without the start."""
        x_min, y_min, x_max, y_max = problem.world.bounds
        farthest = max(np.hypot(x - start.x[0], y - start.y[0]) for x in (x_min, x_max) for y in (y_min, y_max))
        most = int(farthest / step) + 1
        if (2 * most + 1) ** 2 * HEADINGS > MOST_STATES:
            raise OptionError(f"a step of {step:g} m gives more than {MOST_STATES:,} states; take a larger step")
        i, j = (index.ravel() for index in np.meshgrid(*(np.arange(-most, most + 1),) * 2, indexing="ij"))
        cos, sin = step * np.cos(turned_by), step * np.sin(turned_by)
        x, y = start.x[0] + cos * i - sin * j, start.y[0] + sin * i + cos * j
        inside = (x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)
        i, j, x, y = i[inside], j[inside], x[inside], y[inside]
        number, spot = (index.ravel() for index in np.meshgrid(np.arange(HEADINGS), np.arange(i.size), indexing="ij"))
        cells = np.stack([i[spot], j[spot], number], axis=1)
        states = States(x=x[spot], y=y[spot], yaw=HEADING_ANGLES[number] + turned_by)
        collision = problem.model.collision(problem.world)
        free = np.concatenate(
            [collision.states_free(states.take(part)) for part in blocks(len(cells))] or [np.zeros(0, np.bool_)]
        )
        spending.check("the lattice of primitives was built", 0)
        own: BoolArray = (cells == (0, 0, heading)).all(axis=1)
        rows = np.flatnonzero(free & ~own)
        return np.concatenate([[[0, 0, heading]], cells[rows]]), states.take(rows)


def _notes(step: float, car: Ackermann) -> tuple[str, ...]:
    """Return a remark on a step that is much longer than the car needs; otherwise none."""
    known = primitives()
    least = known.least_step(car)
    if step < COARSE * least:
        return ()
    return (
        f"with a step of {step:.3g} m the primitives turn on radii of {step / known.curvature:.3g} m or more, and the "
        f"car can turn on {car.radius:.3g} m: tight manoeuvres may be missing; leave out the step for {least:.3g} m",
    )


def _links(cells: IntArray, *, reverses: bool) -> IntArray:
    """Return the links (L, 2) by primitives between grid states (n, 3), also backwards if the car ``reverses``."""
    known = primitives()
    low = cells.min(axis=0)
    shape = cells.max(axis=0) - low + 1
    number = np.full(shape, -1, dtype=np.int64)
    number[tuple((cells - low).T)] = np.arange(len(cells))
    links = [np.zeros((0, 2), np.int64)]
    for tail, head, step in zip(known.tail.tolist(), known.head.tolist(), known.step, strict=True):
        first = np.flatnonzero(cells[:, 2] == tail)
        there = cells[first, :2] + step - low[:2]
        inside = ((there >= 0) & (there < shape[:2])).all(axis=1)
        first, there = first[inside], there[inside]
        if not low[2] <= head < low[2] + shape[2]:
            continue
        last = number[there[:, 0], there[:, 1], head - low[2]]
        links.append(np.stack([first[last >= 0], last[last >= 0]], axis=1))
    forwards = np.concatenate(links)
    return np.concatenate([forwards, forwards[:, ::-1]]) if reverses else forwards
