"""SE(2) lattice of a robot in a world, as a graph: positions on a grid, and the robot's states at these positions.

The edges are those of Becerra et al. 2020 (arXiv 2002.10696): Type-A edges turn to any other heading at the same
position, Type-B edges go one step along the heading. A robot may have other coordinates, such as the pan of a camera. A
heading with values of these is called a station, and a state is a station at a position. With S stations, the state at
a position has the number position * S + station.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, marked
from hpop.base.options import identity
from hpop.criteria.base import Criterion
from hpop.errors import ModelError, OptionError
from hpop.motions import States
from hpop.planners.graphs.arcs import MOVE, Arcs, blocks
from hpop.planners.graphs.lattice.arcs import costs_anywhere, in_place, lattice_arcs
from hpop.planners.graphs.lattice.grid import Headings, passed_cells, what_separates
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.needs import in_plane

if TYPE_CHECKING:
    from hpop.models.joints import Stations
    from hpop.problems.problem import Problem

REACH = 1.5 + 1e-9  # in steps: distance within which a start or goal off the lattice is connected to states
MAX_STATES = 40_000_000
POSITION = 32  # bytes needed for each position while the lattice is built, without its states


@dataclass(frozen=True, eq=False)
class StateLattice(StateGraph):
    """Lattice: positions on a grid parallel to the axes of the map, and the robot's states at them.

    A position is part of it if the robot is free of collisions there in some station; other states there have no arcs.

    anchor          (x, y) of one position of the grid, m
    step            m  distance between neighbouring positions
    headings        directions in which the robot stands and moves
    corner_cutting  whether a diagonal step may pass blocked positions beside it
    kept            (rows, columns)  mask of the positions, if this is only a part of a lattice; None for all positions
    anchored_at     whether the anchor is the start ("start"), or the corner of the map ("world")
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
                f"a lattice must have at most {MAX_STATES:,} states, got {states:,} with a step of {self.step} m in a "
                f"map of {x_max - x_min:.1f} x {y_max - y_min:.1f} m; take a larger step"
            )

    @property
    def options(self) -> dict[str, Any]:
        """Options from which the lattice was built, JSON-able."""
        options = {"step": self.step, "headings": self.headings.count, "corner_cutting": self.corner_cutting}
        return options if self.anchored_at == "start" else {**options, "anchor": self.anchored_at}

    @property
    def words(self) -> str:
        """Description of the lattice, for certificates."""
        cutting = "" if self.corner_cutting else "no "
        part = "" if self.kept is None else f"the {self.cells[0].size:,} positions on the shortest paths on "
        views = "" if self.width == self.headings.count else f" and {self.width} stations"
        anchor = "" if self.anchored_at == "start" else ", anchored at the corner of the map"
        return (
            f"{part}the lattice of step {self.step:g} m, {self.headings.count} headings{views}, {cutting}corner "
            f"cutting{anchor}"
        )

    @cached_property
    def key(self) -> Hashable:
        """Key of the lattice in the cache of its world: model, anchor, step, headings and corner cutting.

        None if it is not cached: for a part of a lattice, and for a model that may change.
        """
        try:
            model = identity(self.model)
        except TypeError:
            return None
        key = (type(self), model, self.anchor, self.step, self.headings, self.corner_cutting)
        return key if self.kept is None else None

    @property
    def counts(self) -> dict[str, int]:
        """Statistics: after a change of the world, the number of arcs that were checked again; otherwise empty."""
        rechecked = self.cached_part("rechecked")
        return {} if rechecked is None else {"edges_rechecked": rechecked}

    @property
    def is_reused(self) -> bool:
        """True if the lattice does not depend on the start, so that queries with other starts will use it too."""
        return self.anchored_at == "world"

    @cached_property
    def stations(self) -> Stations:
        """Stations of the model (headings with values of its other coordinates), and the motions between them in place.

        Raises ModelError if two kinds of motion lead from the same first to the same last station, since a
        sequence of states would then not say which motion is meant.
        """
        stations = in_plane(self.model).stations(self.headings.yaw)
        joined: dict[tuple[int, int], str] = {}
        for kind, (tails, heads) in stations.motions.items():
            for ends in zip(tails.tolist(), heads.tolist(), strict=True):
                if ends in joined:
                    raise ModelError(
                        f"from one state to another in place, a model must have a single kind of motion, but in "
                        f"{self.model.name} both a {joined[ends]} and a {kind} lead from station {ends[0]} to station "
                        f"{ends[1]}; leave one of them out, or add a coordinate that distinguishes their ends"
                    )
                joined[ends] = kind
        return stations

    @cached_property
    def width(self) -> int:
        """Number S of stations at a position."""
        return int(self.stations.headings.size)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of motions: "move", then those of the model's motions in place."""
        return ("move", *self.stations.motions)

    @cached_property
    def stance(self) -> IntArray:
        """Stance (S,) of each station: the number of its group, whose stations all collide at equal positions.

        A station is a heading with values of the robot's other coordinates, such as the pan of a camera. If collisions
        depend only on position and heading, the stance is the heading; otherwise each station is its own group.
        """
        return np.arange(self.width) if self.collision.posture_matters else self.stations.headings

    @cached_property
    def station_in(self) -> IntArray:
        """One station (heading with values of joints) of each stance (Z,), which stands for all in collision checks."""
        count = self.width if self.collision.posture_matters else self.headings.count
        stations = np.zeros(count, np.int64)
        stations[self.stance[::-1]] = np.arange(self.width)[::-1]  # the first one
        return stations

    def _standing(self, stance: IntArray, x: FloatArray, y: FloatArray) -> States:
        """Return the states (N,) of the robot in given stances (N,) at positions x, y (N,), m."""
        if self.collision.posture_matters:
            return States(**self.stations.states.take(stance).__dict__ | {"x": x, "y": y})
        return States(x=x, y=y, yaw=self.headings.yaw[stance])

    @cached_property
    def first(self) -> tuple[int, int]:
        """Row and column, counted from the anchor, of the position of the grid with the least x and y on the map."""
        x_min, y_min, _, _ = self.world.bounds
        return (
            math.ceil((y_min - self.anchor[1]) / self.step - 1e-9),
            math.ceil((x_min - self.anchor[0]) / self.step - 1e-9),
        )

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of the grid."""
        _, _, x_max, y_max = self.world.bounds
        last_row = math.floor((y_max - self.anchor[1]) / self.step + 1e-9)
        last_column = math.floor((x_max - self.anchor[0]) / self.step + 1e-9)
        return max(0, last_row - self.first[0] + 1), max(0, last_column - self.first[1] + 1)

    def position(self, rows: IntArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y (P,), m, on the map of positions given by rows and columns of the grid."""
        x = self.anchor[0] + (columns + self.first[1]) * self.step
        y = self.anchor[1] + (rows + self.first[0]) * self.step
        return np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)

    @property
    def doing(self) -> str:
        """Text after "while" in notes about a passed time or memory limit: "the lattice of step 0.25 m was built"."""
        return f"the lattice of step {self.step:g} m was built"

    @cached_property
    def clear(self) -> BoolArray:
        """Mask (rows, columns) of the positions at which the robot collides at no yaw, and so in no turn."""
        return self.shared("clear", self._clear)

    def _clear(self) -> BoolArray:
        self.spending.check(self.doing, self.shape[0] * self.shape[1] * POSITION)
        clear = np.zeros(self.shape, dtype=bool)

        def free(part: slice) -> tuple[IntArray, IntArray, BoolArray]:
            rows, columns = marked(self._kept[part])
            rows += part.start
            return rows, columns, self.collision.clear(*self.position(rows, columns))

        for rows, columns, is_clear in self.spending.each(free, self._rows(), self.doing):
            clear[rows, columns] = is_clear
        clear.setflags(write=False)
        return clear

    def _rows(self) -> Iterator[slice]:
        """Yield slices of consecutive rows that together cover the grid; each is the work of one thread at a time.

        Each has at most BLOCK positions (:func:`hpop.planners.graphs.arcs.blocks`), or is a single row.
        """
        return blocks(self.shape[0], max(1, self.shape[1]))

    @property
    def _kept(self) -> BoolArray:
        return np.ones(self.shape, dtype=bool) if self.kept is None else self.kept

    @cached_property
    def free(self) -> BoolArray:
        """Mask (rows, columns, Z): whether the robot is free of collisions at each position in each stance.

        A stance is a group of headings (with values of joints) that collide alike; see :attr:`stance`.
        """
        every = np.broadcast_to(self.clear[:, :, None], (*self.shape, self.station_in.size))
        return self.shared("free", self._free) if self.collision.yaw_matters else every

    def _free(self) -> BoolArray:
        free = np.repeat(self.clear[:, :, None], self.station_in.size, axis=2)

        def at_some_yaw(part: slice) -> tuple[tuple[IntArray, ...], BoolArray]:
            rows, columns, stance = marked(
                (~self.clear[part] & self._kept[part])[:, :, None] & np.ones_like(free[0, 0])
            )
            rows += part.start
            states = self._standing(stance, *self.position(rows, columns))
            return (rows, columns, stance), self.collision.states_free(states)

        for at, is_free in self.spending.each(at_some_yaw, self._rows(), self.doing):
            free[at] = is_free
        free.setflags(write=False)
        return free

    @cached_property
    def cells(self) -> tuple[IntArray, IntArray]:
        """Rows and columns (P,) of the positions at which the robot is free of collisions in at least one state."""
        rows, columns = marked(np.asarray(self.free.any(axis=2)))
        return rows, columns

    @cached_property
    def number(self) -> IntArray:
        """Number of each position (rows, columns), as an index into ``cells``; -1 if all of its states collide."""
        number = np.full(self.shape, -1, dtype=np.int64)
        number[self.cells] = np.arange(self.cells[0].size)
        return number

    @property
    def size(self) -> int:
        """Number of states, P * S: P positions with S states (headings and joint values) each.

        States in which the robot collides are counted too.
        """
        return int(self.cells[0].size) * self.width

    def state(self, row: int, column: int, station: int) -> int:
        """Return the number of the state at a row and column in a station; -1 if it collides or is off the grid.

        station  index of a heading, or of a heading with values of the joints
        """
        inside = 0 <= row < self.shape[0] and 0 <= column < self.shape[1]
        if not inside or not self.free[row, column, self.stance[station]]:
            return -1
        return int(self.number[row, column]) * self.width + station

    def near(self, x: float, y: float, radius: float) -> IntArray:
        """Return the numbers (N,), ascending, of the states within ``radius``, m, of the position (x, y), m.

        All stations of a position are included, also those in which the robot collides.
        """
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
        """Return row and column of a point (x, y), m, as fractions between positions; that of `first` is (0, 0)."""
        return (y - self.anchor[1]) / self.step - self.first[0], (x - self.anchor[0]) / self.step - self.first[1]

    def places(self, ids: IntArray) -> IntArray:
        """Return the number (N,) of the grid position of each state."""
        return ids // self.width

    def states(self, ids: IntArray) -> States:
        """Return the states (N,) with the given numbers, with yaws in [0, 2 pi)."""
        position, station = np.divmod(ids, self.width)
        x, y = self.position(self.cells[0][position], self.cells[1][position])
        return States(**self.stations.states.take(station).__dict__ | {"x": x, "y": y})

    @cached_property
    def in_place(self) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Motions in place at any position, as two tables (S, W) with a row for each station.

        A station is a heading with values of the joints. The first table has the stations that the motions reach, -1 in
        unused columns; the second has the kinds of the motions, as indices into ``kinds``.
        """
        return in_place(self)

    def kinds_between(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return the kind (N,) of the motion from each tail (N,) to its head (N,), as an index into ``kinds``."""
        to, of_kind = self.in_place
        table = np.zeros((self.width, self.width), np.int64)
        station, column = np.nonzero(to >= 0)
        table[station, to[station, column]] = of_kind[station, column]
        (at, tail), (place, head) = (np.divmod(ids, self.width) for ids in (tails, heads))
        return np.where(at == place, table[tail, head], MOVE)

    def costs_anywhere(self, kind: str, criterion: Criterion) -> IntArray | None:
        """Return the cost of each motion in place of one kind, in quanta, indexed by :meth:`in_place_pairs`.

        None for moves, and if the costs depend on the position.
        """
        return None if kind == "move" else costs_anywhere(self, kind, criterion)

    def in_place_pairs(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return a number (N,) for each motion in place that depends only on its two stations: first * S + second.

        A station is a heading, or a heading with values of the joints; there are S at a position.
        """
        pairs: IntArray = tails % self.width * self.width + heads % self.width
        return pairs

    @cached_property
    def arcs(self) -> Arcs:
        """All collision-free arcs: motions in place (Type A) and steps along the heading (Type B)."""
        return self.shared("arcs", lambda: lattice_arcs(self))

    def cut_corners(self, tails: IntArray, kinds: IntArray, blocked: IntArray) -> BoolArray:
        """Return which arcs (N,) may not be used because they are steps that pass a blocked state.

        With corner cutting, none. Arguments as for :meth:`.StateGraph.cut_corners`.
        """
        if self.corner_cutting:
            return np.zeros(tails.size, dtype=np.bool_)
        count = self.stations.headings.size
        is_blocked = np.zeros(self.size + 1, dtype=np.bool_)  # the last entry stands for states that do not exist
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
        """Return the distance, m, within which start and goals are connected to states: one and a half steps."""
        return REACH * self.step

    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Return first and last states of all collision-free motions of one kind."""
        return self.arcs.of(self.kinds.index(kind))

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return in words why no path leads from a state to the goals, between which there is none, and a remedy.

        The reason is obstacles, a passage too narrow for the robot, or steps and turns that the lattice does not have.
        """
        return what_separates(self, start, goals)
