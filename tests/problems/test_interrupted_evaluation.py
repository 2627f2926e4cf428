"""Ctrl-C while many points are re-evaluated: some are saved first, and a second Ctrl-C leaves these."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner, Result

import hpop.view
from hpop.cli import main, results
from hpop.cli.beside import PicturesBeside
from hpop.planners.base import Deferred
from hpop.planners.graph_planners import Lattice
from hpop.problems import solving
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime import limits
from hpop.runtime.limits import Progress
from hpop.scenario import load_scenario
from tests.worlds import TWO_WALLS

SOME = 20
ROOM = TWO_WALLS.replace("step: 0.25", "step: 0.25, max_turns: 1000")  # without stages before the last


class Stopped(NamedTuple):
    """A plan that was interrupted: its output, the fronts that it saved in turn, its folder."""

    result: Result
    saved: list[Front]
    folder: Path


@pytest.fixture(scope="module")
def patch() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solving, "SOME", SOME)
        patch.setattr(hpop.view, "save_pictures", lambda problem, front, folder, **options: [])
        patch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)
        yield patch


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    file = tmp_path_factory.mktemp("room") / "room.yaml"
    file.write_text(ROOM)
    return load_scenario(file).problem


def stopped(folder: Path, times: int) -> Stopped:
    """Plan, and press Ctrl-C so many times while costs are re-evaluated."""
    saved, left, plain, save = list[Front](), [times], limits.described, results.save

    def interrupting(progress: Progress) -> str:
        if progress.stage == "evaluation" and progress.detail and left[0]:
            left[0] -= 1
            raise KeyboardInterrupt
        return plain(progress)

    def keep(front: Front, out: Path) -> None:
        saved.append(front)
        save(front, out)

    (folder / "room.yaml").write_text(ROOM)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limits, "described", interrupting)
        patch.setattr(results, "save", keep)
        result = CliRunner().invoke(main, ["plan", str(folder / "room.yaml"), "--out", str(folder / "out")])
    return Stopped(result, saved, folder / "out")


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory, patch: pytest.MonkeyPatch) -> Stopped:
    return stopped(tmp_path_factory.mktemp("once"), 1)


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory, patch: pytest.MonkeyPatch) -> Stopped:
    return stopped(tmp_path_factory.mktemp("twice"), 2)


def test_some_points_are_saved_before_all_are_re_evaluated(once: Stopped) -> None:
    some, whole = once.saved
    assert once.result.exit_code == 130
    assert len(some) <= SOME < len(whole)
    assert some.status == whole.status == "interrupted"
    assert f"; {len(some)} of the {len(whole)} points, before the others are re-evaluated" in some.certificate
    assert "before the others" not in whole.certificate


def test_they_are_points_of_the_whole_front_and_the_best_in_each_cost_among_them(once: Stopped) -> None:
    some, whole = once.saved
    assert set(map(tuple, some.costs)) < set(map(tuple, whole.costs))
    assert np.array_equal(some.integers.min(axis=0), whole.integers.min(axis=0))


def test_in_the_end_the_file_holds_all(once: Stopped, problem: Problem) -> None:
    front = Front.load(once.folder / "front.json")
    assert np.array_equal(front.costs, problem.solve(Lattice(step=0.25)).costs)


def test_a_second_ctrl_c_ends_and_leaves_a_file_that_holds_what_it_claims(twice: Stopped, problem: Problem) -> None:
    front = Front.load(twice.folder / "front.json")
    assert twice.result.exit_code == 130
    assert "the front found before is saved in" in twice.result.stderr
    assert len(twice.saved) == 1
    assert np.array_equal(front.costs, twice.saved[0].costs)
    assert "before the others are re-evaluated" in front.certificate
    assert verify(problem, front) == []


def test_with_criteria_that_have_memory_fewer_are_saved_first(problem: Problem, patch: pytest.MonkeyPatch) -> None:
    asked = Problem(
        problem.world, problem.model, problem.start, problem.goal, ["turns", "length", "exposure", "sickness"]
    )
    saved, left = list[Front](), [1]

    def progress(now: Progress) -> None:
        if now.stage == "evaluation" and now.detail and left[0]:
            left[0] -= 1
            raise KeyboardInterrupt

    patch.setattr(solving, "SOME", 10**9)
    patch.setattr(solving, "SOME_WITH_MEMORY", 4)
    (whole,) = asked.fronts([Lattice(step=0.5, max_turns=1000)], progress=progress, stage=saved.append)
    assert [len(front) <= 4 < len(whole) for front in saved] == [True]


def test_of_many_trajectories_only_those_that_are_read_are_made() -> None:
    made: list[list[int]] = []

    def make(rows: np.ndarray) -> tuple[str, ...]:
        made.append(rows.tolist())
        return tuple(f"trajectory {row}" for row in rows)

    several: Deferred = Deferred(1000, make)  # type: ignore[arg-type]  # words stand for trajectories
    assert len(several) == 1000
    assert several.take(np.array([7, 3])) == ("trajectory 7", "trajectory 3")
    assert made == [[7, 3]]
    assert (several[0], several[-1]) == ("trajectory 0", "trajectory 999")
    assert len(made) == 2
