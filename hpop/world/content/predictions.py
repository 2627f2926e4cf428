"""Predictions that end: nobody walks through walls or off the map, and nobody is predicted for longer than asked.

What a person did, a recorded track, is no prediction and stays as it is. All else is cut where it cannot be true, so
that there is a time after which nothing changes any more, and notes say where it was cut and what is assumed then.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import shapely

from hpop.base.options import MOST
from hpop.base.text import some
from hpop.errors import MapError
from hpop.world.content.people import STANDS, Afterwards, Future, Person
from hpop.world.content.ways import Way

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from hpop.world.world import World

TALL = (0.0, 1.8)
"""Heights, m, at which obstacles are in the way of people."""
DEEP = 0.1
"""m within an obstacle, from which on a person cannot be meant to be there."""
SHIFTED = 0.5
"""m within an obstacle, up to which a person who walks is shifted out of it: trackers are off by as much."""
AWAY = 1e5
"""m: a person so far away matters to nobody."""
MOVED = "shifted to its border"
LEFT_OUT = "left out"
STAYS = "who stand there, as the map or the place is off; they block what they cover"
SAME = 1e-6
"""s; ends nearer than that to each other are the same."""
DIGITS = 9
"""Digits of an end, s: what is beyond is rounding."""
ENDS = {
    "wall": "would walk into an obstacle, and are predicted to stop before it and to stay",
    "map": "leave the map, and are gone from then on",
    "horizon": "are predicted up to the horizon, and {afterwards}",
    "own": "are predicted up to an end of their own, and {afterwards}",
    "recorded": "are recorded up to an end, and {afterwards}",
}
AFTERWARDS = {"gone": "are gone from then on", "stays": "stay where they are then"}


class End(NamedTuple):
    """When a prediction ends, s, why (a key of ENDS), and what is assumed then; whose it is, in words."""

    who: str
    time: float
    why: str
    afterwards: Afterwards


class Inside(NamedTuple):
    """A person who is within an obstacle: who, where, m, and what becomes of them."""

    who: str
    place: tuple[float, float]
    what: str


def bounded(world: World, horizon: float | None = None) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """The people of a world, their predictions cut, and notes on how each ends. Once done it changes nothing more.

    - Who is predicted to walk into an obstacle stops a body's radius of way before it, and stays there.
    - Who leaves the map is gone from then on.
    - No prediction goes beyond a horizon, s, if one is given; then the person is as ``afterwards`` says. Who stands
      stays where he is, as uncertain as then.
    - Who begins to walk within an obstacle is shifted out of it, up to half a metre; who is deeper within is left out.
      Who stands there stays.

    Raises MapError where all who walk, several or one, begin deep within obstacles, and for somebody who stands and
    grows uncertain for ever.
    """
    people, ends, elsewhere = [], list[End](), list[str]()
    world, inside = _outside(world)
    left_out = {one.who for one in inside if one.what == LEFT_OUT}
    for number, person in enumerate(world.content.people):
        who = repr(person.name) if person.name else f"number {number}"
        cut = []
        for place, (weight, hypothesis) in enumerate(person.hypotheses):
            label = f"{who} (future {place})" if person.futures else who
            changed, end = _cut(world, hypothesis, horizon, label)
            cut.append((weight, hypothesis, changed))
            ends += [] if end is None else [end]
        if who not in left_out and not any(_comes(world, hypothesis) for _, hypothesis in person.hypotheses):
            elsewhere.append(who)
        if all(changed is hypothesis for _, hypothesis, changed in cut):
            people.append(person)
        elif person.futures:
            futures = tuple(Future.of(weight, changed) for weight, _, changed in cut)
            people.append(replace(person, futures=futures, until=None))
        else:
            people.append(cut[0][2])
    return tuple(people), (*_notes(ends), *_note_of(elsewhere), *_notes_of_inside(inside))


def with_people(world: World, people: tuple[Person, ...]) -> World:
    """A world whose people are others, in their order; the very same world where they are the same."""
    content = world.content
    if people == content.people:
        return world
    return world.with_content(people=people, groups=content.groups, landmarks=content.landmarks, zones=content.zones)


def _cut(world: World, person: Person, horizon: float | None, who: str) -> tuple[Person, End | None]:
    """One hypothesis with its end; the very same person where nothing is to be changed."""
    if not person.moves:
        return person, None
    if person.velocity == STANDS and person.track is None:
        return _standing(person, horizon, who)
    way = Way.of(person, world.bounds)
    assert way is not None  # somebody walks
    solid = world.solid(*TALL)
    if person.recorded:
        return person, End(who, person.settled, "recorded", person.afterwards)
    ends = [End(who, MOST, "own", person.afterwards)]
    if (entered := way.enters(solid, DEEP)) is not None:
        ends.append(End(who, way.time(max(entered - person.radius, 0.0)), "wall", "stays"))
    if (left := way.leaves(world.extent)) is not None:
        ends.append(End(who, way.time(left), "map", "gone"))
    if horizon is not None:
        ends.append(End(who, horizon, "horizon", person.afterwards))
    end = min(ends, key=lambda end: end.time)
    if person.until is not None and person.until < end.time - SAME:
        end = End(who, person.until, "own", person.afterwards)
    if person.until is None or person.until > end.time + SAME or person.afterwards != end.afterwards:
        person = _ending(person, end)
    return person, end


def _comes(world: World, person: Person) -> bool:
    """Whether somebody is ever on the map, as predicted or recorded."""
    way = Way.of(person, world.bounds)
    line = shapely.Point(person.x, person.y) if way is None else shapely.LineString(way.points)
    return bool(world.extent.intersects(line))


def _ending(person: Person, end: End) -> Person:
    """The person whose prediction has this end."""
    if person.track is not None and end.time <= person.track.begin:  # comes only after the end: never
        return replace(person, track=None, until=0.0, afterwards="gone")
    return replace(person, until=round(end.time, DIGITS), afterwards=end.afterwards)


def _standing(person: Person, horizon: float | None, who: str) -> tuple[Person, End | None]:
    """Who stands, and leaves at some time or is ever less surely there; the horizon ends the latter only."""
    leaves = person.until is not None and person.afterwards == "gone"
    if leaves and person.until == 0.0:
        return person, None
    if person.until is None and horizon is None:
        raise MapError(
            f"person {who} stands, and is ever less surely there (growth {person.growth:g} m/s): give a time when the "
            "prediction ends (until), or a horizon."
        )
    if horizon is not None and not leaves and (person.until is None or person.until > horizon + SAME):
        return replace(person, until=horizon, afterwards="stays"), End(who, horizon, "horizon", "stays")
    assert person.until is not None  # or the horizon would have ended it
    return person, End(who, person.until, "own", person.afterwards)


def _outside(world: World) -> tuple[World, list[Inside]]:
    """The world whose people who walk begin outside of obstacles, and who was within one.

    Raises MapError where nobody who walks begins outside of obstacles or near their border.
    """
    solid, inside, people = world.solid(*TALL), list[Inside](), list[Person]()
    walking = outside = 0
    for number, person in enumerate(world.content.people):
        who = repr(person.name) if person.name else f"number {number}"
        places = [(one.x, one.y) for _, one in person.hypotheses if one.moves] or [(person.x, person.y)]
        shifts = [_way_out(solid, place) for place in places]
        x, y = max(shifts, key=lambda shift: math.hypot(*shift))
        deep = math.hypot(x, y)
        walks = person.speed > 0.0
        walking, outside = walking + walks, outside + (walks and deep <= SHIFTED)
        if not walks:
            if shapely.contains_xy(solid, person.x, person.y):
                inside.append(Inside(who, places[0], STAYS))
        elif deep > SHIFTED:
            inside.append(Inside(who, places[0], LEFT_OUT))
            person = Person(person.x + AWAY, person.y, radius=person.radius, name=person.name)
        elif deep > 0.0:
            inside.append(Inside(who, places[0], MOVED))
            person = person.shifted(x, y)
        people.append(person)
    if walking and not outside:
        one = next(one for one in inside if one.what == LEFT_OUT)
        raise MapError(
            f"person {one.who} begins at ({one.place[0]:.4g}, {one.place[1]:.4g}), within an obstacle"
            f"{', as all do' if walking > 1 else ''}. People who walk begin where there is room: check the place, and "
            "that the map and the track have the same origin, axes and unit."
        )
    return with_people(world, world.content.people if not inside else tuple(people)), inside


def _way_out(solid: BaseGeometry, place: tuple[float, float]) -> tuple[float, float]:
    """By how much, m, a place within an obstacle is shifted out of it; nothing up to ``DEEP`` within."""
    here = shapely.Point(place)
    if not solid.contains(here) or solid.boundary.distance(here) <= DEEP:
        return 0.0, 0.0
    out = shapely.shortest_line(here, solid.boundary).coords[1]
    return out[0] - here.x, out[1] - here.y


def _notes_of_inside(inside: Sequence[Inside]) -> Iterable[str]:
    """A note for each thing that becomes of people within obstacles."""
    for what in dict.fromkeys(one.what for one in inside):
        those = [f"{one.who} at ({one.place[0]:.4g}, {one.place[1]:.4g})" for one in inside if one.what == what]
        yield f"people within an obstacle, {what}: {some(those)}"


def _notes(ends: Iterable[End]) -> Iterable[str]:
    """A note for each way in which predictions end."""
    several = dict[tuple[str, str], list[End]]()
    for end in ends:
        several.setdefault((end.why, end.afterwards), []).append(end)
    for (why, afterwards), those in several.items():
        words = ENDS[why].format(afterwards=AFTERWARDS[afterwards])
        yield f"people who {words}: {some([f'{end.who} after {end.time:.3g} s' for end in those])}"


def _note_of(elsewhere: Sequence[str]) -> Iterable[str]:
    """A note on those who are never on the map."""
    if elsewhere:
        why = "which may have another origin, other axes or another unit"
        yield f"people who are never on the map, {why}: {some(elsewhere)}"
