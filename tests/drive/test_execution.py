"""Claims of a drive: where it is, what may be chosen, what a change of the world makes of it."""

from __future__ import annotations

import numpy as np
import pytest

import hpop
from hpop.errors import DriveError, MapError
from hpop.world import Person
from tests.drive.rooms import NORTH, SOUTH, planned, through


def driving(door: str = "north") -> hpop.drive.Execution:
    """Return a drive along the trajectory of least turns through one of the doors."""
    problem, front = planned()
    rows = [i for i, way in enumerate(front.trajectories) if through(way) == door]
    return hpop.follow(problem, front, min(rows, key=lambda i: front.costs[i, 1]))


def test_the_plan_is_driven_from_the_start_to_the_goal_and_costs_what_the_front_says() -> None:
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    end = drive.at(drive.plan.duration + 1.0)
    assert end.arrived
    assert end.past == pytest.approx(problem.evaluate(front.knee().trajectory))
    assert drive.at(0.0).past == dict.fromkeys(end.past, 0.0)


def test_another_way_may_be_taken_where_a_straight_move_arrives_later_than_the_deadline() -> None:
    drive = driving()
    for now in np.arange(0.0, drive.plan.duration - 1.0, 0.7).tolist():
        commit = drive.commit(now, 0.5)
        assert commit.time > now + 0.5
        assert drive.plan.kinds[commit.place - 1] == "move"


def test_before_it_leaves_a_robot_may_take_another_way_from_the_start() -> None:
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee", begin=5.0)
    options = drive.options(3.0, 0.5)
    assert options.commit.time == 5.0
    assert len(options) == len(front)
    drive.take(options.best("turns"))
    assert drive.plan.durations.tolist() == front.best("turns").trajectory.durations.tolist()
    assert drive.at(4.9).planned == 0.0


def test_a_door_that_closes_turns_the_robot_to_the_other_one_without_a_jump() -> None:
    drive = driving("north")
    change = drive.world(1.0, close="north")
    assert change.safe_until is not None
    assert change.stops_at is not None
    assert 1.0 < change.stops_at <= change.safe_until
    options = drive.options(1.2)
    assert options.keep_on is None
    assert {through(option.item) for option in options} == {"south"}
    drive.take(options.knee())
    assert drive.at(100.0).arrived
    assert through(drive.plan) == "south"
    assert drive.world(2.0, open="north").safe_until is None


def test_without_another_way_the_robot_stands_before_the_door_until_it_opens() -> None:
    drive = driving("north")
    drive.world(0.5, close="south")
    drive.world(1.0, close=NORTH, name="the north door")
    assert drive.options(1.0).status is hpop.Status.NO_PATH
    waiting = drive.at(60.0)
    assert waiting.stands
    assert not waiting.arrived
    drive.world(70.0, open="the north door")
    assert not drive.at(70.0).stands
    assert drive.plan.kinds.count("hold") == 1
    assert drive.at(200.0).arrived


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"close": "east"}, "no door or zone of the map is called 'east'"),
        ({"open": "north"}, "'north' is not closed"),
        ({"open": SOUTH}, "no closed area equals"),
        ({"close": [(0.5, 1.5), (1.5, 1.5), (1.5, 2.5), (0.5, 2.5)]}, "covers the robot"),
        ({"close": [(0, 0), (1, float("nan")), (1, 1)]}, "an area to close"),
        ({"stop": "somebody"}, "there are no people, so 'somebody' cannot stop"),
        ({"close": "north", "open": "south"}, "give exactly one of close, open, people and stop"),
        ({}, "give exactly one of close, open, people and stop"),
        ({"close": [(0, 0), (10**400, 0), (1, 1)]}, "an area to close must be a polygon"),
        ({"people": 5}, "people must be a list of all people present, each hpop.world.Person"),
        ({"people": "Ada"}, "each hpop.world.Person; got 'Ada'"),
        ({"people": [Person(4.0, 4.0)], "groups": 5}, "groups must be a list"),
    ],
)
def test_what_makes_no_sense_is_told_and_changes_nothing(told: dict[str, object], said: str) -> None:
    drive = driving()
    with pytest.raises((DriveError, MapError), match=said):
        drive.world(0.1, **told)  # type: ignore[arg-type]
    assert drive.record == []
    assert drive.surroundings.closed == ()


def test_what_is_no_problem_and_no_options_is_told() -> None:
    problem, front = planned()
    with pytest.raises(DriveError, match=r"problem must be an hpop.Problem, got None"):
        hpop.follow(None, front, "knee")  # type: ignore[arg-type]
    with pytest.raises(DriveError, match=r"call options\(now\) first"):
        hpop.follow(problem, front, "knee").adapt(None)  # type: ignore[arg-type]


def test_events_are_told_in_order_of_time() -> None:
    drive = driving()
    drive.world(3.0, close="south")
    with pytest.raises(DriveError, match="in order of time"):
        drive.world(2.0, open="south")
    with pytest.raises(DriveError, match="now must be a time"):
        drive.options(float("nan"))
    with pytest.raises(DriveError, match="deadline must be"):
        drive.options(4.0, -1.0)


def test_what_is_refused_has_not_been_told() -> None:
    drive = driving()
    drive.options(1.0, 0.0)
    for refused in (
        lambda: drive.take(0, 900.0),  # where the options begin is long past
        lambda: drive.take(99, 800.0),
        lambda: drive.at(700.0, (1e3, 1e3, 0.0)),  # it has left its plan
        lambda: drive.options(600.0, -1.0),
        lambda: drive.world(500.0, close="east"),
    ):
        with pytest.raises(DriveError):
            refused()
    assert drive.options(1.1, 0.0).now == 1.1
    assert [event["now"] for event in drive.record] == [1.0, 1.1]


@pytest.mark.parametrize("waits", [True, False])
@pytest.mark.parametrize("planner", ["any-angle", "smoothing"])
def test_a_planner_without_a_graph_to_replan_on_is_refused_before_the_drive(planner: str, waits: bool) -> None:
    problem, front = planned()
    with pytest.raises(DriveError, match="has neither for this robot: give planner='lattice'"):
        hpop.follow(problem, front, "knee", planner=planner, waits=waits)
