"""People who walk up to a robot are taken to stop before it, where it needs room; others do as predicted."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.world import Future, Person, Track
from hpop.world.content.predictions import yielding

REACH = 0.3
ORIGIN = (0.0, 0.0)


def gap(person: Person, t: float) -> float:
    x, y = person.at(t)
    return float(np.hypot(x, y)) - REACH - person.radius


@pytest.mark.parametrize(
    "person",
    [
        Person(2.0, 0.0, velocity=(-0.5, 0.0)),
        Person(0.0, -1.0, velocity=(0.0, 0.3), until=4.0),
        Person.along(Track([0.0, 2.0, 6.0], [1.5, 1.0, -1.0], [0.0, 0.0, 0.0])),
    ],
    ids=["walks", "ends", "follows a track"],
)
def test_who_walks_against_the_robot_stops_two_centimetres_before_it(person: Person) -> None:
    stopped = yielding(person, ORIGIN, REACH)
    assert stopped.afterwards == "stays"
    assert 0.02 <= gap(stopped, 100.0) <= 0.02 + 0.51 * 0.01 + 1e-9  # the way of a hundredth of a second
    assert gap(stopped, 0.5) == gap(person, 0.5)


@pytest.mark.parametrize(
    "person",
    [
        Person(2.0, 0.6, velocity=(-0.5, 0.0)),  # passes 5 cm from the robot
        Person(4.0, 0.0, velocity=(-0.5, 0.0)),  # is there after 6.8 s
        Person(0.5, 0.0, velocity=(0.5, 0.0)),  # in contact, and walks away
        Person(1.0, 0.0, velocity=(-0.3, 0.0), until=1.0),  # is gone before
        Person(0.5, 0.0),
    ],
    ids=["passes", "comes late", "leaves", "is gone", "stands"],
)
def test_who_does_not_come_there_soon_does_as_predicted(person: Person) -> None:
    assert yielding(person, ORIGIN, REACH) is person


def test_who_is_in_contact_and_walks_on_stops_at_once() -> None:
    stopped = yielding(Person(0.5, 0.0, velocity=(-0.3, 0.0)), ORIGIN, REACH)
    assert stopped.until == 0.0
    assert gap(stopped, 10.0) == pytest.approx(-0.05)


def test_who_comes_before_the_robot_is_there_stops_where_it_will_be() -> None:
    stopped = yielding(Person(2.0, 0.0, velocity=(-0.5, 0.0)), ORIGIN, REACH, begin=3.5)  # within it at 3.5 s
    assert 0.02 <= gap(stopped, 100.0) <= 0.025 + 1e-9


def test_only_the_future_that_comes_there_stops() -> None:
    futures = (Future(0.5, velocity=(-0.5, 0.0)), Future(0.5, velocity=(0.5, 0.0)))
    first, second = yielding(Person(2.0, 0.0, futures=futures), ORIGIN, REACH).hypotheses
    assert first[1].afterwards == "stays"
    assert second[1].velocity == (0.5, 0.0)
    assert second[1].until is None


def test_who_may_be_elsewhere_stops_earlier() -> None:
    stopped = yielding(Person(2.0, 0.0, velocity=(-0.5, 0.0), spread=0.1), ORIGIN, REACH)
    assert gap(stopped, 100.0) == pytest.approx(0.02 + 1.645 * 0.1, abs=0.006)
