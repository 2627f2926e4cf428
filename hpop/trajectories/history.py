"""History of a whole trajectory in time order, for criteria with memory.

Some criteria depend on the past: sickness builds up and decays, a landmark is seen once or never, curvature changes its
sign. Such a criterion declares ``aggregate="trajectory"``, and its ``cost(m)`` receives a :class:`History` instead of a
batch of motions under one law. It returns the running value (M,) at the end of each motion; the last one is the cost.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray, numbered
from hpop.motions import Instants, Model, Motions, States
from hpop.motions.laws import Phase
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World

T = TypeVar("T")


class SampledTrajectory(Instants):
    """States and rates of a trajectory, such as an executed one with its speed ramps, at ``times`` (N,), s."""

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
    """History of one trajectory: all its motions in time order.

    world       the workspace
    trajectory  as planned; ``executed`` is the robot's real motion
    """

    world: World
    trajectory: Trajectory

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def model(self) -> Model:
        """Model of the robot that moves."""
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
        """Return a value (M,) for each motion in time order; ``column`` computes the values of a batch of motions."""
        values = np.zeros(len(self))
        for index, motions in self.trajectory.batches(self.world):
            values[index] = column(motions)
        return values

    @property
    def executed(self) -> Trajectory:
        """Executed trajectory, from rest to rest."""
        return self._execution[0]

    @property
    def passed(self) -> FloatArray:
        """Time in the execution, s, at which the robot passes each planned state (M+1,)."""
        return self._execution[1]

    def track(self, step: float) -> SampledTrajectory:
        """Return samples of the execution every ``step`` seconds at most, evenly spaced, both ends included."""
        lasts = self.executed.duration
        count = max(2, int(np.ceil(lasts / step - 1e-9)) + 1)
        return self.at(np.linspace(0.0, lasts, count))

    def at(self, times: FloatArray) -> SampledTrajectory:
        """Return samples of the execution at times (N,), s; before its start and after its end the robot stands."""
        return SampledTrajectory(self.executed, times)

    def at_motion_ends(self, times: FloatArray, values: FloatArray) -> FloatArray:
        """Return running values at the end of each planned motion (M,).

        They are interpolated between ``values`` (N,) at ``times`` (N,), s, of the execution.
        """
        return np.interp(self.passed[1:], times, values)

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return a value that several criteria share: computed by ``make`` at the first call, then cached."""
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


@dataclass(frozen=True, eq=False)
class Sections(Motions):
    """Batch of sections of motions under one law; a section is the part of a motion between two times.

    timing  phases (speed profiles) of the whole motions, clipped to the sections
    """

    timing: tuple[Phase, ...] = ()

    whole: ClassVar[bool] = False

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """Phases (speed profiles) of the whole motions, clipped to the sections."""
        return self.timing


def sections(
    whole: Motions,
    owner: IntArray,
    since: FloatArray,
    until: FloatArray,
    ends: tuple[States, States],
    turns: tuple[FloatArray, FloatArray] | None,
) -> Sections:
    """Return sections (P,) of motions, each the part of a motion between two times.

    Parameters
    ----------
    whole : the motions (M,)
    owner : (P,) index of each section's motion
    since, until : (P,) begin and end of each section, s from the start of its motion
    ends : states (P,) at these two times
    turns : (P,) rad, two columns, as in :class:`Motions`
    """
    t0 = None if whole.t0 is None else whole.t0[owner] + since
    timing = _clipped(whole, owner, since, until)
    return Sections(whole.world, whole.model, whole.law, *ends, t0=t0, turns=turns, timing=timing)


