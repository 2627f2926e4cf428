"""Fronts of trajectories: they survive saving, and a file that is none is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.base import trajectory_costs
from hpop.frontier import FrontFileError
from hpop.problem import Problem


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    world = hpop.World.from_polygons([shapely.box(2, 0, 3, 2.2)], extent=shapely.box(0, 0, 5, 4))
    asked = Problem(
        world, hpop.DifferentialDrive(radius=0.2), (1, 1, 0), (4, 1, None), ["obstruction", "turns", "length"]
    )
    return asked.solve(step=0.5)


def test_a_saved_front_is_the_same_when_loaded(front: hpop.Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    assert len(again) > 1
    for name in ("names", "units", "groups", "reported_names", "reported_units", "status", "certificate", "notes"):
        assert getattr(again, name) == getattr(front, name)
    for name in ("provenance", "problem", "runs"):
        assert getattr(again, name) == getattr(front, name)
    for name in ("costs", "reported", "quanta", "integers"):
        assert np.array_equal(getattr(again, name), getattr(front, name))
    for saved, found in zip(again.trajectories, front.trajectories, strict=True):
        assert saved.kinds == found.kinds
        assert saved.model == found.model
        for name in found.states.names:
            assert np.array_equal(getattr(saved.states, name), getattr(found.states, name))


def test_a_loaded_front_united_with_the_first_adds_nothing(front: hpop.Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    both = front | hpop.Front.load(tmp_path / "front.json")
    assert isinstance(both, hpop.Front)
    assert np.array_equal(both.costs, front.costs)
    assert both.runs == front.runs


def test_the_saved_problem_gives_the_saved_costs_again(front: hpop.Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    problem = Problem.from_description(again.problem or {})
    costs = trajectory_costs(problem.criteria, again.trajectories, problem.world)
    assert [c.name for c in problem.criteria] == ["obstruction", "turns", "length"]
    assert np.array_equal(costs, np.column_stack([again.reported[:, 0], again.costs[:, 1:]]))


def edited(front: hpop.Front, path: Path, key: str, value: Any) -> Path:
    front.save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    return path


MODELS = [None, [], {}, {"tank": {}}, {"differential_drive": 3}, {"differential_drive": {"radius": "wide"}}]


@pytest.mark.parametrize("problem", [None, {}, *({"model": model} for model in MODELS)])
def test_a_front_without_a_model_cannot_hold_trajectories(front: hpop.Front, tmp_path: Path, problem: object) -> None:
    path = edited(front, tmp_path / "front.json", "problem", problem)
    with pytest.raises(FrontFileError, match="expected a front with its problem and model"):
        hpop.Front.load(path)
    assert len(hpop.Front.load(path, decode=lambda item: item)) == len(front)


@pytest.mark.parametrize("notes", [None, 3, "text", {"a": 1}])
def test_notes_that_are_no_list_are_passed_over(front: hpop.Front, tmp_path: Path, notes: object) -> None:
    runs = [{"notes": notes}, {"notes": ["goal snapped", {"odd": []}]}, {}]
    path = edited(front, tmp_path / "front.json", "runs", runs)
    assert hpop.Front.load(path).notes == ("goal snapped", "{'odd': []}")


def test_notes_that_several_runs_share_are_said_once(front: hpop.Front) -> None:
    assert front.notes == tuple(dict.fromkeys(front.runs[0]["notes"]))
    assert any("exposure" in note for note in front.notes)
