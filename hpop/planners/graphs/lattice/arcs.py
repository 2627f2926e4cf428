"""Compute the arcs of a lattice: motions in place and steps along headings that are free of collisions.

Array shapes: P positions, H headings, S stations (a heading with values of the robot's other coordinates, such as the
pan of a camera), Z stances (stations that need separate collision checks: all S, or only the H headings), and at most W
motions in place from a station.

Most arcs of a lattice turn in place. Many criteria, such as the duration or the number of turns, give a turn the same
cost at every position. For these, the costs of motions that stay at a position are computed once for all positions. To
find these criteria, each is evaluated on motions that record whether it reads the position or the world.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, marked
from hpop.criteria.base import Criterion
from hpop.motions import Motions, States
from hpop.motions.states import LazyStates
from hpop.planners.graphs.arcs import MOVE, Arcs, blocks
from hpop.planners.graphs.lattice.grid import steps_from
from hpop.planners.objectives import quantised, rounding_noise
from hpop.runtime.limits import LimitPassed

if TYPE_CHECKING:
    from hpop.planners.graphs.lattice.graph import StateLattice
    from hpop.world import World

PLACE = frozenset({"x", "y", "world"})


class RecordedMotions(Motions):
    """Motions that record the names of the state coordinates that are read, and "world" if the world is read.

    recorded  names read so far
    """

    recorded: set[str]

    @property
    def world(self) -> World:
        """World, recorded when it is read."""
        self.recorded.add("world")
        return cast("World", self.__dict__["world"])

    @classmethod
    def of(cls, motions: Motions) -> RecordedMotions:
        """Return a copy of motions that records which of their states are read, and whether the world is."""
        recorded = set[str]()

        def lazy(states: States) -> LazyStates:
            return LazyStates(states.names, states.size, lambda name: getattr(states, name), recorded)

        copy = object.__new__(cls)
        fields = {name: vars(motions)[name] for name in ("world", "model", "law", "t0", "panels", "turns")}
        copy.__dict__.update(fields, start=lazy(motions.start), end=lazy(motions.end), recorded=recorded)
        return copy


def costs_anywhere(lattice: StateLattice, kind: str, criterion: Criterion) -> IntArray | None:
    """Return the costs, in quanta, of all motions of one kind that stay at a position, such as turns.

    They form a table (S, S) by the stations (headings and joint values) in which the motions begin and end. None if the
    costs may depend on the position, because the criterion reads the position or the world; also if the criterion
    cannot cost these motions, or if the lattice has no position.
    """
    if not lattice.cells[0].size:
        return None
    tails, heads = lattice.stations.motions[kind]
    motions = RecordedMotions.of(lattice.motions(kind, tails, heads))  # at the first position
    try:
        costs = np.asarray(criterion.cost(motions))
    except (LimitPassed, MemoryError):
        raise
    except Exception:  # the costs of all arcs raise it again, with its reason
        return None
    is_valid = costs.shape == tails.shape and np.can_cast(costs.dtype, np.float64, "same_kind")
    if motions.recorded & PLACE or not is_valid or not (np.isfinite(costs) & (costs >= 0)).all():
        return None
    table = np.zeros((lattice.width, lattice.width), np.int64)
    table[tails, heads] = quantised(costs.astype(np.float64), criterion, rounding_noise(motions))
    return table


ROOM = 1e-6  # m beside a step within which its collision test is not needed, more than any rounding


def lattice_arcs(lattice: StateLattice) -> Arcs:
    """Return all collision-free arcs of a lattice.

    Heads are first written to a table with a row for each state, in which -1 marks blocked arcs. So the arcs need not
    be sorted.
    """
    (to, of_kind), places, width = lattice.in_place, lattice.cells[0].size, lattice.width
    lattice.spending.check(lattice.doing, places * width * (to.shape[1] + 1) * (4 + 1 + 4 + 1))
    heads = np.empty((places, width, to.shape[1] + 1), np.int32)
    heads[:, :, :-1] = to + np.arange(0, places * width, width, dtype=np.int32)[:, None, None]
    reached = _steps(lattice)[:, lattice.stance]  # (P, S)
    heads[:, :, -1] = np.where(reached >= 0, reached * width + np.arange(width, dtype=np.int32), -1)
    if (to < 0).any():
        heads[:, :, :-1][:, to < 0] = -1
    if lattice.collision.yaw_matters:
        heads[:, :, :-1][~_in_place_free(lattice, to, of_kind)] = -1
    there = heads >= 0
    start = np.zeros(lattice.size + 1, np.int64)
    np.cumsum(there.sum(axis=2).ravel(), out=start[1:])
    kinds = np.concatenate([of_kind, np.full((width, 1), MOVE, np.uint8)], axis=1)
    return Arcs(start, heads[there], np.broadcast_to(kinds, there.shape)[there]).frozen()


def in_place(lattice: StateLattice) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return the motions in place at any position, as two tables (S, W) with a row for each station.

    The first has the stations to which motions lead, with -1 in unused columns; the second has their kinds of motion.
    """
    motions = [*lattice.stations.motions.values()]
    tails, heads = (np.concatenate([ends[side] for ends in motions]) for side in (0, 1))
    kinds = np.repeat(np.arange(1, len(motions) + 1, dtype=np.uint8), [ends[0].size for ends in motions])
    order = np.lexsort((heads, kinds, tails))
    leaving = np.bincount(tails, minlength=lattice.width)
    column = np.arange(tails.size) - np.repeat(np.cumsum(leaving) - leaving, leaving)
    to = np.full((lattice.width, int(leaving.max(initial=0))), -1, np.int32)
    of_kind = np.zeros(to.shape, np.uint8)
    to[tails[order], column], of_kind[tails[order], column] = heads[order], kinds[order]
    return to, of_kind


