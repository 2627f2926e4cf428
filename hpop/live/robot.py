"""Robot of a live session: the simulated base that executes the plan, and its brake."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.math import wrap
from hpop.drive.options import perceived_motions
from hpop.models.execution import Ramps
from hpop.motions import Model
from hpop.trajectories.trajectory import Trajectory

SAMPLED = 0.02
"""Time between stored poses of the executed plan, s."""
NEAR = 4.0
"""Time, s, around the expected one, within which the place of the robot on a new plan is looked for."""
SAME = 1e-3
"""Distance, m, up to which two places count as one."""
BRAKING = 1.0
"""Time, s, to brake for a model without ramps."""


class AnnouncedTurn(NamedTuple):
    """A turn of the executed plan: its begin, s, and its angle, rad, left positive."""

    begin: float
    angle: float


class PlayedRobot:
    """Robot that executes its plan exactly; when it brakes, it slows down along the plan, and the plan waits.

    model  gives the time that braking takes, v/a
    pose   x m, y m, yaw rad
    """

    def __init__(self, model: Model, pose: tuple[float, float, float]) -> None:
        ramps = Ramps.of(model)
        self.braking = BRAKING if ramps is None or not ramps.half else 2.0 * ramps.half
        self.pose = pose
        self.turns: tuple[AnnouncedTurn, ...] = ()
        self.clock = 0.0  # s, of the executed plan
        self.arrives = False
        self._table = np.array([[0.0], [pose[0]], [pose[1]], [pose[2]]])
        self._rate, self._now = 0.0, 0.0

    @property
    def duration(self) -> float:
        """Duration of the executed plan, s."""
        return float(self._table[0, -1])

    @property
    def stands(self) -> bool:
        """Return whether the robot has braked to a standstill, or is at the end of its plan."""
        return self._rate == 0.0 or self.clock >= self.duration

    @property
    def arrived(self) -> bool:
        """Return whether the robot is at the end of a plan that leads to its destination."""
        return self.arrives and self.clock >= self.duration

    def follow(self, trajectory: Trajectory, elapsed: float, arrives: bool) -> None:
        """Continue with a plan, on which the robot is expected at the time ``elapsed``, s.

        Plans among moving people keep their times; on others the robot continues from where it is.
        """
        done = trajectory.execution()
        times = np.append(np.arange(0.0, done.duration, SAMPLED), done.duration)
        states = done.at(times)
        self._table = np.stack([times, states.x, states.y, states.yaw])
        self.arrives = arrives
        yaw = trajectory.model.space.names.index("yaw")
        motions = perceived_motions(done)
        self.turns = tuple(AnnouncedTurn(m.begin, float(m.change[yaw])) for m in motions if m.change[yaw])
        self.clock = min(elapsed, self.duration) if trajectory.punctual else self._nearest(elapsed)

    def _nearest(self, elapsed: float) -> float:
        """Return the time of the plan, s, near an expected one at which it is at the robot's pose.

        A robot that stands continues with the next motion.
        """
        times, x, y, yaw = self._table
        off = np.hypot(x - self.pose[0], y - self.pose[1]) + np.abs(wrap(yaw - self.pose[2]))
        off = np.where(np.abs(times - elapsed) <= NEAR, off, np.inf)
        near = np.flatnonzero(off <= off.min() + SAME)
        return float(times[near[-1] if self.stands else near[np.argmin(np.abs(times[near] - elapsed))]])

    def ahead(self, seconds: float) -> tuple[float, float]:
        """Return where the robot is on its plan some seconds from now, x and y, m."""
        times, x, y, _ = self._table
        at = min(self.clock + seconds, self.duration)
        return float(np.interp(at, times, x)), float(np.interp(at, times, y))

    def advance(self, now: float, *, brakes: bool) -> None:
        """Drive on to the time ``now`` of the session, s, or brake."""
        step, self._now = max(0.0, now - self._now), now
        before, change = self._rate, step / self.braking
        self._rate = max(0.0, before - change) if brakes else min(1.0, before + change)
        self.clock = min(self.clock + 0.5 * (before + self._rate) * step, self.duration)
        times, *columns = self._table
        x, y, yaw = (float(np.interp(self.clock, times, column)) for column in columns)
        self.pose = (x, y, float(wrap(yaw)))
