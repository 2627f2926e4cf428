"""People and what is predicted of them: tracks, futures, ends, deviations, and the same asked later."""

from __future__ import annotations

import dataclasses
import json
import math

import casadi
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import MapError
from hpop.motions.symbolic import lift
from hpop.world import Future, Person, Track, World
from hpop.world.content.content import Content
from hpop.world.content.predictions import bounded

L = Track.through([(1, 0, 0), (3, 2, 0), (4, 2, 1)])
T = np.array([0.0, 0.5, 1.0, 2.0, 3.5, 3.999, 4.0, 6.0])


def columns(person: Person, t: np.ndarray) -> list[np.ndarray]:
    """All that may be asked of one hypothesis."""
    asked = [*person.at(t), *person.velocity_at(t), *person.ahead_at(t), person.there(t), person.deviation(t)]
    return [np.broadcast_to(column, t.shape) for column in asked]


@pytest.mark.parametrize("velocity", [(1e-320, 0.0), (0.0, -5e-324), (4e-7, 4e-7)])
def test_who_is_slower_than_anything_that_is_told_apart_stands(velocity: tuple[float, float]) -> None:
    assert not Person(5.0, 1.0, velocity=velocity).moves
    assert Future(1, velocity=velocity).velocity == (0.0, 0.0)
    slow = World.from_polygons([], extent=shapely.box(0, 0, 6, 4)).with_content(
        people=[Person(5.0, 1.0, velocity=(2e-6, 0.0))]
    )
    (left,), _ = bounded(slow, None)
    assert left.until == pytest.approx(1.0 / 2e-6)


def test_who_walks_looks_where_the_velocity_leads_unless_a_yaw_says_otherwise() -> None:
    assert Person(0.0, 0.0, velocity=(0.0, 0.5)).yaw_at(1.0) == pytest.approx(math.pi / 2)
    assert Person(0.0, 0.0, yaw=0.0, velocity=(0.0, 0.5)).yaw_at(1.0) == 0.0
    assert Person(0.0, 0.0).yaw_at(1.0) == 0.0
    futures = (Future(1, velocity=(-1, 0)), Future(1, velocity=(0, -1), yaw=1.0), Future(1))
    headings = [one.yaw_at(0.0) for _, one in Person(0.0, 0.0, futures=futures).hypotheses]
    assert headings == pytest.approx([math.pi, 1.0, 0.0])
    assert {one.yaw_at(0.0) for _, one in Person(0.0, 0.0, yaw=0.3, futures=futures[::2]).hypotheses} == {0.3}


def test_a_velocity_is_followed_for_ever():
    person = Person(1.0, 2.0, velocity=(0.5, -1.0))
    assert person.moves
    assert person.settled == math.inf
    assert not person.recorded
    assert person.speed == math.hypot(0.5, 1)
    x, y = person.at(T)
    assert x.tolist() == (1.0 + 0.5 * T).tolist()
    assert y.tolist() == (2.0 - T).tolist()
    assert person.velocity_at(T) == (0.5, -1.0)
    assert person.there(T) == 1.0
    assert person.deviation(T) == 0.0
    assert person.hypotheses == ((1.0, person),)


def test_who_stands_is_there_for_ever_and_faces_somewhere():
    person = Person(1.0, 2.0, math.pi / 2, spread=0.1)
    assert not person.moves
    assert person.settled == 0.0
    assert person.later(3.0) is person
    assert person.velocity_at(T) == (0.0, 0.0)
    assert person.deviation(T) == 0.1
    np.testing.assert_allclose(person.ahead_at(T), (0.0, 1.0), atol=1e-15)


