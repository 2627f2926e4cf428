"""One job of a planner that solves many programs: its outcome, and the deadline that all jobs share."""

from __future__ import annotations

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
STOPPED = "User_Requested_Stop"  # IPOPT's word
CUT_SHORT = "cut short"  # what jobs count that did not end by themselves


@dataclass(frozen=True)
class Deadline:
    """A moment on the clock of :func:`time.time`, which processes share; None is never.

    It is one of the limits of :mod:`hpop.world.limits`: fields that are made under it end with it.
    """

    at: float | None = None

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """So many seconds from now."""
        return cls(None if seconds is None else time.time() + seconds)

    @property
    def is_past(self) -> bool:
        """Whether it is over."""
        return self.at is not None and time.time() >= self.at

    def check(self, doing: str, memory: int = 0, *, ahead: float = 0.0) -> None:
        """Raise LimitPassed where it is over, or would be ``ahead`` seconds from now: of what nothing interrupts."""
        if self.at is not None and time.time() + ahead >= self.at:
            raise LimitPassed(f"the time was over while {doing}")

    def hold(self, memory: int, doing: str) -> None:
        """Look at the time; memory is not counted."""
        self.check(doing)

    def check_solver(self, status: str) -> None:
        """Raise LimitPassed where a solver ended with a status that says that it was stopped, or the time is over."""
        if status == STOPPED:
            raise LimitPassed(f"the time was over while {SOLVING}")
        self.check(SOLVING)

    def stopping(self, variables: int, constraints: int) -> dict[str, Any]:
        """Options of a CasADi solver of programs of this size, so that IPOPT ends with the iteration at work."""
        if self.at is None:
            return {}
        stop = import_module("hpop.planners.programs._stop")  # on first use: it imports CasADi
        return {"iteration_callback": stop.Stop(self, variables, constraints)}


F = TypeVar("F")

# Held by a job at work, and by whoever else builds symbols. An executor may have threads, as a Dask worker has unless
# told otherwise, and neither CasADi's symbols nor the linear solver of IPOPT bear them: two programs at once end the
# process.
ONE_PROGRAM = Lock()


@dataclass(frozen=True, eq=False)
class Improved:
    """What became of a warm start: a trajectory, its costs as the program added them up, and how it came about.

    planned    (k,)
    tolerance  (k,)  by how much they may be off
    """

    trajectory: Trajectory
    planned: FloatArray
    tolerance: FloatArray
    provenance: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome(Generic[F]):
    """A candidate, or why there is none.

    found    the candidate, or None
    reason   why there is none, else ""
    counts   how often something happened on the way
    seconds  of building programs and of solving them
    """

    found: F | None
    reason: str
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, result: F | str, counts: Counter[str], seconds: dict[str, float]) -> Outcome[F]:
        """From a candidate, or the reason that there is none."""
        return cls(None, result, counts, seconds) if isinstance(result, str) else cls(result, "", counts, seconds)


@dataclass(eq=False)
class Tally:
    """What came of many jobs, added up.

    counts    how often something happened on the way
    seconds   of building programs and of solving them
    failures  of the jobs without a candidate, by reason
    """

    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0})
    failures: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, outcomes: Iterable[Outcome[Any]]) -> Tally:
        """Of several jobs."""
        tally = cls()
        for outcome in outcomes:
            tally.add(outcome)
        return tally

    def add(self, outcome: Outcome[Any]) -> None:
        """One job more."""
        self.counts.update(outcome.counts)
        for part, spent in outcome.seconds.items():
            self.seconds[part] += spent
        if outcome.found is None:
            self.failures[outcome.reason] += 1

    def notes(self, job: str) -> list[str]:
        """A note on each reason for which jobs, each of which is called so, have no candidate."""
        failures = sorted((why, count) for why, count in self.failures.items() if why != CUT_SHORT)
        return [f"{counted(count, job)} without a candidate: {why}" for why, count in failures]

    @property
    def stats(self) -> dict[str, Any]:
        """Failures by reason, and seconds."""
        return {
            "failed": {why: count for why, count in self.failures.items() if why != CUT_SHORT},
            "build_seconds": self.seconds["build"],
            "solve_seconds": self.seconds["solve"],
        }
