"""Simulator of a live session: the base that follows the plan, and the people around it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from hpop.base.math import wrap
from hpop.drive.options import perceived_motions
from hpop.models.execution import clearance_radius
from hpop.motions import Model, States
from hpop.problems.problem import Problem
from hpop.simulation import Command, Crowd, DriveLimits, Pedestrians, SimulatedBase, TrackedPeople, Tracker, Walking
from hpop.trajectories.contacts import distance_to_outline
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person

Pose = tuple[float, float, float]

WATCHDOG = 0.5
"""Time, s, without a command after which the simulated base brakes by itself."""
NEAR = 4.0
"""Time, s, around the expected one, within which the place of the robot on a new plan is looked for."""
SAMPLED = 0.02
"""Time between the poses of a plan that are compared with the robot's, s."""
SAME = 1e-3
"""Distance, m, up to which two places count as one."""
ANNOUNCED = 3.0
"""Time, s, before a turn at which it is announced."""
SAME_TURN = 1.5
"""Time, s, between the begins of two turns to one side, up to which they count as one that is announced once."""
LOOKS = tuple(0.2 * i for i in range(1, 8))
"""Moments of a look ahead at people, as shares of the time to brake."""
STILL = 1e-3
"""Speed, m/s or rad/s, below which the robot stands."""
PARTED = 0.05
"""Distance, m, of a robot that drives from a path up to which it is still on it."""
BEHIND = 0.15
"""Distance, m, from the expected place above which a robot does not keep the times of a plan: it has braked since."""
STANDS_OFF = 0.3
"""Distance, m, from a path up to which a robot that stands can still begin to follow it."""
OVERSHOOT = 0.15
"""Distance, m, by which a robot may come to rest behind the place where a new plan stops or turns."""
LOOK, LOOK_AHEAD = 0.05, 6.0
"""Time, s, between the moments for which a plan is compared with people before it is driven, and up to the last one."""
SLIGHT = 0.01
"""Change of a gap, m, that does not count."""
KEEPS = 0.1
"""Distance, m, between the surfaces of the robot and of a visitor who waits before it."""
ASTRAY = 0.4
"""Distance, m, of a person from the predicted place, above which the people are reported to the planner anew."""
RADIUS = 0.25
"""Radius of a person, m."""


@dataclass(frozen=True)
class SimulatorOptions:
    """Options of the simulator.

    delay  s, after which a command takes effect
    slip   largest share by which a wheel drives less far than it turns
    noise  m, largest error of measured positions
    crowd  number of people who walk about and avoid the robot; 0 for the people of the scenario
    seed   of all random numbers
    """

    delay: float = 0.0
    slip: float = 0.0
    noise: float = 0.0
    crowd: int = 0
    seed: int = 0


class AnnouncedTurn(NamedTuple):
    """A turn of the executed plan: the time of the plan at which it begins, s, and its angle, rad, left positive."""

    begin: float
    angle: float


class CommandedBase(Protocol):
    """Base of a robot, which obeys velocity commands; poses are (x m, y m, yaw rad). Times are s of a session."""

    @property
    def pose(self) -> Pose:
        """True pose, as well as it is known."""

    @property
    def measured(self) -> Pose | None:
        """Measured pose; None if none has come lately."""

    @property
    def velocity(self) -> Command:
        """Speed, m/s, and turn rate, rad/s."""

    def command(self, v: float, w: float, t: float) -> None:
        """Send a command at a time: speed, m/s, and turn rate, rad/s."""

    def advance(self, t: float) -> None:
        """Move on to a time."""


