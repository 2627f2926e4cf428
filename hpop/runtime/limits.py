"""Limits of time and memory for all work done within a block of code, in this thread.

A map is read before there is a problem to plan, and fields and integrals are computed when a criterion first needs
them, far from the planner that holds the limits. Long work is therefore done in parts, and between two parts it checks
the limits of the surrounding block. Without such a block there are no limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

READING = "the map was read"


class LimitPassed(Exception):
    """Signal that a limit was passed and work was abandoned.

    Callers turn it into a result with a status, not into an error.
    """


class Account(Protocol):
    """Account of time and memory; each method raises LimitPassed when a limit is passed."""

    def check(self, doing: str, memory: int = 0) -> None:
        """Check the time, and whether ``memory`` more bytes fit.

        ``doing`` names the work in the note of a passed limit.
        """

    def hold(self, memory: int, doing: str) -> None:
        """Charge ``memory`` bytes that stay allocated, before they are allocated."""


_LIMITS: ContextVar[Account | None] = ContextVar("limits", default=None)


@contextmanager
def within(limits: Account) -> Iterator[None]:
    """Apply these limits to all work in the block."""
    token = _LIMITS.set(limits)
    try:
        yield
    finally:
        _LIMITS.reset(token)


def hold(doing: str, stays: int, beside: int = 0) -> None:
    """Check and charge memory before an object is made.

    doing   the work in words, for the note of a passed limit
    stays   bytes of the object itself
    beside  bytes that are needed only while the object is made
    """
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing, stays + beside)
        limits.hold(stays, doing)


def check(doing: str) -> None:
    """Check the limits between two parts of a long computation; ``doing`` names it in the note of a passed limit."""
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing)
