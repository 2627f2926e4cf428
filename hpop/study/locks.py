"""Locks on a study's folder: one server at a time, and one change at a time.

The system lets go of them when whoever holds them ends, however it ends; nothing is left behind.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hpop.errors import StudyError

try:
    import fcntl
except ImportError:  # no such locks on this system: only one program may be at work on a study
    fcntl = None  # type: ignore[assignment]


@contextmanager
def changing(folder: Path) -> Iterator[None]:
    """Change what is in a study's folder alone, after who does so already; not to be nested."""
    held = hold(folder, wait=True)
    try:
        yield
    finally:
        release(held)


def serve_alone(folder: Path) -> int | None:
    """Hold a folder for the one server of its answers, until :func:`release`; StudyError where another server does."""
    try:
        return hold(folder, wait=False)
    except BlockingIOError:
        raise StudyError(
            f"{folder.parent} is served already, by another `hpop study serve`: two would take answers from each "
            "other; use the addresses that it printed, or end it with Ctrl-C first"
        ) from None


def release(held: int | None) -> None:
    """Let go of a lock."""
    if held is not None:
        os.close(held)


def hold(folder: Path, *, wait: bool) -> int | None:
    """A folder, open and locked, for :func:`release`; None on systems without such locks.

    BlockingIOError where somebody else holds it and there is no waiting, StudyError where it cannot be locked.
    """
    if fcntl is None:
        return None
    held = None
    try:
        held = os.open(folder, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        release(held)
        if isinstance(error, BlockingIOError):
            raise
        raise StudyError(
            f"cannot lock {folder}: {error.strerror or error}; put the study on a disk of this machine"
        ) from None
    return held
