"""Follower over a websocket to a bridge written from the document of rosbridge; a robot on its other side drives."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
import shapely
from websockets.exceptions import ConnectionClosed

import hpop
from hpop.errors import OptionError, RosError
from hpop.planners.graph_planners import Lattice
from hpop.ros import (
    Bridge,
    FollowInterface,
    FollowPlanner,
    FollowServer,
    FollowSettings,
    Interface,
    SimulatedClock,
    plain,
    planar_pose,
    pose_message,
)
from hpop.ros.follow_server import RobotServer
from hpop.ros.messages import header, transform
from tests.ros.bridge import ABORTED, CANCELED, SUCCEEDED, FakeBridge, fake_bridge
from tests.ros.conftest import DELAYS
from tests.ros.robot import Robot

TO_POSE, THROUGH = "/hpop/navigate_to_pose", "/hpop/navigate_through_poses"
QUICK = hpop.DifferentialDrive(radius=0.2, speed=2.0, acceleration=6.0, turn_rate=6.0, turn_acceleration=24.0)


class DrivenRobot(Robot):
    """A robot behind the bridge: it obeys /cmd_vel 50 times a second, and publishes transforms, until closed.

    With a ``rate`` its time is simulated, runs that many times as fast, begins at 1000 s, and is told on /clock.
    """

    def __init__(self, bridge: FakeBridge, *pose: float, rate: float = 0.0) -> None:
        super().__init__(*pose)
        self.bridge, self.blind, self.commands = bridge, Event(), 0
        self.rate, self.begin, self.zero = rate, time.monotonic(), 1000.0
        self._closed, self._taken = Event(), 0
        self._thread = Thread(target=self._live)
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._thread.join()

    def time(self) -> float:
        """Return the time, s; a simulated one is also told."""
        if not self.rate:
            return time.monotonic()
        now = self.zero + self.rate * (time.monotonic() - self.begin)
        self.bridge.tell("/clock", {"clock": {"sec": int(now), "nanosec": int(now % 1.0 * 1e9)}})
        return now

    def _live(self) -> None:
        v = w = 0.0
        told, last, moment = 0.0, 0.0, self.time()
        while not self._closed.wait(0.02 / max(self.rate, 1.0)):
            before, moment = moment, self.time()
            now = moment
            for topic, message in self.bridge.published[self._taken :]:
                self._taken += 1
                if topic == "/cmd_vel":
                    twist = getattr(message, "twist", message)
                    v, w, last, self.commands = twist.linear.x, twist.angular.z, now, self.commands + 1
            if now - last > 0.5:  # as bases do that get no commands
                v = w = 0.0
            self.drive(v, w, now - before)
            if not self.blind.is_set() and now - told > 0.04:
                told = now
                self.publish()

    def publish(self) -> None:
        turned = (0.0, 0.0, math.sin(0.5 * self.yaw), math.cos(0.5 * self.yaw))
        stamp = int(1e9 * self.time()) if self.rate else time.time_ns()
        # odometry has drifted by (1, 2), which localisation knows
        links = [
            transform(stamp, "odom", "base_link", (self.x - 1.0, self.y - 2.0, 0.0), turned),
            transform(stamp, "map", "odom", (1.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
        ]
        data = json.dumps({"op": "publish", "topic": "/tf", "msg": {"transforms": links}})
        for client in list(self.bridge.clients):
            if "/tf" in client.heard:
                with suppress(ConnectionClosed):
                    client.connection.send(data)


@contextmanager
def following(
    bridge: FakeBridge,
    model: hpop.DifferentialDrive = QUICK,
    known: FollowInterface | None = None,
    settings: FollowSettings | None = None,
    say: Callable[[str], None] = lambda line: None,
    clock: SimulatedClock | None = None,
) -> Iterator[FollowServer]:
    """Drive the robot of a hall of 6 x 4 m, of cells, over a bridge."""
    world = hpop.World.from_cells(np.zeros((40, 60), np.bool_), 0.1)
    problem = hpop.Problem(world, model, (1, 1, 0), (4, 1, None), ["turns", "length"])
    known = known or FollowInterface()
    planner = FollowPlanner(problem, [Lattice(step=0.5)], Interface(frame_id=known.frame_id))
    planner.rehearsed()
    server = FollowServer(planner, settings or FollowSettings(), known, say=say, clock=clock)
    client = Bridge(bridge.url, server, say=say, delays=DELAYS)
    thread = Thread(target=client.run)
    thread.start()
    try:
        yield server
    finally:
        client.stop()
        thread.join()
        server.close()


@contextmanager
def robot_at(bridge: FakeBridge, *pose: float, rate: float = 0.0) -> Iterator[DrivenRobot]:
    robot = DrivenRobot(bridge, *pose, rate=rate)
    try:
        yield robot
    finally:
        robot.close()


def told(bridge: FakeBridge, topic: str) -> list[Any]:
    return [message for name, message in bridge.published if name == topic]


def map_message(boxes: list[tuple[int, int, int, int]]) -> Any:
    cells = np.zeros((40, 60), int)
    for left, low, right, high in boxes:
        cells[low:high, left:right] = 100
    origin = pose_message(0, 0, 0)["pose"]
    info = {"map_load_time": {"sec": 0, "nanosec": 0}, "resolution": 0.1, "width": 60, "height": 40, "origin": origin}
    return {"header": header(0, "map"), "info": info, "data": cells.ravel().tolist()}


def test_it_drives_to_a_pose_and_tells_feedback_path_and_options(bridge):
    with following(bridge), robot_at(bridge, 1.0, 1.0, 0.0) as robot:
        goal = bridge.ended(bridge.send_goal(TO_POSE, {"pose": pose_message(2.0, 1.0, 0.0), "behavior_tree": ""}))
        assert (goal.status, goal.result.error_code, goal.result.error_msg) == (SUCCEEDED, 0, "")
        assert math.dist((robot.x, robot.y), (2.0, 1.0)) < 0.1
        assert goal.feedback >= 1
        assert planar_pose(plain(goal.fed_back)["current_pose"]).frame == "map"
        path = told(bridge, "/hpop/path")[-1]
        assert planar_pose(plain(path.poses[-1]))[:2] == pytest.approx((2.0, 1.0))
        options = json.loads(told(bridge, "/hpop/options")[-1].data)
        assert (options["goal"], options["names"]) == (goal.id, ["turns", "length"])
        assert json.loads(told(bridge, "/hpop/state")[-1].data)["state"] in ("driving", "idle")
        assert robot.commands > 5
    assert bridge.log == []


def test_simulated_time_is_that_of_the_last_message_and_a_wait_for_it_ends_when_it_is_set_back():
    clock = SimulatedClock()
    with pytest.raises(RosError, match="no time has come on /clock"):
        clock.now()
    assert not clock.hear({"clock": {"sec": 7, "nanosec": 250_000_000}})
    assert (clock.now(), clock.stamp()) == (7.25, 7_250_000_000)
    assert clock.wait(7.25, Event()) == 7.25
    assert clock.hear({"clock": {"sec": 1, "nanosec": 0}})
    assert clock.wait(7.3, Event()) == 1.0
    for wrong in ({}, {"clock": 3}, {"clock": {"sec": -1, "nanosec": 0}}, {"clock": {"sec": 1, "nanosec": 1e10}}):
        with pytest.raises(RosError, match="clock"):
            clock.hear(wrong)


@pytest.mark.proof
def test_it_drives_by_the_clock_of_a_simulation_until_that_is_set_back(bridge):
    model, clock = hpop.DifferentialDrive(radius=0.2, speed=1.0, acceleration=1.0), SimulatedClock()
    settings = FollowSettings(late=2.0)
    to = {"pose": pose_message(2.5, 1.0, 0.0)}
    with following(bridge, model, settings=settings, clock=clock):
        early = bridge.ended(bridge.send_goal(TO_POSE, to))
        assert early.result.error_msg.startswith("no time has come on /clock; start the simulation")
        with robot_at(bridge, 1.0, 1.0, 0.0, rate=4.0) as robot:
            assert clock.wait(-math.inf, Event()) >= 1000.0
            goal = bridge.ended(bridge.send_goal(TO_POSE, to))
            assert goal.status == SUCCEEDED
            assert math.dist((robot.x, robot.y), (2.5, 1.0)) < 0.3
            assert plain(goal.fed_back)["navigation_time"]["sec"] >= 1  # simulated; it drives for 2.5 s
            goal = bridge.send_goal(TO_POSE, {"pose": pose_message(1.0, 1.0, 0.0)})
            bridge_waits(lambda: goal.feedback > 0)
            robot.zero = 10.0 - robot.rate * (time.monotonic() - robot.begin)
            assert (bridge.ended(goal).status, goal.result.error_msg) == (ABORTED, "the simulated time was set back")
    assert bridge.log == []


@pytest.mark.proof
def test_it_stops_when_tf_is_lost_stops_before_what_appears_and_drives_round_it(bridge):
    model = hpop.DifferentialDrive(radius=0.2, speed=1.0, acceleration=1.0)
    with following(bridge, model), robot_at(bridge, 1.0, 2.0, 0.0) as robot:
        bridge.tell("/map", map_message([]))
        goal = bridge.send_goal(
            THROUGH, {"poses": [pose_message(2.5, 2.0, 0), pose_message(5, 2, 0)], "behavior_tree": ""}
        )
        bridge_waits(lambda: robot.v > 0.7)
        robot.blind.set()
        bridge_waits(lambda: robot.v == 0.0)
        place = robot.x
        time.sleep(1.0)
        assert robot.x == place < 4.0
        bridge.tell("/map", map_message([(40, 10, 42, 31)]))
        robot.blind.clear()
        assert bridge.ended(goal).status == SUCCEEDED
        assert goal.fed_back.number_of_poses_remaining == 1
        way = shapely.LineString(robot.passed)
        assert way.distance(shapely.box(4.0, 1.0, 4.2, 3.1)) >= 0.2
        assert len(told(bridge, "/hpop/path")) >= 2  # more on a machine so busy that poses come late
    assert bridge.log == []


def bridge_waits(what: Callable[[], bool]) -> None:
    """Wait for what a robot does."""
    end = time.monotonic() + 20.0
    while not what():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_goal_is_canceled_replaced_and_refused_with_its_reason(bridge, said):
    with following(bridge, say=said):
        first = bridge.send_goal(TO_POSE, {"pose": pose_message(2.0, 1.0, 0.0)})  # nobody tells where the robot is
        second = bridge.send_goal(THROUGH, {"poses": [pose_message(2.0, 1.0, 0.0)]})
        assert (bridge.ended(first).status, first.result.error_msg) == (ABORTED, "a newer goal took its place")
        bridge.cancel(second)
        assert bridge.ended(second).status == CANCELED
        for args, why in (
            ({"pose": pose_message(2.0, 1.0, 0.0, frame_id="odom")}, "must be in the frame map, got 'odom'"),
            ({"poses": []}, "a goal must have a pose, or 1 to 60 poses, got []"),
            ({"pose": {"pose": {}}}, "position of pose 1 of the goal must be a message with fields"),
        ):
            goal = bridge.ended(bridge.send_goal(TO_POSE, args))
            assert goal.status == ABORTED
            assert why in goal.result.error_msg
    assert bridge.log == []


@pytest.mark.parametrize("distribution", ["humble", "iron"])
def test_results_have_the_fields_of_the_distribution(distribution):
    with fake_bridge(distribution) as bridge:
        known = FollowInterface(distribution=distribution, cmd_type="geometry_msgs/msg/TwistStamped")
        with following(bridge, known=known):
            goal = bridge.send_goal(THROUGH, {"poses": [pose_message(20.0, 1.0, 0.0)]})
            bridge.cancel(goal)
            assert bridge.ended(goal).status == CANCELED
        assert bridge.log == []


WRONG = [
    ("/tf", {"transforms": 3}),
    ("/tf", {"transforms": [{"child_frame_id": "a", "header": {"frame_id": "b"}, "transform": {}}]}),
    ("/map", {"header": {"frame_id": "map"}, "info": {"width": -1}}),
    ("/map", map_message([]) | {"data": [0] * 7}),
    ("/map", map_message([]) | {"data": [101] * 2400}),
    ("/map", map_message([]) | {"header": header(0, "odom")}),
    ("/map_updates", {"x": 0, "y": 0, "width": 1, "height": 1, "data": [0]}),
    ("/people", {"header": header(0, "laser"), "people": []}),
    ("/people", {"header": header(0, "map"), "people": [{"position": {"x": None}}]}),
    ("/hpop/stop", {"data": "yes"}),
    ("/hpop/take", {"data": "knee"}),
    ("/hpop/take", {"data": 3}),
    ("/other", {}),
]


def test_messages_that_make_no_sense_are_said_and_harm_nothing(bridge, said):
    with following(bridge, say=said), robot_at(bridge, 1.0, 1.0, 0.0):
        bridge.offered(TO_POSE)
        for topic, message in WRONG:
            bridge.raw(json.dumps({"op": "publish", "topic": topic, "msg": message}))
        goal = bridge.send_goal(TO_POSE, {"pose": pose_message(1.5, 1.0, 0.0)})
        assert bridge.ended(goal).status == SUCCEEDED
    assert sum(line.startswith("ignored ") for line in said) == len(WRONG)


@pytest.mark.parametrize(
    "changes",
    [
        {"prefix": "hpop/"}, {"cmd_topic": ""}, {"map_topic": "/a//b"}, {"people_type": "std_msgs/msg/String"},
        {"base_frame": "/base"}, {"rate": 1.0}, {"distribution": "noetic"}, {"cmd_type": "Twist"}, {"pose_type": ""},
    ],
)  # fmt: skip
def test_names_that_are_none_are_refused(changes):
    with pytest.raises(OptionError, match=next(iter(changes))):
        FollowInterface(**changes)


class Maps:
    """Listener that counts maps and stops."""

    def __init__(self) -> None:
        self.grids, self.stops = [], []

    def mapped(self, grid):
        self.grids.append(grid)

    def halt(self, stopped):
        self.stops.append(stopped)

    def located(self, pose, at):
        raise AssertionError("no pose was told")


def test_what_is_heard_before_a_simulation_begins_is_heard_when_it_does():
    """Latched topics, such as the map, are not sent again: walls would stay unknown."""
    listener, refused = Maps(), list[str]()
    server = RobotServer(listener, FollowInterface(), say=refused.append, clock=SimulatedClock())
    subscribed = [message["topic"] for message in server.greetings() if message["op"] == "subscribe"]
    assert subscribed[0] == "/clock"
    hear = server.ops()["publish"]
    for boxes in ([], [(40, 10, 42, 31)]):
        hear({"topic": "/map", "msg": map_message(boxes)})
    hear({"topic": "/hpop/stop", "msg": {"data": True}})
    assert not listener.grids
    hear({"topic": "/clock", "msg": {"clock": {"sec": 1, "nanosec": 0}}})
    assert (len(listener.grids), listener.stops) == (1, [True])  # the last map
    hear({"topic": "/map", "msg": map_message([])})
    assert len(listener.grids) == 2
