"""A live session drives a robot behind a bridge: it follows plans, and stands where it must."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
import shapely

import hpop
from hpop.live.bridged import RosRobot, SeenPeople
from hpop.problems.problem import Problem
from hpop.ros import FollowInterface
from hpop.ros.messages import header
from hpop.trajectories.trajectory import Trajectory
from tests.live.conftest import ROOM, Page, served
from tests.ros.bridge import FakeBridge, fake_bridge
from tests.ros.test_follow_server import QUICK, DrivenRobot, bridge_waits, map_message, robot_at


@pytest.fixture
def bridge() -> Iterator[FakeBridge]:
    with fake_bridge() as made:
        yield made


class Driver:
    """The loop of a session, which steps its robot 50 times a second while ``drives`` is set."""

    def __init__(self, robot: RosRobot) -> None:
        self.robot, self.drives, self._closed = robot, Event(), Event()
        self.drives.set()
        self._thread = Thread(target=self._live)
        self._thread.start()

    def _live(self) -> None:
        began = time.monotonic()
        while not self._closed.wait(0.02):
            if self.drives.is_set():
                self.robot.advance(time.monotonic() - began, brakes=bool(self.robot.trouble()))

    def until(self, holds: Callable[[], bool], seconds: float = 20.0) -> None:
        last = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < last, self.robot.trouble()
            time.sleep(0.01)

    def close(self) -> None:
        self._closed.set()
        self._thread.join()


@contextmanager
def driver_of(bridge: FakeBridge, *corners: tuple[float, float]) -> Iterator[tuple[Driver, DrivenRobot]]:
    """Drive a robot in a hall of 6 x 4 m along a path from (1, 1)."""
    problem = Problem(
        hpop.World.from_cells(np.zeros((40, 60), np.bool_), 0.1), QUICK, (1, 1, 0), (4, 1, None), ["turns", "length"]
    )
    robot = RosRobot(problem, bridge.url, FollowInterface())
    plan = Trajectory.from_poses(QUICK, [(1, 1, 0), *((x, y, 0) for x, y in corners)])
    with robot_at(bridge, 1.0, 1.0, 0.0) as driven:
        with robot.running():
            driver = Driver(robot)
            try:
                driver.until(lambda: robot.trouble() == "")
                robot.follow(plan, 0.0, arrives=True)
                yield driver, driven
            finally:
                driver.close()
        bridge_waits(lambda: driven.v == driven.w == 0.0)


def test_it_follows_a_plan_and_stands_when_it_is_told_nothing_of_its_pose(bridge: FakeBridge) -> None:
    with driver_of(bridge, (3.0, 1.0)) as (driver, driven):
        driver.until(lambda: driven.x > 1.3)
        driven.blind.set()
        driver.until(lambda: driven.v == 0.0 and "where it is" in driver.robot.trouble())
        assert driven.x < 2.9
        driven.blind.clear()
        driver.until(lambda: driver.robot.arrived)
        assert math.dist((driven.x, driven.y), (3.0, 1.0)) < 0.1
        assert driven.fastest <= QUICK.speed * (1.0 + 1e-9)
    assert bridge.log == []


def test_it_brakes_when_the_session_says_no_more_and_at_the_end(bridge: FakeBridge) -> None:
    with driver_of(bridge, (5.0, 1.0)) as (driver, driven):
        driver.until(lambda: driven.v > 1.0)
        driver.drives.clear()
        driver.until(lambda: driven.v == 0.0)
        assert driven.x < 4.9
        driver.drives.set()  # the law thinks that it stood meanwhile
        driver.until(lambda: driver.robot.is_astray)
        begin = (driven.x, driven.y, driven.yaw)
        driver.robot.follow(Trajectory.from_poses(QUICK, [begin, (1.0, 1.0, math.pi)]), 0.0, arrives=True)
        driver.until(lambda: driven.v > 0.5)
    assert driven.x > 1.1


def test_it_stops_before_what_appears_on_its_map_and_knows_the_people(bridge: FakeBridge) -> None:
    with driver_of(bridge, (5.0, 1.0)) as (driver, driven):
        bridge.tell("/map", map_message([(40, 0, 42, 20)]))
        driver.until(lambda: driver.robot.trouble() == "an obstacle is in the way" and driven.v == 0.0)
        assert driven.x < 4.0 - QUICK.radius
        (corners,) = driver.robot.areas.values()  # without the cells at the edge of the world
        assert sorted(map(tuple, corners)) == [(4.0, 0.1), (4.0, 2.0), (4.2, 0.1), (4.2, 2.0)]
        bridge.tell("/map", map_message([]))
        driver.until(lambda: driver.robot.arrived)
        assert driver.robot.areas == {}
        person = {"name": "a", "position": {"x": 2.0, "y": 3.0, "z": 0.0}, "velocity": {"x": 0.5, "y": 0.0, "z": 0.0}}
        bridge.tell("/people", {"header": header(0, "map"), "people": [person]})
        people = SeenPeople(driver.robot.base)
        driver.until(lambda: len(people.advance(0.0, (0.0, 0.0, 0.0))) == 1)
        x, *others = people.advance(0.0, (0.0, 0.0, 0.0))[0]
        assert others == [3.0, 0.5, 0.0]
        assert 2.0 <= x < 2.5
        bridge.tell("/hpop/stop", {"data": True})
        driver.until(lambda: "stopped by its topic" in driver.robot.trouble())
    assert bridge.log == []


@pytest.mark.proof
def test_a_viewer_drives_a_robot_behind_a_bridge_to_its_destination(bridge: FakeBridge, tmp_path: Path) -> None:
    """Choose, take, close the page on the way, go on, meet a new wall on the map, lose the bridge, go on, arrive."""
    room = ROOM.replace("radius: 0.25", "radius: 0.25, speed: 1.5, acceleration: 3.0, turn_rate: 3.0")
    with served(tmp_path, room, robot=bridge.url) as server, robot_at(bridge, 1.0, 1.0, 0.0) as driven:
        page = Page(server.address())
        page.until("scene")
        page.until("note", lambda note: note["words"] == "the map is prepared")
        page.until("state", lambda state: state["braked"] == "")
        page.say("destination", x=6.0, y=4.0)
        page.say("take", option=page.until("options")["cards"][0]["option"])
        page.until("state", lambda state: math.dist((state["x"], state["y"]), (1.0, 1.0)) > 0.3)
        page.close()
        bridge_waits(lambda: driven.v == driven.w == 0.0)
        page = Page(server.address())
        assert page.until("scene")["role"] == "drive"
        page.say("go")
        page.until("state", lambda state: state["moving"] and driven.v != 0.0)
        bridge.tell("/map", map_message([(30, 0, 33, 20)]))
        (name,) = page.until("closed")["names"]
        assert name == "on the map at 3.1, 1.0"
        bridge.drop()
        page.until("note", lambda note: "not connected" in note["words"])
        bridge_waits(lambda: driven.v == driven.w == 0.0)
        page.until("state", lambda state: state["braked"] == "stopped")
        while page.until("state")["braked"]:  # a robot that is not connected again yet stops anew
            page.say("go")
        page.until("arrived")
        assert math.dist((driven.x, driven.y), (6.0, 4.0)) < 0.1
        page.close()
    walls = shapely.union_all([shapely.box(2.0, 0.0, 2.3, 3.2), shapely.box(3.0, 0.0, 3.3, 2.0)])
    assert shapely.LineString(driven.passed).distance(walls) >= 0.25 - 0.03
    assert driven.fastest <= 1.5 * (1.0 + 1e-9)
