"""A whole trajectory in time order, as criteria with memory see it.

Sickness builds up and decays, a landmark is seen once or never, a curve changes its sign: such a criterion declares
``aggregate="trajectory"`` and its ``cost(m)`` gets a :class:`History` instead of a batch of motions under one law. It
returns the running value (M,) at the end of each motion, and the last one is the cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hpop.arrays import Column, FloatArray
from hpop.motions import Model, Motions, Pose
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World


@dataclass(frozen=True, eq=False)
class Track:
    """What the robot does at regular times, its real speed ramps included. Columns (N,).

    times              s, from 0 to the end
    base, camera       poses
    speed              m/s, along the heading
    turn_rate          rad/s
    acceleration       m/s², along the heading
    turn_acceleration  rad/s²
    camera_velocity    (x, y) m/s, world frame
    """

    times: FloatArray
    base: Pose
    camera: Pose
    speed: FloatArray
    turn_rate: FloatArray
    acceleration: FloatArray
    turn_acceleration: FloatArray
    camera_velocity: tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class History:
    """All motions of one trajectory, in time order.

    world       the workspace
    trajectory  as planned; ``executed`` is what the robot does of it
    """

    world: World
    trajectory: Trajectory

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def model(self) -> Model:
        """The system that moves."""
        return self.trajectory.model

    @property
    def duration(self) -> FloatArray:
        """Planned duration (M,) of each motion, s."""
        return self.trajectory.durations

    @property
    def t0(self) -> FloatArray:
        """Planned start time (M,) of each motion, s."""
        return self.trajectory.times[:-1]

    def of_motions(self, column: Callable[[Motions], Column]) -> FloatArray:
        """A column (M,) of the motions, asked of each batch under one law and put in time order."""
        values = np.zeros(len(self))
        for index, motions in self.trajectory.batches(self.world):
            values[index] = column(motions)
        return values

    @property
    def executed(self) -> Trajectory:
        """What the robot does, from rest to rest."""
        return self._execution[0]

    @property
    def passed(self) -> FloatArray:
        """Executed time (M+1,), s, at which each planned state is passed."""
        return self._execution[1]

    def track(self, step: float) -> Track:
        """Samples of the execution every ``step`` seconds at most, evenly spaced, both ends included."""
        executed, model = self.executed, self.model
        count = max(2, int(np.ceil(executed.duration / step - 1e-9)) + 1)
        times = np.linspace(0.0, executed.duration, count)
        states = executed.at(times)
        first, second = executed.rates(times)
        base, camera = model.pose("base", states), model.pose("camera", states)
        ahead, left = np.cos(states.yaw), np.sin(states.yaw)
        velocity = (
            first.x - first.yaw * (camera.y - base.y),
            first.y + first.yaw * (camera.x - base.x),
        )
        return Track(
            times=times,
            base=base,
            camera=camera,
            speed=first.x * ahead + first.y * left,
            turn_rate=first.yaw,
            acceleration=second.x * ahead + second.y * left,
            turn_acceleration=second.yaw,
            camera_velocity=velocity,
        )

    def at_motion_ends(self, times: FloatArray, values: FloatArray) -> FloatArray:
        """Running values (N,) at executed times, read where each planned motion (M,) is completed."""
        return np.interp(self.passed[1:], times, values)

    @cached_property
    def _execution(self) -> tuple[Trajectory, FloatArray]:
        return self.model.execution(self.trajectory)
