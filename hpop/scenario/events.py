"""Events of a simulated drive, read from YAML; errors name the entry, the line and the fix.

::

    choice: knee                            # row to drive: knee, least NAME, or a number [knee]
    events:
      - {at: 4, close: east door}           # a named zone of the map; or corners, m, with a name
      - {at: 6, close: [[3, 2], [4, 2], [4, 3]], name: wet floor}
      - {at: 8, stop: Ada}                  # stands from now on
      - {at: 9, people: [{x: 8, y: 5, velocity: [-0.8, 0]}]}    # all people from now on, as in a scenario
      - {at: 11, wish: fewer turns}         # or hurry, or shares of costs: {duration: -0.2}
      - {at: 12, take: least length}        # one of the options: knee, least NAME, or its number
      - {at: 13, skip: the vase}            # a stop of the tour that is left out
      - {at: 14, open: wet floor}
      - {at: 15, options: true}             # only show the options

Times are seconds since the robot left, in order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import BaseModel, Field
from shapely.geometry import Polygon

from hpop.base.text import shown
from hpop.drive.script import KINDS, Event
from hpop.drive.surroundings import DriveSurroundings
from hpop.drive.wishes import HURRY, checked_wish
from hpop.errors import DriveError, HpopError, did_you_mean
from hpop.problems.named_rows import name_meant
from hpop.scenario.faults import Faults
from hpop.scenario.people import people_of
from hpop.scenario.schema import STRICT, Entry, Point
from hpop.scenario.yaml_lines import Document, Place

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


class EventEntry(BaseModel):
    """Event of a drive: a time, s, and exactly one action."""

    model_config = STRICT
    at: float = Field(ge=0)
    close: str | list[Point] | None = None
    open: str | None = None
    people: list[Entry] | None = None
    stop: str | int | None = None
    wish: str | dict[str, float] | None = None
    take: str | int | None = None
    skip: str | None = None
    options: Literal[True] | None = None
    name: str = ""


class EventsFile(BaseModel):
    """Keys of an events file: the trajectory to drive, and the events."""

    model_config = STRICT
    choice: str | int = "knee"
    events: list[Entry] = Field(min_length=1)


class Script(NamedTuple):
    """Trajectory to drive, and the events on the way.

    choice  a name or number of a front's row
    events  in order of time
    notes   notes (texts to print) on files that the events name
    """

    choice: str | int
    events: tuple[Event, ...]
    notes: tuple[str, ...] = ()


def load_events(path: str | Path, problem: Problem | None = None, names: Sequence[str] = ()) -> Script:
    """Read and check an events file; an error, mostly ScenarioError, lists all faults by line.

    If ``problem`` and the names of its front's costs are given, doors, people, stops and costs that the drive does not
    know are faults too.
    """
    document = Document(Path(path))
    faults = Faults(document)
    file = faults.validated(EventsFile, document.values, ())
    given = document.values.get("events")
    made = faults.made(given, ("events",), EventEntry, partial(_event, faults))
    faults.raise_all()
    events = [event for event in made if event is not None]
    for i in range(1, len(events)):
        if events[i].at < events[i - 1].at:
            faults.add(
                ("events", i, "at"),
                f"{events[i].at:g} s comes before the event above, at {events[i - 1].at:g} s; list them in order",
            )
    faults.raise_all()
    if problem is not None:
        _know(faults, events, problem, names)
        faults.raise_all()
    return Script(file.choice, tuple(events), tuple(faults.notes))


def _know(faults: Faults, events: Sequence[Event], problem: Problem, names: Sequence[str]) -> None:
    """Add a fault for each door, person, stop or cost that is unknown at the time of its event."""
    there = DriveSurroundings.of(problem, 0.0)
    for i, event in enumerate(events):
        place = ("events", i, event.kind)
        try:
            match event.kind:
                case "close":
                    there = there.close(event.at, event.value, event.name)
                case "open":
                    there = there.open(event.at, event.value)
                case "people":
                    there = there.with_people(event.at, event.value)
                case "stop":
                    there = there.stop(event.at, event.value)
                case "wish":
                    shares = event.value if isinstance(event.value, Mapping) else {}
                    checked_wish(None if shares else event.value, shares, names)
                    if event.value == HURRY and "duration" not in names:
                        faults.add(
                            place,
                            f"'hurry' needs the cost duration, but the front has {', '.join(names)}; plan with it",
                        )
                case "skip":
                    names_of_stops = () if problem.tour is None else problem.tour.names
                    if event.value not in names_of_stops:
                        hint = did_you_mean(event.value, names_of_stops)
                        known = ", ".join(names_of_stops) or "none, as the front has no tour"
                        faults.add(
                            place, f"no stop is called {shown(event.value)}.{hint} The stops are {known}", DriveError
                        )
                case "take" if isinstance(event.value, str) and not event.value.isdigit():
                    name_meant(["knee", *(f"least {name}" for name in names)], event.value)
        except HpopError as error:
            faults.add(place, str(error), type(error))


def _event(faults: Faults, entry: EventEntry, place: Place) -> Event | None:
    """Build an event from its entry; None after noting a fault."""
    given = [kind for kind in KINDS if getattr(entry, kind) is not None]
    if len(given) != 1:
        faults.add(place, f"give exactly one of {', '.join(KINDS)}; got {' and '.join(given) or 'none'}")
        return None
    (kind,) = given
    if entry.name and not isinstance(entry.close, list):
        faults.add((*place, "name"), "only an area given by corners (close: [[x, y], ...]) has a name; leave it out")
        return None
    return Event(entry.at, kind, _value(faults, kind, getattr(entry, kind), place), entry.name)


def _value(faults: Faults, kind: str, value: Any, place: Place) -> Any:
    """Convert the value of an event: an area to a polygon, people to persons; "options" has none, others stay."""
    match kind:
        case "close":
            return _area(faults, value, place)
        case "people":
            found = people_of(faults, value, (*place, "people"))
            return tuple(person for entry in found for person in entry or ())
        case "options":
            return None
    return value


def _area(faults: Faults, value: Any, place: Place) -> Any:
    """Convert the value of `close` to a polygon, or keep it if it is the name of a zone."""
    if isinstance(value, str):
        return value
    if len(value) < 3:
        faults.add((*place, "close"), f"expected three or more corners [x, y] in m, got {len(value)}")
        return None
    return Polygon(value)