def test_a_track_is_followed_from_its_first_time_to_its_last():
    person = Person.along(L, radius=0.3, name="Ada")
    assert (person.x, person.y) == (0.0, 0.0)
    assert person.moves
    assert person.until == person.settled == 4.0
    assert person.there(T).tolist() == [0, 0, 1, 1, 1, 1, 0, 0]
    np.testing.assert_allclose(person.at(T)[0], [0, 0, 0, 1, 2, 2, 2, 2])
    np.testing.assert_allclose(person.at(T)[1], [0, 0, 0, 0, 0.5, 0.999, 1, 1], atol=1e-12)
    np.testing.assert_allclose(person.velocity_at(T)[1], [0, 0, 0, 0, 1, 1, 0, 0])
    assert person.speed == 1.0
    assert person.recorded is False
    assert Person.along(L, afterwards="stays").there(T).tolist() == [0, 0, 1, 1, 1, 1, 1, 1]
    assert Person.along(L, until=2.0).settled == 2.0
    np.testing.assert_allclose(Person.along(L, until=2.0, afterwards="stays").at(T)[0], [0, 0, 0, 1, 1, 1, 1, 1])


def test_a_prediction_ends_with_the_person_gone_or_standing():
    walks = Person(0.0, 0.0, velocity=(1.0, 0.0), until=3.0)
    assert walks.settled == 3.0
    assert walks.there(T).tolist() == [1, 1, 1, 1, 0, 0, 0, 0]
    stays = Person(0.0, 0.0, velocity=(1.0, 0.0), until=3.0, afterwards="stays", growth=0.1, spread=0.3)
    assert stays.there(T) == 1.0
    assert stays.at(T)[0].tolist() == [0, 0.5, 1, 2, 3, 3, 3, 3]
    assert stays.velocity_at(T)[0].tolist() == [1, 1, 1, 1, 0, 0, 0, 0]
    assert stays.ahead_at(T) == (1.0, 0.0)
    np.testing.assert_allclose(stays.deviation(T), np.hypot(0.3, 0.1 * np.minimum(T, 3.0)))
    leaves = Person(0.0, 0.0, until=2.0)
    assert leaves.moves
    assert leaves.settled == 2.0
    assert leaves.there(T).tolist() == [1, 1, 1, 0, 0, 0, 0, 0]
    assert not Person(0.0, 0.0, until=2.0, afterwards="stays").moves


def test_futures_are_people_with_weights():
    person = Person(
        1.0,
        1.0,
        futures=(Future(3, velocity=(1, 0)), Future(1, track=Track.through([(0, 1, 1), (2, 1, 2)]))),
        growth=0.2,
    )
    assert person.moves
    assert person.settled == math.inf
    assert [future.weight for future in person.futures] == [0.75, 0.25]
    (first, ahead), (second, aside) = person.hypotheses
    assert (first, second) == (0.75, 0.25)
    assert ahead == Person(1.0, 1.0, velocity=(1.0, 0.0), growth=0.2)
    assert aside.until == 2.0
    assert aside.growth == 0.2
    assert not aside.futures
    assert person.speed == 1.0
    for question in (person.at, person.velocity_at, person.ahead_at, person.there):
        with pytest.raises(MapError, match=r"2 futures, so .* has no single value: .* person\.hypotheses"):
            question(T)


def test_a_future_may_be_surer_and_shorter_than_the_person():
    person = Person(0.0, 0.0, futures=(Future(1, until=9.0, spread=0.5), Future(1, until=1.0)), until=4.0, growth=0.1)
    (_, one), (_, other) = person.hypotheses
    assert (one.until, other.until) == (4.0, 1.0)
    assert (one.spread, other.spread) == (0.5, 0.0)
    assert person.settled == 4.0


people = st.builds(
    lambda kind, until, afterwards, spread, growth: (
        Person.along(L, until=None if until is None else until + 1, afterwards=afterwards, spread=spread, growth=growth)
        if kind == 3
        else Person(1.0, 2.0, 0.5, (kind, 1.0 - kind), until=until, afterwards=afterwards, spread=spread, growth=growth)
        if kind
        else Person(1.0, 2.0, 0.5, until=until, afterwards=afterwards, spread=spread, growth=growth)
    ),
    st.integers(0, 3),
    st.none() | st.integers(0, 6),
    st.sampled_from(["gone", "stays"]),
    st.sampled_from([0.0, 0.3]),
    st.sampled_from([0.0, 0.1]),
)


