"""The planner of a live session: places are checked, ways offered and taken, and a push takes the nearest way."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.cli.live_planner import answers
from hpop.live.cards import Ways, nearest_to_push
from hpop.live.planner import LivePlanner
from hpop.live.scene import scene_of
from hpop.scenario import load_scenario
from hpop.trajectories.trajectory import Trajectory
from tests.worlds import TWO_WALLS

START = (1.0, 1.0, 0.0)


@pytest.fixture
def planner(tmp_path: Path) -> LivePlanner:
    file = tmp_path / "two_walls.yaml"
    file.write_text(TWO_WALLS.replace("step: 0.25", "step: 0.5"))
    return LivePlanner(load_scenario(file))


def of(messages: Any, kind: str) -> dict[str, Any]:
    return next(message for message in messages if message["type"] == kind)


def test_a_free_place_is_reachable_and_its_ways_are_offered(planner: LivePlanner) -> None:
    told = list(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}))
    assert of(told, "place")["status"] == "reachable"
    options = of(told, "options")
    ways = options["all"]
    assert all(math.dist(way["line"][-1], (6.0, 4.0)) < 1e-9 for way in ways)
    assert {card["option"] for card in options["cards"]} <= set(range(len(ways)))
    assert options["cards"][0]["name"] == "knee"
    costs = np.array([list(way["costs"].values()) for way in ways])
    assert not any(((other <= row).all() and (other < row).any()) for row in costs for other in costs)


def test_the_scene_knows_the_unit_of_every_cost_of_the_ways(planner: LivePlanner) -> None:
    """Ways of a lattice cost the exposure that stands in for the mean obstruction."""
    problem = replace(planner.template, criteria=("obstruction", "turns", "length"))
    units = {one["name"]: one["unit"] for one in scene_of(problem, "room")["criteria"]}
    front = problem.solve("lattice", step=1.0)
    assert "obstruction" not in front.names
    assert {name: units[name] for name in front.names} == {"exposure": "s", "turns": "1", "length": "m"}


def test_a_blocked_place_leads_to_the_nearest_free_one(planner: LivePlanner) -> None:
    place = of(planner.destination(0.0, START, {"x": 2.1, "y": 1.0}), "place")
    assert (place["status"], "a wall" in place["words"]) == ("nearest", True)
    assert 1.4 < place["goal"]["x"] < 2.7
    assert f"{math.dist((place['goal']['x'], place['goal']['y']), (2.1, 1.0)):.1f} m away" in place["words"]
    outside = of(planner.destination(0.0, START, {"x": 60.0, "y": 1.0}), "place")
    assert (outside["status"], outside["goal"]) == ("blocked", None)


def test_before_a_landmark_the_robot_ends_some_steps_away_turned_to_it(tmp_path: Path) -> None:
    file = tmp_path / "seen.yaml"
    scenario = TWO_WALLS.replace("step: 0.25", "step: 0.5")
    file.write_text(f"{scenario}landmarks: [{{x: 4.0, y: 2.5, z: 1.0, facing: 90 deg, name: clock}}]\n")
    planner = LivePlanner(load_scenario(file))
    options = of(planner.destination(0.0, START, {"landmark": "clock"}), "options")
    assert options["all"]
    assert planner.offer is not None
    for way in planner.offer.ways.trajectories:
        x, y, yaw = (float(getattr(way.states, name)[-1]) for name in ("x", "y", "yaw"))
        assert 0.8 <= math.dist((x, y), (4.0, 2.5)) <= 2.5
        assert y > 2.5  # on the side to which it faces
        assert abs(math.remainder(math.atan2(2.5 - y, 4.0 - x) - yaw, math.tau)) < 1e-6


def test_a_closed_area_across_all_ways_blocks_the_destination(planner: LivePlanner) -> None:
    list(planner.close(0.0, START, [[3.0, 0.0], [3.5, 0.0], [3.5, 5.0], [3.0, 5.0]], "the tour"))
    told = list(planner.destination(0.1, START, {"x": 6.0, "y": 4.0}))
    assert [message.get("status") for message in told if message["type"] == "place"] == ["reachable", "blocked"]
    list(planner.open(0.2, START, "the tour"))
    assert of(planner.destination(0.3, START, {"x": 6.0, "y": 4.0}), "options")["all"]


def test_the_plan_of_a_push_is_the_way_with_the_least_mean_angle(planner: LivePlanner) -> None:
    options = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    list(planner.take(0.0, START, options["cards"][0]["option"]))
    for direction in (-1.5, 0.0, 0.7):
        list(planner.options(0.0, START))
        assert planner.offer is not None
        ways, present = planner.offer.ways.trajectories, planner.offer.ways.present
        gaps = [brute(way, START[2] + direction) for way in ways]
        pushed = of(planner.push(0.0, START, direction), "pushed")
        assert gaps[pushed["option"]] == pytest.approx(min(gaps), abs=1e-9)
        assert pushed["followed"] or pushed["option"] == present


def test_a_push_just_after_a_new_destination_was_taken_takes_the_nearest_of_the_ways_that_were_offered(
    planner: LivePlanner,
) -> None:
    options = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    list(planner.take(0.0, START, options["cards"][0]["option"]))
    assert planner.offer is not None
    gaps = [brute(way, START[2] + 0.7) for way in planner.offer.ways.trajectories]
    assert len(gaps) > 1
    pushed = of(planner.push_at_once(0.1, START, 0.7), "pushed")
    assert gaps[pushed["option"]] == pytest.approx(min(gaps), abs=1e-9)


def test_a_push_that_was_sent_while_the_ways_of_a_new_destination_were_checked_is_followed(
    planner: LivePlanner,
) -> None:
    options = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    planner.clock = lambda: 0.4
    list(planner.take(0.0, START, options["cards"][0]["option"]))
    kinds = [message["type"] for message in planner.push_at_once(0.1, START, 1.2)]
    assert kinds == ["pushed", "plan", "taken"]


def test_a_push_takes_the_nearest_way_that_is_open_and_none_if_there_is_none(planner: LivePlanner) -> None:
    list(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}))
    assert planner.offer is not None
    ways = planner.offer.ways
    gaps = [brute(way, 0.7) for way in ways.trajectories]
    nearest = nearest_to_push(ways, 0.7)
    assert nearest is not None
    open_ = {*range(len(gaps))} - {nearest.row}
    pushed = nearest_to_push(ways, 0.7, open_.__contains__)
    assert pushed is not None
    assert gaps[pushed.row] == pytest.approx(min(gaps[row] for row in open_), abs=1e-9)
    assert nearest_to_push(ways, 0.7, lambda row: False) is None
    assert nearest_to_push(Ways((), ways.costs[:0], ways.front), 0.7) is None


def test_a_push_beside_a_request_takes_the_way_that_it_would_take_after_it(planner: LivePlanner) -> None:
    options = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    assert list(planner.push_at_once(0.0, START, 1.5)) == []  # no drive yet: it waits
    list(planner.take(0.0, START, options["cards"][0]["option"]))
    list(planner.options(0.0, START))
    assert planner.offer is not None
    gaps = [brute(way, START[2] + 1.5) for way in planner.offer.ways.trajectories]
    told = list(planner.push_at_once(0.1, START, 1.5))
    assert [message["type"] for message in told] == ["pushed", "plan", "taken"]
    assert gaps[told[0]["option"]] == pytest.approx(min(gaps), abs=1e-9)
    taken = told[0]["option"]
    assert planner.offer is not None
    gaps = [brute(way, START[2]) for way in planner.offer.ways.trajectories]
    again = list(planner.push_at_once(0.2, START, 0.0))  # from the same ways, of which the plan is now another one
    assert again[0]["option"] == int(np.argmin(gaps)) != taken
    assert planner.drive is not None
    end = Trajectory.from_description(planner.template.model, again[1]["trajectory"])
    way = planner.offer.ways.trajectories[again[0]["option"]]
    assert (end.states.x[-len(way.states.x) :] == way.states.x).all()
    assert [message["type"] for message in planner.push_at_once(0.25, START, 0.0)] == ["pushed"]  # it keeps on


def test_a_way_that_is_chosen_late_is_taken_where_it_can_still_be_reached(planner: LivePlanner) -> None:
    options = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    list(planner.take(0.0, START, options["cards"][0]["option"]))
    list(planner.options(0.0, START))
    offers = of(planner.show(0.0, START), "options")
    explorer = of(planner.explore(0.0, START), "explorer")["payload"]
    assert explorer["count"] in (len(offers["all"]), len(offers["all"]) - 1)  # without a present plan that is dominated
    drive = planner.drive
    assert drive is not None
    state = drive.at(2.0).state
    pose = (float(state.x[0]), float(state.y[0]), float(state.yaw[0]))
    told = list(planner.take(2.0, pose, offers["present"], asked=offers["asked"]))
    kinds = [message["type"] for message in told]
    assert kinds[:3] == ["options", "plan", "taken"]
    assert told[0]["commit"]["t"] > 2.0 + planner.brakes
    assert told[1]["line"][0] == [1.0, 1.0]


def brute(way: Trajectory, heading: float) -> float:
    """Mean angle between a heading and that of a way, at 0, 0.1, ..., 3 s."""
    yaws = [float(way.at(min(0.1 * i, way.duration)).yaw[0]) for i in range(31)]
    return sum(abs(math.remainder(yaw - heading, math.tau)) for yaw in yaws) / len(yaws)


def test_a_new_destination_is_taken_where_the_robot_can_still_turn_however_long_the_search_took(
    planner: LivePlanner,
) -> None:
    """The clock goes on by 0.8 s while ways are searched from where the robot can still turn."""
    told = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    list(planner.take(0.1, START, told["cards"][0]["option"]))
    assert planner.drive is not None
    x, y, yaw = (float(getattr(planner.drive.at(1.0).state, name)[0]) for name in ("x", "y", "yaw"))
    told = of(planner.destination(1.0, (x, y, yaw), {"x": 1.0, "y": 4.0}), "options")
    late = clock = told["commit"]["t"] - planner.brakes + 0.02
    planner.clock = lambda: clock
    x, y, yaw = (float(getattr(planner.drive.at(late).state, name)[0]) for name in ("x", "y", "yaw"))
    begins, plans = told["commit"]["t"], 0
    for message in planner.take(late, (x, y, yaw), told["cards"][0]["option"], told["asked"]):
        if message["type"] == "options":
            clock += 0.8 if message["asked"] == late else 0.0
            begins = message["commit"]["t"]
        if message["type"] == "plan":
            plans += 1
            assert begins >= clock + planner.brakes
    assert plans == 1


@pytest.mark.parametrize("thinks", [0.05, 0.7, 1.5, 2.5, 5.0])
def test_a_robot_that_was_stopped_takes_a_way_to_a_new_destination_from_where_it_stands(
    planner: LivePlanner, thinks: float
) -> None:
    """However long the viewer looks at the ways, the plan at that time is where the robot stands."""
    told = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    list(planner.take(0.1, START, told["cards"][0]["option"]))
    assert planner.drive is not None
    stands = tuple(float(getattr(planner.drive.at(1.0).state, name)[0]) for name in ("x", "y", "yaw"))
    told = of(planner.destination(3.0, stands, {"x": 1.0, "y": 4.0}), "options")
    plan = of(planner.take(3.0 + thinks, stands, told["cards"][0]["option"], told["asked"]), "plan")
    assert plan["now"] == 3.0 + thinks
    state = Trajectory.from_description(planner.template.model, plan["trajectory"]).at(plan["elapsed"])
    assert math.dist((float(state.x[0]), float(state.y[0])), stands[:2]) < 0.1 + 1e-6  # m, what it drives in `STALE` s
    assert abs(math.remainder(float(state.yaw[0]) - stands[2], math.tau)) < 0.1


def test_a_late_choice_of_a_new_destination_is_searched_once_if_that_takes_about_as_long_as_before(
    planner: LivePlanner,
) -> None:
    """The clock goes on by 0.5 s while ways to the new destination are searched."""
    told = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    list(planner.take(0.1, START, told["cards"][0]["option"]))
    assert planner.drive is not None
    clock = 1.0
    planner.clock = lambda: clock

    def answered(kind: str, *values: Any) -> list[dict[str, Any]]:
        nonlocal clock
        assert planner.drive is not None
        pose, told = tuple(float(getattr(planner.drive.at(clock).state, name)[0]) for name in ("x", "y", "yaw")), []
        for message in getattr(planner, kind)(clock, pose, *values):
            clock += 0.5 if message["type"] == "options" else 0.0
            told.append(message)
        return told

    told = of(answered("destination", {"x": 1.0, "y": 4.0}), "options")
    clock = told["commit"]["t"] - planner.brakes + 0.02  # the viewer has looked at the ways
    kinds = [message["type"] for message in answered("take", told["cards"][0]["option"], told["asked"])]
    assert kinds.count("options") == 1
    assert kinds.count("taken") == 1


def test_ways_of_an_older_question_and_the_end_of_an_older_drive_change_nothing(planner: LivePlanner) -> None:
    options = of(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}), "options")
    told = list(planner.take(0.0, START, 0, asked=options["asked"] + 1.0))
    assert [message["type"] for message in told] == ["refused"]
    list(planner.take(0.0, START, 0, asked=options["asked"]))
    list(planner.arrived(0.1, START, there=False))
    assert planner.drive is not None
    list(planner.arrived(0.2, START))
    assert planner.drive is None


def test_a_robot_that_has_left_its_plan_is_told_to_stop(planner: LivePlanner) -> None:
    list(planner.destination(0.0, START, {"x": 6.0, "y": 4.0}))
    list(planner.take(0.0, START, 0))
    corners = [[6.5, 0.2], [6.8, 0.2], [6.8, 0.5]]
    for pose, lost in ((START, False), ((60.0, 4.5, 0.0), True)):
        told = answers(planner, {"kind": "close", "now": 0.2, "pose": pose, "area": corners, "name": f"area {lost}"})
        assert ("lost" in [message["type"] for message in told]) == lost
