"""Limits of time and memory that hold for everything done within a block of code, in this thread.

A map is read before there is a problem to plan, and a field or an integral is computed when a criterion first asks for
it, far from the planner that has the limits. Work that may take long is therefore done in parts, and between two parts
it asks the limits that hold for now. Without such a block nothing is limited.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

READING = "the map was read"


class LimitPassed(Exception):
    """What limits raise: whatever was being done is not done, and that is a result, not an error."""


class Account(Protocol):
    """An account of time and memory; each method raises LimitPassed where a limit is passed."""

    def check(self, doing: str, memory: int = 0) -> None:
        """Look at the time, and whether there is room for so many bytes more."""

    def hold(self, memory: int, doing: str) -> None:
        """Charge bytes that stay, before they are taken."""


_LIMITS: ContextVar[Account | None] = ContextVar("limits", default=None)


@contextmanager
def within(limits: Account) -> Iterator[None]:
    """What is made in the block keeps these limits."""
    token = _LIMITS.set(limits)
    try:
        yield
    finally:
        _LIMITS.reset(token)


def hold(doing: str, stays: int, beside: int = 0) -> None:
    """Before a map is read or a field made: it takes so many bytes that stay, and others until it is done."""
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing, stays + beside)
        limits.hold(stays, doing)


def check(doing: str) -> None:
    """Between two parts of what is made."""
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing)
