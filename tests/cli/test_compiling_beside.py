"""With nothing compiled `hpop plan` says when other processes begin to compile the search, and then they do."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from click.testing import Result

import hpop.runtime.compiled
import hpop.view
from hpop.cli import results
from hpop.cli.beside import PicturesBeside
from hpop.planners.graph_planners import Lattice
from hpop.problems.front import Front
from hpop.search.machinery import beside

ONCE = "once for each number and kind of costs\n"
AFTER = f"the search is compiled in the background after a first answer and its map, {ONCE}"
AT_ONCE = f"the search is compiled in the background from now on, {ONCE}"
LATTICE = "\n  lattice: {step: 0.5}"
WEIGHTS = "\n- weighted-sum: {step: 0.5}"


@pytest.fixture
def moments(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Record the steps of a run in which no kernel is compiled and no process is started."""
    done: list[str] = []
    save = results.save

    class Process:
        def __init__(self, parts: Sequence[str], *costs: object) -> None:
            done.append("compile")

        def is_compiling_kernel(self, name: str) -> bool:
            return False

        def stop(self) -> None:
            done.append("stop")

    def saved(front: Front, out: Path) -> None:
        done.append("save")
        save(front, out)

    def drawn(*arguments: object, map_alone: bool = False, **limits: object) -> list[Path]:
        done.append("map" if map_alone else "pictures")
        return []

    monkeypatch.setattr(beside, "_Compiler", Process)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # hence one process
    monkeypatch.setattr(hpop.runtime.compiled, "is_cached", lambda compiled: False)
    monkeypatch.setattr(results, "save", saved)
    monkeypatch.setattr(hpop.view, "save_pictures", drawn)
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)
    return done


def test_a_lattice_alone_has_a_first_answer_and_its_map_before_anything_is_compiled_beside(
    plan: Callable[..., Result], room: Path, moments: list[str]
) -> None:
    assert plan(room).stderr.startswith(AFTER)
    assert moments == ["save", "map", "compile", "save", "pictures", "stop"]


def test_without_stages_kernels_are_compiled_beside_from_the_beginning(
    plan: Callable[..., Result], room: Path, write: Callable[..., None], moments: list[str]
) -> None:
    write(room, (LATTICE, "\n  lattice: {step: 0.5, max_turns: 6}"))
    assert plan(room).stderr.startswith(AT_ONCE)
    assert moments == ["compile", "save", "pictures", "stop"]


def test_kernels_are_compiled_beside_a_planner_that_comes_before_the_lattice(
    plan: Callable[..., Result], room: Path, write: Callable[..., None], moments: list[str]
) -> None:
    write(room, (LATTICE, f"{WEIGHTS}{LATTICE.replace('  ', '- ')}"))
    assert plan(room).stderr.startswith(AT_ONCE)
    assert moments == ["compile", "save", "save", "save", "pictures", "stop"]


def test_a_lattice_answers_in_stages_unless_that_would_lose_what_it_is_asked_for(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    assert Lattice().answers_in_stages
    assert Lattice(checkpoint=kept).answers_in_stages
    kept.touch()
    assert not Lattice(checkpoint=kept).answers_in_stages
    assert not Lattice(max_turns=6).answers_in_stages
    assert not Lattice(max_detour=1.3).answers_in_stages
