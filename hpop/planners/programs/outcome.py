"""Outcome of one job of a planner that solves many programs, and the deadline that all jobs share."""

from __future__ import annotations

import math
import platform
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib import import_module
from threading import Lock
from typing import Any, Generic, TypeVar

from hpop.base.arrays import FloatArray
from hpop.base.text import counted
from hpop.runtime.limits import LimitPassed
from hpop.trajectories.trajectory import Trajectory

BUILDING = "a program was built"
SOLVING = "a program was solved"
STOPPED = "User_Requested_Stop"  # IPOPT's status
CUT_SHORT = "cut short"  # counted by jobs that the deadline ended


@dataclass(frozen=True)
class Deadline:
    """Deadline of work in processes of one or several machines; by default never.

    A machine's wall clock may be set while the work goes on, so it is read only by the processes of other machines.
    The deadline is a limit of :mod:`hpop.runtime.limits`: the computation of a field stops at it.

    until    s  on the monotonic clock, which the processes of one machine share; infinite for no deadline
    wall     s  on the clock of :func:`time.time`, for other machines
    machine  name of the machine of ``until``
    """

    until: float = math.inf
    wall: float = math.inf
    machine: str = field(default_factory=platform.node)

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """Return the deadline in ``seconds`` from now; None for no deadline."""
        return cls() if seconds is None else cls(time.monotonic() + seconds, time.time() + seconds)

    @property
    def left(self) -> float:
        """Time, s, until the deadline; negative after it."""
        return self.until - time.monotonic() if platform.node() == self.machine else self.wall - time.time()

    @property
    def is_past(self) -> bool:
        """True after the deadline."""
        return self.left <= 0.0

    def check(self, doing: str, memory: int = 0, *, ahead: float = 0.0) -> None:
        """Raise LimitPassed if the deadline has passed, or will pass during ``ahead`` seconds without interruption."""
        if self.left <= ahead:
            raise LimitPassed(f"the time was over while {doing}")

    def hold(self, memory: int, doing: str) -> None:
        """Check the time; memory is not counted."""
        self.check(doing)

    def check_solver(self, status: str) -> None:
        """Raise LimitPassed if a solver's status says that it was stopped, or the deadline has passed."""
        if status == STOPPED:
            raise LimitPassed(f"the time was over while {SOLVING}")
        self.check(SOLVING)

    def stopping(self, variables: int, constraints: int) -> dict[str, Any]:
        """Return options of a CasADi solver for programs of this size by which IPOPT stops at the deadline."""
        if math.isinf(self.until):
            return {}
        stop = import_module("hpop.planners.programs._stop")  # on first use: it imports CasADi
        return {"iteration_callback": stop.Stop(self, variables, constraints)}


F = TypeVar("F")

# Held while a job runs or symbols are built. An executor may use threads, as a Dask worker does by default, but neither
# CasADi's symbols nor IPOPT's linear solver are thread-safe: two programs at once crash the process.
ONE_PROGRAM = Lock()


@dataclass(frozen=True, eq=False)
class ImprovedTrajectory:
    """Trajectory improved from a warm start.

    planned    (k,)  costs as the program added them up
    tolerance  (k,)  by how much the planned costs may be off
    """

    trajectory: Trajectory
    planned: FloatArray
    tolerance: FloatArray
    provenance: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome(Generic[F]):
    """Result of a job: a candidate, or the reason why there is none.

    candidate  or None
    reason     why there is none, else ""
    counts     of events during the job, by name
    seconds    of building programs and of solving them
    """

    candidate: F | None
    reason: str
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, result: F | str, counts: Counter[str], seconds: dict[str, float]) -> Outcome[F]:
        """Return the outcome of a candidate, or of the reason why there is none."""
        return cls(None, result, counts, seconds) if isinstance(result, str) else cls(result, "", counts, seconds)


@dataclass(eq=False)
class Tally:
    """Sums over the outcomes of many jobs.

    counts    of events during the jobs, by name
    seconds   of building programs and of solving them
    failures  of the jobs without a candidate, by reason
    """

    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0})
    failures: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, outcomes: Iterable[Outcome[Any]]) -> Tally:
        """Return the sums over outcomes."""
        tally = cls()
        for outcome in outcomes:
            tally.add(outcome)
        return tally

    def add(self, outcome: Outcome[Any]) -> None:
        """Add an outcome."""
        self.counts.update(outcome.counts)
        for part, spent in outcome.seconds.items():
            self.seconds[part] += spent
        if outcome.candidate is None:
            self.failures[outcome.reason] += 1

    def notes(self, job: str) -> list[str]:
        """Return a note for each reason of failure; ``job`` names a job in words."""
        failures = sorted((why, count) for why, count in self.failures.items() if why != CUT_SHORT)
        return [f"{counted(count, job)} without a candidate: {why}" for why, count in failures]

    @property
    def stats(self) -> dict[str, Any]:
        """Failures by reason, and seconds of building and solving."""
        return {
            "failed": {why: count for why, count in self.failures.items() if why != CUT_SHORT},
            "build_seconds": self.seconds["build"],
            "solve_seconds": self.seconds["solve"],
        }
