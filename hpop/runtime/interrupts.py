"""Interruptions of work: blocks in which Ctrl-C is delayed, signals that act like it, and rare garbage collection.

Ctrl-C must be delayed where it would do harm. CasADi takes it for a failed evaluation and goes on. LLVM loses it or
frees memory twice. A process pool that is interrupted never ends. If Ctrl-C comes just after one of Python's futures
has taken a lock, the lock is never released, and threads that need it wait for ever.

Python's garbage collector searches new objects for unused cycles. When a process ends, it searches all objects several
times. Nearly all objects of a command live to its end, so these searches find little, but they took an eighth of the
time.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from types import FrameType

# Signals that ask a process to end: after a batch job's time, or when the terminal closes. Some systems lack SIGHUP.
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
SIGNALS = (signal.SIGINT, *ENDING)  # on the command line, the signals ENDING act like Ctrl-C


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Delay Ctrl-C, and SIGTERM and SIGHUP where they act like it, until the end of the block.

    Only the main thread gets signals, so in other threads nothing changes. A signal that is ignored, as in workers,
    stays ignored.

    >>> try:
    ...     with interrupts_held():
    ...         signal.raise_signal(signal.SIGINT)
    ...         print("to the end")
    ... except KeyboardInterrupt:
    ...     print("and then stopped")
    to the end
    and then stopped
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}
    held: list[tuple[int, FrameType | None]] = []

    def hold(number: int, frame: FrameType | None) -> None:
        held.append((number, frame))

    try:
        for number in handlers:
            signal.signal(number, hold)
        yield
    finally:
        late: BaseException | None = None
        restored = False
        while not restored:
            try:
                for number, handler in handlers.items():
                    signal.signal(number, handler)
                restored = True
            except BaseException as error:  # a signal came when only some handlers were restored
                late = error
        if late is not None:
            raise late
        if held:
            handlers[signal.Signals(held[0][0])](*held[0])


@contextmanager
def endings_interrupt() -> Iterator[None]:
    """Let SIGTERM (kill, timeout) and SIGHUP (a closed terminal) act like Ctrl-C in the block.

    A signal that is ignored, as under nohup, stays ignored.
    """
    numbers = [number for number in ENDING if signal.getsignal(number) == signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        numbers = []
    for number in numbers:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def stopping_announced() -> Iterator[None]:
    """Print a reply at once to the first Ctrl-C in the block, because saving the results may take some seconds."""
    answered: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        if not answered:
            with suppress(OSError):  # a closed terminal; os.write takes no lock of a stream
                os.write(2, b"\nstopping: the results so far are being saved, which may take some seconds\n")
        answered.append(number)
        signal.default_int_handler(number, frame)

    numbers = [number for number in SIGNALS if signal.getsignal(number) is signal.default_int_handler]
    if threading.current_thread() is not threading.main_thread():
        numbers = []
    for number in numbers:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.default_int_handler)


COUNTING = "ompl"  # a library that prints the number of its remaining objects when Python ends
OBJECTS = 300_000  # number of new objects between two searches; all imports and four pictures make fewer


@cache
def collect_rarely() -> None:
    """Let Python collect garbage rarely in this process, and not when it ends."""
    gc.set_threshold(OBJECTS)
    atexit.register(stop_collecting)  # registered first, called last


def stop_collecting() -> None:
    """Exclude all objects from garbage collection when the process ends; the system frees their memory.

    There are two exceptions. A file that a user's plugin has left open may have lines that are written only when the
    file object is collected. And the library ``COUNTING`` would print the number of objects that were not collected.
    """
    # Imported here: the registry imports importlib.metadata, a tenth of the start of the command line.
    from hpop.base.registry import criteria, goals, models, planners, readers

    has_plugins = any(registry.own() for registry in (criteria, goals, models, planners, readers))
    if not has_plugins and COUNTING not in sys.modules:
        gc.freeze()
