"""Cut predictions of people at walls, at the edge of the map, at a horizon, and before a standing robot.

A prediction is cut where it becomes impossible, so that after some time no person moves any more. Recorded tracks are
not cut. Notes (warnings to print) say where each prediction was cut, and whether the person then stays or is gone.

A prediction ignores the robot. A person predicted to approach slowly would walk through the robot, and a robot that
must turn before it can leave would have no path. Such a person is therefore assumed to stop before the robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import MOST
from hpop.base.text import some
from hpop.errors import MapError
from hpop.world.content.futures import STANDS, Afterwards, Future
from hpop.world.content.people import Person

if TYPE_CHECKING:
    from hpop.world.world import World

TOUCH = 1e-9
"""Length, m, of a part of a path inside (outside) an area up to which the path only touches (does not leave) it."""

Span = tuple[float, float]
TALL = (0.0, 1.8)
"""Range of heights, m, in which obstacles stop people."""
DEEP = 0.1
"""Depth within an obstacle, m, up to which a person counts as standing beside it: a small error of the position."""
SHIFTED = 0.5
"""Depth within an obstacle, m, up to which a walking person is moved out of it: the error of a tracker."""
AWAY = 1e5
"""Distance, m, by which people who are left out are moved away, so that they affect nothing."""
MOVED = "shifted to its border"
LEFT_OUT = "left out"
STAYS = "who stand there: the map or their position must be wrong; they stay and block the space that they cover"
SAME = 1e-6
"""Difference, s, up to which two times count as equal."""
DIGITS = 9
"""Decimal places to which the end of a prediction, s, is rounded."""
ENDS = {
    "wall": "would walk into an obstacle, and are predicted to stop before it and to stay",
    "map": "leave the map, and are gone from then on",
    "horizon": "are predicted up to the horizon, and {afterwards}",
    "own": "have a prediction that ends, and {afterwards}",
    "recorded": "have a recording that ends, and {afterwards}",
}
AFTERWARDS = {"gone": "are gone from then on", "stays": "stay where they are then"}
GAP = 0.02
"""Distance, m, between a person who stops for the robot and the space that the robot needs."""
WITHIN = 5.0
"""Time, s, that a robot gets to leave its position: people who reach it later are not assumed to stop."""
STEP = 0.01  # s between the moments at which contact is looked for
SIGMAS = 1.645  # standard deviations by which a person of uncertain position stops earlier


@dataclass(frozen=True, eq=False)
class WalkedPath:
    """Predicted path of a walking person: straight segments between points with times.

    times   (N,)    s  when the person is at each point
    points  (N, 2)  m
    """

    times: FloatArray
    points: FloatArray

    @classmethod
    def of(cls, person: Person, bounds: tuple[float, float, float, float]) -> WalkedPath | None:
        """Return the path of a person with one future: the track from time 0, or a line to beyond the bounds, m.

        Return None if the person stands.
        """
        if person.track is not None:
            track = person.track.later(0.0)
            points = np.stack([track.x, track.y], axis=1)
            if track.begin < 0:
                points[0] = person.x, person.y
            return cls(np.maximum(track.times, 0.0), points)
        if person.velocity == STANDS:
            return None
        x0, y0, x1, y1 = bounds
        here, middle = np.array([person.x, person.y]), np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        time = (2 * math.hypot(x1 - x0, y1 - y0) + math.dist(here, middle)) / person.speed
        return cls(np.array([0.0, time]), np.stack([here, here + time * np.array(person.velocity)]))

    @cached_property
    def lengths(self) -> FloatArray:
        """Return the distance (N,), m, of each point from the start, along the path."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))])

    def time(self, length: float) -> float:
        """Return the time, s, at a distance along the path, m."""
        leg = int(np.searchsorted(self.lengths, length, side="left"))
        if leg == 0:
            return float(self.times[0])
        leg = min(leg, self.times.size - 1)
        share = (length - self.lengths[leg - 1]) / (self.lengths[leg] - self.lengths[leg - 1])
        return float(self.times[leg - 1] + min(share, 1.0) * (self.times[leg] - self.times[leg - 1]))

    def enters(self, area: BaseGeometry, beyond: float = 0.0) -> float | None:
        """Return the distance along the path, m, at which it first enters an area; None if it never does.

        A path along the border does not enter. A part inside that ends within the first ``beyond`` m is ignored: such a
        person starts inside and steps out.
        """
        for begin, end in self._spans(area):
            if end > beyond and shapely.contains_xy(area, *self._place((begin + end) / 2)):
                return begin
        return None

    def leaves(self, area: BaseGeometry) -> float | None:
        """Return the distance along the path, m, where it first leaves an area: 0 if never inside, None if it stays."""
        spans = self._spans(area)
        if not spans:
            stays = self.lengths[-1] == 0.0 and area.covers(shapely.Point(self.points[0]))
            return None if stays else 0.0
        left = spans[0][1]
        for begin, end in spans[1:]:
            if begin > left + TOUCH:
                break
            left = max(left, end)
        return None if left >= self.lengths[-1] - TOUCH else left

    def _place(self, length: float) -> tuple[float, float]:
        x, y = (float(np.interp(length, self.lengths, column)) for column in self.points.T)
        return x, y

    def _spans(self, area: BaseGeometry) -> list[Span]:
        """Return the parts of the path inside an area or on its border: sorted (begin, end) distances along it, m."""
        legs = np.stack([self.points[:-1], self.points[1:]], axis=1)  # (N-1, 2, 2)
        lines: Any = shapely.linestrings(legs)
        shapely.prepare(area)
        steps = np.diff(self.lengths)
        covered: Any = shapely.covers(area, lines)
        near: BoolArray = np.asarray(shapely.intersects(area, lines)) & (steps > 0)
        spans = list[Span]()
        for leg in np.flatnonzero(near).tolist():
            begin, length = float(self.lengths[leg]), float(steps[leg])
            if covered[leg]:
                spans.append((begin, begin + length))
                continue
            ahead = (legs[leg, 1] - legs[leg, 0]) / length
            for part in shapely.get_parts(shapely.intersection(lines[leg], area)):
                along = (shapely.get_coordinates(part) - legs[leg, 0]) @ ahead
                if along.max() - along.min() > TOUCH:
                    spans.append((begin + float(along.min()), begin + float(along.max())))
        return sorted(spans)


