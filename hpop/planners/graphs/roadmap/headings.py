"""Roadmap of positions: straight moves between random positions, and turns in place between the moves' headings.

In the probabilistic roadmap of Kavraki et al. 1996 (doi 10.1109/70.508439), nodes are configurations. Here turns have
costs of their own, so a node is a position with a heading. A position has one node for each heading of a move that
leaves or reaches it, and turns connect these nodes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.math import wrap
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.errors import OptionError, QueryError
from hpop.motions import Motions, States
from hpop.planners.graphs.arcs import blocks
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.needs import End, elsewhere, goals_of, in_plane, start_of
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

ALIGNED = 1e-9  # rad: directions that differ by less are one heading
MAX_EDGES = 60_000_000
LINK = 40  # bytes needed for each link while nearest neighbours are searched
ARROW = 80  # bytes needed for each directed move while the graph is built
TURN = 48  # bytes needed for each turn while the graph is built
PIECES = 4  # work of checking a turn, in arcs: at least four intermediate states


@dataclass(frozen=True, eq=False)
class StateRoadmap(StateGraph):
    """Roadmap of positions: states are positions with headings, arcs are straight moves and turns in place.

    Turns connect the headings at a position. Between headings that differ by less than a degree, there are only turns
    from the start's heading and to a goal's heading. Of several links from a position in one direction, only the
    shortest is used: the others pass through its end.

    positions  (P, 2)  m    distinct; the first is the position of the start
    links      (L, 2)       pairs of positions (indices) between which straight moves, in both directions, are tried
    start_yaw  rad, heading at the start
    targets    for each goal: index of its position, and yaw, rad, or None if any heading will do
    name       description of the roadmap, for certificates
    chosen     options, JSON-able
    remedy     advice for the user if there is no path, such as "take more samples"
    """

    notes: ClassVar[tuple[str, ...]] = ()

    positions: FloatArray
    links: IntArray
    start_yaw: float
    targets: tuple[tuple[int, float | None], ...]
    name: str
    chosen: dict[str, Any]
    remedy: str

    @property
    def options(self) -> dict[str, Any]:
        """Options from which the roadmap was built, JSON-able."""
        return self.chosen

    @property
    def words(self) -> str:
        """Description of the roadmap, for certificates."""
        return self.name

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of positions, moves and turns, for statistics."""
        return {"positions": len(self.positions), "moves": self.moves[0].size, "turns": self.turns[0].size}

    @cached_property
    def directed_moves(self) -> tuple[IntArray, IntArray, FloatArray]:
        """All collision-free moves, as three arrays (M,): first position, last position, and heading in rad.

        They are sorted by first position, then by heading.
        """
        self.spending.check(self._work_text, 2 * len(self.links) * ARROW)
        tails, heads = np.concatenate([self.links, self.links[:, ::-1]]).T

        def free_moves(ids: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
            return self._free_directed_moves(tails[ids], heads[ids])

        return _concatenated(self.spending.each(free_moves, _by_position(tails), self._work_text))

    def _free_directed_moves(self, tails: IntArray, heads: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the collision-free ones of some moves, as arrays: first positions, last positions, headings in rad.

        Of several moves from a position in one direction, only the shortest is considered.
        """
        span = self.positions[heads] - self.positions[tails]
        yaw = _in_one_turn(np.arctan2(span[:, 1], span[:, 0]))
        direction = _pair_numbers(tails, yaw)
        order = np.lexsort((np.hypot(*span.T), direction))
        nearest = order[np.unique(direction[order], return_index=True)[1]]
        tails, heads, yaw = tails[nearest], heads[nearest], yaw[nearest]
        free = self._moves_free(tails, heads, yaw)
        return tails[free], heads[free], yaw[free]

    @property
    def _work_text(self) -> str:
        return f"{self.words} was built"

    def _moves_free(self, tails: IntArray, heads: IntArray, yaw: FloatArray) -> BoolArray:
        start, end = (States(x=x, y=y, yaw=yaw) for x, y in (self.positions[ids].T for ids in (tails, heads)))
        return self.collision.motions_free(Motions(self.world, self.model, self.model.laws["move"], start, end))

    @cached_property
    def _needed_states(self) -> tuple[IntArray, FloatArray]:
        """Pairs of position and heading for which a state must exist, as two arrays, with repetitions.

        They are listed for the beginnings of all moves, the ends of all moves, the start, and the goals. A goal that
        accepts any heading is listed too, with yaw 0, so that it has a state even if no link reaches it.
        """
        tails, heads, yaw = self.directed_moves
        places, yaws = zip((0, self.start_yaw), *self.targets, strict=True)
        ends = _in_one_turn(np.array([end or 0.0 for end in yaws]))
        return np.concatenate([tails, heads, places]), np.concatenate([yaw, yaw, ends])

    @cached_property
    def _state_of_needed(self) -> IntArray:
        """Number of the state for each entry of ``_needed_states``; equal entries have equal numbers.

        The states at one position have consecutive numbers.
        """
        at, yaw = self._needed_states
        self.spending.check(self._work_text, at.size * ARROW)
        numbers, count = np.empty(at.size, np.int64), 0
        for ids in _by_position(at):
            numbers[ids] = count + _pair_numbers(at[ids], yaw[ids])
            count = int(numbers[ids].max()) + 1
            self.spending.check(self._work_text)
        return numbers

    @cached_property
    def _positions_and_yaws(self) -> tuple[IntArray, FloatArray]:
        """Position (index) and yaw (rad) of every state, as two arrays (S,)."""
        at, yaw = self._needed_states
        first = np.full(self._state_of_needed.max() + 1, at.size)
        np.minimum.at(first, self._state_of_needed, np.arange(at.size))
        return at[first], yaw[first]

    @property
    def size(self) -> int:
        """Number of states."""
        return int(self._positions_and_yaws[0].size)

    def places(self, ids: IntArray) -> IntArray:
        """Return the index of the position of each state (N,)."""
        return self._positions_and_yaws[0][ids]

    def states(self, ids: IntArray) -> States:
        """Return the states (N,) with the given numbers, with yaws in [0, 2 pi)."""
        x, y = self.positions[self._positions_and_yaws[0][ids]].T
        return States(x=x, y=y, yaw=self._positions_and_yaws[1][ids])

    @property
    def start(self) -> int:
        """Number of the start's state."""
        return int(self._state_of_needed[-1 - len(self.targets)])

    @cached_property
    def goals(self) -> list[int]:
        """Numbers of the goals' states: one for each goal, or all states at its position if any heading will do."""
        goals = list(self._exact_goals)
        for position, yaw in self.targets:
            goals += np.flatnonzero(self._positions_and_yaws[0] == position).tolist() if yaw is None else []
        return list(dict.fromkeys(goals))

    @property
    def _exact_goals(self) -> list[int]:
        """Numbers of the states of those goals that have a fixed heading."""
        ids = self._state_of_needed[-len(self.targets) :].tolist()
        return [state for state, (_, yaw) in zip(ids, self.targets, strict=True) if yaw is not None]

    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Return first and last states of all collision-free turns (kind "turn"), or of all collision-free moves."""
        return self.turns if kind == "turn" else self.moves

    @cached_property
    def moves(self) -> tuple[IntArray, IntArray]:
        """First and last states of all collision-free moves."""
        count = self.directed_moves[0].size
        return self._state_of_needed[:count], self._state_of_needed[count : 2 * count]

    @cached_property
    def turns(self) -> tuple[IntArray, IntArray]:
        """First and last states of all collision-free turns between headings that differ by more than LEAST_TURN.

        Smaller turns do not count as turns, so a sequence of them could turn by any angle at no cost. Only turns from
        the start's heading and to a goal's heading may be smaller.
        """
        at = self._positions_and_yaws[0]
        first = np.searchsorted(at, at)
        degree = np.searchsorted(at, at, side="right") - first - 1
        self.spending.check(self._work_text, int(degree.sum()) * TURN)
        if degree.sum() > MAX_EDGES:
            raise OptionError(
                f"{self.words} must have at most {MAX_EDGES:,} turns, got {degree.sum():,} between {self.size:,} "
                "states; take fewer samples, or fewer neighbours"
            )
        before = np.concatenate([[0], np.cumsum(degree)])

        def free_turns(part: slice) -> tuple[IntArray, IntArray]:
            tails = np.repeat(np.arange(part.start, part.stop), degree[part])
            heads = first[tails] + np.arange(before[part.start], before[part.stop]) - before[tails]
            heads += heads >= tails
            return self._free_turns(tails, heads)

        each = max(1, int(degree.max()) * PIECES)
        return _concatenated(self.spending.each(free_turns, blocks(at.size, each), self._work_text))

    def _free_turns(self, tails: IntArray, heads: IntArray) -> tuple[IntArray, IntArray]:
        """Return those of some turns that are large enough and free of collisions, as first and last states."""
        at, yaw = self._positions_and_yaws
        large = (np.abs(wrap(yaw[heads] - yaw[tails])) > LEAST_TURN) | (tails == self.start)
        for goal in self._exact_goals:
            large |= heads == goal
        tails, heads = tails[large], heads[large]
        if not self.collision.yaw_matters:
            return tails, heads
        free = self.collision.clear(*self.positions[at[tails]].T)
        near = np.flatnonzero(~free)
        free[near] = self.collision.motions_free(self.motions("turn", tails[near], heads[near]))
        return tails[free], heads[free]

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason, as text, why no path leads from the start to the goals.

        Start and goals may lie in unconnected parts (components) of the roadmap, or the robot has no room to turn.
        """
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import connected_components

        tails, heads, _ = self.directed_moves
        count = len(self.positions)
        links = csr_array((np.ones(tails.size), (tails, heads)), shape=(count, count))
        components, component = connected_components(links, directed=False)
        begin, *ends = component[self.places(np.array([start, *goals]))].tolist()
        if begin in ends:
            return (
                f"no path: straight moves connect start and goal on {self.words}, but the robot has no room to turn "
                f"from one move to the next; {self.remedy}, or use a robot with a rounder outline"
            )
        sizes = np.bincount(component)
        apart = ", ".join(str(sizes[end]) for end in dict.fromkeys(ends))
        return (
            f"no path: {self.words} has {components} unconnected parts; the part with the start has {sizes[begin]} of "
            f"{count} positions, the part with the goal {apart}; {self.remedy}"
        )


def _in_one_turn(yaw: FloatArray) -> FloatArray:
    """Return yaws, rad, reduced to [0, 2 pi); values that are just below 2 pi by rounding become 0."""
    yaw = yaw % (2 * math.pi)
    return np.where(yaw > 2 * math.pi - ALIGNED, 0.0, yaw)


def _pair_numbers(at: IntArray, yaw: FloatArray) -> IntArray:
    """Assign numbers to the distinct pairs of a position ``at`` (N,) and a ``yaw`` (N,), by position, then by yaw.

    Returns the number (N,) of each pair; yaws within ALIGNED count as equal.
    """
    order = np.lexsort((yaw, at))
    new = (np.diff(at[order], prepend=-1) != 0) | (np.diff(yaw[order], prepend=-1.0) > ALIGNED)
    number = np.empty(at.size, np.int64)
    number[order] = np.cumsum(new) - 1
    return number


def _by_position(at: IntArray) -> Iterator[IntArray]:
    """Divide the entries of ``at`` into blocks, such that entries with the same position are in the same block.

    Yields the indices of each block; ``at`` has the index of a position for each entry.
    """
    order = np.argsort(at, kind="stable")
    cuts = np.array([part.stop for part in blocks(at.size)][:-1], dtype=np.int64)
    ends = np.unique(np.searchsorted(at[order], at[order][cuts]))
    yield from np.split(order, ends[ends > 0])


def _concatenated(parts: Iterable[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Concatenate blocks that are tuples of arrays: the first arrays of all blocks, the second arrays, and so on."""
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def nearest_links(positions: FloatArray, count: int, spending: Spending) -> IntArray:
    """Return links (L, 2), as pairs of indices, from each position to the ``count`` positions nearest to it."""
    from scipy.spatial import KDTree

    count = min(count, len(positions) - 1)
    if not count:
        return np.zeros((0, 2), np.int64)
    doing = "the nearest neighbours of positions were searched"
    spending.check(doing, len(positions) * count * LINK)
    tree = KDTree(positions)

    def links(part: slice) -> IntArray:
        _, nearest = tree.query(positions[part], [*range(2, count + 2)])  # the first is itself
        return np.stack([np.repeat(np.arange(len(positions))[part], count), nearest.ravel()], axis=1)

    return np.concatenate([*spending.each(links, blocks(len(positions), count), doing)])


DRAWS = 1000  # largest number of positions that are drawn for each sample wanted
SAMPLE = 64  # bytes needed for drawing a position
SAME = 1e-9  # m: two positions within this distance are one position


class PositionedEnds(NamedTuple):
    """Distinct positions of the start and the goals, and the heading of each goal.

    positions  (E, 2)  m; the first is the position of the start
    goals      for each goal: index of its position, and yaw, rad, or None if any heading will do
    """

    positions: FloatArray
    goals: tuple[tuple[int, float | None], ...]


def checked_ends(problem: Problem) -> PositionedEnds:
    """Return the start and the goals without a collision; raise QueryError if the start or every goal is blocked.

    A goal that accepts any heading is not checked if collisions depend on the heading.
    """
    collision = in_plane(problem.model).collision(problem.world)

    def refusal(what: str, end: End) -> str:
        x, y, yaw = end
        if yaw is None and collision.yaw_matters:  # another heading may be free
            return ""
        state = States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw or 0.0]))
        reason = collision.why_blocked(state)
        hint = reason and elsewhere(problem.model, problem.world, state)
        return reason and f"the {what} ({x:.3f}, {y:.3f}) is not usable: {reason}.{hint}"

    start, goals = start_of(problem), goals_of(problem)
    refusals = [refusal(f"goal {i}" if len(goals) > 1 else "goal", goal) for i, goal in enumerate(goals)]
    if refused := refusal("start", start) or (all(refusals) and " ".join(refusals)):
        raise QueryError(refused)
    positions, at = [start[:2]], list[tuple[int, float | None]]()
    for x, y, yaw in (goal for goal, refused in zip(goals, refusals, strict=True) if not refused):
        near = [i for i, position in enumerate(positions) if math.dist(position, (x, y)) <= SAME]
        at.append((near[0] if near else len(positions), yaw))
        positions += [] if near else [(x, y)]
    return PositionedEnds(np.array(positions), tuple(at))


def pairs(count: int) -> IntArray:
    """Return all pairs (L, 2) of indices i < j below ``count``, to link all positions with each other."""
    return np.stack(np.triu_indices(count, 1), axis=1)


def drawn_positions(problem: Problem, samples: int, seed: int, spending: Spending) -> FloatArray:
    """Draw ``samples`` random positions (n, 2), m, uniformly over the map, at which the robot does not collide.

    The robot is checked at a random heading. Fewer positions are returned if nearly all that are drawn collide. Equal
    seeds give equal positions.
    """
    rng = np.random.default_rng(seed)
    collision = problem.model.collision(problem.world)
    x_min, y_min, x_max, y_max = problem.world.bounds
    drawn = np.zeros((0, 2))
    for _ in range(DRAWS):
        spending.check("positions were drawn", samples * SAMPLE)
        at = rng.uniform((x_min, y_min, 0.0), (x_max, y_max, 2 * math.pi), (samples, 3))

        def free(part: slice, at: FloatArray = at) -> FloatArray:
            x, y, yaw = at[part].T
            return at[part][collision.states_free(States(x=x, y=y, yaw=yaw)), :2]

        drawn = np.concatenate([drawn, *spending.each(free, blocks(samples), "positions were drawn")])
        if len(drawn) >= samples:
            break
    return drawn[:samples]
