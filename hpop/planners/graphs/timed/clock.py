"""Clock of a search among moving people: it counts time in ticks, and rounds the durations of motions to ticks.

A motion lasts a whole number of ticks in the search, but a little more or less in reality. The rounding errors of moves
along one straight line do not add up: plan and clock differ by at most a tick there. A turn differs by less than a
tick, and the errors of many turns cancel on average. For each complete plan the deviation is computed (:mod:`.plans`),
and a hold, which ends at a fixed time, removes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import MOST, real
from hpop.base.text import set_python_values
from hpop.errors import OptionError
from hpop.motions import States
from hpop.motions.laws import LONGEST as LONGEST_HOLD
from hpop.planners.needs import people_move
from hpop.search.timed.graph import MAX_TICKS

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

TICK = 1 / 20  # s, by default
SHORTEST, LONGEST = 0.01, 1.0  # s, limits of a tick: shorter ones waste memory, in longer ones people walk too far
HOLD = 1.0  # s, default of the shortest wait: in a shorter one, stopping and starting take all of the time
GOLDEN = (math.sqrt(5) - 1) / 2  # its multiples, modulo 1, are evenly spread between 0 and 1
SAME = 1e-9  # in ticks: rounding error of times
OFFSET = 1 / math.pi  # in ticks: added to positions in time so that none lies exactly on a border between ticks
SLACK = 0.2  # s: the robot keeps clear of people even if it is early or late by this time


@dataclass(frozen=True)
class TickClock:
    """Clock that converts between seconds and ticks.

    tick  s, duration of a tick
    """

    tick: float

    def seconds(self, ticks: FloatArray | IntArray) -> FloatArray:
        """Convert ticks (N,) to times (N,) in s."""
        return np.asarray(ticks * self.tick, dtype=np.float64)

    def of(self, seconds: FloatArray) -> IntArray:
        """Convert durations (N,) in s to ticks (N,), rounded to the nearest number, at least 1."""
        return np.asarray(np.maximum(1, np.rint(seconds / self.tick)), dtype=np.int64)

    def in_place(self, seconds: FloatArray, place: IntArray) -> IntArray:
        """Convert durations (N,), s, of motions in place to ticks (N,), rounded up or down so that the mean is right.

        If a robot always turns by the same angle, rounding to the nearest number would always err in one direction. So
        the number of the place decides the direction of rounding. A motion gets at least one tick.

        place  (N,)  number of the place of each motion
        """
        share = place * GOLDEN % 1.0
        return np.asarray(np.maximum(1, np.floor(seconds / self.tick + share + SAME)), dtype=np.int64)

    def along(self, start: States, end: States, seconds: FloatArray) -> IntArray:
        """Convert durations ``seconds`` (M,) of straight moves to ticks (M,), so that rounding errors do not add up.

        start, end  states (M,) between which the robot moves

        The ticks of all moves along one straight line add up to the duration of the line, rounded up or down; but a
        move shorter than a tick gets at least one tick.
        """
        dx, dy = end.x - start.x, end.y - start.y
        length = np.hypot(dx, dy)
        pace = np.divide(seconds, length * length * self.tick, out=np.zeros_like(length), where=length > 0)
        begin = (start.x * dx + start.y * dy) * pace  # ticks from a fixed point of the line to the start of the move
        ticks = np.floor(begin + seconds / self.tick + OFFSET) - np.floor(begin + OFFSET)
        return np.asarray(np.maximum(1, ticks), dtype=np.int64)

    def up_to(self, seconds: float) -> int:
        """Convert a duration in s to ticks, rounded up."""
        return math.ceil(seconds / self.tick - 1e-9)

    def within(self, seconds: float) -> int:
        """Convert a duration in s to ticks, rounded down."""
        return math.floor(seconds / self.tick + 1e-9)


@dataclass(frozen=True)
class TimeOptions:
    """Planner options for planning among moving people.

    clock      s  time step (tick) of the search; None: 1/20
    hold       s  shortest duration of a wait; None: the robot never waits
    arrive_by  s  latest arrival; None: no limit
    margin     m  distance that the robot keeps from people
    """

    clock: float | None = None
    hold: float | None = HOLD
    arrive_by: float | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        set_python_values(self)
        if self.clock is not None:
            real("clock", self.clock, SHORTEST, LONGEST, "a time step in s", hint="leave it out for 1/20 s")
        if self.hold is not None:
            what = "the shortest wait in s, at least one time step (option clock),"
            real("hold", self.hold, self.tick, LONGEST_HOLD, what, hint="with None (null in a file), it never waits")
        if self.arrive_by is not None:
            most = MAX_TICKS * self.tick
            real("arrive_by", self.arrive_by, self.tick, most, "a time in s", hint="leave it out for no limit")
        real("margin", self.margin, 0.0, MOST, "a distance in m")

    @property
    def tick(self) -> float:
        """Duration of a tick, s: the option ``clock`` or its default."""
        return TICK if self.clock is None else float(self.clock)

    @property
    def described(self) -> dict[str, float | None]:
        """Values of the options by name, for JSON. Each trajectory that is found stores them in its provenance.

        None means as in the fields above: no waits (hold), or no limit (arrive_by).
        """
        return {"clock": self.tick, "hold": self.hold, "arrive_by": self.arrive_by, "margin": self.margin}


def needless(problem: Problem, options: TimeOptions) -> tuple[str, ...]:
    """Return a note for the user if options for moving people are set although no person moves; otherwise ().

    Raises OptionError if ``arrive_by`` is set although no person moves, since the search would ignore it.
    """
    if people_move(problem):
        return ()
    if options.arrive_by is not None:
        raise OptionError(
            "arrive_by needs people who move, since a search considers time only among them; leave arrive_by out, and "
            "use the criterion 'duration' instead"
        )
    names = ("clock", "hold") if problem.world.content.bodies else ("clock", "hold", "margin")
    unused = [name for name in names if getattr(options, name) != getattr(TimeOptions(), name)]
    if not unused:
        return ()
    return (f"no person moves, so the search does not consider time: {', '.join(unused)} had no effect",)


class BlockedArcs(NamedTuple):
    """Arcs that are blocked for departures at some ticks.

    rows   (b,)  indices of the arcs, ascending
    table  (b, H + 1)  True at the departure ticks at which each arc is blocked
    """

    rows: IntArray
    table: BoolArray

    @classmethod
    def of(cls, rows: IntArray, ticks: IntArray, horizon: int) -> BlockedArcs:
        """Build the table, for ticks 0 to ``horizon``, from pairs (N,) of an arc and a tick at which it is blocked."""
        arcs, which = np.unique(rows, return_inverse=True)
        table = np.zeros((arcs.size, horizon + 1), dtype=bool)
        table[which, ticks] = True
        return cls(arcs, table)


def widened(table: BoolArray, slack: int) -> BoolArray:
    """Extend a mask over ticks (q, H + 1) by ``slack`` ticks before and after each True; plans may be early or late."""
    width = table.shape[1]
    if not table.any() or not slack:
        return table
    some = np.flatnonzero(table.any(axis=1))
    padded = np.pad(table[some], ((0, 0), (slack, slack)), mode="edge")
    counts = np.cumsum(padded, axis=1, dtype=np.int32)
    counts = np.pad(counts, ((0, 0), (1, 0)))
    wide = table.copy()
    wide[some] = counts[:, 2 * slack + 1 :] - counts[:, :width] > 0
    return wide
