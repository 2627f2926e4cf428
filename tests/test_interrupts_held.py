"""Claim: Ctrl-C is held to the end of a block, then does what it would have done, and every handler is back."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import pytest

from hpop.runtime.interrupts import SIGNALS, interrupts_held


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
