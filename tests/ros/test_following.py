"""Follower of plans on a small simulated robot: it arrives, and stops where it must."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError, RosError
from hpop.planners.graph_planners import Lattice
from hpop.ros import Interface, PlanarPose, planar_pose
from hpop.ros.follow_plans import Ended, FollowPlanner, FollowSettings, Planned
from hpop.ros.following import Follower
from hpop.ros.observations import FilterScale, OccupancyGrid
from hpop.simulation import Command, SimulatedBase
from hpop.world import Person
from tests.ros.robot import AtOnce, Robot, Trip
from tests.simulation.rooms import ROBOT, room

GOAL = PlanarPose(7.0, 5.0, 0.0, "map")
RADIUS = 0.2


@pytest.fixture(scope="module")
def planner() -> FollowPlanner:
    """Return a planner in a hall of 8 x 6 m of cells, with a wall that leaves a door of 2 m at its upper end."""
    cells = np.zeros((60, 80), np.bool_)
    cells[:40, 38:42] = True
    world = hpop.World.from_cells(cells, 0.1)
    model = hpop.DifferentialDrive(radius=RADIUS, speed=0.8)
    problem = hpop.Problem(world, model, (1, 1, 0), (7, 5, None), ["turns", "length"])
    return FollowPlanner(problem, [Lattice(step=0.5)], Interface())


@pytest.fixture
def trip(planner: FollowPlanner) -> Trip:
    return started(planner, FollowSettings())


def started(planner: FollowPlanner, settings: FollowSettings) -> Trip:
    made = Trip(Follower(planner, settings, AtOnce()), Robot(1.03, 1.08, 0.2))
    made.follower.follow("a", [GOAL], 0.0)
    return made


def hall(*boxes: tuple[int, int, int, int]) -> OccupancyGrid:
    """Return the map of the hall with boxes (column, row, column, row) that are occupied."""
    cells = np.zeros((60, 80), np.int8)
    cells[:40, 38:42] = 100
    for left, low, right, high in boxes:
        cells[low:high, left:right] = 100
    return OccupancyGrid(cells, 0.1, (0.0, 0.0, 0.0))


def least_gap(trip: Trip, *obstacles: shapely.Geometry) -> float:
    """Return the least distance between the robot's surface and obstacles, on its whole way."""
    way = shapely.LineString(trip.robot.passed)
    return min(way.distance(obstacle) for obstacle in obstacles) - RADIUS


def test_it_arrives_within_the_limits_of_its_model(trip, planner):
    ended = trip.go_until_ended()
    assert ended == Ended("a", True, "reached")
    assert math.dist(trip.robot.passed[-1], GOAL[:2]) < 0.1
    assert least_gap(trip, shapely.box(3.8, 0, 4.2, 4)) >= 0
    model = planner.problem.model
    assert trip.robot.fastest <= model.speed + 1e-9
    assert trip.robot.hardest <= model.acceleration * (1 + 1e-6)
    (planned,) = (event for event in trip.events if isinstance(event, Planned))
    assert planar_pose(planned.path["poses"][-1])[:2] == pytest.approx(GOAL[:2])
    assert json.loads(json.dumps(planned.options))["points"] >= 1
    trip.go(0.1)
    assert trip.stands
    assert trip.follower.step(trip.now).command is None  # others may drive now


def test_it_drives_to_several_poses_in_their_order(planner):
    trip = Trip(Follower(planner, FollowSettings(), AtOnce()), Robot(1.0, 1.0, 0.0))
    poses = [PlanarPose(1.0, 5.0, 0.0, "map"), PlanarPose(3.0, 2.0, 0.0, "map"), GOAL]
    trip.follower.follow("tour", poses, 0.0)
    left = []
    trip.go(120, lambda: left.append(trip.state()["poses_remaining"]) or bool(trip.events[1:]))
    assert trip.go_until_ended().reached
    assert sorted(set(left), reverse=True) == [3, 2, 1, 0]
    assert left == sorted(left, reverse=True)
    times = [min(range(len(trip.robot.passed)), key=lambda i: math.dist(trip.robot.passed[i], p[:2])) for p in poses]
    assert times == sorted(times)
    assert all(math.dist(trip.robot.passed[i], p[:2]) <= 0.5 for i, p in zip(times, poses, strict=True))


