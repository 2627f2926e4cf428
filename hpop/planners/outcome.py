"""What comes of one job of a planner that solves a program from each of many warm starts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from threading import Lock
from typing import Generic, TypeVar

F = TypeVar("F")

# Held by a job at work, and by whoever else builds symbols. An executor may have threads, as a Dask worker has unless
# told otherwise, and neither CasADi's symbols nor the linear solver of IPOPT bear them: two programs at once end the
# process.
ALONE = Lock()


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
