"""People and events of a scenario, read from YAML.

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
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import BaseModel, Field
from shapely.geometry import Polygon

from hpop.base.text import counted, printable, shown
from hpop.drive.script import KINDS, Event
from hpop.drive.surroundings import DriveSurroundings
from hpop.drive.wishes import HURRY, checked_wish
from hpop.errors import DriveError, HpopError, MapError, did_you_mean
from hpop.problems.named_rows import name_meant
from hpop.scenario.faults import Faults
from hpop.scenario.schema import STRICT, Entry, FutureEntry, PersonEntry, Point, TrackEntry, WaypointsEntry
from hpop.scenario.yaml_lines import Document, Place, entries
from hpop.world.content.futures import Future
from hpop.world.content.people import Person
from hpop.world.tracks import Track, read_tracks

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


BESIDE = frozenset({"track", "frame_rate", "unit", "format", "id", "begin", "waypoints"})
"""Keys of an entry that select or describe a track, and are not attributes of a person."""

FORMS: dict[str, type[BaseModel]] = {"track": TrackEntry, "waypoints": WaypointsEntry}
ALIKE = 0.8  # similarity from which on a word counts as a misspelling

People = tuple[Person, ...]


def people_of(faults: Faults, given: Any, within: Place = ("people",)) -> list[People | None]:
    """Build the people of each entry in a list, in order; None for an entry with a fault, which is collected."""
    found: list[People | None] = []
    for place, entry in (((*within, i), entry) for i, entry in enumerate(entries(given))):
        found.append(None)
        checked = faults.validated(form_of(entry), entry, place) if isinstance(entry, dict) else None
        if checked is not None:
            with faults.collected(place):
                found[-1] = _people(faults, checked, place)
    return found


def form_of(entry: dict[str, Any]) -> type[BaseModel]:
    """Return the schema that fits the keys of an entry (recorded, waypoints, or other), even if a key is misspelt."""
    return next((form for key, form in FORMS.items() if get_close_matches(key, map(str, entry), 1, ALIKE)), PersonEntry)


def groups_of(faults: Faults, given: Any, people: Sequence[People | None]) -> list[list[int]]:
    """Return the members of each group as indices among all people; the file gives indices of entries, or names."""
    everyone = [person for entry in people for person in entry or (None,)]
    first = [sum(len(entry or (None,)) for entry in people[:i]) for i in range(len(people))]
    names = [person.name if person else "" for person in everyone]
    groups: list[list[int]] = []
    for i, group in enumerate(entries(given)):
        groups.append([])
        for j, member in enumerate(entries(group)):
            where = [k for k, name in enumerate(names) if name and name == member]
            if type(member) is int and 0 <= member < len(people):
                if len(people[member] or (None,)) > 1:
                    faults.add(("groups", i, j), f"entry {member} is {len(people[member] or ())} people; give a name")
                groups[-1].append(first[member])
            elif len(where) == 1:
                groups[-1] += where
            elif isinstance(member, int | str) and not (isinstance(member, str) and None in everyone):
                faults.add(("groups", i, j), _unknown(member, names, len(people), len(where)))
    return groups


def _people(faults: Faults, entry: BaseModel, place: Place) -> People:
    """Build the people of one entry; a recorded track may have several."""
    said = {key: getattr(entry, key) for key in entry.model_fields_set - BESIDE}
    match entry:
        case TrackEntry():
            return _recorded(faults, entry, said)
        case WaypointsEntry():
            return (Person.along(Track.through(entry.waypoints), **said),)
        case PersonEntry():
            said["futures"] = tuple(_future(future) for future in entry.futures)
            if entry.yaw is not None:
                said["yaw"] = faults.angle(entry.yaw, (*place, "yaw"), "a yaw")
            return (Person(**said),)
    raise AssertionError(entry)  # there is no other form


def _future(entry: FutureEntry) -> Future:
    """Build one possible future of a person."""
    said = {key: getattr(entry, key) for key in entry.model_fields_set - BESIDE}
    return Future(**said, track=None if entry.waypoints is None else Track.through(entry.waypoints))


def _recorded(faults: Faults, entry: TrackEntry, said: dict[str, Any]) -> People:
    """Return the people in a track file who are present in the time span of an entry."""
    ids = [entry.id] if isinstance(entry.id, int | str) else entry.id
    path = faults.beside(entry.track)
    tracks = read_tracks(path, entry.frame_rate, entry.unit, entry.format, ids)
    faults.notes += tracks.notes
    people = []
    for one, whole in tracks.items():
        track = whole.later(entry.begin) if entry.begin else whole
        if track.end > 0 and (entry.until is None or track.begin < entry.until):
            name = entry.name if entry.name and len(tracks) == 1 else f"{entry.name} {one}".strip()
            people.append(Person.along(track, **{**said, "name": name}))
    if not people:
        begin, end = min(track.begin for track in tracks.values()), max(track.end for track in tracks.values())
        asked = " on" if entry.until is None else f" to {entry.begin + entry.until:g} s"
        raise MapError(
            f"no person of {shown(entry.track)} is present from {entry.begin:g} s{asked}: its "
            f"{counted(len(tracks), 'track')} go from {begin:g} to {end:g} s; set begin to a time within them."
        )
    return tuple(people)


def _unknown(member: int | str, names: Sequence[str], places: int, times: int) -> str:
    """Return the message for a member of a group that names no person, or more than one.

    places  number of entries in the list of people, which the indices count
    times   number of people with that name
    """
    known = ", ".join(name for name in names if name)
    where = f"indices are 0 to {places - 1}" if places else "there are no people"
    if times > 1:
        return f"{times} people are called {shown(member)}; give the index of one of them ({where})"
    return f"expected a person's index or name, got {shown(member)}; {where}" + (
        f", names are {printable(known)}" if known else ""
    )


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