def test_it_stops_when_its_pose_is_lost_and_goes_on_from_there(trip):
    assert trip.go(20, lambda: trip.robot.v > 0.7)
    trip.blind, lost, place = True, trip.now, trip.robot.passed[-1]
    assert trip.go(5, lambda: trip.stands)
    assert trip.now - lost < 0.5 + 0.8 / 1.0 + 0.3
    assert math.dist(trip.robot.passed[-1], place) < 0.8 * (0.5 + 0.1) + 0.8**2 / 2
    trip.go(3)
    assert trip.stands
    state = trip.state()
    assert (state["state"], state["pose"]) == ("waiting", None)
    assert state["why"].startswith("the pose of the robot is ")
    trip.blind = False
    assert trip.go_until_ended().reached


def test_it_brakes_before_an_obstacle_that_appears_and_takes_another_way(trip):
    """A wall appears 1.2 m ahead, across the way to the door but for a gap at its other end."""
    assert trip.go(20, lambda: trip.robot.v > 0.7 and trip.robot.y > 1.3)
    row = int(10 * (trip.robot.y + 1.2))
    trip.follower.mapped(hall((10, row, 38, row + 2)))
    assert trip.go(5, lambda: trip.stands)
    assert trip.go_until_ended().reached
    wall = shapely.box(1.0, row / 10, 3.8, row / 10 + 0.2)
    assert least_gap(trip, wall, shapely.box(3.8, 0, 4.2, 4)) >= 0
    assert sum(isinstance(event, Planned) for event in trip.events) == 2


def test_it_waits_where_there_is_no_way_and_goes_on_when_there_is_one_again(trip):
    assert trip.go(20, lambda: trip.robot.v > 0.7)
    trip.follower.mapped(hall((38, 40, 42, 60)))
    assert trip.go(5, lambda: trip.stands)
    trip.go(10)
    assert trip.stands
    assert "no path" in trip.state()["why"] or "separate" in trip.state()["why"]
    trip.follower.mapped(hall())
    assert trip.go_until_ended().reached


def test_it_gives_up_after_its_patience(planner):
    trip = started(planner, FollowSettings(patience=5.0))
    trip.follower.mapped(hall((38, 40, 42, 60)))
    ended = trip.go_until_ended(20)
    assert not ended.reached
    assert ended.words.startswith("gave up after 6 s: no path")


def test_a_person_who_steps_into_the_way_is_not_touched(trip):
    assert trip.go(20, lambda: trip.robot.v > 0.7)
    way = [planar_pose(pose)[:2] for pose in trip.events[0].path["poses"]]
    near = min(range(len(way)), key=lambda i: math.dist(way[i], trip.robot.passed[-1]))
    place = next(one for one in way[near:] if math.dist(one, trip.robot.passed[-1]) > 1.2)
    body = shapely.Point(place).buffer(0.25)

    def sees() -> bool:
        trip.follower.saw([Person(*place)], trip.now)
        return trip.stands

    assert trip.go(5, sees)
    assert trip.go(120, lambda: sees() and any(isinstance(event, Ended) for event in trip.events))
    assert least_gap(trip, body) >= -0.005
    assert trip.events[-1].reached


def test_a_stop_holds_it_until_it_is_lifted(trip):
    assert trip.go(20, lambda: trip.robot.v > 0.5)
    trip.follower.halt(True)
    assert trip.go(3, lambda: trip.stands)
    trip.go(70)  # longer than its patience, which does not count here
    assert trip.stands
    assert (trip.state()["state"], trip.state()["why"]) == ("waiting", "told to stop")
    trip.follower.halt(False)
    assert trip.go_until_ended().reached


