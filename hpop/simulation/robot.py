"""Simulated differential drive: commands take effect late, wheels slip, and its pose is measured with noise."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import real, whole
from hpop.motions import Model
from hpop.simulation.tracking import Command, DriveLimits

NOISE_LEVER = 1.0  # m: noise of the measured yaw is the noise of positions over this distance
SLIP_LASTS = 1.0  # s between random values of the slip, which changes linearly from one to the next
Pose2 = tuple[float, float, float]


class SimulatedBase:
    """Base that follows velocity commands; poses are (x m, y m, yaw rad) in the frame of the world.

    model  robot; only the distance between its wheels is used
    pose   true pose at time 0
    delay  s, after which a command takes effect. The next step of :meth:`advance` changes the velocity to it, linearly
    slip   0 to 0.5, largest share by which a wheel drives less far than it turns; drawn for each wheel every second
    noise  m, radius of the disc about the true position in which measured positions lie; yaws are off by up to as many
           radians as this is metres
    seed   of all random numbers: equal seeds give equal drives
    """

    def __init__(
        self, model: Model, pose: Pose2, delay: float = 0.0, slip: float = 0.0, noise: float = 0.0, seed: int = 0
    ) -> None:
        self.delay = float(real("delay", delay, 0.0, 1.0, "a time in s"))
        self.slip = float(real("slip", slip, 0.0, 0.5, "a share of the wheels' motion"))
        self.noise = float(real("noise", noise, 0.0, 1.0, "a distance in m"))
        self._half = 0.5 * DriveLimits.of(model).wheel_base
        self._slips, self._noises = np.random.default_rng(whole("seed", seed, 0, 2**31, "a number")).spawn(2)
        self._knots = [self._slips.uniform(0.0, self.slip, 2) for _ in range(2)]
        self._waiting = deque[tuple[float, Command]]()
        self._in_effect, self._wheels = Command(0.0, 0.0), Command(0.0, 0.0)
        self._time = 0.0
        self.velocity = Command(0.0, 0.0)
        """True speed, m/s, and turn rate, rad/s."""
        self.pose: Pose2 = (float(pose[0]), float(pose[1]), float(pose[2]))
        """True pose."""
        self.measured: Pose2 = self._measure()
        """Measured pose."""

    def command(self, v: float, w: float, t: float) -> None:
        """Send a command at time ``t``, s: speed, m/s, and turn rate, rad/s."""
        self._waiting.append((t + self.delay, Command(float(v), float(w))))

    def advance(self, t: float) -> None:
        """Move on to time ``t``, s: one step, in which speeds change linearly to those of the command in effect."""
        step = t - self._time
        if step <= 0.0:
            return
        while self._waiting and self._waiting[0][0] <= self._time + 1e-9:
            self._in_effect = self._waiting.popleft()[1]
        self._time = t
        while len(self._knots) < t / SLIP_LASTS + 2:
            self._knots.append(self._slips.uniform(0.0, self.slip, 2))
        before, self.velocity = self.velocity, self._slipping(self._in_effect, t)
        x, y, yaw = self.pose
        gain, turn_gain = self.velocity.v - before.v, self.velocity.w - before.w
        for share, weight in ((0.5 - math.sqrt(0.15), 5.0), (0.5, 8.0), (0.5 + math.sqrt(0.15), 5.0)):  # Gauss-Legendre
            way = step * weight / 18.0 * (before.v + share * gain)
            along = yaw + step * share * (before.w + 0.5 * share * turn_gain)
            x, y = x + way * math.cos(along), y + way * math.sin(along)
        self.pose = (x, y, yaw + step * (before.w + 0.5 * turn_gain))
        self.measured = self._measure()

    def _slipping(self, command: Command, t: float) -> Command:
        """Return the true speed and turn rate at time ``t``, s, if the wheels turn as commanded but slip."""
        number, share = divmod(t / SLIP_LASTS, 1.0)
        slip: FloatArray = (1.0 - share) * self._knots[int(number)] + share * self._knots[int(number) + 1]
        if not self._half:
            return Command(command.v * (1.0 - slip[0]), command.w * (1.0 - slip[0]))
        left = (command.v - self._half * command.w) * (1.0 - slip[0])
        right = (command.v + self._half * command.w) * (1.0 - slip[1])
        return Command(0.5 * float(left + right), 0.5 * float(right - left) / self._half)

    def _measure(self) -> Pose2:
        """Return a measured pose: its position is uniform in a disc about the true one, its yaw in an interval."""
        area, angle, turned = self._noises.uniform(size=3).tolist()
        off, along = self.noise * math.sqrt(area), math.tau * angle
        x, y, yaw = self.pose
        wrong = self.noise / NOISE_LEVER * (2.0 * turned - 1.0)
        return (x + off * math.cos(along), y + off * math.sin(along), yaw + wrong)
