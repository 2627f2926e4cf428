"""Predictions that end: at walls, at the map's border, at a horizon, before a robot; and in problems."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import hpop
from hpop.errors import MapError, QueryError
from hpop.world import Future, Person, Track, World
from hpop.world.content.predictions import bounded, yielding

WALL = shapely.box(6, 0, 6.5, 4)
HALL = World.from_polygons([WALL, (shapely.box(1, 5, 2, 6), (2.2, 2.5))], extent=shapely.box(0, 0, 10, 8))


def people_of(*people: Person, world: World = HALL, horizon: float | None = None) -> tuple[Person, ...]:
    return bounded(world.with_content(people=people), horizon)[0]


def notes_of(*people: Person, horizon: float | None = None) -> tuple[str, ...]:
    return bounded(HALL.with_content(people=people), horizon)[1]


def test_who_would_walk_into_a_wall_stops_a_radius_before_it_and_stays():
    (ada,) = people_of(Person(2.0, 2.0, velocity=(1.0, 0.0), radius=0.3, name="Ada"))
    assert ada.until == pytest.approx(3.7, abs=1e-9)  # the wall is at x = 6
    assert ada.afterwards == "stays"
    assert ada.settled == ada.until
    np.testing.assert_allclose(ada.at(np.array([1.0, 50.0]))[0], [3.0, 5.7])
    (note,) = notes_of(Person(2.0, 2.0, velocity=(1.0, 0.0), radius=0.3, name="Ada"))
    expected = "walk into an obstacle, and are predicted to stop before it and to stay: 'Ada' after 3.7 s"
    assert note == f"people who would {expected}"


def test_what_hangs_overhead_stops_nobody():
    (person,) = people_of(Person(0.5, 5.5, velocity=(1.0, 0.0)))
    assert person.until == pytest.approx(9.5)
    assert person.afterwards == "gone"


def test_who_leaves_the_map_is_gone_from_then():
    (person,) = people_of(Person(8.0, 2.0, velocity=(0.5, 0.5)))
    assert person.until == pytest.approx(4.0)
    assert person.there(np.array([3.9, 4.1])).tolist() == [1.0, 0.0]
    assert notes_of(Person(8.0, 2.0, velocity=(0.5, 0.5))) == (
        "people who leave the map, and are gone from then on: number 0 after 4 s",
    )


@pytest.mark.parametrize(("x", "speed", "until"), [(-2.0, 1.0, 12.0), (12.0, 1.0, 0.0), (-2.0, -1.0, 0.0)])
def test_who_comes_from_outside_is_there_until_he_has_crossed_the_map(x, speed, until):
    (person,) = people_of(Person(x, 6.0, velocity=(speed, 0.0)))
    assert person.until == pytest.approx(until)


def test_who_is_never_on_the_map_is_told():
    off = Track([0.0, 4.0], [40.0, 44.0], [5.0, 5.0], recorded=True)
    passes = Track([0.0, 30.0], [-9.0, 20.0], [7.0, 7.0], recorded=True)
    given = (Person(50.0, 5.0, name="Ada"), Person.along(off), Person.along(passes), Person(3.0, 3.0), Person(0.0, 0.0))
    assert notes_of(*given)[-1] == (
        "people who are never on the map, which may have another origin, other axes or another unit: 'Ada', number 1"
    )
    assert not any("never" in note for note in notes_of(*given[2:]))
    perhaps = Person(3.0, 3.0, futures=(Future(1.0), Future(1.0, track=Track([0.0, 1.0], [3.0, 3.5], [3.0, 3.0]))))
    assert not any("never" in note for note in notes_of(perhaps))


def test_a_horizon_ends_predictions_but_not_what_was_recorded():
    walks, stays = Person(1, 7, velocity=(0.5, 0)), Person(1, 7, velocity=(0.5, 0), afterwards="stays")
    track = Track.through([(0, 1, 7), (9, 5, 7)])
    recorded = Track(track.times, track.x, track.y, recorded=True)
    stands = Person(1.0, 1.0, growth=0.1)
    given = (walks, stays, Person.along(track), Person.along(recorded), stands, Person(3.0, 3.0))
    people = people_of(*given, horizon=5.0)
    assert [person.until for person in people] == [5.0, 5.0, 5.0, 9.0, 5.0, None]
    assert [person.afterwards for person in people] == ["gone", "stays", "gone", "gone", "stays", "gone"]
    assert float(people[4].deviation(np.float64(90.0))) == pytest.approx(0.5)
    assert notes_of(*given, horizon=5.0) == (
        "people who are predicted up to the horizon, and are gone from then on: number 0 after 5 s, number 2 after 5 s",
        "people who are predicted up to the horizon, and stay where they are then: number 1 after 5 s, "
        "number 4 after 5 s",
        "people who have a recording that ends, and are gone from then on: number 3 after 9 s",
    )


def test_a_track_that_begins_after_the_horizon_is_never_there():
    late = Person.along(Track.through([(7, 1, 7), (9, 3, 7)]))
    (person,) = people_of(late, horizon=5.0)
    assert person.there(np.arange(20.0)).max() == 0.0
    assert person.settled == 0.0


def test_each_future_ends_by_itself():
    given = Person(4.0, 2.0, futures=(Future(3, velocity=(1, 0)), Future(1, velocity=(0, -1))), name="Ada")
    (person,) = people_of(given)
    (_, stops), (_, leaves) = person.hypotheses
    assert (stops.afterwards, leaves.afterwards) == ("stays", "gone")
    assert [stops.until, leaves.until] == pytest.approx([1.75, 2.0])
    assert person.settled == leaves.until
    assert notes_of(given)[1].endswith("gone from then on: 'Ada' (future 1) after 2 s")


def test_of_many_people_a_note_names_a_few():
    notes = notes_of(*(Person(0.5 + i / 10, 7, velocity=(0.5, 0)) for i in range(7)), horizon=2.0)
    assert len(notes) == 1
    assert notes[0].endswith("number 3 after 2 s and 3 others")


def test_walls_do_not_change_what_people_did():
    track = Track([0.0, 4.0], [4.0, 8.0], [2.0, 2.0], recorded=True)
    (person,) = people_of(Person.along(track))
    assert person == Person.along(track)


def test_who_walks_from_within_a_wall_is_shifted_to_its_border():
    """A tracker that is off by centimetres: 20 cm within a wall that is half a metre thick."""
    walker, did = Person(6.2, 2, velocity=(-1, 0), name="Ada"), Track([0, 4], [6.2, 3], [2, 2], recorded=True)
    for person in (walker, Person.along(did, name="Ada")):
        (shifted,) = people_of(person)
        assert (shifted.x, shifted.y) == pytest.approx((6.0, 2.0))
        x, y = shifted.at(np.array([1.0]))
        assert (x[0], y[0]) == pytest.approx((5.0 if person is walker else 5.2, 2.0))
        assert "people within an obstacle, shifted to its border: 'Ada' at (6.2, 2)" in notes_of(person)


def test_who_is_deep_within_an_obstacle_is_left_out_and_the_others_are_there():
    block = World.from_polygons([shapely.box(4, 0, 7, 4)], extent=shapely.box(0, 0, 10, 8))
    lost, walks = Person(5.5, 2.0, velocity=(1, 0), name="Bob"), Person(1.0, 6.0, velocity=(0.5, 0), until=4.0)
    people, notes = bounded(block.with_content(people=[lost, walks]))
    assert people[1] == walks
    assert math.hypot(people[0].x, people[0].y) > 1e4  # where nobody meets anybody
    assert not people[0].moves
    assert [note for note in notes if "Bob" in note] == ["people within an obstacle, left out: 'Bob' at (5.5, 2)"]
    with pytest.raises(
        MapError,
        match=r"person 'Bob' begins at \(5.5, 2\), within an obstacle. People who walk must begin in free space",
    ):
        people_of(lost, world=block)
    with pytest.raises(MapError, match="within an obstacle, and so do all the others"):
        people_of(lost, lost, world=block)


def test_who_stands_within_an_obstacle_stays_and_is_noted():
    assert people_of(Person(6.25, 2.0)) == (Person(6.25, 2.0),)  # who sits in an armchair is
    (note,) = notes_of(Person(6.25, 2.0, name="Eve"))
    assert note.startswith("people within an obstacle, who stand there")
    assert note.endswith("'Eve' at (6.25, 2)")


def test_who_leans_on_a_wall_may_walk_away_but_not_through():
    away, through = Person(6.05, 2, velocity=(-1, 0)), Person(6.05, 2, velocity=(1, 0))
    (away, through) = people_of(away, through)
    assert (away.afterwards, through.afterwards, through.until) == ("gone", "stays", 0.0)


def test_who_is_ever_less_surely_there_needs_an_end():
    with pytest.raises(MapError, match=r"becomes ever more uncertain .*\(until\), or a horizon"):
        people_of(Person(1.0, 1.0, growth=0.1, name="Ada"))


def entry(x: float, y: float, vx: float, vy: float) -> float:
    """Return the time at which a point first is within the wall, by small steps: up to one step late."""
    t = np.arange(0.0, 40.0, 1e-3)
    inside = (x + vx * t > 6) & (x + vx * t < 6.5) & (y + vy * t > 0) & (y + vy * t < 4)
    return float(t[np.argmax(inside)]) if inside.any() else math.inf


@given(
    st.tuples(st.integers(1, 23), st.integers(1, 31), st.integers(-3, 3), st.integers(-3, 3)).filter(
        lambda p: (p[2], p[3]) != (0, 0)
    )
)
def test_an_end_is_when_the_centre_meets_wall_or_border_whatever_the_direction(numbers):
    x, y, vx, vy = (number / 4 for number in numbers)
    (person,) = people_of(Person(x, y, velocity=(vx, vy)))
    border = min(((10 if v > 0 else 0) - p) / v for p, v in ((x, vx),) if v) if vx else math.inf
    border = min(border, ((8 if vy > 0 else 0) - y) / vy if vy else math.inf)
    wall = entry(x, y, vx, vy)
    if wall < border:
        assert person.afterwards == "stays"
        assert person.until == pytest.approx(max(wall - 0.25 / math.hypot(vx, vy), 0.0), abs=2e-3)
    else:
        assert (person.until, person.afterwards) == (pytest.approx(border), "gone")


def test_a_track_of_who_stays_in_one_place_leaves_no_map_that_it_is_in():
    there, beside = (Person.along(Track.through([(0, x, 1), (3, x, 1), (9, x, 1)])) for x in (1, 12))
    assert people_of(there) == (there,)
    assert [person.until for person in people_of(there, beside)] == [9.0, 0.0]


walkers = st.builds(
    lambda x, y, vx, vy, until, kind: (
        Person.along(Track.through([(0, x, y), (3, x, y), (9, x + vx, y + 2 * vy)]), until=until)
        if kind
        else Person(x, y, velocity=(vx, vy), until=until)
    ),
    *(st.integers(1, 5), st.integers(1, 7), st.integers(-2, 2), st.integers(-2, 2)),
    st.none() | st.integers(1, 9),
    st.booleans(),
)


@given(st.lists(walkers, max_size=4), st.none() | st.integers(1, 6), st.integers(0, 8))
def test_what_is_bounded_stays_as_it_is_also_later_and_after_saving(people, horizon, t):
    world = HALL.with_content(people=people)
    cut, notes = bounded(world, horizon)
    again = World.from_description(json.loads(json.dumps(world.with_content(people=cut).describe())))
    assert bounded(again, horizon) == (cut, notes)
    later = tuple(person.later(float(t)) for person in cut)
    for now, then in zip(people_of(*later, horizon=horizon), later, strict=True):
        assert now.settled == pytest.approx(then.settled, abs=1e-5)
        assert now.afterwards == then.afterwards


def problem_with(*people: Person, **options: object) -> hpop.Problem:
    model = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    world = HALL.with_content(people=people)
    return hpop.Problem(world, model, (1, 1, 0), (9, 1, 0), ["length", "personal_space"], **options)


def test_a_problem_has_bounded_people_and_says_so():
    problem = problem_with(Person(4.0, 2.0, velocity=(1.0, 0.0), name="Ada"), Person(1.0, 7.0))
    assert [person.settled for person in problem.world.content.people] == [pytest.approx(1.75), 0.0]
    assert problem.notes == (
        "people who would walk into an obstacle, and are predicted to stop before it and to stay: 'Ada' after 1.75 s",
    )
    again = hpop.Problem.from_description(json.loads(json.dumps(problem.describe())))
    assert (again.notes, again.world.content.people) == (problem.notes, problem.world.content.people)


def test_a_problem_later_predicts_the_same():
    problem = problem_with(Person(1.0, 7.0, velocity=(1.0, 0.0)), horizon=4.0)
    later = problem.at((2, 1, 0), 1.5)
    (person,), (then,) = problem.world.content.people, later.world.content.people
    assert then.until == 2.5
    np.testing.assert_allclose(then.at(np.array([0.0, 1.0, 9.0])), person.at(np.array([1.5, 2.5, 9.0])))
    assert later.notes[0].endswith("number 0 after 2.5 s")
    assert later.describe()["horizon"] == 4.0


def test_who_stands_leaves_world_and_description_alone():
    problem = problem_with(Person(1.0, 7.0), Person(3.0, 7.0, spread=0.2))
    assert problem.notes == ()
    assert "horizon" not in problem.describe()
    world = HALL.with_content(people=[Person(1.0, 7.0)])
    assert hpop.Problem(world, problem.model, (1, 1, 0), (9, 1, 0), ["length"]).world is world


@pytest.mark.parametrize("horizon", [0, -1, math.inf, math.nan, "8", True])
def test_a_horizon_is_a_time(horizon):
    with pytest.raises(QueryError, match=r"horizon must be a time in s"):
        problem_with(Person(1.0, 7.0), horizon=horizon)


def test_fronts_carry_how_predictions_end():
    problem = problem_with(Person(1.0, 7.0, velocity=(1.0, 0.0), name="Ada"), horizon=4.0)
    trajectory = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (5, 1, 0)])
    from hpop.planners.base import Candidates
    from hpop.runtime.limits import Status

    costs = np.array([list(problem.evaluate(trajectory).values())])
    candidates = Candidates(
        trajectories=[trajectory],
        objectives=problem.criteria,
        planned=costs,
        tolerance=np.zeros((1, 2)),
        status=Status.COMPLETE,
        certificate="none",
        provenance=({},),
    )
    assert problem.notes[0] in problem.front(candidates).notes


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