def test_it_asks_after_a_stop_and_takes_what_is_told(planner):
    trip = started(planner, FollowSettings(asks=True))
    assert trip.go(20, lambda: trip.robot.v > 0.5)
    trip.follower.halt(True)
    assert trip.go(3, lambda: trip.stands)
    trip.follower.halt(False)
    trip.go(2)
    assert (trip.state()["state"], trip.stands) == ("asks", True)
    asked = trip.events[-1]
    assert isinstance(asked, Planned)
    assert asked.path is None
    with pytest.raises(RosError, match="no row 9999"):
        trip.follower.take("9999", trip.now)
    trip.follower.take(str(asked.options["named"]["least turns"]), trip.now)
    assert trip.go_until_ended().reached
    taken = trip.events[-2]
    assert taken.options["chosen"] == asked.options["named"]["least turns"]


def test_a_canceled_goal_and_one_that_is_replaced_end_and_the_robot_brakes(trip):
    assert trip.go(20, lambda: trip.robot.v > 0.5)
    trip.follower.follow("b", [GOAL], trip.now)
    assert trip.go_until_ended() == Ended("a", False, "a newer goal took its place")
    assert trip.go(20, lambda: trip.robot.v > 0.5)
    with pytest.raises(RosError, match="cancel must name the goal that the robot follows, 'b', got 'a'"):
        trip.follower.cancel("a")
    trip.follower.cancel("b")
    assert trip.go(3, lambda: trip.stands)
    assert trip.events[-1] == Ended("b", False, "canceled", canceled=True)
    assert trip.robot.hardest <= 1.0 + 1e-6


def test_a_robot_that_is_pushed_off_its_plan_plans_again(trip):
    assert trip.go(20, lambda: trip.robot.v > 0.5)
    trip.robot.x += 0.7
    assert trip.go_until_ended().reached
    assert sum(isinstance(event, Planned) for event in trip.events) == 2


def test_masks_close_areas_and_limit_the_speed(trip):
    closed = replaced(hall(), (10, 20, 38, 22), 100)
    trip.follower.filtered(closed, FilterScale())
    slow = replaced(hall(), (0, 0, 80, 60), 50)
    trip.follower.filtered(slow, FilterScale(kind=1))
    assert trip.go_until_ended().reached
    assert least_gap(trip, shapely.box(1.0, 2.0, 3.8, 2.2)) >= 0
    assert trip.robot.fastest <= 0.4 + 1e-9
    assert FilterScale(2, 0.1, 0.01).speed(20, 1.0) == pytest.approx(0.3)
    assert FilterScale(2, 0.1, 0.01).speed(0, 1.0) == math.inf


def replaced(grid: OccupancyGrid, box: tuple[int, int, int, int], value: int) -> OccupancyGrid:
    cells = np.zeros_like(grid.cells)
    cells[box[1] : box[3], box[0] : box[2]] = value
    return OccupancyGrid(cells, grid.resolution, grid.origin)


@pytest.mark.parametrize(
    "wrong", [{"late": -1.0}, {"off": math.nan}, {"delay": 2.0}, {"choice": ""}, {"asks": "yes"}, {"patience": "long"}]
)
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(OptionError, match=next(iter(wrong))):
        FollowSettings(**wrong)


