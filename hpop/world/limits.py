"""What reading a world and making its fields may take: whoever plans has limits, and what takes long or much asks them.

A map is read before there is a problem to plan, and a field is made when a criterion first asks for it, far from
whoever plans; so the limits hold for all that is done within a block, in this thread. Maps are read and fields made in
parts, and ask between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

READING = "the map was read"


class LimitPassed(Exception):
    """What limits raise: whatever was being done is not done, and that is a result, not an error."""


class Limits(Protocol):
    """Time and memory of whoever plans; each raises where a limit is passed."""

    def check(self, doing: str, memory: int = 0) -> None:
        """Look at the time, and whether there is room for so many bytes more."""

    def hold(self, memory: int, doing: str) -> None:
        """Charge bytes that stay, before they are taken."""


_LIMITS: ContextVar[Limits | None] = ContextVar("limits", default=None)


@contextmanager
def within(limits: Limits) -> Iterator[None]:
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
