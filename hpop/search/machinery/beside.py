"""Compilation of kernels in background processes, which share numba's cache with this process.

Threads would not help, as numba compiles under Python's lock. A background process runs a rehearsal (:mod:`.rehearsal`)
and prints the name of the kernel that it compiles. This process waits for a kernel only while a background process
compiles it, and compiles other kernels itself. So no kernel is compiled twice, and a failing process does no harm.
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

PARTS = ("search", "bounds", "weights")  # of a rehearsal, the most urgent first
# The kernels of a search in the order of their use.
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
POLL = 0.02  # s between two looks at the output of processes

_processes: list[_Process] = []
_awaited: list[_Awaited] = []  # not empty while kernels are to be compiled


class _Process:
    """Background process, and the kernel that it compiles."""

    def __init__(self, parts: Sequence[str], aggregates: Sequence[str], turns: int) -> None:
        command = [sys.executable, "-P", "-c", REHEARSAL, ",".join(parts), str(turns), *aggregates]
        # A separate session, so that Ctrl-C on the terminal does not reach it.
        self._process = Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=DEVNULL, start_new_session=True)
        assert self._process.stdout is not None
        self._output = self._process.stdout
        os.set_blocking(self._output.fileno(), False)
        self._line = b""
        self.at = ""
        self.ended = False

    def is_at(self, name: str) -> bool:
        """Return whether the process compiles the kernel of a name at the moment."""
        self._listen()
        return self.at == name and not self.ended

    def _listen(self) -> None:
        """Read the new output of the process."""
        while not self.ended:
            with suppress(BlockingIOError):
                more = os.read(self._output.fileno(), 4096)
                self.ended = not more
                *lines, self._line = (self._line + more).split(b"\n")
                self.at = lines[-1].decode() if lines else self.at
                continue
            return

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        self._output.close()


class Onset(StrEnum):
    """Time at which background processes begin to compile, in words for the user."""

    AT_ONCE = "from now on"
    AFTER_FIRST = "after a first answer and its map"


class _Awaited(NamedTuple):
    """Kernels to be compiled: the costs that they are for, and the kernel of a first answer."""

    aggregates: Sequence[str]
    turns: int
    first: Any


@contextmanager
def compiling_beside(aggregates: Sequence[str], turns: int, onset: Onset, kernels: Kernels) -> Iterator[Onset | None]:
    """Compile the kernels of a search in the background of a ``with`` block; the value is when, or None if cached.

    With ``Onset.AFTER_FIRST`` compilation begins with :func:`begin`, so that a first answer and its map come sooner.

    turns    column of the cost that counts turns, or -1
    kernels  returns, for these costs, the kernel that takes longest to compile and that of a first answer
    """
    from hpop.runtime.compiled import can_be_cached, is_cached  # numba: on first use

    longest, first = kernels(aggregates, turns)
    if can_be_cached(longest) and not is_cached(longest):
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
    """Start the background processes, if kernels are to be compiled and none was started."""
    if not _awaited or _processes:
        return
    aggregates, turns, _ = _awaited[0]
    with suppress(OSError), interrupts_held():  # if no process can be started, this one compiles
        count = 2 if (os.cpu_count() or 1) > 2 else 1
        _processes.extend(_Process(PARTS[part::count], aggregates, turns) for part in range(count))


def is_compiling() -> bool:
    """Return whether kernels of the search were missing in the cache at the beginning."""
    return bool(_awaited)


def first_is_awaited() -> bool:
    """Return whether the kernel of a first answer is not compiled yet, so that the answer must do without it."""
    if not _awaited:
        return False
    from hpop.runtime.compiled import is_cached

    return not is_cached(_awaited[0].first)


def wait_for(compiled: Any, report: Callable[[], None]) -> None:
    """Wait while a background process compiles a kernel, with progress reports."""
    if not _processes:
        return
    from hpop.runtime.compiled import compiling_elsewhere

    name = name_of(compiled)
    with compiling_elsewhere():
        while any(process.is_at(name) for process in _processes):
            report()
            sleep(POLL)


def words(compiled: Any) -> str:
    """Return the kernel that is compiled and its number among all, for the user."""
    name = compiled.py_func.__name__
    if name not in ORDER:
        return f"{name} (once)"
    return f"{name}, {ORDER.index(name) + 1} of {len(ORDER)} parts of the search (once)"


def name_of(compiled: Any) -> str:
    """Return the module and name of a kernel."""
    return f"{compiled.py_func.__module__}.{compiled.py_func.__name__}"