def test_goals_that_cannot_be_reached_end_with_the_reason(planner):
    trip = Trip(Follower(planner, FollowSettings(), AtOnce()), Robot(1.0, 1.0, 0.0))
    trip.follower.follow("far", [PlanarPose(70.0, 5.0, 0.0, "map")], 0.0)
    ended = trip.go_until_ended(3)
    assert (ended.reached, ended.words) == (False, "the goal (70, 5) is off the map")
    with pytest.raises(RosError, match="at least one pose"):
        trip.follower.follow("none", [], trip.now)


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(4))
def test_with_delay_noise_and_people_it_arrives_and_touches_neither_walls_nor_people(seed):
    """Commands take effect 0.1 s late, poses are off by 1 cm; people walk straight on, and stop before the robot."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((80, 100), np.bool_)
    for _ in range(8):
        x, y = rng.integers(10, 85), rng.integers(5, 70)
        cells[y : y + rng.integers(3, 15), x : x + rng.integers(3, 15)] = True
    cells[5:20, 2:15] = cells[60:78, 82:98] = False
    world = hpop.World.from_cells(cells, 0.1)
    model = hpop.DifferentialDrive(radius=0.25, speed=0.8, acceleration=0.8)
    problem = hpop.Problem(world, model, (1, 1, 0), (9, 7, None), ["turns", "length"])
    planner = FollowPlanner(problem, [Lattice(step=0.5)], Interface())
    follower = Follower(planner, FollowSettings(delay=0.1), AtOnce())
    robot, pending, now = Robot(1.0, 1.0, 0.0), [(0.0, 0.0)] * 2, 0.0
    places = np.column_stack([rng.uniform(3, 8, 3), rng.uniform(2, 6, 3)])
    velocities = rng.normal(0.0, 0.4, (3, 2))
    follower.follow("a", [PlanarPose(9.0, 7.0, 0.0, "map")], now)
    ended: list[Ended] = []
    gaps = []
    while not ended and now < 200:
        apart = np.hypot(*(places - (robot.x, robot.y)).T)
        gaps.append(apart.min() - 0.5)
        moving = np.where((apart < 1.3)[:, None], 0.0, velocities)
        seen = PlanarPose(robot.x + rng.normal(0, 0.01), robot.y + rng.normal(0, 0.01), robot.yaw, "map")
        follower.located(seen, now)
        follower.saw([Person(*place, velocity=tuple(v)) for place, v in zip(places, moving, strict=True)], now)
        step = follower.step(now)
        ended += [event for event in step.events if isinstance(event, Ended)]
        pending.append(step.command or (0.0, 0.0))
        robot.drive(*pending.pop(0), 0.05)
        places += 0.05 * moving
        velocities = np.where((places < 0.5) | (places > (9.5, 7.5)), -velocities, velocities)
        now += 0.05
    assert ended[0].reached
    assert min(gaps) > 0.0
    assert shapely.LineString(robot.passed).distance(world.raster.solid()) > 0.25


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(300))
def test_in_random_rooms_it_stays_near_its_plan_keeps_its_limits_and_touches_nothing(seed: int) -> None:
    """Rooms, delays, slips and noises of the simulator's proof; people walk straight on, and wait before the robot."""
    problem, disturbances, _ = room(seed)
    planner = FollowPlanner(problem, [Lattice(step=0.5, eps=0.05, time_limit=10.0)], Interface())
    follower = Follower(planner, FollowSettings(delay=disturbances["delay"], patience=20.0), AtOnce())
    base = SimulatedBase(problem.model, tuple(problem.start), **disturbances, seed=seed)
    people = problem.world.content.people
    places = np.array([(person.x, person.y) for person in people]).reshape(-1, 2)
    velocities = np.array([person.velocity for person in people]).reshape(-1, 2)
    x, y, _ = problem.goal
    follower.follow("a", [PlanarPose(x, y, 0.0, "map")], 0.0)
    radius, limits, ended, last, off = ROBOT.radius, follower.limits, list[Ended](), Command(0.0, 0.0), 0.0
    walls = shapely.union_all([obstacle.polygon for obstacle in problem.world.obstacles])
    for i in range(4000):
        now = 0.05 * i
        apart = np.hypot(*(places - base.pose[:2]).T)
        assert not len(places) or apart.min() > radius + 0.25
        assert not walls.distance(shapely.Point(base.pose[:2])) <= radius  # NaN in an empty room
        moving = np.where((apart < radius + 0.25 + 0.7)[:, None], 0.0, velocities)
        follower.located(PlanarPose(*base.measured, "map"), now)
        follower.saw([Person(*at, velocity=tuple(v)) for at, v in zip(places, moving, strict=True)], now)
        step = follower.step(now)
        command = step.command or Command(0.0, 0.0)
        for was, given, speed, change in zip(
            last,
            command,
            (limits.speed, limits.turn_rate),
            (limits.acceleration, limits.turn_acceleration),
            strict=True,
        ):
            assert abs(given) <= speed + 1e-9
            assert abs(given - was) <= 0.05 * change + 1e-6
        last, off = command, max(off, follower.state(now)["off"])
        ended += [event for event in step.events if isinstance(event, Ended)]
        if ended:
            break
        base.command(*command, now)
        base.advance(now + 0.05)
        places = places + 0.05 * moving
    assert off <= 0.5
    assert ended[0].reached or "no path" in ended[0].words or "blocked" in ended[0].words, ended
