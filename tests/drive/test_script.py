"""A drive by a script does what its methods do, one event after another, and tells what became of each."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive.script import Event, Happening, performed
from hpop.errors import DriveError
from hpop.world import Future, Person
from tests.drive.rooms import NORTH, SOUTH, planned, through


def north() -> hpop.drive.Execution:
    problem, front = planned()
    rows = [i for i, way in enumerate(front.trajectories) if through(way) == "north"]
    return hpop.follow(problem, front, min(rows, key=lambda i: front.costs[i, 1]))


def test_each_event_is_told_to_the_drive_and_its_options_are_those_that_a_drive_told_the_same_has() -> None:
    scripted, by_hand = north(), north()
    close, fewer = performed(scripted, [Event(1.0, "close", "north"), Event(3.0, "wish", "fewer turns")], deadline=10.0)
    change = by_hand.world(1.0, close="north")
    options = by_hand.options(1.0, 10.0)
    assert close.change == change
    np.testing.assert_array_equal(close.options.front.costs, options.front.costs)
    assert close.taken is not None
    assert not close.asked
    assert close.taken.index == options.knee().index  # its way is closed: the robot takes the knee by itself
    by_hand.take(options.knee())
    options = by_hand.options(3.0, 10.0)
    wish = by_hand.wish("fewer turns")
    assert fewer.words == wish.words
    assert (fewer.taken is None) == (wish.option is None)
    if wish.option is not None:
        by_hand.take(wish.option)
    np.testing.assert_array_equal(scripted.plan.states.x, by_hand.plan.states.x)
    assert through(scripted.plan) == "south"


def test_what_happened_tells_the_way_until_then_and_the_plan_before() -> None:
    drive = north()
    announced = drive.announced
    (happening,) = performed(drive, [Event(1.5, "close", "north")])
    assert happening.driven.duration == pytest.approx(1.5)
    assert happening.before is announced
    assert [closing.name for closing in happening.closed] == ["north"]


def test_somebody_takes_what_is_named() -> None:
    drive = north()
    (happening,) = performed(drive, [Event(1.0, "take", "least turns")])
    assert happening.asked
    assert happening.taken is not None
    assert happening.taken.costs["turns"] == happening.options.front.costs[:, 1].min()
    assert happening.words.startswith("least turns")


def test_options_are_looked_at_without_a_change() -> None:
    drive = north()
    plan = drive.plan
    (happening,) = performed(drive, [Event(1.0, "options")])
    assert happening.taken is None
    assert drive.plan is plan


@pytest.mark.parametrize(
    ("events", "words"),
    [
        ([Event(4.0, "options"), Event(3.0, "options")], "list events in order of time"),
        ([Event(500.0, "options")], "comes too late: the robot arrives"),
        ([Event(1.0, "close", "west")], "west"),
        ([Event(1.0, "stop", "Ada")], "there are no people, so 'Ada' cannot stop"),
        (
            [Event(1.0, "close", shapely.box(90, 1, 91, 2))],
            "about .90.50, 1.50. is not on the map, which is from .0, 0.",
        ),
        ([Event(1.0, "wish", "fewer tunrs")], "Did you mean 'turns'"),
        ([Event(1.0, "close", NORTH, name="door"), Event(2.0, "open", "gate")], "gate"),
    ],
)
def test_what_cannot_be_is_told(events: list[Event], words: str) -> None:
    with pytest.raises(DriveError, match=words):
        list[Happening](performed(north(), events))


def test_what_cannot_be_done_is_said_in_words_and_the_drive_goes_on() -> None:
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    x, y = (float(getattr(drive.at(2.0).state, name)[0]) for name in ("x", "y"))
    events = [
        Event(0.5, "wish", "hurry"),  # no duration among the costs
        Event(1.0, "take", 999),
        Event(2.0, "close", shapely.box(x - 0.1, y - 0.1, x + 0.1, y + 0.1)),
        Event(2.0, "close", NORTH, name="one"),
        Event(2.0, "close", SOUTH, name="other"),
        Event(2.5, "wish", "fewer turns"),  # of a plan with something in its way
        Event(2.5, "take", "knee"),
        Event(3.0, "open", "one"),
    ]
    hurry, row, on_robot, _, _, fewer, none, opened = performed(drive, events)
    assert "duration" in hurry.words
    assert row.words == f"there is no option 999: options are numbered 0 to {len(row.options) - 1}"
    assert "covers the robot" in on_robot.words
    assert on_robot.change is None
    assert "is in its way" in fewer.words
    assert "no option to take" in none.words
    assert [h.taken for h in (hurry, row, on_robot, fewer, none)] == [None] * 5
    assert opened.change is not None


def test_somebody_who_may_walk_at_the_robot_is_taken_to_stop_and_it_takes_the_way_round() -> None:
    extent = shapely.box(0, -3, 12, 3)
    ada = Person(11.0, 2.0, velocity=(0.0, 0.1), until=1.0, name="Ada")
    world = hpop.World.from_polygons([], extent=extent).with_content(people=[ada])
    robot = hpop.DifferentialDrive(radius=0.25)
    problem = hpop.Problem(world, robot, (3.0, 0.0, 0.0), (10.0, 0.0, 0.0), ["duration", "turns"])
    drive = hpop.follow(problem, problem.solve("lattice", step=1.0), "least duration")
    ways = Future(1.0, velocity=(-1.0, 0.0)), Future(1.0, velocity=(-1.0, 0.05))
    comes = Person(3.7, 0.0, futures=ways, until=3.0)
    met, later = performed(drive, [Event(0.2, "people", (comes,)), Event(6.0, "options")], deadline=0.5)
    assert met.taken is not None
    assert any("taken to stop" in note for note in met.options.front.notes)
    assert later.taken is None  # it goes on as it was taken
    assert drive.announced is drive.plan  # it is driven to the goal


@pytest.mark.parametrize("at", [-1.0, float("nan"), "soon"])
def test_an_event_is_at_a_time(at: object) -> None:
    with pytest.raises(DriveError, match="at must be"):
        Event(at, "options")  # type: ignore[arg-type]


def test_an_event_is_of_a_known_kind() -> None:
    with pytest.raises(DriveError, match="one of close, open, people, stop, wish, take, skip, options"):
        Event(1.0, "explode")