@given(people, st.lists(st.integers(0, 12), min_size=1, max_size=3))
def test_a_person_later_is_the_same_prediction_asked_later(person, halves):
    """Whatever has begun or ended: place, velocity, presence and deviation; in as many steps as one likes."""
    later = person
    for half in halves:
        later = later.later(half / 2.0)
    on = sum(halves) / 2.0
    t = np.arange(0.0, 9.0, 0.25)
    for now, then in zip(columns(later, t), columns(person, t + on), strict=True):
        np.testing.assert_allclose(now, then, atol=1e-12)
    assert later.settled == pytest.approx(max(person.settled - on, 0.0))


@given(st.lists(people, min_size=1, max_size=3), st.integers(0, 12))
def test_futures_later_are_each_later(hypotheses, half):
    one = Person(1.0, 2.0, 0.5, growth=0.05, futures=tuple(Future.of(i + 1.0, p) for i, p in enumerate(hypotheses)))
    t = np.arange(0.0, 9.0, 0.25)
    for (weight, now), (_, then) in zip(one.later(half / 2.0).hypotheses, one.hypotheses, strict=True):
        for column, expected in zip(columns(now, t), columns(then, t + half / 2.0), strict=True):
            np.testing.assert_allclose(column, expected, atol=1e-12)
        assert weight > 0


@given(people)
def test_people_survive_saving_and_say_no_more_than_they_must(person):
    world = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20)).with_content(people=[person])
    said = json.loads(json.dumps(world.describe()))
    assert World.from_description(said).content.people == (person,)
    plain = Content([Person(1.0, 2.0)]).describe()["people"][0]
    assert set(plain) == {"x", "y", "yaw", "velocity", "radius", "name"}


def test_futures_survive_saving():
    futures = (Future(1, track=L), Future(2, velocity=(0.0, 1.0), until=3.0, afterwards="stays", spread=0.1))
    content = Content([Person(0.0, 0.0, futures=futures).later(1.5), Person.along(L)])
    assert Content.build(json.loads(json.dumps(content.describe()))).people == content.people


def test_symbols_give_what_numbers_give():
    symbol = casadi.MX.sym("t", T.size)
    column = lift(symbol, T.size)
    t = T + 0.1  # steps are smoothed within 0.02 s
    for person in (
        Person.along(L, until=3.5, growth=0.1),
        Person(0.0, 1.0, velocity=(1.0, 0.5), until=3.0, afterwards="stays"),
        Person(0.0, 1.0, until=3.0),
    ):
        asked = [*person.at(column), *person.velocity_at(column), person.there(column), person.deviation(column)]
        outputs = [part.to_casadi() if hasattr(part, "to_casadi") else casadi.MX(part) for part in asked]
        values = casadi.Function("f", [symbol], outputs)(t)
        got = [np.broadcast_to(np.asarray(value).ravel(), t.shape) for value in values]
        expected = [column for i, column in enumerate(columns(person, t)) if i not in (4, 5)]
        np.testing.assert_allclose(got, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"track": L, "velocity": (1, 0)}, "person 'Ada' has a track and a velocity"),
        ({"track": [[0, 1, 1]]}, "needs an hpop.world.Track"),
        ({"track": L, "x": 3.0}, r"is at \(3, 0\), but the track is at \(0, 0\) at time 0"),
        ({"futures": [Future(1)], "velocity": (1, 0)}, "has futures, each with a velocity or track of its own"),
        ({"futures": [Future(1)], "track": L}, "has futures, each with a velocity or track of its own"),
        ({"futures": [{"weight": 1}]}, r"futures must be a list of hpop.world.Future"),
        ({"futures": 3}, r"futures must be a list of hpop.world.Future"),
        ({"spread": -0.1}, "spread must be a number from 0"),
        ({"growth": math.nan}, "growth must be a number"),
        ({"until": -1}, "until must be a number from 0"),
        ({"track": L, "until": 0.5}, "ends at 0.5 s, before the track begins, at 1 s"),
        ({"afterwards": "vanishes"}, "afterwards must be one of gone, stays"),
    ],
)
def test_what_is_no_prediction_is_refused(given, message):
    with pytest.raises(MapError, match=message):
        Person(**{"x": 0.0, "y": 0.0, "name": "Ada", **given})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"weight": 0}, "a future: weight must be a number"),
        ({"weight": True}, "a future: weight must be a number"),
        ({"velocity": 3}, r"a future needs a velocity \(x, y\)"),
        ({"track": L, "velocity": (1, 0)}, "a future has a track and a velocity"),
        ({"until": -2}, "until must be a number from 0"),
        ({"yaw": 90}, "a future: yaw must be in radians"),
        ({"x": math.inf}, "x must be a number"),
        ({"afterwards": "?"}, "afterwards is|afterwards must be one of gone, stays"),
    ],
)
def test_what_is_no_future_is_refused(given, message):
    with pytest.raises(MapError, match=message):
        Future(**{"weight": 1.0, **given})
    with pytest.raises(MapError, match=r"needs an hpop\.world\.Track"):
        Person.along([(0, 1, 1)])


