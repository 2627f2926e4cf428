"""Status of a search, which tells how it ended."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """Outcome of a planner or a search. Only after COMPLETE and NO_PATH the result is complete.

    POINT_LIMIT: the option ``max_points`` of a planner was reached. RUN_LIMIT: none of a planner's random runs reached
    the goal. UNFINISHED: the result is from an early stage of a planner that goes on searching.
    """

    COMPLETE = "complete"
    NO_PATH = "no path"
    TIME_LIMIT = "time limit"
    LABEL_LIMIT = "label limit"
    MEMORY_LIMIT = "memory limit"
    POINT_LIMIT = "point limit"
    RUN_LIMIT = "run limit"
    INTERRUPTED = "interrupted"
    UNFINISHED = "unfinished"

    @property
    def is_final(self) -> bool:
        """True if the search ran to its end, so that the result is complete."""
        return self in (Status.COMPLETE, Status.NO_PATH)
