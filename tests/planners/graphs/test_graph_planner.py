"""Weighted sums on the graph of another planner: they take the graph, and nothing else of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError, UnknownName, UnsupportedCriterion, UnsupportedModel
from hpop.planners import Roadmap, WeightedSum

PILLAR = hpop.World.from_polygons([shapely.box(2.3, 1.2, 2.9, 2.9)], extent=shapely.box(0, 0, 5, 4))
DRIVE = hpop.DifferentialDrive(radius=0.2)
HEAD = hpop.PanTilt(DRIVE)


def problem(model: Any = DRIVE, criteria: Any = ("length", "turns")) -> hpop.Problem:
    head = (0.0, 0.0) if model is HEAD else ()
    return hpop.Problem(PILLAR, model, (0.8, 2.0, 0.3, *head), (4.2, 2.1, -1.1, *head), criteria)


@pytest.mark.parametrize(("model", "samples"), [(DRIVE, 12), (HEAD, 25)], ids=["positions", "configurations"])
def test_weighted_sums_on_a_roadmap_are_the_supported_points_of_its_front(hull: Any, model: Any, samples: int) -> None:
    options = {"samples": samples, "seed": 3}
    asked = problem(model, [{"exposure": {"radius": 1.0}}, "rotation", "length"])
    exact, found = Roadmap(**options).solve(asked), WeightedSum(on={"roadmap": options}).solve(asked)
    quanta = np.array([criterion.quantum for criterion in exact.objectives])
    points, supported = (
        [tuple(row) for row in np.rint(each.planned / quanta).astype(int).tolist()] for each in (exact, found)
    )
    assert len(points) > len(supported) > 3
    assert hull.extreme(points) <= set(supported) <= {y for y in points if hull.supported(y, points)}
    assert found.certificate.startswith(
        f"weighted-sum: all extreme supported points of the roadmap of {samples} samples"
    )


@dataclass(frozen=True)
class Bare(hpop.DifferentialDrive):
    """A robot that does not say that it turns and moves."""

    @property
    def provides(self) -> frozenset[str]:
        return frozenset({"base", "camera", "heading", "plane"})


def test_weighted_sums_need_what_their_graph_needs() -> None:
    asked = problem(Bare(radius=0.2))
    with pytest.raises(UnsupportedModel, match="weighted-sum needs a model with turn-move"):
        asked.solve("weighted-sum")
    with pytest.raises(UnsupportedModel, match="weighted-sum needs a model with turn-move"):
        asked.solve({"weighted-sum": {"on": "lattice"}})
    assert WeightedSum(on="roadmap").solve(asked).trajectories
    assert WeightedSum(on="roadmap").needs == frozenset()
    assert WeightedSum(on={"lattice": {"step": 0.5}}).needs == WeightedSum().needs


def test_on_a_lattice_they_are_what_they_are_with_its_options() -> None:
    asked = problem()
    one, other = WeightedSum(step=0.5), WeightedSum(on={"lattice": {"step": 0.5}})
    assert one.solve(asked).planned.tolist() == other.solve(asked).planned.tolist()
    assert one.solve(asked).certificate == other.solve(asked).certificate


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"on": "smoothing"}, r"unknown graph 'smoothing'.* corners, lattice, primitives, roadmap"),
        ({"on": {"roadmap": {"time_limit": 3}}}, "no option 'time_limit'.* It has samples, .*; options of the search"),
        ({"on": {"lattice": {"eps": 0.1}}}, "graph 'lattice' has no option 'eps'.* stand beside `on`"),
        ({"on": {"roadmap": {"sampels": 3}}}, "graph 'roadmap' has no option 'sampels'"),
        (
            {"on": "roadmap", "step": 0.5},
            "step, headings and corner_cutting are options of the default lattice, which `on` replaces: .*, not both",
        ),
        ({"on": 7}, "a graph must be given as a name"),
    ],
)
def test_what_is_no_graph_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises((OptionError, UnknownName), match=said):
        WeightedSum(**options)


def test_a_worst_edge_names_the_planner_of_the_graph() -> None:
    with pytest.raises(UnsupportedCriterion, match="use planner 'roadmap'"):
        WeightedSum(on="roadmap").solve(problem(criteria=["clearance", "length"]))
