"""A live session in simulated time: its planner is in this process, and its answers come some seconds later."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hpop.cli.live_planner import answers, at_once
from hpop.live.planner import LivePlanner
from hpop.live.process import PlannerProcess
from hpop.live.record import Record
from hpop.live.scene import scene_of
from hpop.live.session import TICK, LiveSession
from hpop.live.simulator import LiveRobot, SimulatorOptions
from hpop.scenario import load_scenario
from hpop.simulation import Pedestrians, Walking
from hpop.trajectories.contacts import distance_to_outline
from hpop.trajectories.trajectory import Trajectory

Pose = tuple[float, float, float]


class SteppedPlanner(PlannerProcess):
    """Client of a planner in this process.

    late  returns the seconds of the session after which the answer to a request of a kind is there
    """

    def __init__(self, tell: Any, planner: LivePlanner, late: Callable[[str], float]) -> None:
        super().__init__(Path(), (), tell)
        self.planner, self.late, self.is_ready = planner, late, True
        self.answered = list[tuple[str, float]]()  # kind of each request, and seconds until its answer
        self._now = 0.0
        self._coming = list[tuple[float, bool, list[dict[str, Any]]]]()  # when, whether of a push, what

    @property
    def is_busy(self) -> bool:
        return bool(self._coming or self._waiting)

    def _next(self) -> None:
        """Wait for the next step."""

    def step(self, now: float) -> None:
        """Hand on the answers that are there by now; begin with the requests that have waited longest."""
        self._now = now
        while self._coming and self._coming[0][0] <= now:
            for message in self._coming.pop(0)[2]:
                self.tell(message)
        for kind, given in [*self._waiting]:
            if any((kind == "push") == is_push for _, is_push, _ in self._coming):
                continue
            values = {name: value() if callable(value) else value for name, value in given.items()}
            request = {"kind": kind, **values}
            messages = list(at_once(self.planner, request)) if kind == "push" else []
            if kind == "push" and not messages and self._coming:
                continue  # it waits for the other request
            self._waiting.remove((kind, given))
            due = max([now + self.late(kind), *(due for due, _, _ in self._coming)])  # answers come in order
            self._coming.append((due, kind == "push", messages or list(answers(self.planner, request))))
            self.answered.append((kind, due - now))
            if kind != "push":
                self.took = due - now


class Walkers:
    """People who walk on at their velocities, whatever the robot does; a test may change them."""

    radius = 0.25

    def __init__(self, *people: Walking) -> None:
        self.people, self._now = list(people), 0.0

    def advance(self, t: float, robot_pose: Pose) -> list[Walking]:
        step, self._now = t - self._now, t
        self.people = [(x + step * vx, y + step * vy, vx, vy) for x, y, vx, vy in self.people]
        return self.people


class SteppedSession(LiveSession):
    """A session that is driven by one viewer, in steps of `TICK`.

    told    messages that viewers were told
    met     seconds from which a plan that was handed to the robot leads into a person, as people walked then
    off     largest distance of the robot from its plan, m
    gap     least gap between the robot and a person, m
    """

    def __init__(
        self, file: Path, folder: Path, people: Pedestrians, late: Callable[[str], float], **robot: Any
    ) -> None:
        scenario = load_scenario(file)
        self.t = 0.0
        problem, self.told = scenario.problem, list[dict[str, Any]]()
        self.live = LivePlanner(scenario)
        self.live.prepare()
        values = dict(zip(problem.model.space.names, problem.start, strict=True))
        driven = LiveRobot.simulated(
            problem.model, (values["x"], values["y"], values["yaw"]), SimulatorOptions(**robot)
        )
        client = lambda tell: SteppedPlanner(tell, self.live, late)  # noqa: E731
        record = Record(folder / "record.jsonl", {})
        super().__init__(problem, scene_of(problem, "room"), record, client, driven, people)
        self.live.clock = lambda: self.t
        self.met, self.off, self.gap = list[float](), 0.0, np.inf
        follow = driven.follow

        def followed(trajectory: Trajectory, elapsed: float, *, arrives: bool) -> None:
            follow(trajectory, elapsed, arrives=arrives)
            self._judge(trajectory, min(elapsed, 0.0) or driven.clock)

        driven.follow = followed  # type: ignore[method-assign]
        viewer = self.join(may_drive=True)
        assert viewer is not None
        self.viewer = viewer
        viewer.greeted = viewer.wants = True

    @property
    def now(self) -> float:
        return self.t

    def tell(self, message: Any) -> None:
        self.told.append(message)
        super().tell(message)

    def say(self, kind: str, **values: Any) -> None:
        self.act(self.viewer, kind, values)

    def go(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Go on for some seconds, or until something holds; return whether it holds."""
        end = self.t + seconds
        while self.t < end:
            self.t += TICK
            self.viewer.alive = self.t
            self.planner.step(self.t)
            self.step(self.t)
            self.viewer.waiting.clear()
            self._measure()
            if until():
                return True
        return False

    def wait_for(self, kind: str, seconds: float = 30.0) -> dict[str, Any]:
        """Go on until viewers are told a message of a kind, and return it."""
        before = len(self.told)
        fresh = lambda: [message for message in self.told[before:] if message["type"] == kind]  # noqa: E731
        assert self.go(seconds, lambda: bool(fresh())), kind
        return fresh()[0]

    def _measure(self) -> None:
        robot, tracker = self.robot, self.robot._tracker
        if tracker is not None:
            self.off = max(self.off, tracker.off(self.t - robot._zero, robot.base.pose))
        self.gap = min([self.gap, *self._gaps(np.array([robot.base.pose]), self.people, np.zeros(1)).min(axis=1)])

    def _gaps(self, poses: Any, people: Sequence[Walking], times: Any) -> Any:
        """Return the gap, m, to each person (P, N) of the robot at poses (N, 3) and times (N,), s from now."""
        model = self.problem.model
        values = dict.fromkeys(model.space.names, np.zeros(len(poses)))
        states = type(model.space.state(self.problem.start))(
            **values | dict(zip(("x", "y", "yaw"), poses.T, strict=True))
        )
        found = [
            distance_to_outline(model.platform, states, np.stack([x + vx * times, y + vy * times], axis=1)) - radius
            for (x, y, vx, vy), radius in zip(people, self.radii, strict=True)
        ]
        return np.reshape(found, (len(people), len(poses)))

    def _judge(self, trajectory: Trajectory, elapsed: float) -> None:
        """Note when the robot would touch a person by its own motion along a plan that it is handed."""
        done, times = trajectory.execution(), np.arange(0.0, 6.0, 0.1)
        states = done.at(np.clip(elapsed + times, 0.0, done.duration))
        poses = np.stack([states.x, states.y, states.yaw], axis=1)
        here = np.repeat([self.robot.base.pose], times.size, axis=0)
        gaps, stays = (self._gaps(each, self.people, times) for each in (poses, here))
        wrong = ((gaps < -0.02) & (gaps < stays - 0.02)).any(axis=0)
        if wrong.any():
            self.met.append(self.t)
