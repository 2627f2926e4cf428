"""Starting a drive: from a point of a front, from a saved file, or with a script of events."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from shapely.errors import ShapelyError
from shapely.geometry import shape

from hpop.base.arguments import checked_arguments
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.drive.closings import Closing
from hpop.drive.execution import Execution
from hpop.drive.options import Option, Options
from hpop.drive.plan import until
from hpop.drive.storage import NOTED, Change, read
from hpop.drive.wishes import NOTICE, PATIENCE
from hpop.errors import CoversRobot, DriveError, HpopError, OptionError, QueryError, UnsupportedModel
from hpop.frontier.choices import Preferring
from hpop.frontier.strict_json import plain
from hpop.planners.base import Planner, PlannerSpec, make_planner
from hpop.planners.needs import refuse_unsupported
from hpop.problems.front import Front, Point, chosen_point, question_of
from hpop.problems.named_rows import named_rows
from hpop.problems.problem import Problem
from hpop.problems.why import planner_of_point
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person
from hpop.world.content.people import person_from

# Time is simulated, so a scripted drive takes only the time of its searches. After each event options are computed; if
# no person chooses one, the robot decides (:meth:`hpop.drive.Execution.adapt`).


WORLD = ("close", "open", "people", "stop")
CHOICES = ("wish", "take")
KINDS = (*WORLD, *CHOICES, "skip", "options")


@dataclass(frozen=True, eq=False)
class Event:
    """An event of a drive: a change of the world, or a choice of the person aboard.

    at     s, time of the drive
    kind   "close", "open", "people" or "stop": a change of the world (:meth:`hpop.drive.Execution.world`); "wish" or
           "take": a choice of the person aboard; "skip": a stop of the tour is left out; "options": options are only
           listed
    value  for "close" and "open": a polygon, or the name of a door; "people": all people present; "stop": a person;
           "wish": its words or shares; "take": an index, "knee" or "least NAME"; "skip": the name of a stop;
           "options": None
    name   name of a closed polygon, by which it can be opened
    """

    at: float
    kind: str
    value: Any = None
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", float(real("at", self.at, 0, MOST, "a time in s", error=DriveError)))
        if self.kind not in KINDS:
            raise DriveError(f"an event must be one of {', '.join(KINDS)}, got {shown(self.kind)}")

    def __str__(self) -> str:
        match self.kind, self.value:
            case (("close" | "open"), str()):
                words = repr(self.value)
            case (("close" | "open"), _):
                words = repr(self.name) if self.name else "an area"
            case "people", people:
                words = f"{len(people)} there now"
            case "stop", Person():
                words = self.value.name or "a person"
            case "wish", Mapping():
                words = ", ".join(f"{name} {share:+.0%}" for name, share in self.value.items())
            case _, None:
                words = ""
            case _:
                words = str(self.value)
        return f"{self.kind}: {words}" if words else self.kind


@dataclass(frozen=True, eq=False)
class Happening:
    """An event, and its effect on the drive.

    change   effect of a change of the world; None for other events, and for a change that was refused
    options  the options after the event
    taken    the option that the robot follows from the next place where the plan may change; None if it keeps its plan
    asked    whether the person aboard chose the option, rather than the robot
    words    description of the choice, or the reason why there is none
    driven   the trajectory up to the event
    before   the plan before the event, from the beginning to the goal
    closed   closed areas after the event
    people   people present, with predictions from the event on
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
def performed(drive: Execution, events: Iterable[Event], *, deadline: float | None = None) -> Iterator[Happening]:
    """Perform a script of events in a drive, and yield the effect of each.

    After an event the robot may also change its plan by itself. ``deadline`` is the processor time for options, s.
    Raises DriveError for events that are out of order or come after the arrival, and the errors of the methods of the
    drive.
    """
    last = 0.0
    for event in events:
        if event.at < last:
            raise DriveError(f"the event at {event.at:g} s comes after one at {last:g} s: list events in order of time")
        last = event.at
        yield _happened(drive, event, deadline)


def _happened(drive: Execution, event: Event, deadline: float | None) -> Happening:
    moment = drive.at(event.at)
    if moment.arrived:
        raise DriveError(
            f"the event at {event.at:g} s comes too late: the robot arrives at {drive.begin + drive.plan.duration:.1f} "
            "s; leave it out, or give it an earlier time"
        )
    driven, before = until(moment.plan, moment.planned), drive.announced
    change, words = None, ""
    if event.kind in WORLD:
        try:
            change = drive.world(event.at, name=event.name, **{event.kind: event.value})
        except CoversRobot as error:  # where the robot is becomes known only now
            words = str(error)
    if event.kind == "skip":
        try:
            drive.skip(event.value, event.at)
        except DriveError as error:  # which stops remain becomes known only now
            words = str(error)
    drive.ready(event.at)  # simulated time waits for the graph
    closed = drive.surroundings.closings
    options = drive.options(event.at, deadline)
    taken = None
    if event.kind in CHOICES:
        taken, words = _chosen(drive, options, event)
    asked = taken is not None
    if asked:
        drive.take(taken)  # type: ignore[arg-type]
    elif change is not None or event.kind == "skip" or options.keep_on is None:  # a robot that waits takes what is open
        taken = drive.adapt(options)
    there = drive.surroundings
    people = tuple(person.later(event.at - there.since) for person in there.people)
    return Happening(event, change, options, taken, asked, words, driven, before, closed, people)