class LiveRobot:
    """Robot that follows plans, and brakes when it is told to; then its plan waits.

    base     its base, which obeys commands after ``delay``, s
    turns    turns of the present plan
    arrives  whether the present plan leads to the destination
    braking  s, that braking from the largest speed takes
    """

    def __init__(self, model: Model, base: CommandedBase, delay: float = 0.0) -> None:
        self.base = base
        self._limits = limits = DriveLimits.of(model)
        self.braking = limits.speed / limits.acceleration
        self.turns: tuple[AnnouncedTurn, ...] = ()
        self.arrives = False
        self._delay = delay
        self._tracker: Tracker | None = None
        self._zero, self._now = 0.0, 0.0  # session's time at which the plan began, and now
        self._announced = 0  # turns of the plan
        self._last_turn = (-math.inf, 0.0)  # time of the session at which it begins, s, and its angle, rad

    @classmethod
    def simulated(cls, model: Model, pose: Pose, options: SimulatorOptions) -> LiveRobot:
        """Return a robot with a simulated base, which stands at a pose."""
        base = SimulatedBase(model, pose, options.delay, options.slip, options.noise, options.seed)
        return cls(model, base, options.delay)

    @property
    def areas(self) -> Mapping[str, list[list[float]]]:
        """Corners (x, y), m, by name, of blocked areas that the scenario does not have."""
        return {}

    def running(self) -> AbstractContextManager[None]:
        """Return a context in which the robot runs."""
        return nullcontext()

    @property
    def is_lost(self) -> bool:
        """Return whether there is no connection to the robot."""
        return False

    @property
    def is_astray(self) -> bool:
        """Return whether the robot is too far off its plan to follow it."""
        return False

    def trouble(self) -> str:
        """Return in words why the robot cannot drive now; "" if it can."""
        return ""

    @property
    def pose(self) -> Pose:
        """Measured pose: x m, y m, yaw rad."""
        x, y, yaw = self.base.measured or self.base.pose
        return x, y, float(wrap(yaw))

    @property
    def clock(self) -> float:
        """Time of the executed plan at which the robot is, s."""
        return 0.0 if self._tracker is None else self._tracker.clock(self._now - self._zero)

    @property
    def stands(self) -> bool:
        """Return whether the robot does not move."""
        return max(map(abs, self.base.velocity)) < STILL

    @property
    def arrived(self) -> bool:
        """Return whether the robot is at the end of a plan that leads to its destination."""
        return self._tracker is not None and self.arrives and self._tracker.finished(self._now - self._zero)

    def follow(self, trajectory: Trajectory, elapsed: float, *, arrives: bool) -> None:
        """Continue with a plan, on which the robot is expected at the time ``elapsed``, s.

        Plans among moving people keep their times, and may begin later than now (``elapsed`` is negative), unless the
        robot is elsewhere than expected. On others the robot continues from where it is.
        """
        done = trajectory.execution()
        yaw = trajectory.model.space.names.index("yaw")
        motions = perceived_motions(done)
        self.turns = tuple(AnnouncedTurn(m.begin, float(m.change[yaw])) for m in motions if m.change[yaw])
        self.arrives, self._announced = arrives, 0
        clock = self._clock_on(trajectory, elapsed)
        if self._tracker is None:
            self._tracker = Tracker(trajectory, delay=self._delay)
        self._zero = self._now - clock
        self._tracker.follow(trajectory, max(clock, 0.0))

    def _clock_on(self, trajectory: Trajectory, elapsed: float) -> float:
        """Return the time of a plan, s, from which the robot follows it, if it is expected at the time ``elapsed``."""
        done = trajectory.execution()
        if trajectory.punctual:
            at = done.at(np.clip(elapsed, 0.0, done.duration))
            if elapsed < 0.0 or math.dist(self.pose[:2], (float(at.x[0]), float(at.y[0]))) <= BEHIND:
                return elapsed
        return self._nearest(done, elapsed, last=self.stands and not trajectory.punctual)

    def misses(self, trajectory: Trajectory, elapsed: float) -> bool:
        """Return whether it is too late to follow a plan, on which the robot is expected at the time ``elapsed``, s.

        The robot has passed the place where the plan leaves the present one, or is too fast to stop or turn there.
        """
        if self._tracker is None:
            return False
        x, y, _, v, _ = (*self.pose, 0.0, 0.0) if self.stands else self._tracker.at(self.clock)
        done = trajectory.execution()
        begin, end = (min(max(elapsed + side * NEAR, 0.0), done.duration) for side in (-1.0, 1.0))
        times = np.linspace(begin, end, 2 + math.ceil((end - begin) / SAMPLED))
        states = done.at(times)
        off = np.hypot(states.x - x, states.y - y)
        near = off <= off.min() + SAMPLED
        speeds, _ = done.rates(times)
        planned = float(np.hypot(speeds.x, speeds.y)[near].max())
        overshoot = (v * v - planned * planned) / (2.0 * self._limits.acceleration)
        return bool(off.min() > (STANDS_OFF if self.stands else PARTED) or overshoot > OVERSHOOT)

    def approaches(
        self, trajectory: Trajectory, elapsed: float, people: Sequence[Walking], radii: Sequence[float]
    ) -> bool:
        """Return whether a plan leads the robot into a person within `LOOK_AHEAD` s, if people walk on as they do now.

        A person who walks into the robot where it is now does not count.

        elapsed  s, time of the plan now
        radii    m, of the people
        """
        done, times = trajectory.execution(), np.arange(0.0, LOOK_AHEAD, LOOK)
        elapsed = self._clock_on(trajectory, elapsed)
        then = done.at(np.clip(elapsed + times, 0.0, done.duration))
        names = trajectory.model.space.names
        here = done.at(np.full(times.size, np.clip(elapsed, 0.0, done.duration)))
        pose = dict(zip(("x", "y", "yaw"), self.pose, strict=True))
        here = States(**{name: np.full(times.size, pose.get(name, getattr(here, name)[0])) for name in names})
        for (x, y, vx, vy), radius in zip(people, radii, strict=True):
            places = np.stack([x + vx * times, y + vy * times], axis=1)
            gaps, stays = (distance_to_outline(trajectory.model.platform, each, places) for each in (then, here))
            if ((gaps < radius) & (gaps < stays - SLIGHT)).any():
                return True
        return False

    def _nearest(self, done: Trajectory, elapsed: float, *, last: bool) -> float:
        """Return the time, s, at which an executed plan is nearest to the robot's pose, within `NEAR` s of ``elapsed``.

        Of several such times, return the ``last``, from which a robot that stands continues with the next motion, or
        the one nearest to ``elapsed``.
        """
        times = np.append(np.arange(0.0, done.duration, SAMPLED), done.duration)
        times = times[np.abs(times - np.clip(elapsed, 0.0, done.duration)) <= NEAR]
        states = done.at(times)
        here = self.pose
        off = np.hypot(states.x - here[0], states.y - here[1]) + np.abs(wrap(states.yaw - here[2]))
        near = np.flatnonzero(off <= off.min() + SAME)
        return float(times[near[-1] if last else near[np.argmin(np.abs(times[near] - elapsed))]])

    def ahead(self, seconds: float) -> tuple[float, float]:
        """Return the position (x, y), m, at which the robot will be on its plan some seconds from now."""
        if self._tracker is None:
            return self.base.pose[:2]
        return self._tracker.at(self.clock + seconds)[:2]

    def announcement(self) -> dict[str, Any] | None:
        """Return the message "turn" some seconds before the next turn begins, once for each turn; otherwise None."""
        for i, turn in enumerate(self.turns):
            wait = turn.begin - self.clock
            if i >= self._announced and 0.0 <= wait <= ANNOUNCED and not self.stands:
                self._announced = i + 1
                begins, before = self._now + wait, self._last_turn
                self._last_turn = (begins, turn.angle)
                if abs(begins - before[0]) < SAME_TURN and turn.angle * before[1] > 0:
                    return None  # the plan has changed since, but not this turn
                side = "left" if turn.angle > 0 else "right"
                degrees = round(abs(math.degrees(turn.angle)))
                return {"type": "turn", "in": round(wait, 2), "direction": side, "degrees": degrees}
        return None

    def meets(self, people: Sequence[Walking], least: Sequence[float]) -> bool:
        """Return whether the robot would come too near to a person, as they walk now, before it could stand.

        A robot that drives away from a person does not meet them. ``least`` has a distance of the centres, m, for each.
        """
        here = self.base.pose
        for (px, py, vx, vy), nearest in zip(people, least, strict=True):
            gap = math.hypot(px - here[0], py - here[1])
            for seconds in LOOKS:
                later = seconds * self.braking
                x, y = self.ahead(later)
                then = math.hypot(px + later * vx - x, py + later * vy - y)
                stays = math.hypot(px + later * vx - here[0], py + later * vy - here[1])
                if then < min(nearest, stays, gap):
                    return True
        return False

    def advance(self, now: float, *, brakes: bool) -> None:
        """Move on to the time ``now`` of the session, s, and follow the plan, or brake and stand if ``brakes``."""
        if now - self._now > WATCHDOG:  # the server was paused: as a real base, this one has stopped by itself
            self.base.advance(self._now + WATCHDOG)
            self.base.command(0.0, 0.0, self._now + WATCHDOG - self._delay)
            self.base.advance(self._now + WATCHDOG + self.braking)
        self._now = now
        self.base.advance(now)
        if self._tracker is None:
            return
        if brakes != self._tracker.stopping:
            (self._tracker.stop if brakes else self._tracker.go)()
        self.base.command(*self._tracker.command(now - self._zero, self.base.measured), now)


