"""Claims: a block can hold Ctrl-C to its end; a wait loses none; every handler is back afterwards."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest

from hpop.runtime.interrupts import SIGNALS, interrupts_held, interrupts_noted, waited

ROOT = Path(__file__).parents[1]


def interrupt(number: int, frame: Any) -> None:
    raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def handled() -> Iterator[None]:
    """Every signal that ends a command interrupts, as where hpop's command line runs."""
    before = {number: signal.signal(number, interrupt) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def handlers() -> set[Any]:
    return {signal.getsignal(number) for number in SIGNALS}


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_waits_for_the_end_of_the_block(number: signal.Signals) -> None:
    done = []

    def to_the_end() -> None:
        with interrupts_held():
            signal.raise_signal(number)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        to_the_end()
    assert done == ["all of it"]
    assert handlers() == {interrupt}


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("after", range(len(SIGNALS)))
def test_a_signal_that_comes_while_handlers_are_put_back_leaves_none_behind(
    number: signal.Signals, after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    install, restored = signal.signal, []

    def watched(which: int, handler: Any) -> Any:
        was = install(which, handler)
        if handler is interrupt:
            restored.append(which)
            if len(restored) == after + 1:
                signal.raise_signal(number)
        return was

    with pytest.raises(KeyboardInterrupt), interrupts_held():
        monkeypatch.setattr(signal, "signal", watched)
    monkeypatch.undo()
    assert handlers() == {interrupt}


def press(begun: Event) -> None:
    """Send Ctrl-C to the thread that calls this: nothing ends a wait of the main thread in C, as just before a wait."""
    begun.wait()
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)


def test_a_wait_ends_though_its_thread_does_not_notice_the_signal() -> None:
    def pressed() -> None:
        """Wait; the signal may also come before the wait, on a machine that is busy."""
        other.start()
        threading.Timer(0.1, begun.set).start()
        waited(Event())

    begun = Event()
    other = Thread(target=press, args=[begun])
    with pytest.raises(KeyboardInterrupt):
        pressed()
    other.join()
    assert handlers() == {interrupt}


SERVING = """
import threading
from hpop.runtime.page_server import PageServer
from tests.test_interrupts_held import press

begun = threading.Event()
threading.Thread(target=press, args=[begun]).start()
threading.Timer(0.1, begun.set).start()
try:
    with PageServer([]) as server:
        server.serve_forever()
except KeyboardInterrupt:
    print("ended")
"""


def test_a_server_ends_though_its_thread_does_not_notice_the_signal() -> None:
    """In a process of its own: a browser of other tests may have an event loop in this one."""
    ended = subprocess.run([sys.executable, "-c", SERVING], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert ended.stdout == "ended\n", ended.stderr


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_whose_exception_is_dropped_is_noted(number: signal.Signals) -> None:
    class Ending:
        def __del__(self) -> None:
            signal.raise_signal(number)

    with interrupts_noted() as check:
        check()
        ending = Ending()
        del ending
        with pytest.raises(KeyboardInterrupt):
            check()
    assert handlers() == {interrupt}
