"""Ctrl-C: what else does the same, how it is answered, and where it must wait.

CasADi takes it for a failed evaluation and goes on, LLVM loses it or frees twice, a pool that is left never ends. Where
it comes just as Python's futures have taken a lock, nobody gives that back: threads that ask for it wait for ever.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

# What ends a process: a closed terminal, the end of a batch job's time. SIGHUP is not known everywhere.
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
SIGNALS = (signal.SIGINT, *ENDING)  # the latter where the command line lets them do what Ctrl-C does


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C until the block has ended, then let it do what it would have done.

    Only the main thread gets signals; where they are ignored, as in workers, there is nothing to hold.

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
            except BaseException as error:  # a signal came, and its handler was back before the others
                late = error
        if late is not None:
            raise late
        if held:
            handlers[signal.Signals(held[0][0])](*held[0])


@contextmanager
def endings_interrupt() -> Iterator[None]:
    """Let SIGTERM (kill, timeout) and SIGHUP (a closed terminal) do what Ctrl-C does.

    One that is ignored, as by nohup, stays so.
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
def stopping_told() -> Iterator[None]:
    """Answer a first Ctrl-C at once: to keep what millions of labels have found takes seconds."""
    told: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        if not told:
            with suppress(OSError):  # a terminal that was closed; and no lock of a stream
                os.write(2, b"\nstopping: what was found is kept, which may take some seconds\n")
        told.append(number)
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
