"""What a program of driven trajectories cannot change, phases of driving straight and of turning; where it begins."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hpop.base.arrays import FloatArray, IntArray

LEAST_IN = {True: 4, False: 3}  # intervals of a turn, and of straight driving


@dataclass(frozen=True)
class Phases:
    """What the program cannot change: phases of straight driving and of turning, one after the other.

    turns      count
    leading    whether it drives straight before the first turn
    trailing   whether it drives straight after the last turn
    intervals  count, at least: more where the phases need them
    """

    turns: int
    leading: bool
    trailing: bool
    intervals: int

    @cached_property
    def turning(self) -> tuple[bool, ...]:
        """Whether each phase turns."""
        between = [False, True] * self.turns
        phases = between[0 if self.leading else 1 :] + [False] * self.trailing
        return tuple(phases) if self.turns else (False,)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Intervals of each phase: the least that they need, and what is left evenly among them."""
        counts = [LEAST_IN[turns] for turns in self.turning]
        left = max(0, self.intervals - sum(counts))
        more, some = divmod(left, len(counts))
        return tuple(count + more + (i < some) for i, count in enumerate(counts))

    @cached_property
    def phase(self) -> IntArray:
        """Phase of each interval (n,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def places(self) -> tuple[IntArray, IntArray]:
        """Places in the program's vector of variables: of what the nodes have (5, n+1), and of durations (n,).

        What stays the same is one variable: the yaw in a phase of straight driving, the duration of each interval of a
        phase.
        """
        each = np.arange(n := len(self.phase) + 1)
        yaw = np.searchsorted(self.turning_intervals, each)
        of_nodes = np.cumsum([0, n, n, yaw[-1] + 1, n])[:, None] + [each, each, yaw, each, each]
        return of_nodes, of_nodes[-1, -1] + 1 + self.phase

    @cached_property
    def turning_intervals(self) -> IntArray:
        """Intervals of (n,) in phases of turning."""
        return np.flatnonzero(np.array(self.turning)[self.phase])

    @cached_property
    def straight_nodes(self) -> IntArray:
        """Nodes of (n+1,) at which the yaw rate is zero: those of straight driving, and both ends."""
        straight = np.setdiff1d(np.arange(len(self.phase)), self.turning_intervals)
        return np.unique(np.concatenate([straight, straight + 1, [0, len(self.phase)]]))

    @cached_property
    def turning_nodes(self) -> IntArray:
        """Nodes of (n+1,) inside phases of turning."""
        return np.setdiff1d(np.arange(len(self.phase) + 1), self.straight_nodes)


@dataclass(frozen=True, eq=False)
class Guess:
    """Where the program begins: values at the nodes, and what it has to keep.

    nodes     (5, n+1)  x, y, yaw, speed, turn rate
    lasts     (P,)      s, of each phase
    signs     (P,)      1 or -1 for turns to the left or right, 0 for straight driving
    goal_yaw  whether the last yaw is asked for
    """

    nodes: FloatArray
    lasts: FloatArray
    signs: FloatArray
    goal_yaw: bool
