"""A trajectory in short pieces: parts of its motions, each under the law and in the timing of its motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray, numbered
from hpop.motions import Motions, States
from hpop.motions.sections import sections
from hpop.trajectories.history import History
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World


@dataclass(frozen=True, eq=False, repr=False)
class Pieces:
    """The motions of a trajectory, each cut into pieces of equal duration.

    trajectory  m motions
    counts      (m,)  pieces of each motion
    """

    trajectory: Trajectory
    counts: IntArray

    def __len__(self) -> int:
        return int(self.counts.sum())

    @cached_property
    def owner(self) -> IntArray:
        """Place (n,) of the motion of which each piece is a part."""
        return numbered(self.counts)[0]

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Law (n,) of each piece."""
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
        """States (n+1,) at those times."""
        return self.trajectory.at(self.times)

    def batches(self, world: World) -> Iterator[tuple[IntArray, Motions]]:
        """The pieces grouped by law, each group with their places in time order."""
        until = self._since + (self.trajectory.durations / self.counts)[self.owner]
        # What turns along curves end in a piece depends on nothing but its ends.
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
        """Time (n,), s, from the start of its motion to each piece."""
        owner, within = numbered(self.counts)
        return within * (self.trajectory.durations / self.counts)[owner]

    def __repr__(self) -> str:
        return f"<Pieces: {len(self):,} of {self.trajectory!r}>"


@dataclass(frozen=True, eq=False)
class PiecesHistory(History):
    """A trajectory as criteria with memory see it, its running values asked at the end of each piece."""

    pieces: Pieces

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
        """A column (n,) of the pieces, in time order."""
        values = np.zeros(len(self))
        for index, pieces in self.pieces.batches(self.world):
            values[index] = column(pieces)
        return values

    @property
    def passed(self) -> FloatArray:
        """Executed time (n+1,), s, at which the pieces begin and end: spread over each motion as it is planned."""
        return np.interp(self.pieces.times, self.trajectory.times, super().passed)
