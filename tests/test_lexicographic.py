"""The example plugin's planner: a new search, in one file, on every graph of hpop."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import planners
from hpop.errors import QueryError, UnsupportedCriterion
from hpop.planners import Exact
from hpop.problems.verify import verify
from hpop.world import Person

PLUGIN = str(Path(__file__).parents[1] / "examples" / "plugin")


@pytest.fixture(autouse=True, scope="module")
def plugin() -> Iterator[None]:
    """Register the plugin as if it were installed, for these tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PLUGIN)
        importlib.import_module("hpop_example_plugin.lexicographic")
        yield
    planners._types.pop("lexicographic", None)


def lexicographic(**options: Any) -> Any:
    return sys.modules["hpop_example_plugin.lexicographic"].Lexicographic(**options)


WORLD = hpop.World.from_polygons([shapely.box(2.0, 0.0, 2.4, 1.6)], extent=shapely.box(0, 0, 4.6, 3.2))
BASE = hpop.DifferentialDrive(radius=0.2)
HEAD = hpop.PanTilt(BASE)


def problem(model: Any, *criteria: Any, world: hpop.World = WORLD) -> hpop.Problem:
    head = (0.0, 0.0) if model is HEAD else ()
    return hpop.Problem(world, model, (0.6, 0.6, 0.0, *head), (4.0, 0.7, None, *head), list(criteria))


@pytest.mark.parametrize(
    ("on", "model"),
    [
        ({"lattice": {"step": 0.5}}, BASE),
        ({"roadmap": {"samples": 12, "seed": 1}}, BASE),
        ({"roadmap": {"samples": 25, "seed": 1}}, HEAD),
        ({"corners": {"step": 0.5}}, BASE),
    ],
    ids=["lattice", "positions", "configurations", "corners"],
)
@pytest.mark.parametrize("order", [("turns", "exposure", "length"), ("length", "exposure", "turns")])
def test_it_is_the_first_row_of_the_exact_front_on_every_graph(on: Any, model: Any, order: tuple[str, ...]) -> None:
    asked = problem(model, *order)
    found, exact = lexicographic(on=on).solve(asked), Exact(on).solve(asked)
    assert found.planned.tolist() == [min(exact.planned.tolist())]
    front = asked.front(found)
    assert "NOT VALID" not in front.certificate
    assert verify(asked, front) == []
    assert np.allclose(front.costs, found.planned, atol=found.tolerance.max())


def test_what_it_cannot_do_it_refuses() -> None:
    with pytest.raises(UnsupportedCriterion, match="not clearance"):
        lexicographic().solve(problem(BASE, "length", "clearance"))
    among = WORLD.with_content(people=(Person(4.0, 2.8, velocity=(-0.4, 0.0), name="Ann"),))
    with pytest.raises(QueryError, match=r"does not consider time, .*: Ann"):
        lexicographic().solve(problem(BASE, "length", world=among))


def test_where_there_is_no_path_it_says_what_separates_the_ends() -> None:
    walled = hpop.World.from_polygons([shapely.box(2.0, 0.0, 2.4, 3.2)], extent=shapely.box(0, 0, 4.6, 3.2))
    found = lexicographic(on={"lattice": {"step": 0.5}}).solve(problem(BASE, "length", world=walled))
    assert found.status is hpop.Status.NO_PATH
    assert any(note.startswith("no path") for note in found.notes)
