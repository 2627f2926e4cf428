"""Tracking of a plan: velocity commands that keep a differential drive on the executed profile of a trajectory.

The law is the one of Samson (1993) and Kanayama et al. (1990): feed-forward of the reference's speed v and turn rate w,
plus feedback of the errors ahead, aside and in heading, in the frame of the robot:

    v_command = v cos(e_yaw) + k e_ahead
    w_command = w + K_ASIDE v sinc(e_yaw) e_aside + K_YAW e_yaw

The correction is bounded. Commands then keep to the largest speeds and accelerations of the base and of its wheels;
speed and turn rate are scaled together, so that the curvature stays.

A plan at full speed leaves no reserve to catch up, so the reference has a clock of its own. It slows down where the
robot is behind, and stands while the robot brakes. It gains where the plan stands, and where the base is faster than
its plan. It never runs ahead of the time. :attr:`Tracker.late` is the time by which it is behind.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import real
from hpop.errors import ModelError
from hpop.models.laws import Run, Spin
from hpop.models.speeds import SpeedChange
from hpop.motions import Model, Wheeled
from hpop.motions.laws import CHANGE
from hpop.trajectories.trajectory import Trajectory

K_AHEAD, K_ASIDE, K_YAW = 1.5, 4.0, 2.5  # 1/s, 1/m², 1/s: gains of the errors ahead, aside and in heading
MOST_AHEAD, MOST_YAW = 0.3, 1.0  # m/s, rad/s: bounds of the correction
SLACK, SPAN = 0.03, 0.15  # m: the reference slows down from the one distance on, and stands SPAN farther
YAW_SPAN = 0.4  # rad: the same for the heading
SETTLES = 0.25  # s: time constant by which estimates follow measured poses
SAMPLING = 0.005  # s: of the reference
TINY = 1e-9  # m/s, rad/s: slower is to stand
LONGEST_STEP = 0.25  # s: after a longer silence of the caller the robot is taken to have stood


class Command(NamedTuple):
    """Velocity command to a differential drive: speed ahead ``v``, m/s, and turn rate ``w``, rad/s, left positive."""

    v: float
    w: float


@dataclass(frozen=True)
class DriveLimits:
    """Largest speeds and accelerations of a base: m/s, m/s², rad/s, rad/s²; of its wheels: m/s, m/s².

    ``wheel_base`` is the distance between the wheels, m; 0 for a base of which no wheels are known.
    """

    speed: float
    acceleration: float
    turn_rate: float
    turn_acceleration: float
    wheel_base: float = 0.0
    wheel_speed: float = math.inf
    wheel_acceleration: float = math.inf

    @classmethod
    def of(cls, model: Model) -> DriveLimits:
        """Return the limits of a model; raise ModelError if it does not run straight ahead and turn in place."""
        laws, executed = model.laws, model.executed
        run, spin = laws.get(executed.get("move", "run")), laws.get(executed.get("turn", "spin"))
        drive = laws.get(CHANGE) if model.speed_classes else run
        if not isinstance(spin, Spin) or not isinstance(drive, Run | SpeedChange):
            raise ModelError(
                "tracking needs a robot that drives straight ahead and turns in place, got the motions "
                f"{', '.join(laws)}; plan with differential_drive, pan_tilt or mobile_arm"
            )
        speed = drive.speed if isinstance(drive, Run) else float(model.speed_classes[-1])
        acceleration = drive.acceleration
        rates = spin.turn_rate, spin.turn_acceleration
        if "wheels" not in model.provides:
            return cls(speed, acceleration, *rates)
        base = cast(Wheeled, model)
        return cls(speed, acceleration, *rates, base.wheel_base, base.wheel_speed, base.wheel_acceleration)

    @property
    def time_to_stop(self) -> float:
        """Time, s, in which the base stops from its largest speeds."""
        return max(self.speed / self.acceleration, self.turn_rate / self.turn_acceleration)

    def reached(self, last: Command, v: float, w: float, step: float) -> Command:
        """Return the command towards (v, w) that the base reaches from the ``last`` one within ``step`` seconds.

        v, w  m/s and rad/s; both are reduced by one factor if they exceed the largest speeds
        """
        half = 0.5 * self.wheel_base
        share = max(1.0, abs(v) / self.speed, abs(w) / self.turn_rate, (abs(v) + half * abs(w)) / self.wheel_speed)
        dv, dw = v / share - last.v, w / share - last.w
        most_v, most_w = self.acceleration * step, self.turn_acceleration * step
        dv, dw = min(max(dv, -most_v), most_v), min(max(dw, -most_w), most_w)
        wheel = abs(dv) + half * abs(dw)
        if wheel > self.wheel_acceleration * step:
            dv, dw = (change * self.wheel_acceleration * step / wheel for change in (dv, dw))
        return Command(last.v + dv, last.w + dw)


class Tracker:
    """Tracking law for one trajectory, called at any rate from 10 Hz on; 50 Hz suits most bases.

    trajectory  the plan; its :meth:`~hpop.Trajectory.execution` is the reference
    limits      of the base; default: those of the plan's model. A base that is faster than its plan can catch up
    delay       s, after which a command takes effect on the base, as well as you know it
    """

    def __init__(self, trajectory: Trajectory, *, limits: DriveLimits | None = None, delay: float = 0.0) -> None:
        self.delay = float(real("delay", delay, 0.0, 1.0, "a time in s"))
        self.limits = limits or DriveLimits.of(trajectory.model)
        times, rows, self._stands_until = _sampled(trajectory)
        self.duration = float(times[-1])  # s, of the executed plan
        self._rows: list[list[float]] = rows.tolist()
        self._reserve = _spare(self.limits, times, *rows[:, 3:].T)
        self._clock, self._now = 0.0, math.nan
        self.feed = self._last = Command(0.0, 0.0)  # of the reference; sent
        self._estimate: FloatArray | None = None  # pose when the next command takes effect
        self._history = deque[tuple[float, float, FloatArray]]()  # time of a command, clock and estimate for it
        self._stops = False

    def follow(self, trajectory: Trajectory, clock: float | None = None) -> None:
        """Continue with another plan from its time ``clock``, s, on; commands go on from the last one.

        From the next call on, :meth:`command` must get times since the new plan began: ``clock``, or a little later.
        With None, the clock of the old plan goes on; then both plans must be executed alike until now and for the
        robot's delay after it.
        """
        times, rows, self._stands_until = _sampled(trajectory)
        self.duration = float(times[-1])
        self._rows = rows.tolist()
        self._reserve = _spare(self.limits, times, *rows[:, 3:].T)
        if clock is not None:
            self._clock = self._now = clock
            self._history.clear()

    def command(self, t: float, pose: tuple[float, float, float] | None) -> Command:
        """Return the command at ``t``, s since the plan began, for a measured pose (x m, y m, yaw rad) in the world.

        Times must not decrease. Without a pose, the estimate is continued from the commands so far. After more than
        0.25 s without a call, the robot is taken to have stood.
        """
        step = 0.0 if math.isnan(self._now) else max(0.0, t - self._now)
        if step > LONGEST_STEP:
            step, self.feed, self._last, self._estimate = LONGEST_STEP, Command(0.0, 0.0), Command(0.0, 0.0), None
        self._now = t if math.isnan(self._now) else max(t, self._now)
        here = self._estimated(t, pose, step)
        ahead, aside, turned = self._errors(here)
        self._advance(t, step, ahead, turned)
        ahead, aside, turned = self._errors(here)
        v, w = self.feed
        if not self._stops:
            stands = v == 0.0 and w == 0.0
            near = stands and abs(ahead) < SLACK and abs(turned) < SLACK
            v = v * math.cos(turned) + (0.0 if near else _bounded(K_AHEAD * ahead, MOST_AHEAD))
            w += (
                0.0
                if near
                else _bounded(K_ASIDE * v * float(np.sinc(turned / np.pi)) * aside + K_YAW * turned, MOST_YAW)
            )
        elif v:
            w += _bounded(K_ASIDE * v * aside + K_YAW * turned, MOST_YAW)
        self._last = self.limits.reached(self._last, v, w, step)
        return self._last

    def stop(self) -> None:
        """Brake from the next command on, at the base's deceleration and along the plan; the plan waits."""
        self._stops = True

    def go(self) -> None:
        """Continue after :meth:`stop`, from the place of the plan at which the robot stopped."""
        self._stops = False

    @property
    def stopping(self) -> bool:
        """True while the robot brakes or stands because of :meth:`stop`."""
        return self._stops

    @property
    def late(self) -> float:
        """Time, s, by which the robot is behind its plan; 0 once it is at the end."""
        clock = 0.0 if math.isnan(self._now) else self.clock(self._now)
        return 0.0 if math.isnan(self._now) or clock >= self.duration else max(0.0, self._now - clock)

    def clock(self, t: float) -> float:
        """Return the time of the plan, s, at whose pose the robot should be at ``t``, s since the plan began.

        It is less than ``t`` if the plan has waited for the robot. Use it for times near the last command.
        """
        when = self._clock if not self._history else self._history[0][1]
        for begun, clock, _ in self._history:
            if begun <= t - self.delay + 1e-9:
                when = clock
        return min(when, self.duration)

    def reference(self, t: float) -> tuple[float, float, float]:
        """Return the pose (x m, y m, yaw rad) of the plan at which the robot should be at ``t``."""
        x, y, yaw, _, _ = self.at(self.clock(t))
        return x, y, yaw

    def off(self, t: float, pose: tuple[float, float, float]) -> float:
        """Return the distance, m, between a pose and the plan's :meth:`reference` at ``t``."""
        x, y, _ = self.reference(t)
        return math.hypot(pose[0] - x, pose[1] - y)

    def finished(self, t: float) -> bool:
        """Return whether the plan has ended by ``t``, and the last command was below 0.03 m/s and 0.03 rad/s."""
        return t >= self.duration and self._clock >= self.duration and max(map(abs, self._last)) < SLACK

    def _advance(self, t: float, step: float, ahead: float, turned: float) -> None:
        """Move the reference's clock on, as fast as the errors and accelerations allow, and set its feed-forward."""
        until = t + self.delay
        _, _, _, v, w = self.at(self._clock + step)
        behind = ahead if v > 0 else -ahead if v < 0 else abs(ahead)
        rate = min(1.0, 1.0 - (behind - SLACK) / SPAN, 1.0 - (abs(turned) - SLACK) / YAW_SPAN)
        rate = 0.0 if self._stops else max(rate, 0.0)
        last = len(self._rows) - 1
        stands = self._stands_until[min(int(self._clock * last / max(self.duration, TINY)), last)]
        if stands > self._clock and not self._stops:  # the plan stands: what is late is made up
            moved = min(max(until - self._clock, rate * step), stands - self._clock) if rate > 0.5 else rate * step
        else:
            rate *= 1.0 + min(self._reserve, max(0.0, until - self._clock - step))
            rate = self._reachable(rate, step)
            moved = rate * step
        self._clock = max(self._clock, min(self._clock + moved, until))
        _, _, _, v, w = self.at(self._clock)
        self.feed = Command(rate * v, rate * w)
        if step and self._estimate is not None:
            self._history.append((t, self._clock, self._estimate))
            while len(self._history) > 1 and self._history[1][0] <= t - self.delay + 1e-9:
                self._history.popleft()

    def _reachable(self, rate: float, step: float) -> float:
        """Return the rate, s of the plan per s, nearest to ``rate`` that the accelerations of the base allow."""
        reached = 1.0
        for _ in range(3):  # the plan's speed after the step depends on the rate
            _, _, _, v, w = self.at(self._clock + reached * step)
            slowest, fastest = 0.0, 1.0 + self._reserve
            for planned, now, most in (
                (abs(v), abs(self.feed.v), self.limits.acceleration),
                (abs(w), abs(self.feed.w), self.limits.turn_acceleration),
            ):
                if planned > TINY:
                    fastest = min(fastest, (now + most * step) / planned)
                    slowest = max(slowest, (now - most * step) / planned)
            reached = min(max(rate, slowest), fastest)
        return reached

    def _estimated(self, t: float, pose: tuple[float, float, float] | None, step: float) -> FloatArray:
        """Return the pose when the next command takes effect: dead reckoning, corrected by the measured pose."""
        if self._estimate is None:
            self._history.clear()
            self._estimate = np.array(self.at(self._clock)[:3] if pose is None else pose, float)
            return self._estimate
        x, y, yaw = self._estimate.tolist()
        v, w = self._last
        middle = yaw + 0.5 * step * w
        moved = np.array([x + step * v * math.cos(middle), y + step * v * math.sin(middle), yaw + step * w])
        if pose is not None and step:
            then = self._history[0][2] if self.delay and self._history else moved
            wrong = np.array(pose, float) - then
            wrong[2] = math.remainder(wrong[2], math.tau)
            shift = (1.0 - math.exp(-step / SETTLES)) * wrong
            self._history = deque((begun, clock, estimate + shift) for begun, clock, estimate in self._history)
            moved = moved + shift
        self._estimate = moved
        return moved

    def _errors(self, here: FloatArray) -> tuple[float, float, float]:
        """Return the reference, at the present time of its clock, as seen from a pose (3,): x m, y m, yaw rad.

        The result is its distance ahead, m, its distance to the left, m, and its rotation to the left, rad. Negative
        values mean behind, to the right, and turned to the right.
        """
        x, y, yaw, _, _ = self.at(self._clock)
        dx, dy, cos, sin = x - here[0], y - here[1], math.cos(here[2]), math.sin(here[2])
        return dx * cos + dy * sin, dy * cos - dx * sin, math.remainder(yaw - here[2], math.tau)

    def at(self, clock: float) -> tuple[float, float, float, float, float]:
        """Return x m, y m, yaw rad, speed m/s and turn rate rad/s of the reference at a time of the plan, s."""
        if clock >= self.duration:
            x, y, yaw, _, _ = self._rows[-1]
            return x, y, yaw, 0.0, 0.0
        i, share = divmod(clock * (len(self._rows) - 1) / self.duration, 1.0)
        begin, end = self._rows[int(i)], self._rows[int(i) + 1]
        x, y, yaw, v, w = (one + share * (other - one) for one, other in zip(begin, end, strict=True))
        return x, y, yaw, v, w


