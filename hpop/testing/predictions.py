"""Worlds in which people walk, leave, follow tracks or may do several things, and what a criterion makes of that."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion, motion_costs
from hpop.errors import CriterionError
from hpop.motions import HOLD, Motions
from hpop.testing.checks import Check, differ, fault_of
from hpop.world import World
from hpop.world.content.futures import Future
from hpop.world.content.people import Person
from hpop.world.tracks import Track

TOLERANCE = 2e-3  # relative: panels of integrals end at other times, where people turn at other times
ASKED = ("move", HOLD.kind)
SLACK = 0.1  # of a worst moment, which lies between two samples


def sure_world(world: World) -> World:
    """The same people, one after the other on a track, walking until they leave, and standing, for about a minute."""
    doings = (_on_a_track, _leaving, lambda person: person)
    people = [doings[i % 3](person) for i, person in enumerate(world.content.people)]
    return with_people(world, people)


def open_world(world: World) -> World:
    """The same people, each with two futures, one of them ever less certain."""
    people = [
        replace(
            person,
            spread=0.2,
            futures=(
                Future(2.0, velocity=(0.02, 0.03), growth=0.01),
                Future(1.0, track=_on_a_track(person).track, afterwards="stays"),
            ),
        )
        for person in world.content.people
    ]
    return with_people(world, people)


def prediction_checks(criterion: Criterion, world: World, batches: list[Motions]) -> Iterator[Check]:
    """Check what a criterion makes of people who may do several things, and of those who have left.

    A criterion may refuse futures and uncertain places, by a CriterionError.
    """
    yield Check("reckons with each of a person's futures", fault_of(lambda: _futures(criterion, world, batches)))
    yield Check("costs nothing for people who are gone", fault_of(lambda: _without_the_gone(criterion, world, batches)))


def predicted_batches(criterion: Criterion, world: World, batches: list[Motions]) -> list[Motions]:
    """Moves and holds among people on tracks and who leave, and among some with futures if that is not refused."""
    worlds = [one for one in (sure_world(world), open_world(world)) if not refuses(criterion, one, batches)]
    asked = [motions for motions in batches if motions.kind in ASKED and len(motions) > 1]
    return [replace(motions, world=one) for one in worlds for motions in asked]


def refuses(criterion: Criterion, world: World, batches: list[Motions]) -> bool:
    """Whether a criterion refuses what is predicted in a world."""
    try:
        _costs(criterion, world, batches[:1])
    except CriterionError:
        return True
    return False


def with_people(world: World, people: list[Person]) -> World:
    """The same world with other people."""
    content = world.content
    return world.with_content(people=people, groups=content.groups, landmarks=content.landmarks, zones=content.zones)


def _on_a_track(person: Person) -> Person:
    x, y = person.x, person.y
    track = Track.through([(0, x, y), (25, x + 1.5, y + 0.5), (40, x + 0.5, y + 1.0), (58, x, y - 0.5)])
    return replace(person, track=track, afterwards="stays")


def _leaving(person: Person) -> Person:
    return replace(person, velocity=(-0.03, 0.02), until=40.0)


def _costs(criterion: Criterion, world: World, batches: list[Motions]) -> FloatArray:
    return np.concatenate([motion_costs(criterion, replace(motions, world=world)) for motions in batches])


def _futures(criterion: Criterion, world: World, batches: list[Motions]) -> str:
    """One person's futures, against worlds in which each of them is sure."""
    everyone = open_world(world).content.people
    if refuses(criterion, with_people(world, list(everyone)), batches):
        return ""
    others = [replace(person, futures=()) for person in everyone[1:]]
    found = _costs(criterion, with_people(world, [everyone[0], *others]), batches)
    weights, sure = zip(*everyone[0].hypotheses, strict=True)
    each = np.stack([_costs(criterion, with_people(world, [person, *others]), batches) for person in sure])
    shares = each * np.array(weights)[:, None]
    worst = criterion.aggregate == "max"
    least, most = shares.max(axis=0) if worst else shares.sum(axis=0), each.sum(axis=0)
    slack = (SLACK if worst else TOLERANCE) * found.max()
    wrong = (found < least - slack) | (found > most + slack)
    if not wrong.any():
        return ""
    i = int(np.argmax(wrong))
    return (
        f"{found[i]:.6g} where a person may do two things, of which {least[i]:.6g} is the "
        f"{'largest share' if worst else 'mean'} and {most[i]:.6g} the sum; see hpop.world.content.proxemics.expected"
    )


def _without_the_gone(criterion: Criterion, world: World, batches: list[Motions]) -> str:
    people = list(sure_world(world).content.people)
    gone = Person(6.0, 4.5, velocity=(0.02, 0.0), until=0.0)
    there, without = (_costs(criterion, with_people(world, some), batches) for some in ([*people, gone], people))
    return differ("with somebody who is gone", without, there, TOLERANCE)