def _steps(lattice: StateLattice) -> NDArray[np.int32]:
    """Return the number of the position that one step along the heading reaches, for P positions and Z stances, (P, Z).

    A stance is a heading or, if collisions depend on the joints, a heading with values of the joints. -1 marks steps
    that collide or lead off the grid.
    """
    count, places = lattice.station_in.size, lattice.cells[0].size
    headings = lattice.stations.headings if lattice.collision.posture_matters else np.arange(count)
    steps = np.full(places * count, -1, np.int32)
    mirrored = not lattice.collision.yaw_matters  # a round robot may move in both directions or in none
    for stance, heading in enumerate(headings.tolist()):
        rows, columns, to_rows, to_columns = steps_from(
            lattice.free[:, :, stance], lattice.headings.steps[heading], corner_cutting=lattice.corner_cutting
        )
        steps[lattice.number[rows, columns] * count + stance] = lattice.number[to_rows, to_columns]

    beyond = ROOM + lattice.step * max(math.hypot(*step) for step in lattice.headings.steps)

    def blocked(part: slice) -> IntArray:
        first, last = part.start // count, -(-part.stop // count)
        x, y = lattice.position(*(axis[first:last] for axis in lattice.cells))
        is_open = lattice.collision.clear(x, y, beyond)
        tails: IntArray = part.start + np.flatnonzero(steps[part] >= 0)
        if mirrored:
            tails = tails[tails % count < count // 2]
        tails = tails[~is_open[tails // count - first]]
        place, stance = np.divmod(tails, count)
        station = lattice.station_in[stance]
        ends = (place * lattice.width + station, steps[tails].astype(np.int64) * lattice.width + station)
        return tails[~lattice.collision.motions_free(lattice.motions("move", *ends))]

    for tails in lattice.spending.each(blocked, blocks(steps.size), lattice.doing):
        if mirrored:
            back = steps[tails] * np.int64(count) + (tails + count // 2) % count
            steps[back] = -1
        steps[tails] = -1
    return steps.reshape(places, count)


def _in_place_free(lattice: StateLattice, to: NDArray[np.int32], of_kind: NDArray[np.uint8]) -> BoolArray:
    """Return which motions in place are free of collisions, as a mask (P, S, W).

    Its axes are the P positions, the S stations at which motions begin, and the W columns of ``to``. Collisions may
    depend only on position and heading, not on other coordinates (the posture). Then a motion that turns the base is
    checked as a turn, and any other motion is free wherever its state is.

    to, of_kind  (S, W)  stations reached, and kinds of motion, from :func:`in_place`
    """
    if lattice.collision.posture_matters:
        return _each_in_place_free(lattice, to, of_kind)
    count = lattice.headings.count
    others = np.array([[b for b in range(count) if b != a] for a in range(count)], np.int32)
    turns = _turns_free(lattice, others)  # (P, H, H - 1)
    here = lattice.stations.headings[:, None]
    there = lattice.stations.headings[to]
    turned = turns[:, here, np.where(there < here, there, there - 1) % (count - 1)]
    free: BoolArray = np.where(there == here, lattice.free[lattice.cells][:, here], turned)
    return free


def _each_in_place_free(lattice: StateLattice, to: NDArray[np.int32], of_kind: NDArray[np.uint8]) -> BoolArray:
    """Return a mask (P, S, W) of the motions in place that are free of collisions, with a separate check for each.

    The axes are those of :func:`_in_place_free`.

    to, of_kind  (S, W)  stations reached, and kinds of motion, from :func:`in_place`
    """
    stances = lattice.free[lattice.cells]  # (P, S)
    free: BoolArray = stances[:, :, None] & stances[:, to] & (to >= 0)
    sure = lattice.clear[lattice.cells]

    def blocked(part: slice) -> tuple[IntArray, ...]:
        place, station, column = marked(free[part] & ~sure[part, None, None])
        tails, heads = ((place + part.start) * lattice.width + at for at in (station, to[station, column]))
        wrong = np.zeros(place.size, dtype=bool)
        kinds = of_kind[station, column]
        for kind in np.unique(kinds).tolist():
            of = np.flatnonzero(kinds == kind)
            wrong[of] = ~lattice.collision.motions_free(lattice.motions(lattice.kinds[kind], tails[of], heads[of]))
        return place[wrong] + part.start, station[wrong], column[wrong]

    for at in lattice.spending.each(blocked, blocks(len(free), to.size), lattice.doing):
        free[at] = False
    return free


def _turns_free(lattice: StateLattice, others: NDArray[np.int32]) -> BoolArray:
    """Return which turns (P, H, H - 1), from each heading to every other, are free of collisions.

    Usually only turns between neighbouring headings are checked, and a longer turn is free if all those that it
    consists of are free. This gives equal results if the angles between neighbouring headings are multiples of the
    collision test's ``turn_part``; otherwise each turn is checked.

    others  (H, H - 1)  for each heading, the indices of the other headings
    """
    count = lattice.headings.count
    if not lattice.cells[0].size or not _are_multiples(lattice.headings.yaw, lattice.collision.turn_part):
        return _each_turn_free(lattice, others)
    free = lattice.free[lattice.cells]  # (P, H)
    onward = (np.arange(count) + 1) % count
    sectors = free & free[:, onward]  # from each heading to the next one counter-clockwise
    sure = lattice.clear[lattice.cells]

    def blocked(part: slice) -> tuple[IntArray, IntArray]:
        place, heading = marked(sectors[part] & ~sure[part, None])
        first = (place + part.start) * lattice.width
        tails, heads = (first + lattice.station_in[at] for at in (heading, onward[heading]))
        wrong = ~lattice.collision.motions_free(lattice.motions("turn", tails, heads))
        return place[wrong] + part.start, heading[wrong]

    for at in lattice.spending.each(blocked, blocks(len(free), count), lattice.doing):
        sectors[at] = False
    passed = _passed_sectors(lattice, others).reshape(-1, count).T.astype(np.float32)  # (H, H * (H - 1))
    turns = np.empty((len(free), *others.shape), np.bool_)
    for part in blocks(len(free), count * count):
        turns[part] = ((~sectors[part]).astype(np.float32) @ passed == 0).reshape(-1, *others.shape)
    return turns


def _are_multiples(yaw: FloatArray, part: float) -> bool:
    """Return whether all angles between neighbouring headings (H,), rad, are multiples of ``part``, rad.

    False if ``part`` is 0.
    """
    if not part > 0.0:
        return False
    parts = np.diff(yaw, append=yaw[0] + 2 * math.pi) / part
    return bool((np.abs(parts - np.round(parts)) < 1e-6).all())


def _passed_sectors(lattice: StateLattice, others: NDArray[np.int32]) -> BoolArray:
    """Return which sectors each turn passes, as a mask (H, H - 1, H); sector h lies between headings h and h + 1.

    others  (H, H - 1)  for each heading, the indices of the other headings
    """
    count = len(others)
    a = np.repeat(np.arange(count), count - 1)
    b = others.ravel()
    motions = lattice.motions("turn", lattice.station_in[a], lattice.station_in[b])
    counter_clockwise = motions.end.yaw > motions.start.yaw
    first, last = np.where(counter_clockwise, a, b), np.where(counter_clockwise, b, a)
    passed: BoolArray = (np.arange(count) - first[:, None]) % count < ((last - first) % count)[:, None]
    return passed.reshape(*others.shape, count)


def _each_turn_free(lattice: StateLattice, others: NDArray[np.int32]) -> BoolArray:
    """Return which turns (P, H, H - 1), from each heading to every other, are free, with a check of each turn.

    others  (H, H - 1)  for each heading, the indices of the other headings
    """
    count = lattice.headings.count
    free = lattice.free[lattice.cells]
    possible = free[:, :, None] & free[:, others]
    sure = lattice.clear[lattice.cells]

    def turns_checked(part: slice) -> tuple[tuple[IntArray, ...], BoolArray]:
        place, a, b = marked(possible[part] & ~sure[part, None, None])
        tails, heads = (
            (place + part.start) * lattice.width + lattice.station_in[heading] for heading in (a, others[a, b])
        )
        return (place + part.start, a, b), lattice.collision.motions_free(lattice.motions("turn", tails, heads))

    for at, turns in lattice.spending.each(turns_checked, blocks(len(free), count * count), lattice.doing):
        possible[at] = turns
    return possible