class End(NamedTuple):
    """End of a prediction: name of the person, time, s, reason (a key of ENDS), and "stays" or "gone" from then on."""

    who: str
    time: float
    why: str
    afterwards: Afterwards


class Inside(NamedTuple):
    """Person found within an obstacle: name, position, m, and the treatment (such as `MOVED`) in words for a note."""

    who: str
    place: tuple[float, float]
    what: str


def bounded(world: World, horizon: float | None = None) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Cut the predictions of a world's people where they become impossible.

    Return the people, and notes (warnings to print) on the ends of their predictions.

    - A person predicted to walk into an obstacle stops a body's radius before it, and stays there.
    - A person who leaves the map is gone from then on.
    - With a horizon, s, only recordings go beyond it. A walking person is then gone or stays, as its ``afterwards``
      says. A standing person stays, and its uncertainty grows no further.
    - A walking person who begins within an obstacle is shifted out of it by up to half a metre, or left out if deeper
      inside. A person who stands within an obstacle stays.

    Calling the function again with its own result changes nothing. Raises MapError if all walking people begin deep
    within obstacles, or if the position of a standing person becomes ever more uncertain without end.
    """
    if not world.content.people:
        return (), ()
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
    why = "people who are never on the map, which may have another origin, other axes or another unit: "
    never = [why + some(elsewhere)] if elsewhere else []
    return tuple(people), (*_notes(ends), *never, *_notes_of_inside(inside))


def with_people(world: World, people: tuple[Person, ...]) -> World:
    """Return the world with its people replaced by others in the same order; the same object if nothing changes."""
    content = world.content
    if people == content.people:
        return world
    return world.with_content(people=people, groups=content.groups, landmarks=content.landmarks, zones=content.zones)


def _cut(world: World, person: Person, horizon: float | None, who: str) -> tuple[Person, End | None]:
    """Cut the prediction of a person with one future.

    Return the person (the same object if nothing changes) and the end of the prediction. The end is None for a person
    who never changes.
    """
    if not person.moves:
        return person, None
    if person.velocity == STANDS and person.track is None:
        return _standing(person, horizon, who)
    way = WalkedPath.of(person, world.bounds)
    assert way is not None  # the person walks
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
    """Return whether the predicted or recorded path of a person crosses the map."""
    way = WalkedPath.of(person, world.bounds)
    line = shapely.Point(person.x, person.y) if way is None else shapely.LineString(way.points)
    return bool(world.extent.intersects(line))


def _ending(person: Person, end: End) -> Person:
    """Return the person with the prediction cut at the given end."""
    if person.track is not None and end.time <= person.track.begin:  # comes only after the end: never
        return replace(person, track=None, until=0.0, afterwards="gone")
    return replace(person, until=round(end.time, DIGITS), afterwards=end.afterwards)


def _standing(person: Person, horizon: float | None, who: str) -> tuple[Person, End | None]:
    """Cut the prediction of a standing person who leaves later, or whose position becomes more uncertain.

    Return the person and the end of the prediction. A horizon only ends the growth of the uncertainty; the person
    stays.
    """
    leaves = person.until is not None and person.afterwards == "gone"
    if leaves and person.until == 0.0:
        return person, None
    if person.until is None and horizon is None:
        raise MapError(
            f"person {who} stands, but its position becomes ever more uncertain (growth {person.growth:g} m/s): give "
            "a time when the prediction ends (until), or a horizon."
        )
    if horizon is not None and not leaves and (person.until is None or person.until > horizon + SAME):
        return replace(person, until=horizon, afterwards="stays"), End(who, horizon, "horizon", "stays")
    assert person.until is not None  # or the horizon would have ended it
    return person, End(who, person.until, "own", person.afterwards)


def _outside(world: World) -> tuple[World, list[Inside]]:
    """Return the world with walking people shifted out of obstacles, and a list of all people who were within one.

    Walking people deep inside are left out: they keep their index, but stand ``AWAY`` m away. Standing people stay.
    Raises MapError if all walking people begin deep inside.
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
            f"{', and so do all the others' if walking > 1 else ''}. People who walk must begin in free space: check "
            "the position, and that the map and the track have the same origin, axes and unit."
        )
    return with_people(world, world.content.people if not inside else tuple(people)), inside


