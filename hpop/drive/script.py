"""A drive by a script: what happens when, and what the robot does about it.

The clock is told, so a drive of minutes is over as soon as its options are found. After each event the options are
asked for, and what nobody chose is left to the robot (:meth:`hpop.drive.Execution.adapt`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from hpop.base.arguments import checked_arguments
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.drive.change import Change
from hpop.drive.closings import Closing
from hpop.drive.execution import DEADLINE, Execution
from hpop.drive.options import Option, Options
from hpop.drive.plan import until
from hpop.errors import CoversRobot, DriveError, OptionError
from hpop.problems.named_rows import named_rows
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person

WORLD = ("close", "open", "people", "stop")
ASKED = ("wish", "take")
KINDS = (*WORLD, *ASKED, "options")


@dataclass(frozen=True, eq=False)
class Event:
    """Something that happens during a drive, or that somebody asks for.

    at     s, of the drive
    kind   "close", "open", "people" or "stop": the world changes (:meth:`hpop.drive.Execution.world`); "wish" or
           "take": somebody aboard chooses; "options": they are only looked at
    value  a polygon or a door's name; people; who; words or shares of a wish; a number, "knee" or "least NAME"; None
    name   by which a polygon that is closed is opened again
    """

    at: float
    kind: str
    value: Any = None
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", float(real("at", self.at, 0, MOST, "a time in s", error=DriveError)))
        if self.kind not in KINDS:
            raise DriveError(f"an event is one of {', '.join(KINDS)}, got {shown(self.kind)}")

    def __str__(self) -> str:
        match self.kind, self.value:
            case (("close" | "open"), str()):
                what = repr(self.value)
            case (("close" | "open"), _):
                what = repr(self.name) if self.name else "an area"
            case "people", people:
                what = f"{len(people)} there now"
            case "stop", Person():
                what = self.value.name or "somebody"
            case "wish", Mapping():
                what = ", ".join(f"{name} {share:+.0%}" for name, share in self.value.items())
            case _, None:
                what = ""
            case _:
                what = str(self.value)
        return f"{self.kind}: {what}" if what else self.kind


@dataclass(frozen=True, eq=False)
class Happening:
    """An event, and what became of it.

    change   of the plan, by a change of the world; None of other events, and where it could not be
    options  that there were then
    taken    the option that is driven from their commit on; None where the robot keeps its plan
    asked    whether somebody took it, or the robot did by itself
    words    what is said of it: what was chosen, or why nothing could be done
    driven   until then
    before   the plan before it, from the beginning to the goal
    closed   what is closed then
    people   who are there, with their time from then on
    """

    event: Event
    change: Change | None
    options: Options
    taken: Option | None
    asked: bool
    words: str
    driven: Trajectory
    before: Trajectory
    closed: tuple[Closing, ...]
    people: tuple[Person, ...]


@checked_arguments
def performed(drive: Execution, events: Iterable[Event], *, deadline: float = DEADLINE) -> Iterator[Happening]:
    """Drive by a script; what becomes of each event, in order of time. The robot changes its plan by itself too.

    deadline  s of this thread's processor time for options

    Raises DriveError for events that are not in order of time, or come after the robot has arrived, and as the methods
    of the drive do.
    """
    last = 0.0
    for event in events:
        if event.at < last:
            raise DriveError(f"the event at {event.at:g} s comes after one at {last:g} s: list events in order of time")
        last = event.at
        yield _happened(drive, event, deadline)


def _happened(drive: Execution, event: Event, deadline: float) -> Happening:
    moment = drive.at(event.at)
    if moment.arrived:
        raise DriveError(
            f"the event at {event.at:g} s comes too late: the robot arrives at {drive.begin + drive.plan.duration:.1f} "
            "s; leave it out, or let it happen before"
        )
    driven, before = until(moment.plan, moment.planned), drive.announced
    change, words = None, ""
    if event.kind in WORLD:
        try:
            change = drive.world(event.at, name=event.name, **{event.kind: event.value})
        except CoversRobot as error:  # only now is it known where the robot is
            words = str(error)
    drive.ready(event.at)  # the clock is told, and waits
    closed = drive.surroundings.closings
    options = drive.options(event.at, deadline)
    taken = None
    if event.kind in ASKED:
        taken, words = _chosen(drive, options, event)
    asked = taken is not None
    if asked:
        drive.take(taken)  # type: ignore[arg-type]
    elif change is not None or options.keep_on is None:  # a robot that waits takes what is open
        taken = drive.adapt(options)
    there = drive.surroundings
    people = tuple(person.later(event.at - there.since) for person in there.people)
    return Happening(event, change, options, taken, asked, words, driven, before, closed, people)


def _chosen(drive: Execution, options: Options, event: Event) -> tuple[Option | None, str]:
    """The option that somebody asks for, and what is said of it."""
    if event.kind == "wish":
        value = event.value
        wish = drive.wish(**value) if isinstance(value, Mapping) else drive.wish(value)
        return wish.option, wish.words
    if not len(options):
        return None, f"there is nothing to take: {options.certificate}"
    try:
        (row,) = named_rows(options.front, [event.value])
    except OptionError:  # only now is it known how many there are
        last = len(options) - 1
        return None, f"no option {shown(event.value)}: " + (f"they are numbered 0 to {last:,}" if last else "0 is all")
    option: Option = options[row.number]
    return option, str(row)