def _clipped(whole: Motions, owner: IntArray, since: FloatArray, until: FloatArray) -> tuple[Phase, ...]:
    """Return the phases (speed profiles) of motions, clipped to sections (P,) between two times."""

    def pick(column: Column) -> FloatArray:
        return np.broadcast_to(column, len(whole))[owner]

    first, last, elapsed = np.zeros(owner.size), np.zeros(owner.size), np.zeros(owner.size)
    parts = list[Phase]()
    for phase in whole.phases:
        picked = Phase(pick(phase.duration), pick(phase.begin), pick(phase.end), phase.shape, pick(phase.change))
        lasts = np.where(picked.duration > 0, picked.duration, 1.0)
        begin, end = (np.clip((moment - elapsed) / lasts, 0.0, 1.0) for moment in (since, until))
        first = np.where(since >= elapsed, picked.share(begin), first)
        last = np.where(until >= elapsed, picked.share(end), last)
        parts.append(picked.part(begin, end))
        elapsed = elapsed + picked.duration
    span = np.where(last > first, last - first, 1.0)
    return tuple(
        part._replace(**{name: np.clip((getattr(part, name) - first) / span, 0.0, 1.0) for name in ("begin", "end")})
        for part in parts
    )


@dataclass(frozen=True, eq=False, repr=False)
class TrajectoryPieces:
    """Motions of a trajectory, each cut into pieces of equal duration.

    trajectory  m motions
    counts      (m,)  pieces of each motion
    """

    trajectory: Trajectory
    counts: IntArray

    def __len__(self) -> int:
        return int(self.counts.sum())

    @cached_property
    def owner(self) -> IntArray:
        """Index (n,) of each piece's motion."""
        return numbered(self.counts)[0]

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Name of the law (n,) of each piece."""
        return tuple(self.trajectory.kinds[i] for i in self.owner)

    @cached_property
    def times(self) -> FloatArray:
        """Times (n+1,), s, at which the pieces begin, and the end of the last."""
        return np.append(self.trajectory.times[self.owner] + self._since, self.trajectory.duration)

    @cached_property
    def durations(self) -> FloatArray:
        """Duration (n,) of each piece, s."""
        return np.diff(self.times)

    @cached_property
    def states(self) -> States:
        """States (n+1,) of the robot at `times`."""
        return self.trajectory.at(self.times)

    def batches(self, world: World) -> Iterator[tuple[IntArray, Motions]]:
        """Yield, for each law, the indices of its pieces in time order, and these pieces as one batch."""
        until = self._since + (self.trajectory.durations / self.counts)[self.owner]
        # The turns along curves that end in a piece depend only on its ends.
        turns = Trajectory(self.trajectory.model, self.states, self.kinds).turns
        for motions, whole in self.trajectory.batches(world):
            (place,) = np.isin(self.owner, motions).nonzero()
            names = whole.start.names
            start, end = (
                States(**{name: getattr(self.states, name)[at] for name in names}) for at in (place, place + 1)
            )
            owner = np.searchsorted(motions, self.owner[place])
            ended = None if whole.turns is None else (turns[0][place], turns[1][place])
            yield place, sections(whole, owner, self._since[place], until[place], (start, end), ended)

    @cached_property
    def _since(self) -> FloatArray:
        """Time (n,), s, from the start of its motion to the start of each piece."""
        owner, within = numbered(self.counts)
        return within * (self.trajectory.durations / self.counts)[owner]

    def __repr__(self) -> str:
        return f"<TrajectoryPieces: {len(self):,} of {self.trajectory!r}>"


@dataclass(frozen=True, eq=False)
class PiecesHistory(History):
    """History of a trajectory whose motions are cut into n pieces, with values for each piece, not for each motion."""

    pieces: TrajectoryPieces

    def __len__(self) -> int:
        return len(self.pieces)

    @property
    def duration(self) -> FloatArray:
        """Planned duration (n,) of each piece, s."""
        return self.pieces.durations

    @property
    def t0(self) -> FloatArray:
        """Planned start time (n,) of each piece, s."""
        return self.pieces.times[:-1]

    def of_motions(self, column: Callable[[Motions], Column]) -> FloatArray:
        """Return a value (n,) for each piece in time order; ``column`` computes the values of a batch of pieces."""
        values = np.zeros(len(self))
        for index, pieces in self.pieces.batches(self.world):
            values[index] = column(pieces)
        return values

    @property
    def passed(self) -> FloatArray:
        """Time in the execution, s, at which pieces begin and end (n+1,), interpolated within each motion."""
        return np.interp(self.pieces.times, self.trajectory.times, super().passed)
