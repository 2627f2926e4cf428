"""Compilation of kernels in background processes, which share numba's cache with this process.

Threads would not help, as numba compiles under Python's lock. A background process searches a tiny graph
(:mod:`.rehearsal`), and prints the name of each kernel that it compiles. This process waits for a kernel only while a
background process compiles it, and compiles other kernels itself. So no kernel is compiled twice, and a process that
fails does no harm.
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

from hpop import runtime
from hpop.runtime.interrupts import interrupts_held

PARTS = ("search", "bounds", "weights")  # groups of kernels, the most urgent first
# The kernels of a search in the order of their use.
ORDER = (
    "number_groups",
    "separate_turns",
    "write_turn_costs",
    "no_dearer_than_two",
    "pack_arcs",
    "settle_groups",
    "costs_of_least_path",
    "fill_tables",
    "advance",
    "trace_paths",
)
REHEARSAL = "from hpop.search.rehearsal import main; main()"
Kernels = Callable[[Sequence[str], int], tuple[Any, Any]]
POLL = 0.02  # s between two looks at the output of processes

_processes: list[_Compiler] = []
_missing: list[_MissingKernels] = []  # not empty if the cache lacks kernels of the search


class _Compiler:
    """Background process that compiles kernels.

    current  name of the kernel that the process compiles now
    ended    whether the process has ended
    """

    def __init__(self, parts: Sequence[str], aggregates: Sequence[str], turns: int) -> None:
        command = [sys.executable, "-P", "-c", REHEARSAL, ",".join(parts), str(turns), *aggregates]
        # A separate session, so that Ctrl-C on the terminal does not reach it.
        self._process = Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=DEVNULL, start_new_session=True)
        assert self._process.stdout is not None
        self._output = self._process.stdout
        os.set_blocking(self._output.fileno(), False)
        self._line = b""
        self.current = ""
        self.ended = False

    def is_compiling_kernel(self, name: str) -> bool:
        """Return whether the process compiles the named kernel now."""
        self._read_output()
        return self.current == name and not self.ended

    def _read_output(self) -> None:
        """Read the new output of the process, and update ``current`` and ``ended``."""
        while not self.ended:
            with suppress(BlockingIOError):
                more = os.read(self._output.fileno(), 4096)
                self.ended = not more
                *lines, self._line = (self._line + more).split(b"\n")
                self.current = lines[-1].decode() if lines else self.current
                continue
            return

    def stop(self) -> None:
        """Kill the process and wait for its end."""
        self._process.kill()
        self._process.wait()
        self._output.close()


class Onset(StrEnum):
    """Choice of when background processes begin to compile; the values are words for the user."""

    AT_ONCE = "from now on"
    AFTER_FIRST = "after a first answer and its map"


class _MissingKernels(NamedTuple):
    """Description of the search whose kernels the cache lacks.

    aggregates  "sum" or "max" for each cost
    turns       column of the cost that counts turns, or -1
    first       kernel that computes a first result
    """

    aggregates: Sequence[str]
    turns: int
    first: Any


@contextmanager
def compiling_beside(aggregates: Sequence[str], turns: int, onset: Onset, kernels: Kernels) -> Iterator[Onset | None]:
    """Compile the missing kernels of a search in background processes while a ``with`` block runs.

    The ``with`` statement yields ``onset``, or None if the kernel that takes longest is cached or cannot be cached.
    With ``Onset.AFTER_FIRST``, compilation starts only when :func:`start_compilers` is called, so that a first result
    and its map come sooner.

    aggregates  "sum" or "max" for each cost
    turns       column of the cost that counts turns, or -1
    onset       when compilation begins
    kernels     function that returns, for these costs, the kernel that takes longest to compile and that of a first
                result
    """
    longest, first = kernels(aggregates, turns)
    if runtime.compiled.can_be_cached(longest) and not runtime.compiled.is_cached(longest):
        _missing.append(_MissingKernels(aggregates, turns, first))
    try:
        if onset is Onset.AT_ONCE:
            start_compilers()
        yield onset if _missing else None
    finally:
        _missing.clear()
        while _processes:
            _processes.pop().stop()


def start_compilers() -> None:
    """Start the background processes if kernels are missing and no process runs yet."""
    if not _missing or _processes:
        return
    aggregates, turns, _ = _missing[0]
    with suppress(OSError), interrupts_held():  # if no process can be started, this one compiles
        count = 2 if (os.cpu_count() or 1) > 2 else 1
        _processes.extend(_Compiler(PARTS[part::count], aggregates, turns) for part in range(count))


def is_compiling() -> bool:
    """Return whether kernels of the search were missing in the cache when :func:`compiling_beside` began."""
    return bool(_missing)


def is_first_kernel_missing() -> bool:
    """Return whether the kernel that computes a first result is not compiled yet; SciPy then computes that result."""
    if not _missing:
        return False
    return not runtime.compiled.is_cached(_missing[0].first)


def wait_for(compiled: Any, report: Callable[[], None]) -> None:
    """Wait while a background process compiles a kernel; call ``report`` again and again meanwhile."""
    if not _processes:
        return
    name = kernel_name(compiled)
    with runtime.compiled.compiling_elsewhere():
        while any(process.is_compiling_kernel(name) for process in _processes):
            report()
            sleep(POLL)


def description(compiled: Any) -> str:
    """Return the name of a kernel and its number among the kernels of a search, for a progress report."""
    name = compiled.py_func.__name__
    if name not in ORDER:
        return f"{name} (once)"
    return f"{name}, {ORDER.index(name) + 1} of {len(ORDER)} parts of the search (once)"


def kernel_name(compiled: Any) -> str:
    """Return the dotted name of a kernel, with its module."""
    return f"{compiled.py_func.__module__}.{compiled.py_func.__name__}"
