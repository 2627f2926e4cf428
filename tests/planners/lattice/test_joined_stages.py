"""No stage of a planner loses what an earlier one had, in criteria that only filter or within a precision."""

from __future__ import annotations

import itertools

import pytest
import shapely

import hpop
from hpop.planners import searches as exact_search
from hpop.planners.graph_planners import Lattice
from hpop.problems.front import Front
from hpop.problems.problem import Problem

WALLS = [shapely.box(2, 0, 2.3, 3.2), shapely.box(4.4, 1.6, 4.8, 5), shapely.box(3, 3.8, 3.4, 4.2)]
WORLD = hpop.World.from_polygons(WALLS, extent=shapely.box(0, 0, 7, 5))
MEMORY = ["sickness", "msdv"]


@pytest.fixture(scope="module")
def fronts() -> tuple[Problem, list[Front]]:
    """Return the front after each stage, the last one at the end."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exact_search, "QUICK", 60.0)
        patch.setattr(exact_search, "_quick_exact_answer", lambda *asked: None)
        asked = Problem(
            WORLD,
            hpop.DifferentialDrive(radius=0.25),
            (1.0, 1.0, 0.0),
            (6.0, 4.0, None),
            ["turns", "length", *MEMORY],
        )
        stages: list[Front] = []
        (last,) = asked.fronts([Lattice(step=0.25)], stage=stages.append)
        return asked, [*stages, last]


def test_every_point_of_a_stage_is_covered_by_the_next(fronts):
    _, found = fronts
    assert len(found) >= 2
    for earlier, later in itertools.pairwise(found):
        for row in earlier.costs:
            assert (later.costs <= row + 1e-9).all(axis=1).any()


def test_the_search_alone_would_lose_some_and_the_certificate_says_whence_they_are(fronts):
    asked, found = fronts
    alone = asked.front(Lattice(step=0.25).solve(asked))
    lost = [row for row in found[0].costs if not (alone.costs <= row + 1e-9).all(axis=1).any()]
    assert lost
    assert str(found[-1].status) == "complete"
    assert "points of earlier stages (supported points), which may be better in sickness, msdv" in found[-1].certificate
    stages = [origin.get("stage") for origin in found[-1].provenance]
    assert stages.count("supported points") == len(lost)


def test_the_least_of_what_was_only_evaluated_is_called_the_least_of_those_found(fronts):
    asked, found = fronts
    assert found[-1].evaluated == tuple(MEMORY)
    names = set(found[-1].named())
    assert {"knee", "least turns", "least length", "least sickness of those found"} <= names
    searched = Problem(asked.world, asked.model, asked.start, asked.goal, ["turns", "length"]).solve(
        "lattice", step=0.5
    )
    assert searched.evaluated == ()


def test_a_last_stage_within_a_precision_keeps_what_is_better_than_its_own():
    asked = Problem(
        WORLD, hpop.DifferentialDrive(radius=0.25), (1.0, 1.0, 0.0), (6.0, 4.0, None), ["exposure", "turns", "length"]
    )
    planner = Lattice(step=0.5, eps=0.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exact_search, "QUICK", 60.0)
        patch.setattr(exact_search, "_quick_exact_answer", lambda *asked: None)
        stages: list[Front] = []
        (last,) = asked.fronts([planner], stage=stages.append)
    for row in stages[-1].costs:
        assert (last.costs <= row + 1e-9).all(axis=1).any()
    assert len(last) > len(asked.front(planner.solve(asked)))


def test_what_is_evaluated_is_kept_with_the_front(fronts, tmp_path):
    _, found = fronts
    found[-1].save(tmp_path / "front.json")
    assert Front.load(tmp_path / "front.json").evaluated == tuple(MEMORY)
    assert (found[-1] | found[0]).evaluated == tuple(MEMORY)
