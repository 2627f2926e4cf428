"""Kernels that other processes compile beside this one; numba's cache is where they meet.

Threads would not help: numba compiles under Python's lock. What to compile is found by a rehearsal
(:mod:`.rehearsal`), and a process says on its output which kernel it is at. Whoever needs that one waits, all others
are compiled where they are needed, so nothing is compiled twice, and nothing depends on a process that fails.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from enum import StrEnum
from subprocess import DEVNULL, PIPE, Popen
from time import sleep
from typing import Any, NamedTuple

from hpop.runtime.interrupts import interrupts_held

PARTS = ("search", "bounds", "weights")  # of a rehearsal, in the order of their need
# The kernels of a search in the order in which it takes them.
ORDER = (
    "number_groups",
    "part_arcs",
    "tell_turns",
    "no_dearer_than_two",
    "reverse",
    "cost_to_go",
    "cost_along",
    "fill_tables",
    "advance",
    "trace",
)
REHEARSAL = "from hpop.search.rehearsal import main; main()"
Kernels = Callable[[Sequence[str], int], tuple[Any, Any]]
POLL = 0.02  # s between two looks at what a process says

_processes: list[_Process] = []
_awaited: list[_Awaited] = []  # while there is something to compile


class _Process:
    """A process that compiles, and the kernel that it is at."""

    def __init__(self, parts: Sequence[str], aggregates: Sequence[str], turns: int) -> None:
        command = [sys.executable, "-P", "-c", REHEARSAL, ",".join(parts), str(turns), *aggregates]
        # A session of its own: Ctrl-C on the terminal is not meant for it.
        self._process = Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=DEVNULL, start_new_session=True)
        assert self._process.stdout is not None
        self._said = self._process.stdout
        os.set_blocking(self._said.fileno(), False)
        self._rest = b""
        self.at = ""
        self.ended = False

    def is_at(self, name: str) -> bool:
        """Whether the process compiles the kernel of this name."""
        self._listen()
        return self.at == name and not self.ended

    def _listen(self) -> None:
        """Take what the process said since."""
        while not self.ended:
            with suppress(BlockingIOError):
                more = os.read(self._said.fileno(), 4096)
                self.ended = not more
                *lines, self._rest = (self._rest + more).split(b"\n")
                self.at = lines[-1].decode() if lines else self.at
                continue
            return

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        self._said.close()


class Onset(StrEnum):
    """When other processes begin to compile, in words for the user."""

    AT_ONCE = "from now on"
    AFTER_FIRST = "after a first answer and its map"


class _Awaited(NamedTuple):
    """What is to be compiled: for which costs, and the kernel that a first answer would take."""

    aggregates: Sequence[str]
    turns: int
    first: Any


@contextmanager
def compiling_beside(aggregates: Sequence[str], turns: int, onset: Onset, kernels: Kernels) -> Iterator[Onset | None]:
    """Compile the kernels of a search beside what is done in a ``with``; tells when, None where they are kept.

    After a first answer that begins with :func:`begin`: who waits for it and its picture has the machine for these.

    turns    the cost that counts turns, -1 for none
    kernels  gives, for these, the kernel that takes longest to compile and the one that a first answer takes
    """
    from hpop.runtime.compiled import can_be_kept, is_kept  # numba: on first use

    longest, first = kernels(aggregates, turns)
    if can_be_kept(longest) and not is_kept(longest):
        _awaited.append(_Awaited(aggregates, turns, first))
    try:
        if onset is Onset.AT_ONCE:
            begin()
        yield onset if _awaited else None
    finally:
        _awaited.clear()
        while _processes:
            _processes.pop().stop()


def begin() -> None:
    """Begin to compile, if there is anything to compile and that has not begun."""
    if not _awaited or _processes:
        return
    aggregates, turns, _ = _awaited[0]
    with suppress(OSError), interrupts_held():  # where no process can be had, this one compiles
        count = 2 if (os.cpu_count() or 1) > 2 else 1
        _processes.extend(_Process(PARTS[part::count], aggregates, turns) for part in range(count))


def is_compiling() -> bool:
    """Whether something that the search takes was not compiled when this began."""
    return bool(_awaited)


def first_is_awaited() -> bool:
    """Whether what a first answer takes is compiled beside: then one is sought without."""
    if not _awaited:
        return False
    from hpop.runtime.compiled import is_kept

    return not is_kept(_awaited[0].first)


def wait_for(compiled: Any, report: Callable[[], None]) -> None:
    """Wait while a process is at this kernel, and report now and then."""
    if not _processes:
        return
    from hpop.runtime.compiled import compiling_elsewhere

    name = name_of(compiled)
    with compiling_elsewhere():
        while any(process.is_at(name) for process in _processes):
            report()
            sleep(POLL)


def words(compiled: Any) -> str:
    """What is compiled and how far that is, for the user."""
    name = compiled.py_func.__name__
    if name not in ORDER:
        return f"{name} (once)"
    return f"{name}, {ORDER.index(name) + 1} of {len(ORDER)} parts of the search (once)"


def name_of(compiled: Any) -> str:
    """Module and name of a kernel."""
    return f"{compiled.py_func.__module__}.{compiled.py_func.__name__}"
