"""The world of a drive as it changes: doors that close and open, people who come, go and stop."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.base.scalars import is_whole
from hpop.base.text import shown
from hpop.drive.closings import Closing, named_areas, to_close, to_open
from hpop.drive.ways import OF_PEOPLE, bare
from hpop.errors import DriveError, did_you_mean
from hpop.models.execution import needed_about
from hpop.motions import States
from hpop.world import Person, World
from hpop.world.content.content import Content
from hpop.world.content.predictions import taken_to_stop, yielding

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

GONE = 1e5  # m: nobody who is so far away matters


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is asked of a drive since some moment: its problem, in the world as it is since then.

    problem   in that world, with its time from then on
    bare      the world without people and without closed areas that have names
    closings  what is closed
    known     areas by name, of the map and of those that were closed meanwhile
    since     s, of the drive: when its people were predicted
    bodies    of the people who stand, which are closed as well
    margin    m, that is kept from them
    stopping  notes on people who are taken to stop before the robot, which would have no path otherwise
    """

    problem: Problem
    bare: World
    closings: tuple[Closing, ...]
    known: dict[str, BaseGeometry]
    since: float
    bodies: dict[Person, Closing]
    margin: float = 0.0
    stopping: tuple[str, ...] = ()

    @classmethod
    def of(cls, problem: Problem, since: float, margin: float = 0.0) -> Surroundings:
        """Those of a problem as it is: what is closed are its keep-out zones that have names."""
        zones = problem.world.content.zones
        closings = tuple(Closing(z.area, z.name) for z in zones if z.kind == "keep-out" and z.name)
        people = problem.world.content.people
        bodies = _bodies(people, {}, margin)
        return cls(problem, bare(problem.world), closings, named_areas(problem.world), since, bodies, margin)

    @property
    def people(self) -> tuple[Person, ...]:
        """People as they are predicted."""
        return self.problem.world.content.people

    @property
    def moving(self) -> bool:
        """Whether anybody is predicted to move."""
        return any(person.moves for person in self.people)

    @property
    def closed(self) -> tuple[Closing, ...]:
        """All that is closed to the robot and was not in the bare world."""
        return (*self.closings, *self.bodies.values())

    def at(self, state: States, now: float) -> Problem:
        """The problem asked from a state (1,) at a time of the drive, s."""
        return self.problem.at(self.problem.model.space.values(state), max(0.0, now - self.since))

    # Changes

    def changed(self, now: float, what: str, value: Any, name: str, groups: Any) -> Surroundings:
        """With one thing changed: ``close``, by a name as well, ``open``, ``people``, with groups, or ``stop``."""
        match what:
            case "close":
                return self.close(now, value, name)
            case "open":
                return self.open(now, value)
            case "people":
                return self.with_people(now, value, groups)
        return self.stop(now, value)

    def close(self, now: float, area: Any, name: str) -> Surroundings:
        """With an area closed, by a name that is known or as a polygon; DriveError where there is none."""
        closing = to_close(area, name, self.known, self.closings)
        if not closing.area.intersects(self.bare.extent):
            x_min, y_min, x_max, y_max = self.bare.bounds
            raise DriveError(
                f"{closing} is not on the map, which is from ({x_min:g}, {y_min:g}) to ({x_max:g}, {y_max:g}) m; close "
                "what the robot may come to"
            )
        known = {**self.known, closing.name: closing.area} if closing.name else self.known
        return self._changed(*self._as_predicted(now), closings=(*self.closings, closing), known=known)

    def open(self, now: float, area: Any) -> Surroundings:
        """Without a closing, by its name or its polygon; DriveError where nothing is closed there."""
        opened = to_open(area, self.known, self.closings)
        return self._changed(*self._as_predicted(now), closings=tuple(c for c in self.closings if c not in opened))

    def with_people(self, now: float, people: Iterable[Person], groups: Iterable[Iterable[int]] = ()) -> Surroundings:
        """With other people, as they are and are predicted now, and their conversations, places in ``people``."""
        given = tuple(people) if isinstance(people, Iterable) and not isinstance(people, str) else None
        if given is None or not all(isinstance(person, Person) for person in given):
            raise DriveError(f"people are a list of hpop.world.Person, all who are there now, got {shown(people)}")
        if not given and any(OF_PEOPLE & {*criterion.requires} for criterion in self.problem.criteria):
            given, groups = tuple(_gone(person) for person in self.people), self.problem.world.content.groups
        return self._changed(now, given, groups=groups)

    def stop(self, now: float, person: Any) -> Surroundings:
        """With one person, by name or number, who stands from now on where the prediction has them."""
        place = self._place_of(person)
        people = list(self._people_at(now))
        people[place] = _standing(people[place])
        return self._changed(now, tuple(people))

    def with_people_who_stop(self, states: States, times: FloatArray) -> Surroundings | None:
        """Return the surroundings in which people stop before a robot in each of some states (n,).

        None where nobody comes there soon. Predictions begin when they did.

        Parameters
        ----------
        times : (n,) s, of the drive, from when on the robot is in each state
        """
        reach = needed_about(self.problem.model, self.margin)
        people = self.people
        begins = np.maximum(times - self.since, 0.0).tolist()
        for x, y, begin in zip(states.x.tolist(), states.y.tolist(), begins, strict=True):
            people = tuple(yielding(person, (x, y), reach, begin) for person in people)
        stopped = [i for i, person in enumerate(people) if person is not self.people[i]]
        if not stopped:
            return None
        at_once = (one.moves and one.until == 0.0 and one.afterwards == "stays" for one in people)
        people = tuple(_standing(one) if stops else one for one, stops in zip(people, at_once, strict=True))
        return replace(self._changed(self.since, people), stopping=(taken_to_stop(self.people, stopped),))

    def _place_of(self, person: Any) -> int:
        """The number of a person."""
        names = [one.name for one in self.people]
        if is_whole(person) and 0 <= person < len(names):
            return int(person)
        name = person.name if isinstance(person, Person) else person
        if isinstance(name, str) and names.count(name) == 1:
            return names.index(name)
        if not names:
            raise DriveError(f"nobody is there to stop, asked for {shown(name)}; tell people first, all who are there")
        listed = ", ".join(f"{i}: {shown(name)}" if name else str(i) for i, name in enumerate(names))
        raise DriveError(
            f"nobody is called {shown(name)}, or several are.{did_you_mean(name, names)} The people are {listed}; give "
            "a name that one of them has, or a number"
        )

    def _as_predicted(self, now: float) -> tuple[float, tuple[Person, ...]]:
        """Since when, and the people: as they were predicted, so that all that is known of them stays.

        Where nobody moves any more, they are those who are still there.
        """
        people = self._people_at(now)
        return (self.since, self.people) if any(person.moves for person in people) else (now, people)

    def _people_at(self, now: float) -> tuple[Person, ...]:
        """People as they are predicted to be by now; those who are gone stay gone."""
        people = (person.later(max(0.0, now - self.since)) for person in self.people)
        return tuple(_gone(person) if _has_gone(person) else person for person in people)

    def _changed(
        self,
        since: float,
        people: tuple[Person, ...],
        *,
        closings: tuple[Closing, ...] | None = None,
        groups: Iterable[Iterable[int]] | None = None,
        known: dict[str, BaseGeometry] | None = None,
    ) -> Surroundings:
        """Others, people as they are predicted since some time."""
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
        known = self.known if known is None else known
        bodies = _bodies(problem.world.content.people, self.bodies, self.margin)
        stopping = self.stopping if problem.world.content.people == self.people else ()
        return Surroundings(problem, self.bare, closings, known, since, bodies, self.margin, stopping)


def _bodies(people: Iterable[Person], before: Mapping[Person, Closing], margin: float) -> dict[Person, Closing]:
    """What is closed by people who stand, and a margin; of those who stood before it is the very same."""
    found, content = {}, Content(people=tuple(people), kept=margin)
    for i, body in content.bodies.items():
        person = content.people[i]
        closing = Closing(body, who=person.name or "somebody", place=(person.x, person.y))
        found[person] = before.get(person) or closing
    return found


def _standing(person: Person) -> Person:
    """A person who stands where they are, and stays."""
    yaw = person.yaw
    if person.moves and not person.futures:
        x, y = person.ahead_at(0.0)
        yaw = math.atan2(float(y), float(x))
    return Person(person.x, person.y, yaw=yaw, radius=person.radius, name=person.name)


def _has_gone(person: Person) -> bool:
    """Whether a person is surely not there any more, and never will be."""
    return all(one.until == 0.0 and one.afterwards == "gone" for _, one in person.hypotheses)


def _gone(person: Person) -> Person:
    """A person who is not there any more: so far away that criteria of people, which ask for somebody, cost nothing."""
    return replace(_standing(person), x=person.x + GONE)