def test_a_way_has_the_corners_between_which_it_is_straight():
    person = Person.along(L.later(2.0), until=1.5)
    assert person.way().tolist() == [[0, 1, 0, 0], [1, 2, 0, math.pi / 2], [1.5, 2, 0.5, math.pi / 2]]
    assert Person(1.0, 2.0, 0.5).way().tolist() == [[0, 1, 2, 0.5]]
    walks = Person(1.0, 2.0, 0.5, velocity=(0.0, 1.0), until=2.0, name="Ada")  # and looks aside
    assert walks.way().tolist() == [[0, 1, 2, 0.5], [2, 1, 4, 0.5]]
    with pytest.raises(MapError, match=r"'Ada' has a prediction without end.*give the time"):
        dataclasses.replace(walks, until=None).way()


@given(people)
def test_a_way_is_where_the_person_is(person):
    if not math.isfinite(person.settled):
        return
    t = np.arange(0.0, 8.0, 0.125)
    times, x, y, _ = person.way().T
    np.testing.assert_allclose((np.interp(t, times, x), np.interp(t, times, y)), columns(person, t)[:2], atol=1e-12)


def test_the_likeliest_of_several_futures_is_the_one_of_the_greatest_weight():
    one = Person(1.0, 1.0, futures=(Future(1, velocity=(1, 0)), Future(3, velocity=(0, 1)), Future(2)))
    assert one.likeliest == Person(1.0, 1.0, velocity=(0.0, 1.0))
    assert one.likeliest.likeliest is one.likeliest


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda: Person(1, 1, velocity=(30, 40), name="Ada"), r"person 'Ada' has a velocity of 50 m/s, .*\(10 m/s\)"),
        (lambda: Person(1, 1, radius=100, name="Ada"), r"person 'Ada' needs a radius of at most 2 m; got 100"),
        (lambda: Future(1, velocity=(0, -11)), r"a future has a velocity of 11 m/s"),
        (
            lambda: Person(5, 5, futures=(Future(1, track=L), Future(1))),
            r"is at \(5, 5\), but the track of a future is at \(0, 0\)",
        ),
    ],
)
def test_what_nobody_does_is_refused(wrong, says):
    with pytest.raises(MapError, match=says):
        wrong()


def test_a_future_may_begin_elsewhere_if_it_says_so():
    aside = Person(5, 5, futures=(Future(1, track=L, x=0, y=0), Future(1)))
    assert [person.at(np.float64(0.0)) for _, person in aside.later(1.0).hypotheses] == [(0.0, 0.0), (5.0, 5.0)]
