"""The fuzzer finds what it is for: planted tracebacks, crashes, hangs, hoarding, control characters, by kind."""

from __future__ import annotations

import importlib
import os
import signal
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

FUZZ = Path(__file__).parent / "fuzz"


@pytest.fixture
def harness(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(FUZZ))
    return importlib.import_module("harness")


@pytest.fixture
def mutations(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(FUZZ))
    return importlib.import_module("mutations")


def planted(rng: np.random.Generator, folder: Path) -> str:
    """Every kind of failure in turn; the folder's name is the input's number."""
    number = int(folder.name)
    if number == 1:
        raise ZeroDivisionError
    if number == 2:
        os.kill(os.getpid(), signal.SIGSEGV)
    if number == 3:
        while True:
            pass
    if number == 4:
        bytes(10**11)
    return "accepted" if rng.random() < 2 else "refused"


def test_each_failure_is_counted_by_kind_and_the_inputs_after_it_are_tried(
    harness: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(harness, "PROCESSOR_SECONDS", 0.2)
    target = harness.Target("planted", planted)
    tally = harness.run(target, 0, tmp_path, seconds=600, inputs=7)
    kinds = {kind.partition(" at ")[0]: count for kind, count in tally.outcomes.items()}
    over = "over 0.2 processor seconds"
    assert kinds == {"accepted": 3, "ZeroDivisionError": 1, "dies of SIGSEGV": 1, over: 1, "out of memory": 1}
    assert (tally.inputs, tally.failures) == (7, 4)
    assert sorted(tally.first.values()) == [1, 2, 3, 4]
    assert not any(tmp_path.glob("[056]"))


@pytest.fixture
def targets(harness: ModuleType) -> ModuleType:
    return importlib.import_module("targets")


@pytest.mark.parametrize("text", ["\x1b[31mred", "\u202eexe", "a\x07", "x" * 5000])
def test_what_nobody_should_be_shown_is_a_failure(harness: ModuleType, text: str) -> None:
    shown = importlib.import_module("verdicts").shown
    with pytest.raises(harness.Wrong):
        shown(text)
    assert shown("two lines\nwith Umläute and a\ttab") == "refused"


def test_an_input_is_the_same_whenever_it_is_made(targets: ModuleType, harness: ModuleType, mutations: Any) -> None:
    one, other = (harness.generator(0, targets.TARGETS["plan"], 7) for _ in range(2))
    for _ in range(20):
        assert repr(mutations.bent_tree(targets.given.ROOM, one)) == repr(
            mutations.bent_tree(targets.given.ROOM, other)
        )


def test_mutations_change_a_tree_and_leave_the_original(mutations: ModuleType, targets: ModuleType) -> None:
    before = repr(targets.given.ROOM)
    rng = np.random.default_rng(0)
    bent = [repr(mutations.bent_tree(targets.given.ROOM, rng)) for _ in range(200)]
    assert repr(targets.given.ROOM) == before
    assert sum(one != before for one in bent) > 150
    assert len(set(bent)) > 150


@pytest.mark.parametrize("name", ["geojson", "movingai", "tracks", "scenario", "python", "ros"])
def test_some_inputs_are_accepted_and_some_refused(
    targets: ModuleType, harness: ModuleType, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the fuzzer would only knock at the door."""
    outcomes = set()
    for number in range(60):
        place = tmp_path / str(number)
        place.mkdir()
        monkeypatch.chdir(place)
        outcomes.add(harness.outcome_of(targets.TARGETS[name], 0, place, number))
        if {"accepted", "refused"} <= outcomes:
            break
    assert {"accepted", "refused"} <= outcomes