def _way_out(solid: BaseGeometry, place: tuple[float, float]) -> tuple[float, float]:
    """Return the shift (x, y), m, to the border from a place over ``DEEP`` m inside an obstacle; (0, 0) elsewhere."""
    here = shapely.Point(place)
    if not solid.contains(here) or solid.boundary.distance(here) <= DEEP:
        return 0.0, 0.0
    out = shapely.shortest_line(here, solid.boundary).coords[1]
    return out[0] - here.x, out[1] - here.y


def _notes_of_inside(inside: Sequence[Inside]) -> Iterable[str]:
    """Yield a note (a warning to print) for each way in which people within obstacles were treated."""
    for what in dict.fromkeys(one.what for one in inside):
        those = [f"{one.who} at ({one.place[0]:.4g}, {one.place[1]:.4g})" for one in inside if one.what == what]
        yield f"people within an obstacle, {what}: {some(those)}"


def _notes(ends: Iterable[End]) -> Iterable[str]:
    """Yield a note (a warning to print) for each reason why predictions end, with the people concerned."""
    several = dict[tuple[str, str], list[End]]()
    for end in ends:
        several.setdefault((end.why, end.afterwards), []).append(end)
    for (why, afterwards), those in several.items():
        words = ENDS[why].format(afterwards=AFTERWARDS[afterwards])
        yield f"people who {words}: {some([f'{end.who} after {end.time:.3g} s' for end in those])}"


def yielding(person: Person, place: tuple[float, float], reach: float, begin: float = 0.0) -> Person:
    """Return the person, stopped before a standing robot if predicted to reach it; otherwise the same object.

    Parameters
    ----------
    place : (x, y) m, position of the robot
    reach : m, radius of the space that the robot needs: its body, the margin, and its tracking error
    begin : s, when the robot begins to stand there; a person who arrives more than ``WITHIN`` later does not stop
    """
    if not person.futures:
        return _stopped(person, place, reach, begin)
    each = [(weight, one, _stopped(one, place, reach, begin)) for weight, one in person.hypotheses]
    if all(stopped is one for _, one, stopped in each):
        return person
    return replace(person, futures=tuple(Future.of(weight, stopped) for weight, _, stopped in each), until=None)


def with_stops(
    people: Sequence[Person], which: Sequence[int], place: tuple[float, float], reach: float
) -> tuple[Person, ...]:
    """Return all people; those with indices ``which`` stop before a robot that stands from now on, see `yielding`."""
    return tuple(yielding(person, place, reach) if i in which else person for i, person in enumerate(people))


def taken_to_stop(people: Sequence[Person], which: Sequence[int]) -> str:
    """Return a note that names the people, given by index, who are assumed to stop before the robot."""
    who = some([repr(people[i].name) if people[i].name else f"number {i}" for i in which])
    return f"people who would reach the robot before it can leave, and are taken to stop before it: {who}"


def _stopped(person: Person, place: tuple[float, float], reach: float, begin: float) -> Person:
    """Return a person with one future, stopped before the robot if predicted to reach it; see `yielding`."""
    if person.velocity == STANDS and person.track is None:
        return person
    times = np.arange(0.0, begin + WITHIN, STEP)
    x, y = (np.broadcast_to(column, times.shape) for column in person.at(times))
    apart = np.hypot(x - place[0], y - place[1])
    near = apart < reach + person.radius + GAP + SIGMAS * np.asarray(person.deviation(times))
    near &= np.broadcast_to(person.there(times), times.shape) > 0.0
    comes = near & (times >= begin) & np.append(np.diff(apart) < 0.0, False)
    if not comes.any():
        return person
    before = np.flatnonzero(~near[: int(np.argmax(comes))])
    until = float(times[before[-1]]) if before.size else 0.0
    return replace(person, until=max(until, person.begin), afterwards="stays")
