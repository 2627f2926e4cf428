"""The fuzzer finds what it is for: planted tracebacks, crashes, hangs, hoarding, control characters, by kind."""

from __future__ import annotations

import importlib
import itertools
import mmap
import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.search import Graph

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


@pytest.fixture
def combinations(targets: ModuleType) -> ModuleType:
    return importlib.import_module("targets.combinations")


def small() -> tuple[hpop.Problem, hpop.Front]:
    world = hpop.World.from_polygons([shapely.box(1.4, 0.9, 1.8, 1.3)], extent=shapely.box(0, 0, 3, 2))
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.2), (0.5, 1, 0), (2.5, 1, None), ["turns", "length"])
    return problem, problem.solve("lattice", step=0.25)


PLANTED: dict[str, Any] = {
    "planned and re-evaluated costs differ": lambda front: {"certificate": f"NOT VALID: {front.certificate}"},
    "verify: trajectory #: length is saved as": lambda front: {"costs": front.costs + np.array([0.0, 0.5])},
    "no path, and points": lambda front: {"status": "no path"},
}


@pytest.mark.parametrize("kind", PLANTED)
def test_what_is_wrong_of_a_front_is_a_failure(combinations: ModuleType, harness: ModuleType, kind: str) -> None:
    problem, front = small()
    combinations._is_right(problem, front)
    with pytest.raises(harness.Wrong, match=kind):
        combinations._is_right(problem, replace(front, **PLANTED[kind](front)))


def test_time_and_memory_beyond_the_limits_are_failures(
    combinations: ModuleType, harness: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(combinations, "SLACK", 0.0)
    monkeypatch.setattr(combinations, "ROOM", 10**7)
    quick, small = hpop.planners.Lattice(time_limit=1e-3), hpop.planners.Lattice(max_memory=10**6)
    within = combinations._in_time_and_memory
    with pytest.raises(harness.Wrong, match="over three times its time limit"), within([quick]):
        spend(0.01)
    with pytest.raises(harness.Wrong, match="memory beyond max_memory"), within([small]):
        fill_fresh_memory(8 * 10**7)
    with within([small, hpop.planners.Lattice()]):  # of several, one without a limit
        fill_fresh_memory(8 * 10**7)


def fill_fresh_memory(size: int) -> None:
    """Fill ``size`` bytes that come from the system; an array could reuse memory that the process holds already."""
    with mmap.mmap(-1, size) as block:
        for begin in range(0, size, mmap.PAGESIZE):
            block[begin] = 1


def spend(seconds: float) -> None:
    """Take processor time."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


@pytest.mark.parametrize("worst", [0, 1, 2])
def test_the_oracle_of_combinations_finds_all_non_dominated_sums_and_maxima(
    combinations: ModuleType, worst: int
) -> None:
    """By the costs of all simple paths of a small graph, none of whose arcs is free of charge."""
    rng = np.random.default_rng(worst)
    tails, heads = np.nonzero(~np.eye(6, dtype=bool))
    costs = rng.integers(1, 9, (tails.size, 3))
    aggregates = ["sum"] * (3 - worst) + ["max"] * worst
    graph = Graph.from_arcs(6, tails, heads, costs, aggregates=aggregates)
    paid = {(t, h): c for t, h, c in zip(tails.tolist(), heads.tolist(), costs, strict=True)}
    every = set()
    for count in range(5):
        for between in itertools.permutations(range(1, 5), count):
            arcs = np.array([paid[arc] for arc in itertools.pairwise((0, *between, 5))])
            every.add((*arcs.sum(axis=0)[: 3 - worst].tolist(), *arcs.max(axis=0)[3 - worst :].tolist()))
    best = {a for a in every if not any(b != a and all(np.less_equal(b, a)) for b in every)}
    assert combinations._by_loops(graph, 0, [5]) == best


@pytest.mark.parametrize("number", [0, pytest.param(7, marks=pytest.mark.proof)])
def test_a_combination_is_planned_and_used(
    targets: ModuleType, harness: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    targets.allowed.plugin()
    monkeypatch.chdir(tmp_path)
    assert harness.outcome_of(targets.TARGETS["combination"], 0, tmp_path, number) in {"accepted", "refused"}
