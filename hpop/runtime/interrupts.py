"""Interruptions of work: Ctrl-C delayed or never lost, signals that act like it, and rare garbage collection.

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
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from math import inf
from time import monotonic
from types import FrameType
from typing import Any

# Signals that ask a process to end: after a batch job's time, or when the terminal closes. Some systems lack SIGHUP.
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
SIGNALS = (signal.SIGINT, *ENDING)  # on the command line, the signals ENDING act like Ctrl-C
WAKING = 0.5  # s after which a loop that waits looks whether a Ctrl-C was lost
Handler = Callable[[int, FrameType | None], Any]


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
    held: list[tuple[int, FrameType | None]] = []
    handlers = _handlers()
    try:
        with _handled(handlers, lambda number, frame: held.append((number, frame))):
            yield
    finally:
        if held:
            handlers[signal.Signals(held[0][0])](*held[0])


@contextmanager
def interrupts_noted() -> Iterator[Callable[[], None]]:
    """Note each Ctrl-C in the block; the function that is yielded raises KeyboardInterrupt if one came.

    Python loses a Ctrl-C in two ways. A signal that comes just before a wait in C does not end the wait. An exception
    that is raised in a finalizer or a weak reference's callback is printed, and dropped. A loop that waits for long
    therefore wakes up every `WAKING` s, and calls the function; so does :func:`waited`.
    """
    noted: list[int] = []
    handlers = _handlers()

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        handlers[signal.Signals(number)](number, frame)

    def check() -> None:
        if noted:
            raise KeyboardInterrupt

    with _handled(handlers, note):
        yield check


def waited(event: threading.Event, seconds: float = inf) -> bool:
    """Wait until an event is set, for at most ``seconds``; return whether it is set. No Ctrl-C is lost meanwhile."""
    last = monotonic() + seconds
    with interrupts_noted() as check:
        while not event.wait(max(0.0, min(WAKING, last - monotonic()))) and monotonic() < last:
            check()
    return event.is_set()


def _handlers() -> dict[signal.Signals, Handler]:
    """Return the handlers of `SIGNALS` that are not ignored; none outside the main thread, which gets no signals."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}


@contextmanager
def _handled(handlers: dict[signal.Signals, Handler], handle: Handler) -> Iterator[None]:
    """Handle signals by another function in the block, in place of their handlers."""
    try:
        for number in handlers:
            signal.signal(number, handle)
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
