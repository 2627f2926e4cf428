"""The changing world of a drive: doors that close and open, and people who come, go and stop.

Times of the drive are on the clock of the caller, s.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.base.text import is_whole, shown
from hpop.drive.closings import Closing, named_areas, to_close, to_open
from hpop.drive.drive_graph import OF_PEOPLE
from hpop.errors import DriveError, did_you_mean
from hpop.models.execution import clearance_radius
from hpop.motions import States
from hpop.world import Person, World
from hpop.world.content.content import Content
from hpop.world.content.predictions import taken_to_stop, yielding

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

GONE = 1e5  # m: a person that far away has no effect


def bare(world: World) -> World:
    """Return a world without its people and named keep-out zones, because these may change during a drive."""
    content = world.content
    zones = tuple(zone for zone in content.zones if not (zone.kind == "keep-out" and zone.name))
    if not content.people and len(zones) == len(content.zones):
        return world
    return world.with_content(landmarks=content.landmarks, zones=zones)


@dataclass(frozen=True, eq=False)
class DriveSurroundings:
    """The world of a drive from some time on, and the problem of the drive in it.

    problem   problem in this world; its time begins at `since`
    bare      the world without people and without named keep-out zones
    closings  areas that are closed now, except the bodies of standing people
    areas     all areas with a name: zones of the map, and areas closed during the drive
    since     s, time of the drive at which the predictions of people begin
    bodies    closed areas of the standing people
    margin    m, distance to keep from people
    stopping  notes (warnings to print) on people who are predicted to stop before the robot, so that a path is open
    """

    problem: Problem
    bare: World
    closings: tuple[Closing, ...]
    areas: dict[str, BaseGeometry]
    since: float
    bodies: dict[Person, Closing]
    margin: float = 0.0
    stopping: tuple[str, ...] = ()

    @classmethod
    def of(cls, problem: Problem, since: float, margin: float = 0.0) -> DriveSurroundings:
        """Return the surroundings at the start of a drive; named keep-out zones of the problem are closed at first."""
        zones = problem.world.content.zones
        closings = tuple(Closing(z.area, z.name) for z in zones if z.kind == "keep-out" and z.name)
        people = problem.world.content.people
        bodies = _bodies(people, {}, margin, problem.world.extent)
        return cls(problem, bare(problem.world), closings, named_areas(problem.world), since, bodies, margin)

    @property
    def people(self) -> tuple[Person, ...]:
        """The people, as predicted."""
        return self.problem.world.content.people

    @property
    def moving(self) -> bool:
        """True if any person is predicted to move."""
        return any(person.moves for person in self.people)

    @property
    def closed(self) -> tuple[Closing, ...]:
        """All areas closed to the robot: doors and other areas that were closed, and the bodies of standing people."""
        return (*self.closings, *self.bodies.values())

    def at(self, state: States, now: float) -> Problem:
        """Return the problem with a state (1,), at a time of the drive, s, as its start."""
        return self.problem.at(self.problem.model.space.values(state), max(0.0, now - self.since))

    def touched(self, state: States, now: float) -> bool:
        """Return whether any person is within the clearance that a robot in a state (1,) needs, at a time, s."""
        near, x, y = clearance_radius(self.problem.model, self.margin), float(state.x[0]), float(state.y[0])
        return any(math.hypot(p.x - x, p.y - y) < near + p.radius for p in self._people_at(now))

    def predicted(self, now: float) -> tuple[Person, ...]:
        """Return the people as predicted for time ``now``, s: the same as those of the problem :meth:`at` that time."""
        return tuple(person.later(max(0.0, now - self.since)) for person in self.people)

    # Changes

    def changed(self, now: float, what: str, value: Any, name: str, groups: Any) -> DriveSurroundings:
        """Return the surroundings after one change ``what``: "close", "open", "people" or "stop".

        value   an area to close or open, all people present, or the person who stops
        name    name of an area that is closed, by which it can be opened; "" for none
        groups  indices of the people in each group that talks together
        """
        match what:
            case "close":
                return self.close(now, value, name)
            case "open":
                return self.open(now, value)
            case "people":
                return self.with_people(now, value, groups)
        return self.stop(now, value)

    def close(self, now: float, area: Any, name: str) -> DriveSurroundings:
        """Return the surroundings with an area closed, given by name or as a polygon; DriveError otherwise."""
        closing = to_close(area, name, self.areas, self.closings)
        if not closing.area.intersects(self.bare.extent):
            x_min, y_min, x_max, y_max = self.bare.bounds
            raise DriveError(
                f"{closing} is not on the map, which is from ({x_min:g}, {y_min:g}) to ({x_max:g}, {y_max:g}) m; give "
                "an area on the map"
            )
        areas = {**self.areas, closing.name: closing.area} if closing.name else self.areas
        return self._changed(*self._as_predicted(now), closings=(*self.closings, closing), areas=areas)

    def open(self, now: float, area: Any) -> DriveSurroundings:
        """Return the surroundings with an area opened, given by name or polygon; DriveError if it is not closed."""
        opened = to_open(area, self.areas, self.closings)
        return self._changed(*self._as_predicted(now), closings=tuple(c for c in self.closings if c not in opened))

    def with_people(
        self, now: float, people: Iterable[Person], groups: Iterable[Iterable[int]] = ()
    ) -> DriveSurroundings:
        """Return the surroundings with other people, predicted from now on.

        groups  indices of the people in each group that talks together
        """
        given = tuple(people) if isinstance(people, Iterable) and not isinstance(people, str) else None
        if given is None or not all(isinstance(person, Person) for person in given):
            raise DriveError(
                f"people must be a list of all people present, each hpop.world.Person; got {shown(people)}"
            )
        if not given and any(OF_PEOPLE & {*criterion.requires} for criterion in self.problem.criteria):
            given, groups = tuple(_gone(person) for person in self.people), self.problem.world.content.groups
        return self._changed(now, given, groups=groups)

    def stop(self, now: float, person: Any) -> DriveSurroundings:
        """Return the surroundings in which one person, given by name or index, stands from now on."""
        place = self._place_of(person)
        people = list(self._people_at(now))
        people[place] = _standing(people[place])
        return self._changed(now, tuple(people))

    def with_people_who_stop(self, states: States, times: FloatArray) -> DriveSurroundings | None:
        """Return the surroundings in which people stop before a robot that comes to the states (n,).

        Return None if no person comes there soon. Predictions begin at the same time as before.

        Parameters
        ----------
        times : (n,) s, of the drive, at which the robot comes to each state
        """
        reach = clearance_radius(self.problem.model, self.margin)
        people = self.people
        begins = np.maximum(times - self.since, 0.0).tolist()
        for x, y, begin in zip(states.x.tolist(), states.y.tolist(), begins, strict=True):
            people = tuple(yielding(person, (x, y), reach, begin) for person in people)
        stopped = [i for i, person in enumerate(people) if person is not self.people[i]]
        if not stopped:
            return None
        at_once = (person.moves and person.until == 0.0 and person.afterwards == "stays" for person in people)
        people = tuple(_standing(person) if stops else person for person, stops in zip(people, at_once, strict=True))
        return replace(self._changed(self.since, people), stopping=(taken_to_stop(self.people, stopped),))

    def _place_of(self, person: Any) -> int:
        """Return the index of a person, given by index, name or `Person`; DriveError unless exactly one person fits."""
        names = [known.name for known in self.people]
        if is_whole(person) and 0 <= person < len(names):
            return int(person)
        name = person.name if isinstance(person, Person) else person
        if isinstance(name, str) and names.count(name) == 1:
            return names.index(name)
        if not names:
            raise DriveError(
                f"there are no people, so {shown(name)} cannot stop; first give all people present, with people="
            )
        listed = ", ".join(f"{i}: {shown(name)}" if name else str(i) for i, name in enumerate(names))
        raise DriveError(
            f"expected the name of one person, got {shown(name)}.{did_you_mean(name, names)} The people are {listed}; "
            "give a name that only one of them has, or a number"
        )

    def _as_predicted(self, now: float) -> tuple[float, tuple[Person, ...]]:
        """Return the time, s, at which predictions begin, and the people; both stay as they are while any person moves.

        If no person moves any more, return the present time, and the people where they are now.
        """
        people = self._people_at(now)
        return (self.since, self.people) if any(person.moves for person in people) else (now, people)

    def _people_at(self, now: float) -> tuple[Person, ...]:
        """Return the people as predicted for time ``now``, s; people who have left are moved far away."""
        return tuple(_gone(person) if _has_gone(person) else person for person in self.predicted(now))

    def _changed(
        self,
        since: float,
        people: tuple[Person, ...],
        *,
        closings: tuple[Closing, ...] | None = None,
        groups: Iterable[Iterable[int]] | None = None,
        areas: dict[str, BaseGeometry] | None = None,
    ) -> DriveSurroundings:
        """Return surroundings with other people, predicted from ``since`` on, and other closed areas.

        Closed areas, groups and named areas that are None stay as they are.
        """
        closings = self.closings if closings is None else closings
        content = self.problem.world.content
        zones = [zone for zone in content.zones if not (zone.kind == "keep-out" and zone.name)]
        unnamed = [zone for zone in self.bare.content.zones if zone.kind == "keep-out"]
        zones = [zone for zone in zones if zone.kind != "keep-out"] + unnamed + [closing.zone for closing in closings]
        world = self.problem.world.with_content(
            people=people,
            groups=content.groups if groups is None else groups,
            landmarks=content.landmarks,
            zones=zones,
        )
        problem = replace(self.problem, world=world)
        areas = self.areas if areas is None else areas
        bodies = _bodies(problem.world.content.people, self.bodies, self.margin, self.bare.extent)
        stopping = self.stopping if problem.world.content.people == self.people else ()
        return DriveSurroundings(problem, self.bare, closings, areas, since, bodies, self.margin, stopping)


def _bodies(
    people: Iterable[Person], before: Mapping[Person, Closing], margin: float, extent: BaseGeometry
) -> dict[Person, Closing]:
    """Return the closed area of each person who stands on the map, of ``extent``: the body, enlarged by a margin, m.

    A person who is in ``before`` (earlier areas) keeps the area from there, as the same object.
    """
    bodies, content = {}, Content(people=tuple(people), kept=margin)
    for i, body in content.bodies.items():
        person = content.people[i]
        closing = Closing(body, person=person.name or "a person", place=(person.x, person.y))
        if body.intersects(extent):  # else the person has gone
            bodies[person] = before.get(person) or closing
    return bodies


def _standing(person: Person) -> Person:
    """Return the person, changed to stand at the present position from now on."""
    yaw = person.yaw
    if person.moves and not person.futures:
        x, y = person.ahead_at(0.0)
        yaw = math.atan2(float(y), float(x))
    return Person(person.x, person.y, yaw=yaw, radius=person.radius, name=person.name)


def _has_gone(person: Person) -> bool:
    """Return whether a person has left in all possible futures."""
    return all(likely.until == 0.0 and likely.afterwards == "gone" for _, likely in person.hypotheses)


def _gone(person: Person) -> Person:
    """Return the person moved far away, without effect; so criteria that need people still have one."""
    return replace(_standing(person), x=person.x + GONE)
