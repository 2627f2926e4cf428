"""The clock of a search: time in whole ticks, and the durations of motions on it.

A motion lasts a whole number of ticks on the clock, and a little more or less in reality. Moves along one line share a
zero of the count, so plan and clock never differ by more than a tick along a straight line. A turn differs by less
than a tick, and turns on average not at all. The deviation of each whole plan is computed (:mod:`.plans`); a hold
removes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import MOST, real
from hpop.base.scalars import set_python_values
from hpop.errors import OptionError
from hpop.motions import States
from hpop.motions.laws import LONGEST as LONGEST_HOLD
from hpop.planners.needs import people_move
from hpop.search.timed.graph import MAX_TICKS

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

TICK = 1 / 20  # s, by default
SHORTEST, LONGEST = 0.01, 1.0  # s, of a tick: shorter ones only need memory, in longer ones people walk too far
HOLD = 1.0  # s: a shorter stop loses as much time by stopping and starting
GOLDEN = (math.sqrt(5) - 1) / 2  # any number of its multiples are evenly spread over a unit interval
SAME = 1e-9  # of a tick
OFFSET = 1 / math.pi  # of a tick: with it, no multiple of a step lies on a border between ticks
SLACK = 0.2  # s: deviation from the clock at which a plan still keeps clear of people


@dataclass(frozen=True)
class TickClock:
    """Clock that counts time in ticks.

    tick  s, duration of a tick
    """

    tick: float

    def seconds(self, ticks: FloatArray | IntArray) -> FloatArray:
        """Return the times (N,), s, of ticks."""
        return np.asarray(ticks * self.tick, dtype=np.float64)

    def of(self, seconds: FloatArray) -> IntArray:
        """Return durations (N,), s, in ticks, rounded, at least one."""
        return np.asarray(np.maximum(1, np.rint(seconds / self.tick)), dtype=np.int64)

    def in_place(self, seconds: FloatArray, place: IntArray) -> IntArray:
        """Return durations (N,), in ticks, of motions in place, rounded up or down so that the mean is right.

        place  (N,) position of each motion, which decides the direction of rounding. Plain rounding would always err in
        the
               same direction if a robot always turns by the same angle
        """
        share = place * GOLDEN % 1.0
        return np.asarray(np.maximum(1, np.floor(seconds / self.tick + share + SAME)), dtype=np.int64)

    def along(self, start: States, end: States, seconds: FloatArray) -> IntArray:
        """Return durations (M,), in ticks, of straight moves.

        The moves along a line add up to the duration of the line.
        """
        dx, dy = end.x - start.x, end.y - start.y
        length = np.hypot(dx, dy)
        pace = np.divide(seconds, length * length * self.tick, out=np.zeros_like(length), where=length > 0)
        begin = (start.x * dx + start.y * dy) * pace  # ticks from the line's zero, at the move's own pace
        ticks = np.floor(begin + seconds / self.tick + OFFSET) - np.floor(begin + OFFSET)
        return np.asarray(np.maximum(1, ticks), dtype=np.int64)

    def up_to(self, seconds: float) -> int:
        """Return seconds in ticks, rounded up."""
        return math.ceil(seconds / self.tick - 1e-9)

    def within(self, seconds: float) -> int:
        """Return seconds in ticks, rounded down."""
        return math.floor(seconds / self.tick + 1e-9)


@dataclass(frozen=True)
class TimeOptions:
    """Options of a planner for time, which have an effect if people move.

    clock      s  duration of a tick; None: 1/20
    hold       s  least duration of a wait; None: the robot never waits
    arrive_by  s  latest arrival; None: any time
    margin     m  additional distance from people who move
    """

    clock: float | None = None
    hold: float | None = HOLD
    arrive_by: float | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        set_python_values(self)
        if self.clock is not None:
            real("clock", self.clock, SHORTEST, LONGEST, "the tick of a clock in s", hint="leave it out for 1/20 s")
        if self.hold is not None:
            what = "the least duration of a wait in s, a tick or more,"
            real("hold", self.hold, self.tick, LONGEST_HOLD, what, hint="None (null in a scenario) lets it never wait")
        if self.arrive_by is not None:
            most = MAX_TICKS * self.tick
            real("arrive_by", self.arrive_by, self.tick, most, "a time in s", hint="leave it out for no limit")
        real("margin", self.margin, 0.0, MOST, "a distance in m")

    @property
    def tick(self) -> float:
        """Tick of the clock, s."""
        return TICK if self.clock is None else float(self.clock)

    @property
    def described(self) -> dict[str, float | None]:
        """The options as JSON, for provenance."""
        return {"clock": self.tick, "hold": self.hold, "arrive_by": self.arrive_by, "margin": self.margin}


def needless(problem: Problem, options: TimeOptions) -> tuple[str, ...]:
    """Return a note on options for time that have no effect, because no person moves and so there is no clock.

    Raises OptionError if a latest arrival is set, since it would not be kept.
    """
    if people_move(problem):
        return ()
    if options.arrive_by is not None:
        raise OptionError(
            "arrive_by needs a clock, and there is none where no person moves; leave it out, and list the criterion "
            "'duration'"
        )
    names = ("clock", "hold") if problem.world.content.bodies else ("clock", "hold", "margin")
    unused = [name for name in names if getattr(options, name) != getattr(TimeOptions(), name)]
    if not unused:
        return ()
    return (f"no person moves, so there is no clock: {', '.join(unused)} had no effect",)
