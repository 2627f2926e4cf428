"""Limits of time and memory for all work within a block of code, in this thread.

A map is read before there is a problem to plan. Distance grids and integrals are computed when a criterion first needs
them, by code that does not know the planner's limits. Long work is therefore done in parts, and between two parts it
checks the limits of the surrounding block (:func:`within`). Outside of such a block there are no limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

READING = "the map was read"


class LimitPassed(Exception):
    """Signal that work was stopped because it exceeded a limit of time or memory.

    Callers turn it into a result with a status, not into an error.
    """


class Account(Protocol):
    """Account of the time and memory that were used; each method raises LimitPassed if a limit is exceeded."""

    def check(self, doing: str, memory: int = 0) -> None:
        """Check the time limit, and whether ``memory`` more bytes are allowed.

        ``doing`` completes the note on an exceeded limit, "it was passed while DOING": for example "the map was read".
        """

    def hold(self, memory: int, doing: str) -> None:
        """Count ``memory`` bytes that are about to be allocated and will stay allocated."""


_LIMITS: ContextVar[Account | None] = ContextVar("limits", default=None)


@contextmanager
def within(limits: Account) -> Iterator[None]:
    """Apply the limits of an account to all work in the block."""
    token = _LIMITS.set(limits)
    try:
        yield
    finally:
        _LIMITS.reset(token)


def hold(doing: str, stays: int, beside: int = 0) -> None:
    """Check that an object may be made within the memory limit, and count its memory.

    doing   the work in words, for the note on an exceeded limit: "zones were sampled"
    stays   bytes of the object itself
    beside  bytes that are needed only while the object is being made
    """
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing, stays + beside)
        limits.hold(stays, doing)


def check(doing: str) -> None:
    """Check the limits between two parts of a long computation, called ``doing`` in the note on an exceeded limit."""
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing)