class Visitors:
    """People of a scenario, each on a track that begins again when it ends.

    keeps  m, between the centres of person and robot: a person who would come nearer waits
    """

    def __init__(self, people: Sequence[Person], keeps: float) -> None:
        self._people, self._keeps = people, keeps
        self._walking = [TrackedPeople([person], keeps) for person in people]
        self._began = [0.0] * len(people)
        self.radius = max((person.radius for person in people), default=RADIUS)

    def advance(self, t: float, robot_pose: Pose) -> list[Walking]:
        """Move on to time ``t``, s, and return all people."""
        found: list[Walking] = []
        for i, person in enumerate(self._people):
            (walking,) = self._walking[i].advance(t - self._began[i], robot_pose)
            if math.isnan(walking[0]) and t > self._began[i]:
                self._walking[i], self._began[i] = TrackedPeople([person], self._keeps), t
                (walking,) = self._walking[i].advance(0.0, robot_pose)
            found.append(walking)
        return found


def people_of(problem: Problem, pose: Pose, options: SimulatorOptions) -> Pedestrians:
    """Return the people around a robot at a pose: a crowd that reacts to it, or those of the scenario.

    The crowd is placed here, before a session runs: on a large map this takes seconds, in which a session would stand.
    """
    reach = clearance_radius(problem.model, 0.0)
    if options.crowd:
        crowd = Crowd(problem.world, options.crowd, robot=reach, seed=options.seed)
        crowd.begin(pose)
        return crowd
    people = problem.world.content.people
    return Visitors(people, reach + max((person.radius for person in people), default=RADIUS) + KEEPS)


class ToldPeople:
    """People as last reported to the planner, who are reported anew only when a prediction is wrong or old."""

    def __init__(self) -> None:
        self._people: list[Walking] = []
        self._at = -math.inf

    def differ(self, people: Sequence[Walking], now: float, lasts: float) -> bool:
        """Return whether the planner needs a new prediction of the people at time ``now``, s.

        It does if their number has changed, if a person is more than `ASTRAY` m from the predicted place, or if a
        person walks and the prediction is older than ``lasts``, s.
        """
        passed = now - self._at
        if len(people) != len(self._people):
            return True
        if passed > lasts and any(math.hypot(vx, vy) > STILL for _, _, vx, vy in people):
            return True
        return any(
            math.hypot(x - a - va * passed, y - b - vb * passed) > ASTRAY
            for (x, y, _, _), (a, b, va, vb) in zip(people, self._people, strict=True)
        )

    def keep(self, people: Sequence[Walking], now: float) -> None:
        """Remember people as they are reported to the planner at a time ``now`` of the session, s."""
        self._people, self._at = list(people), now
