"""What comes of one job of a planner that solves a program from each of many warm starts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, Generic, TypeVar

from hpop.base.arrays import FloatArray
from hpop.base.text import counted
from hpop.planners.programs.deadline import CUT_SHORT
from hpop.trajectories.trajectory import Trajectory

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
