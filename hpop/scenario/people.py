"""People of a scenario: their positions, predictions, and recorded tracks from files."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel

from hpop.base.text import counted, printable, shown
from hpop.errors import MapError
from hpop.scenario.faults import Faults
from hpop.scenario.schema import FutureEntry, PersonEntry, TrackEntry, WaypointsEntry
from hpop.scenario.yaml_lines import Place, entries
from hpop.world.content.futures import Future
from hpop.world.content.people import Person
from hpop.world.tracks import Track, read_tracks

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
