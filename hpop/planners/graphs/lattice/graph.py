"""The SE(2) lattice of a robot in a world: grid positions, stations, motions in place and steps, as a plain graph.

Becerra et al. 2020 (arXiv 2002.10696): Type-A edges turn to any other heading at the same position, Type-B edges go one
step along the heading. A station is what a state is at its position: a heading, and what else the model's states have.
Everything is built in array operations; a state's id is position * S + station.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.errors import ModelError, OptionError
from hpop.motions import States
from hpop.planners.graphs.arcs import MOVE, Arcs, blocks
from hpop.planners.graphs.lattice.grid import Headings, passed_cells, steps_from, what_separates
from hpop.planners.graphs.state_graph import StateGraph, identity
from hpop.planners.needs import in_plane

if TYPE_CHECKING:
    from hpop.models.joints import Stations
    from hpop.problems.problem import Problem

REACH = 1.5 + 1e-9  # steps: a start or goal that is none of the lattice's states is joined to those within
MAX_STATES = 40_000_000
POSITION = 32  # bytes that laying out a position takes, beside its states


@dataclass(frozen=True, eq=False)
class StateLattice(StateGraph):
    """Grid positions through an anchor point, axes along the world's, and the robot's free states on them.

    anchor          (x, y) m of a grid position
    step            m between neighbouring positions
    headings        directions in which the robot stands and moves
    corner_cutting  whether a diagonal may pass between two blocked positions
    kept            (rows, columns)  positions that belong to it; None for all. A path of a part is one of the whole
    anchored_at     "start" or "world": what the anchor is
    """

    anchor: tuple[float, float]
    step: float
    headings: Headings
    corner_cutting: bool
    kept: BoolArray | None = None
    anchored_at: str = "start"

    def __post_init__(self) -> None:
        rows, columns = self.shape
        states = rows * columns * self.width
        if states > MAX_STATES:
            x_min, y_min, x_max, y_max = self.world.bounds
            raise OptionError(
                f"a step of {self.step} m in a map of {x_max - x_min:.1f} x {y_max - y_min:.1f} m makes {states:,} "
                f"states, more than {MAX_STATES:,}; take a larger step"
            )

    @property
    def options(self) -> dict[str, Any]:
        """What tells this lattice from others, JSON-able."""
        options = {"step": self.step, "headings": self.headings.count, "corner_cutting": self.corner_cutting}
        return options if self.anchored_at == "start" else {**options, "anchor": self.anchored_at}

    @property
    def words(self) -> str:
        """The same in words."""
        cutting = "" if self.corner_cutting else "no "
        part = "" if self.kept is None else f"the {self.cells[0].size:,} positions on the shortest ways on "
        views = "" if self.width == self.headings.count else f" and {self.width} stations"
        anchor = "" if self.anchored_at == "start" else ", anchored at the corner of the map"
        return (
            f"{part}the lattice of step {self.step:g} m, {self.headings.count} headings{views}, {cutting}corner "
            f"cutting{anchor}"
        )

    @cached_property
    def key(self) -> Hashable:
        """Model, step, headings, anchor and corner cutting; a part of a lattice is not kept."""
        try:
            model = identity(self.model)
        except TypeError:
            return None
        key = (type(self), model, self.anchor, self.step, self.headings, self.corner_cutting)
        return key if self.kept is None else None

    @property
    def counts(self) -> dict[str, int]:
        """Arcs that were checked again after a change of the world, of a lattice that was updated."""
        rechecked = self.kept_part("rechecked")
        return {} if rechecked is None else {"edges_rechecked": rechecked}

    @property
    def is_reused(self) -> bool:
        """Whether it is anchored at the world, so that queries with other starts find it."""
        return self.anchored_at == "world"

    @cached_property
    def stations(self) -> Stations:
        """The states in which the model may be at one position, and its motions in place.

        Raises ModelError where two of these join the same stations: a path of states would not say which it takes.
        """
        stations = in_plane(self.model).stations(self.headings.yaw)
        joined: dict[tuple[int, int], str] = {}
        for kind, (tails, heads) in stations.motions.items():
            for ends in zip(tails.tolist(), heads.tolist(), strict=True):
                if ends in joined:
                    raise ModelError(
                        f"stations {ends[0]} and {ends[1]} of {self.model.name} are joined by a {joined[ends]} and by "
                        f"a {kind}; give one of them, or a state that tells them apart"
                    )
                joined[ends] = kind
        return stations

    @cached_property
    def width(self) -> int:
        """Stations at a position, S."""
        return int(self.stations.headings.size)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Moves, and the model's motions in place."""
        return ("move", *self.stations.motions)

    @cached_property
    def _stance(self) -> IntArray:
        """Stance of each station (S,): of those with one stance all are free at a place, or none.

        That is the heading, or, where the posture matters, the station itself.
        """
        return np.arange(self.width) if self.collision.posture_matters else self.stations.headings

    @cached_property
    def _at_stance(self) -> IntArray:
        """A station in each stance (Z,) that has one."""
        count = self.width if self.collision.posture_matters else self.headings.count
        stations = np.zeros(count, np.int64)
        stations[self._stance[::-1]] = np.arange(self.width)[::-1]  # the first of each
        return stations

    def _standing(self, stance: IntArray, x: FloatArray, y: FloatArray) -> States:
        """States (N,) in stances at places, m."""
        if self.collision.posture_matters:
            return States(**self.stations.states.take(stance).__dict__ | {"x": x, "y": y})
        return States(x=x, y=y, yaw=self.headings.yaw[stance])

    @cached_property
    def first(self) -> tuple[int, int]:
        """Grid coordinates (row, column) of the first cell in the extent; the anchor is (0, 0)."""
        x_min, y_min, _, _ = self.world.bounds
        return (
            math.ceil((y_min - self.anchor[1]) / self.step - 1e-9),
            math.ceil((x_min - self.anchor[0]) / self.step - 1e-9),
        )

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        _, _, x_max, y_max = self.world.bounds
        last_row = math.floor((y_max - self.anchor[1]) / self.step + 1e-9)
        last_column = math.floor((x_max - self.anchor[0]) / self.step + 1e-9)
        return max(0, last_row - self.first[0] + 1), max(0, last_column - self.first[1] + 1)

    def position(self, rows: IntArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """World x, y (P,), m, of grid cells."""
        x = self.anchor[0] + (columns + self.first[1]) * self.step
        y = self.anchor[1] + (rows + self.first[0]) * self.step
        return np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)

    @property
    def _laid(self) -> str:
        """What is done while the states are found, in words."""
        return f"the lattice of step {self.step:g} m was laid out"

    @cached_property
    def clear(self) -> BoolArray:
        """Positions (rows, columns) where the robot is free at every yaw, so that every turn is free too."""
        return self.shared("clear", self._clear)

    def _clear(self) -> BoolArray:
        self.spending.check(self._laid, self.shape[0] * self.shape[1] * POSITION)
        clear = np.zeros(self.shape, dtype=bool)

        def free(part: slice) -> tuple[IntArray, IntArray, BoolArray]:
            rows, columns = np.nonzero(self._kept[part])
            rows += part.start
            return rows, columns, self.collision.clear(*self.position(rows, columns))

        for rows, columns, found in self.spending.each(free, self._rows(), self._laid):
            clear[rows, columns] = found
        clear.setflags(write=False)
        return clear

    def _rows(self) -> Iterator[slice]:
        """Ranges of rows, bounded in positions."""
        return blocks(self.shape[0], max(1, self.shape[1]))

    @property
    def _kept(self) -> BoolArray:
        return np.ones(self.shape, dtype=bool) if self.kept is None else self.kept

    @cached_property
    def free(self) -> BoolArray:
        """Positions and stances (rows, columns, Z) at which the robot is free."""
        every = np.broadcast_to(self.clear[:, :, None], (*self.shape, self._at_stance.size))
        return self.shared("free", self._free) if self.collision.yaw_matters else every

    def _free(self) -> BoolArray:
        free = np.repeat(self.clear[:, :, None], self._at_stance.size, axis=2)

        def at_some_yaw(part: slice) -> tuple[tuple[IntArray, ...], BoolArray]:
            rows, columns, stance = np.nonzero(
                (~self.clear[part] & self._kept[part])[:, :, None] & np.ones_like(free[0, 0])
            )
            rows += part.start
            states = self._standing(stance, *self.position(rows, columns))
            return (rows, columns, stance), self.collision.states_free(states)

        for at, found in self.spending.each(at_some_yaw, self._rows(), self._laid):
            free[at] = found
        free.setflags(write=False)
        return free

    @cached_property
    def cells(self) -> tuple[IntArray, IntArray]:
        """Rows and columns (P,) of the positions where at least one stance is free."""
        rows, columns = np.nonzero(self.free.any(axis=2))
        return rows, columns

    @cached_property
    def number(self) -> IntArray:
        """Position number (rows, columns), -1 where nothing is free."""
        number = np.full(self.shape, -1, dtype=np.int64)
        number[self.cells] = np.arange(self.cells[0].size)
        return number

    @property
    def size(self) -> int:
        """Number of states, P * S."""
        return int(self.cells[0].size) * self.width

    def state(self, row: int, column: int, station: int) -> int:
        """Id of a state, -1 where it is not free or off the grid."""
        inside = 0 <= row < self.shape[0] and 0 <= column < self.shape[1]
        if not inside or not self.free[row, column, self._stance[station]]:
            return -1
        return int(self.number[row, column]) * self.width + station

    def near(self, x: float, y: float, radius: float) -> IntArray:
        """Ids (N,), rising, of the states no farther than a radius, m, from a place; not all of them need be free."""
        low, high = (self._cell(x + sign * radius, y + sign * radius) for sign in (-1, 1))
        rows, columns = (
            np.arange(max(0, math.floor(a)), min(math.ceil(b) + 1, n))
            for a, b, n in zip(low, high, self.shape, strict=True)
        )
        row, column = (index.ravel() for index in np.meshgrid(rows, columns, indexing="ij"))
        at_x, at_y = self.position(row, column)
        number = self.number[row, column]
        number = number[(number >= 0) & (np.hypot(at_x - x, at_y - y) <= radius)]
        return (number[:, None] * self.width + np.arange(self.width)).ravel()

    def _cell(self, x: float, y: float) -> tuple[float, float]:
        """Row and column of a place, fractions for one between positions."""
        return (y - self.anchor[1]) / self.step - self.first[0], (x - self.anchor[0]) / self.step - self.first[1]

    def places(self, ids: IntArray) -> IntArray:
        """Number (N,) of the grid position of each state."""
        return ids // self.width

    def states(self, ids: IntArray) -> States:
        """Positions of states (N,), and what their stations are: yaws in [0, 2 pi)."""
        position, station = np.divmod(ids, self.width)
        x, y = self.position(self.cells[0][position], self.cells[1][position])
        return States(**self.stations.states.take(station).__dict__ | {"x": x, "y": y})

    @cached_property
    def _in_place(self) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Where motions in place lead from each station (S, W), -1 where it has no more of them, and their kinds."""
        motions = [*self.stations.motions.values()]
        tails, heads = (np.concatenate([ends[side] for ends in motions]) for side in (0, 1))
        kinds = np.repeat(np.arange(1, len(motions) + 1, dtype=np.uint8), [ends[0].size for ends in motions])
        order = np.lexsort((heads, kinds, tails))
        leaving = np.bincount(tails, minlength=self.width)
        column = np.arange(tails.size) - np.repeat(np.cumsum(leaving) - leaving, leaving)
        to = np.full((self.width, int(leaving.max(initial=0))), -1, np.int32)
        of_kind = np.zeros(to.shape, np.uint8)
        to[tails[order], column], of_kind[tails[order], column] = heads[order], kinds[order]
        return to, of_kind

    def kinds_between(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Kind (N,) of the edges between states: that in place between their stations, or a move."""
        to, of_kind = self._in_place
        table = np.zeros((self.width, self.width), np.int64)
        station, column = np.nonzero(to >= 0)
        table[station, to[station, column]] = of_kind[station, column]
        (at, tail), (place, head) = (np.divmod(ids, self.width) for ids in (tails, heads))
        return np.where(at == place, table[tail, head], MOVE)

    @cached_property
    def arcs(self) -> Arcs:
        """Type-A edges are motions in place, Type-B edges go one step along the heading.

        Heads stand in a table with a row a state, in order, so nothing need be sorted; -1 marks what is not free.
        """
        return self.shared("arcs", self._arcs)

    def _arcs(self) -> Arcs:
        (to, of_kind), places, width = self._in_place, self.cells[0].size, self.width
        self.spending.check(self._laid, places * width * (to.shape[1] + 1) * (4 + 1 + 4 + 1))
        heads = np.empty((places, width, to.shape[1] + 1), np.int32)
        heads[:, :, :-1] = to + np.arange(0, places * width, width, dtype=np.int32)[:, None, None]
        reached = self._steps[:, self._stance]  # (P, S)
        heads[:, :, -1] = np.where(reached >= 0, reached * width + np.arange(width, dtype=np.int32), -1)
        if (to < 0).any():
            heads[:, :, :-1][:, to < 0] = -1
        if self.collision.yaw_matters:
            heads[:, :, :-1][~self._in_place_free(to, of_kind)] = -1
        there = heads >= 0
        start = np.zeros(self.size + 1, np.int64)
        np.cumsum(there.sum(axis=2).ravel(), out=start[1:])
        kinds = np.concatenate([of_kind, np.full((width, 1), MOVE, np.uint8)], axis=1)
        return Arcs(start, heads[there], np.broadcast_to(kinds, there.shape)[there]).frozen()

    @property
    def _steps(self) -> NDArray[np.int32]:
        """The position (P, Z) that one step from each position in each stance reaches, -1 where none is free."""
        count, places = self._at_stance.size, self.cells[0].size
        headings = self.stations.headings if self.collision.posture_matters else np.arange(count)
        steps = np.full(places * count, -1, np.int32)
        mirrored = not self.collision.yaw_matters  # a round robot is free on a move where it is on the move back
        for stance, heading in enumerate(headings.tolist()):
            rows, columns, to_rows, to_columns = steps_from(
                self.free[:, :, stance], self.headings.steps[heading], corner_cutting=self.corner_cutting
            )
            steps[self.number[rows, columns] * count + stance] = self.number[to_rows, to_columns]

        def blocked(part: slice) -> IntArray:
            tails: IntArray = part.start + np.flatnonzero(steps[part] >= 0)
            if mirrored:
                tails = tails[tails % count < count // 2]
            place, stance = np.divmod(tails, count)
            station = self._at_stance[stance]
            ends = (place * self.width + station, steps[tails].astype(np.int64) * self.width + station)
            return tails[~self.collision.motions_free(self.motions("move", *ends))]

        for tails in self.spending.each(blocked, blocks(steps.size), self._laid):
            if mirrored:
                back = steps[tails] * np.int64(count) + (tails + count // 2) % count
                steps[back] = -1
            steps[tails] = -1
        return steps.reshape(places, count)

    def _in_place_free(self, to: NDArray[np.int32], of_kind: NDArray[np.uint8]) -> BoolArray:
        """Which motions in place (P, S, W) are free.

        Those that turn the base by their turns, others by their place; each by itself where the posture matters.
        """
        if self.collision.posture_matters:
            return self._each_in_place_free(to, of_kind)
        count = self.headings.count
        others = np.array([[b for b in range(count) if b != a] for a in range(count)], np.int32)
        turns = self._turns_free(others)  # (P, H, H - 1)
        here = self.stations.headings[:, None]
        there = self.stations.headings[to]
        turned = turns[:, here, np.where(there < here, there, there - 1) % (count - 1)]
        free: BoolArray = np.where(there == here, self.free[self.cells][:, here], turned)
        return free

    def _each_in_place_free(self, to: NDArray[np.int32], of_kind: NDArray[np.uint8]) -> BoolArray:
        """The same, each looked at."""
        stances = self.free[self.cells]  # (P, S)
        free: BoolArray = stances[:, :, None] & stances[:, to] & (to >= 0)
        sure = self.clear[self.cells]

        def blocked(part: slice) -> tuple[IntArray, ...]:
            place, station, column = np.nonzero(free[part] & ~sure[part, None, None])
            tails, heads = ((place + part.start) * self.width + at for at in (station, to[station, column]))
            wrong = np.zeros(place.size, dtype=bool)
            kinds = of_kind[station, column]
            for kind in np.unique(kinds).tolist():
                of = np.flatnonzero(kinds == kind)
                wrong[of] = ~self.collision.motions_free(self.motions(self.kinds[kind], tails[of], heads[of]))
            return place[wrong] + part.start, station[wrong], column[wrong]

        for at in self.spending.each(blocked, blocks(len(free), to.size), self._laid):
            free[at] = False
        return free

    def _turns_free(self, others: NDArray[np.int32]) -> BoolArray:
        """Which turns (P, H, H - 1) to the other headings are free."""
        count = self.headings.count
        free = self.free[self.cells]
        possible = free[:, :, None] & free[:, others]
        sure = self.clear[self.cells]

        def found(part: slice) -> tuple[tuple[IntArray, ...], BoolArray]:
            place, a, b = np.nonzero(possible[part] & ~sure[part, None, None])
            tails, heads = (
                (place + part.start) * self.width + self._at_stance[heading] for heading in (a, others[a, b])
            )
            return (place + part.start, a, b), self.collision.motions_free(self.motions("turn", tails, heads))

        for at, turns in self.spending.each(found, blocks(len(free), count * count), self._laid):
            possible[at] = turns
        return possible

    def cut_corners(self, tails: IntArray, kinds: IntArray, blocked: IntArray) -> BoolArray:
        """Mark the steps (N,) that pass a blocked state, which are no steps without corner cutting."""
        if self.corner_cutting:
            return np.zeros(tails.size, dtype=np.bool_)
        count = self.stations.headings.size
        is_blocked = np.zeros(self.size + 1, dtype=np.bool_)  # the last for what is not free anyway
        is_blocked[blocked] = True
        position, station = np.divmod(tails, count)
        rows, columns = (axis[position] for axis in self.cells)
        heading = np.where(kinds == MOVE, self.stations.headings[station], -1)
        cut = np.zeros(tails.size, dtype=np.bool_)
        for number, step in enumerate(self.headings.steps):
            own = np.flatnonzero(heading == number)
            for across, up in passed_cells(step):
                passed = self.number[rows[own] + up, columns[own] + across]
                cut[own] |= is_blocked[np.where(passed >= 0, passed * count + station[own], -1)]
        return cut

    def reach(self, problem: Problem) -> float:
        """Return one and a half steps, m."""
        return REACH * self.step

    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Tails and heads of all free motions of one kind."""
        return self.arcs.of(self.kinds.index(kind))

    def what_separates(self, start: int, goals: list[int]) -> str:
        """The widest passage between a state and the goals, or the wall, in words."""
        return what_separates(self, start, goals)
