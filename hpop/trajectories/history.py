"""A whole trajectory in time order, as criteria with memory see it.

Sickness builds up and decays, a landmark is seen once or never, a curve changes its sign: such a criterion declares
``aggregate="trajectory"`` and its ``cost(m)`` gets a :class:`History` instead of a batch of motions under one law. It
returns the running value (M,) at the end of each motion, and the last one is the cost.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.motions import Instants, Model, Motions
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World

T = TypeVar("T")


class Track(Instants):
    """What the robot does at ``times`` (N,), s, its real speed ramps included."""

    def __init__(self, executed: Trajectory, times: FloatArray) -> None:
        states, (rates, changes) = executed.at(times), executed.rates(times)
        self.times = times
        super().__init__(
            executed.model,
            states.names,
            times.size,
            times,
            lambda name: getattr(states, name),
            lambda name: (getattr(rates, name), getattr(changes, name)),
        )


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
        lasts = self.executed.duration
        count = max(2, int(np.ceil(lasts / step - 1e-9)) + 1)
        return self.at(np.linspace(0.0, lasts, count))

    def at(self, times: FloatArray) -> Track:
        """Moments (N,) of the execution, s; before its start and after its end the robot stands."""
        return Track(self.executed, times)

    def at_motion_ends(self, times: FloatArray, values: FloatArray) -> FloatArray:
        """Running values (N,) at executed times, read where each planned motion (M,) is completed."""
        return np.interp(self.passed[1:], times, values)

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What several criteria derive from the same motions, such as what a viewer sees: made by the first of them."""
        if key not in self._derived:
            self._derived[key] = make()
        derived: T = self._derived[key]
        return derived

    @cached_property
    def _derived(self) -> dict[Hashable, Any]:
        return {}

    @cached_property
    def _execution(self) -> tuple[Trajectory, FloatArray]:
        return self.model.execution(self.trajectory)
