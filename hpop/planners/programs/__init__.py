"""Planners that solve optimisation programs (nonlinear or convex) in continuous space, and modules that they share.

Here are the outcome of one job of such a planner, which solves many programs, and the deadline that all jobs share.
"""

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
    """Deadline that processes on one or several machines can check; by default there is none.

    On the machine that made it, the monotonic clock is read, as a wall clock may be adjusted during the work. Processes
    on other machines read their wall clock. The deadline can serve as a limit of :mod:`hpop.runtime.limits`, which also
    stops the computation of a field.

    until    s  on the monotonic clock, which the processes of one machine share; infinite for no deadline
    wall     s  on the clock of :func:`time.time`, for other machines
    machine  name of the machine whose clock ``until`` refers to
    """

    until: float = math.inf
    wall: float = math.inf
    machine: str = field(default_factory=platform.node)

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """Return the deadline that is ``seconds`` from now; for None, a deadline that never comes."""
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
        """Raise LimitPassed if the deadline is at most ``ahead`` seconds away: the duration of the next piece of work.

        doing   what was going on, a clause in the past tense for the message
        memory  not used; limits of :mod:`hpop.runtime.limits` take it
        """
        if self.left <= ahead:
            raise LimitPassed(f"the time limit was reached while {doing}")

    def hold(self, memory: int, doing: str) -> None:
        """Raise LimitPassed if the deadline has passed; memory, which other limits count, is ignored."""
        self.check(doing)

    def check_solver(self, status: str) -> None:
        """Raise LimitPassed if a solver's status says that :meth:`stopping` ended it, or if the deadline has passed."""
        if status == STOPPED:
            raise LimitPassed(f"the time limit was reached while {SOLVING}")
        self.check(SOLVING)

    def stopping(self, variables: int, constraints: int) -> dict[str, Any]:
        """Return options for a CasADi solver that make IPOPT stop at the deadline; empty if there is no deadline.

        ``variables`` and ``constraints`` are the numbers of these in the program.
        """
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
    """Trajectory that a program found by improving a warm start.

    planned     (k,)  costs as the program computed them
    tolerance   (k,)  largest error of the planned costs
    provenance  how it was found, for the front
    """

    trajectory: Trajectory
    planned: FloatArray
    tolerance: FloatArray
    provenance: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome(Generic[F]):
    """Result of a job: a candidate, or the reason why there is none.

    candidate  or None
    reason     why there is no candidate, else ""
    counts     number of events of each name during the job, such as "repairs"
    seconds    spent on building programs ("build") and on solving them ("solve")
    """

    candidate: F | None
    reason: str
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, result: F | str, counts: Counter[str], seconds: dict[str, float]) -> Outcome[F]:
        """Return the outcome of a job whose result is a candidate or, as a string, the reason why there is none."""
        return cls(None, result, counts, seconds) if isinstance(result, str) else cls(result, "", counts, seconds)


@dataclass(eq=False)
class Tally:
    """Sums over the outcomes of many jobs.

    counts    number of events of each name during the jobs
    seconds   spent on building programs ("build") and on solving them ("solve")
    failures  number of jobs without a candidate, by reason
    """

    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0})
    failures: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, outcomes: Iterable[Outcome[Any]]) -> Tally:
        """Return the sums over the given outcomes."""
        tally = cls()
        for outcome in outcomes:
            tally.add(outcome)
        return tally

    def add(self, outcome: Outcome[Any]) -> None:
        """Add the counts, seconds and failure of one outcome to the sums."""
        self.counts.update(outcome.counts)
        for part, spent in outcome.seconds.items():
            self.seconds[part] += spent
        if outcome.candidate is None:
            self.failures[outcome.reason] += 1

    def notes(self, job: str) -> list[str]:
        """Return one note (a line for the user) for each reason of failure; ``job`` is the word for one job.

        Jobs that the deadline cut short get no note.
        """
        failures = sorted((why, count) for why, count in self.failures.items() if why != CUT_SHORT)
        return [f"{counted(count, job)} without a candidate: {why}" for why, count in failures]

    @property
    def stats(self) -> dict[str, Any]:
        """Statistics of a result: failures by reason, and seconds of building and of solving programs.

        Jobs that the deadline cut short are not among the failures.
        """
        return {
            "failed": {why: count for why, count in self.failures.items() if why != CUT_SHORT},
            "build_seconds": self.seconds["build"],
            "solve_seconds": self.seconds["solve"],
        }