def _bounded(correction: float, most: float) -> float:
    return min(max(correction, -most), most)


def _spare(limits: DriveLimits, times: FloatArray, v: FloatArray, w: FloatArray) -> float:
    """Return the share by which a base can be faster than a plan: 0.1 if it can drive all of it 1.1 times as fast.

    At least 0, even if the base is slower than the plan, and at most 1.

    times, v, w  (N,)  s, m/s, rad/s: time, speed and turn rate of the plan
    """
    if times.size < 2:
        return 0.0
    v, w = np.abs(v), np.abs(w)
    a, b = (np.abs(np.diff(speed)) / np.diff(times) for speed in (v, w))
    pairs = (
        (limits.speed, v),
        (limits.turn_rate, w),
        (limits.wheel_speed, v + 0.5 * limits.wheel_base * w),
        (limits.acceleration, np.sqrt(a * limits.acceleration)),  # it grows with the square of the rate
        (limits.turn_acceleration, np.sqrt(b * limits.turn_acceleration)),
    )
    return max(0.0, min(2.0, *(most / max(float(used.max()), TINY) for most, used in pairs)) - 1.0)


def _sampled(trajectory: Trajectory) -> tuple[FloatArray, FloatArray, list[float]]:
    """Return times (N,), s, and rows (N, 5) of the executed plan, and until when (N,), s, the base stands at each.

    Rows have x m, y m, yaw rad, speed m/s and turn rate rad/s. The times until which the base stands are 0 where it
    moves, and infinite where it stands at the end.
    """
    done = trajectory.execution()
    times = np.linspace(0.0, done.duration, 1 + math.ceil(done.duration / SAMPLING))
    states, (velocity, _) = done.at(times), done.rates(times)
    v = velocity.x * np.cos(states.yaw) + velocity.y * np.sin(states.yaw)
    moves = (np.abs(v) > TINY) | (np.abs(velocity.yaw) > TINY)
    stands, until = list[float](), math.inf
    for time, before, after in zip(times[::-1], moves[::-1], [False, *moves[:0:-1]], strict=True):
        until = 0.0 if before or after else until or float(time)
        stands.append(until)
    return times, np.stack([states.x, states.y, states.yaw, v, velocity.yaw], axis=1), stands[::-1]
