"""Trajectories that are made when they are asked for: of a hundred thousand a few can be had within a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np

from hpop.base.arrays import IntArray
from hpop.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Deferred(Sequence[Trajectory]):
    """Trajectories of which all are made together once one is read, or some alone.

    number  of them
    make    the trajectories of some rows
    """

    number: int
    make: Callable[[IntArray], tuple[Trajectory, ...]]

    def __len__(self) -> int:
        return self.number

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Trajectory, ...]: ...
    def __getitem__(self, index: int | slice) -> Trajectory | tuple[Trajectory, ...]:
        return self._all[index]

    def take(self, rows: IntArray) -> tuple[Trajectory, ...]:
        """Those of some rows, made without the others."""
        if "_all" in vars(self):  # made already
            return tuple(self._all[i] for i in rows.tolist())
        return self.make(rows)

    @cached_property
    def _all(self) -> tuple[Trajectory, ...]:
        return self.make(np.arange(self.number))
