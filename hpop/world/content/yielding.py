"""People who would walk against a robot that cannot be away in time: they are taken to stop before it.

A prediction knows nothing of the robot, so a person who walks slowly up to it is predicted to walk through it. A robot
that must turn before it can leave has then no path at all, though no person walks through a robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hpop.base.text import some
from hpop.world.content.people import STANDS, Future, Person

GAP = 0.02
"""m between a person who has stopped and what a robot needs."""
WITHIN = 5.0
"""s: a robot that has not left its place by then is not kept there by people who come later."""
STEP = 0.01  # s between the moments at which contact is looked for
SIGMAS = 1.645  # standard deviations that a person who may be elsewhere stops earlier


def yielding(person: Person, place: tuple[float, float], reach: float, begin: float = 0.0) -> Person:
    """Return a person who stops before a robot that stands at a place; the very same person if they do not come there.

    Parameters
    ----------
    place : (x, y) m, of the robot's axis
    reach : m, what the robot needs about its axis: its body, the margin, and what its execution is off the plan
    begin : s, from when on the robot stands there; who comes more than ``WITHIN`` later is left as predicted
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
    """Return people of whom some, by number, stop before a robot as :func:`yielding` says."""
    return tuple(yielding(person, place, reach) if i in which else person for i, person in enumerate(people))


def taken_to_stop(people: Sequence[Person], which: Sequence[int]) -> str:
    """Return in words which people, by number, are taken to stop before the robot."""
    who = some([repr(people[i].name) if people[i].name else f"number {i}" for i in which])
    return f"people who would walk up to the robot before it can be away, and are taken to stop before it: {who}"


def _stopped(person: Person, place: tuple[float, float], reach: float, begin: float) -> Person:
    """Return one hypothesis of a person with its stop."""
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
