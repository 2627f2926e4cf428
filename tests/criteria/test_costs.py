"""Claims: a problem may compare costs in other steps than its criteria declare, and its fronts know in which."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import shapely

from hpop.base import registry
from hpop.criteria.base import criterion
from hpop.criteria.costs import with_quanta
from hpop.errors import CriterionError, HpopError
from hpop.frontier import FrontError
from hpop.models import DifferentialDrive
from hpop.planners.objectives import edge_objectives
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.world import World


def problem(criteria: list[Any], **options: Any) -> Problem:
    boxes = [shapely.box(2.0, 0.0, 3.0, 2.0)]
    world = World.from_polygons(boxes, extent=shapely.box(0.0, 0.0, 5.0, 4.0))
    return Problem(world, DifferentialDrive(radius=0.2), (0.5, 0.5, 0.0), (4.5, 0.5, 0.0), criteria, **options)


def test_costs_are_compared_in_the_steps_asked_for_and_the_saved_front_is_verified_with_them(tmp_path: Path) -> None:
    asked = problem(["length", "exposure"], quanta={"length": 0.5})
    fine = problem(["length", "exposure"]).solve("lattice", step=0.5)
    coarse = asked.solve("lattice", step=0.5)
    assert coarse.quanta.tolist() == [0.5, 1e-6]
    assert len(coarse) < len(fine)
    assert coarse.certificate.endswith("; quanta as set: length 0.5 m")
    assert "quanta as set" not in fine.certificate
    coarse.save(tmp_path / "front.json")
    loaded = Front.load(tmp_path / "front.json")
    again = Problem.from_description(loaded.problem or {})
    assert again.quanta == {"length": 0.5}
    assert verify(again, loaded) == []
    assert any("quantum" in fault for fault in verify(problem(["length", "exposure"]), loaded))
    with pytest.raises(FrontError, match="the quanta of two fronts must be equal for a union"):
        fine | coarse


def test_what_stands_in_for_a_mean_has_the_step_of_its_own_name() -> None:
    asked = problem(["obstruction", "length", "exposure"], quanta={"exposure": 0.25, "obstruction": 0.01})
    quanta = {c.name: c.quantum for c in edge_objectives(asked.criteria, "lattice").optimised}
    assert quanta == {"exposure": 0.25, "length": 1e-6}
    assert edge_objectives(asked.criteria, "lattice").means[0].quantum == 0.01
    assert {c.name: c.quantum for c in problem(["obstruction"]).criteria} == {"obstruction": 1e-6}
    assert pickle.loads(pickle.dumps(asked.criteria[2])).quantum == 0.25  # as workers get it


@pytest.mark.parametrize(
    ("quanta", "said"),
    [
        ({"lenght": 0.1}, "got 'lenght'. Did you mean 'length'? They are length, turns, obstruction, exposure"),
        ({"length": 0}, "the quantum of length must be a number, in 'm' from 1e-12 to 1,000,000, got 0"),
        ({"length": float("nan")}, "the quantum of length must be"),
        ({"length": "fine"}, "the quantum of length must be"),
        ({"length": True}, "the quantum of length must be"),
        ({"turns": 0.5}, "the quantum of turns must be 1, because it is a count, got 0.5; leave it out"),
        ([0.1], "quanta must map names of costs to numbers"),
    ],
)
def test_other_names_and_numbers_are_refused(quanta: Any, said: str) -> None:
    with pytest.raises(CriterionError) as error:
        problem(["length", "turns", "obstruction"], quanta=quanta)
    assert said in str(error.value)


def test_a_class_that_cannot_take_another_one_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria))

    @criterion("slotted", group="C", unit="m", aggregate="sum")
    @dataclass(frozen=True, slots=True)
    class Slotted:
        def cost(self, m: Any) -> Any:
            return m.camera.length

    with pytest.raises(CriterionError, match="the quantum of slotted, its class Slotted must not have slots"):
        with_quanta([Slotted()], {"slotted": 0.1})


SCENARIO = """\
world: {polygons: {extent: [[0, 0], [5, 0], [5, 4], [0, 4]]}}
start: [0.5, 0.5, 0]
goal: [4.5, 0.5, 0]
criteria: [obstruction, length]
quanta: QUANTA
"""


@pytest.mark.parametrize(
    ("quanta", "said"),
    [
        ("{length: 0.001, exposure: 0.01}", ""),
        ("{turns: 2}", "quanta must name criteria of this problem"),
        ("{length: fine}", "quanta"),
    ],
)
def test_a_scenario_says_them(tmp_path: Path, quanta: str, said: str) -> None:
    file = tmp_path / "room.yaml"
    file.write_text(SCENARIO.replace("QUANTA", quanta))
    if not said:
        assert load_scenario(file).problem.quanta == {"length": 0.001, "exposure": 0.01}
        return
    with pytest.raises(HpopError, match=r"(?s)line 5.*") as error:
        load_scenario(file)
    assert said in str(error.value)
