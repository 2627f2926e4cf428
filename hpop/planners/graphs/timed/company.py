"""Worlds with some of their people alone: who is far away need not be asked about."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

from hpop.world import World
from hpop.world.content.people import Person


class Company(NamedTuple):
    """The people of a world who move, and what must stay together.

    world   with all of them
    moving  places, among its people, of those who move
    """

    world: World
    moving: tuple[int, ...]

    @classmethod
    def of(cls, world: World) -> Company:
        """That of a world."""
        people = world.content.people
        return cls(world, tuple(i for i, person in enumerate(people) if person.moves))

    @property
    def people(self) -> tuple[Person, ...]:
        """Those who move."""
        return tuple(self.world.content.people[i] for i in self.moving)

    @property
    def settled(self) -> float:
        """Time, s, from which on nothing about them changes."""
        return max((person.settled for person in self.people), default=0.0)

    def with_those(self, who: Collection[int]) -> World:
        """The world with those who stand and, of those who move, some (places in ``moving``) and who talks to them."""
        content = self.world.content
        kept = {i for i, person in enumerate(content.people) if not person.moves} | {self.moving[i] for i in who}
        return self._with(self._together(kept))

    def alone(self, number: int, person: Person) -> World:
        """The world with one of those who move alone, as somebody else it may be, and with who talks to it."""
        place = self.moving[number]
        return self._with(self._together({place}), {place: person})

    def _together(self, kept: set[int]) -> set[int]:
        """Those, and everybody in conversations with one of them who moves."""
        people, groups = self.world.content.people, self.world.content.groups
        while True:
            more = {i for group in groups if any(people[j].moves and j in kept for j in group) for i in group}
            if more <= kept:
                return kept
            kept = kept | more

    def _with(self, kept: set[int], instead: dict[int, Person] | None = None) -> World:
        content = self.world.content
        places = sorted(kept)
        number = {place: i for i, place in enumerate(places)}
        people = tuple((instead or {}).get(place, content.people[place]) for place in places)
        groups = tuple(tuple(number[i] for i in group) for group in content.groups if set(group) <= kept)
        return replace(self.world, content=replace(content, people=people, groups=groups))
