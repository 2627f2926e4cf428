"""The clock of a search: time in whole ticks, and what motions last on it.

A motion lasts a whole number of ticks there, and a little more or less in truth. Moves along one line are counted from
one zero, so that along a straight run, however long, plan and clock are never more than a tick apart; a turn is off by
less than a tick, and turns on average by nothing. By how much a whole plan is off is reckoned for each (:mod:`.plans`),
and a hold brings it back.
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

TICK = 1 / 20  # s, where people move and nobody says otherwise
SHORTEST, LONGEST = 0.01, 1.0  # s of a tick: a finer one only takes memory, in a coarser one people walk too far
HOLD = 1.0  # s: a robot that stops for less loses as much by stopping and starting
GOLDEN = (math.sqrt(5) - 1) / 2  # its multiples are evenly spread over a unit, whatever their number
SAME = 1e-9  # of a tick
OFFSET = 1 / math.pi  # of a tick: where it lies, no multiple of a step is a border between ticks
SLACK = 0.2  # s: so far a plan may be off the clock, and people are kept clear of all the same


@dataclass(frozen=True)
class TickClock:
    """Time in ticks.

    tick  s
    """

    tick: float

    def seconds(self, ticks: FloatArray | IntArray) -> FloatArray:
        """Times (N,), s, of ticks."""
        return np.asarray(ticks * self.tick, dtype=np.float64)

    def of(self, seconds: FloatArray) -> IntArray:
        """Durations (N,) in ticks, the nearest, at least one."""
        return np.asarray(np.maximum(1, np.rint(seconds / self.tick)), dtype=np.int64)

    def in_place(self, seconds: FloatArray, place: IntArray) -> IntArray:
        """Durations (N,), in ticks, of motions at places: now more, now less, but right on average over places.

        The nearest would be off in the same direction whenever a robot turns by the same angle.
        """
        share = place * GOLDEN % 1.0
        return np.asarray(np.maximum(1, np.floor(seconds / self.tick + share + SAME)), dtype=np.int64)

    def along(self, start: States, end: States, seconds: FloatArray) -> IntArray:
        """Durations (M,), in ticks, of straight moves, such that those of a line add up to that of the line."""
        dx, dy = end.x - start.x, end.y - start.y
        length = np.hypot(dx, dy)
        pace = np.divide(seconds, length * length * self.tick, out=np.zeros_like(length), where=length > 0)
        begin = (start.x * dx + start.y * dy) * pace  # ticks from the line's zero, at the move's own pace
        ticks = np.floor(begin + seconds / self.tick + OFFSET) - np.floor(begin + OFFSET)
        return np.asarray(np.maximum(1, ticks), dtype=np.int64)

    def up_to(self, seconds: float) -> int:
        """Whole ticks after which so many seconds have passed."""
        return math.ceil(seconds / self.tick - 1e-9)

    def within(self, seconds: float) -> int:
        """Whole ticks in so many seconds."""
        return math.floor(seconds / self.tick + 1e-9)


@dataclass(frozen=True)
class TimeOptions:
    """What a planner is told about time; it matters where people move.

    clock      s  of a tick; None: 1/20
    hold       s  that the robot stands at least when it waits; None: it never does
    arrive_by  s  at the latest; None: whenever
    margin     m  to be kept from people who move
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
            what = "how long the robot stands at least, in s, a tick or more,"
            real("hold", self.hold, self.tick, LONGEST_HOLD, what, hint="None (null in a scenario) lets it never wait")
        if self.arrive_by is not None:
            most = MAX_TICKS * self.tick
            real("arrive_by", self.arrive_by, self.tick, most, "a time in s", hint="leave it out for no limit")
        real("margin", self.margin, 0.0, MOST, "a distance in m")

    @property
    def tick(self) -> float:
        """Of the clock, s."""
        return TICK if self.clock is None else float(self.clock)

    @property
    def described(self) -> dict[str, float | None]:
        """JSON-able, as provenance tells it."""
        return {"clock": self.tick, "hold": self.hold, "arrive_by": self.arrive_by, "margin": self.margin}


def needless(problem: Problem, options: TimeOptions) -> tuple[str, ...]:
    """Return a note that names the options of time that are set where no person moves, so that there is no clock.

    Raises OptionError where a time of arrival is asked for, which would not be kept.
    """
    if people_move(problem):
        return ()
    if options.arrive_by is not None:
        raise OptionError(
            "arrive_by needs a clock, and where nobody moves there is none; leave it out, and list the criterion "
            "'duration'"
        )
    names = ("clock", "hold") if problem.world.content.bodies else ("clock", "hold", "margin")
    given = [name for name in names if getattr(options, name) != getattr(TimeOptions(), name)]
    if not given:
        return ()
    return (f"nobody moves, so there is no clock: {', '.join(given)} did not matter",)