def _chosen(drive: Execution, options: Options, event: Event) -> tuple[Option | None, str]:
    """Return the option that the person aboard chooses, and a description of the choice.

    If there is no such option, return None and the reason.
    """
    if event.kind == "wish":
        value = event.value
        wish = drive.wish(**value) if isinstance(value, Mapping) else drive.wish(value)
        return wish.option, wish.words
    if not len(options):
        return None, f"there is no option to take: {options.certificate}"
    try:
        (row,) = named_rows(options.front, [event.value])
    except OptionError:  # the number of options becomes known only now
        last = len(options) - 1
        there = f"options are numbered 0 to {last:,}" if last else "the only option is 0"
        return None, f"there is no option {shown(event.value)}: {there}"
    option: Option = options[row.number]
    return option, str(row)


# A search that was ended by its deadline cannot be repeated exactly, so the event log has its result.


@checked_arguments
def load(path: str | os.PathLike[str]) -> Execution:
    """Read a drive that :meth:`hpop.drive.Execution.save` wrote, and repeat its events.

    Raises DriveError for any other file, OSError if it cannot be read.
    """
    stored = read(path)
    try:
        problem = Problem.from_description(stored["problem"])
        choice, *ways = MotionTable.from_description(problem.model, stored["ways"]).trajectories()
        drive = Execution(
            problem,
            ways,
            choice,
            make_planner(stored["planner"]),
            begin=stored["begin"],
            patience=stored["patience"],
            notice=stored["notice"],
        )
        for event in stored["events"]:
            tell(drive, event)
    except HpopError as error:
        raise DriveError(f"{path}: {error!s:.600}") from error
    except (TypeError, ValueError, OverflowError, LookupError, AttributeError, ShapelyError) as error:
        raise DriveError(f"{path}: expected the record of a drive: {shown(error)}; save the drive again") from None
    return drive


def tell(drive: Execution, event: Mapping[str, Any]) -> None:
    """Repeat one event of an event log in a drive; DriveError for an invalid event."""
    kind, now = event["event"], event["now"]
    if kind == "seen":
        drive.at(now, event["state"])
    elif kind == "options":
        drive.options_again(now, event["deadline"], event["answer"])
    elif kind == "wish":
        drive.wish(event["wish"], **event["shares"])
    elif kind == "take":
        rest = event["rest"]
        way = None if rest is None else Trajectory.from_description(drive.problem.model, rest)
        drive.take_again(event, way)
    elif kind in ("close", "open"):
        area = event["area"]
        change: dict[str, Any] = {kind: area if isinstance(area, str) else shape(area)}
        drive.world(now, **change, name=event["name"])
    elif kind == "people":
        drive.world(now, people=[person_from(person) for person in event["people"]], groups=event["groups"])
    elif kind == "stop":
        drive.world(now, stop=event["person"])
    elif kind == "skip":
        drive.skip(event["stop"], now)
    elif kind not in NOTED:
        raise DriveError(f"unknown event {shown(kind)} in the record of a drive; save the drive again")


@checked_arguments
def follow(
    problem: Problem,
    front: Front,
    choice: Point | int | str | Preferring,
    *,
    planner: PlannerSpec | None = None,
    begin: float = 0.0,
    patience: float = PATIENCE,
    notice: float = NOTICE,
    waits: bool = True,
) -> Execution:
    """Start a drive along one of the plans of a front.

    Parameters
    ----------
    problem : the problem of the front
    choice : a point of the front, its row, or its name, such as "knee" (:meth:`hpop.Front.named`); or a person's
        preference (:class:`hpop.study.Preference`), by which the robot then also chooses on the way
    planner : provides the graph to search on the way; default: the planner that found the choice, with its options for
        graph and time
    begin : s, when the robot leaves, on the clock of the caller
    patience, notice, waits : see :class:`hpop.drive.Execution`

    Raises QueryError if the front belongs to another problem; DriveError for a choice that is no point of the front,
    for a plan with motions other than turns, straight moves and holds, and for a planner without a graph;
    UnsupportedModel for a robot without straight moves and turns in place (``turn-move``), such as a car, and for a
    planner with a graph that the robot cannot drive.
    """
    if not isinstance(problem, Problem):
        raise DriveError(f"problem must be an hpop.Problem, got {shown(problem)}")
    if not isinstance(front, Front):
        raise DriveError(f"front must be an hpop.Front of trajectories, got {shown(front)}")
    if front.problem is not None and question_of(front.problem) != question_of(plain(problem.describe())):
        raise QueryError(
            "the front belongs to another problem than the one given; give its own problem, "
            "hpop.Problem.from_description(front.problem)"
        )
    if not problem.model.provides >= {"turn-move"}:
        raise UnsupportedModel(
            "a drive needs a robot with straight moves and turns in place (turn-move), between which its plan may "
            f"change; {problem.model.name} lacks them. Execute the plan with trajectory.execution(), and plan again "
            "from where the robot stands"
        )
    preference = choice if isinstance(choice, Preferring) else None
    point = chosen_point(front, choice) if preference is None else front.select(preference=preference)
    made = _planner_of(point.provenance) if planner is None else make_planner(planner)
    refuse_unsupported(made, problem.model)
    options: dict[str, Any] = {"begin": begin, "patience": patience, "notice": notice, "preference": preference}
    return Execution(problem, front.trajectories, point.item, made, **options, waits=waits)


def _planner_of(origin: Mapping[str, Any]) -> Planner:
    """Return the planner that found a point, given the point's provenance, with its options for graph and time."""
    planner = planner_of_point(origin)
    if planner is None:
        raise DriveError(
            f"{shown(origin.get('planner'))} has no graph on which a drive can search; plan with lattice or roadmap, "
            "or in Python give one of them: planner='lattice'"
        )
    return planner
