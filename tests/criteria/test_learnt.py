"""A learnt criterion is the sum that its file says, everywhere that criteria are used; other files are refused."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Learnt
from hpop.criteria.base import describe_criterion, make_criterion
from hpop.criteria.costs import motion_costs, trajectory_cost, trajectory_costs
from hpop.criteria.learnt import Source
from hpop.errors import CriterionError
from hpop.planners import make_planner
from hpop.scenario import load_scenario
from hpop.testing.worlds import random_motions
from hpop.world import Person
from tests.own_criteria import LEARNT, own_criterion
from tests.planners.timed.rooms_with_people import ROBOT, through_the_doors

ROOM = """\
world:
  polygons:
    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]
    obstacles: [{corners: [[2.5, 0], [3.5, 0], [3.5, 2.2], [2.5, 2.2]]}]
start: [1.0, 1.0, 0]
goal: [5.0, 1.0, any]
criteria: [{learnt: {file: comfort.json}}, turns]
planner: {lattice: {step: 0.5}}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    shutil.copy(LEARNT, tmp_path / "comfort.json")
    (tmp_path / "room.yaml").write_text(ROOM)
    return tmp_path / "room.yaml"


def test_it_costs_the_weighted_sum_of_its_parts() -> None:
    learnt = own_criterion("learnt")
    problem = hpop.examples.museum()
    rng = np.random.default_rng(0)
    parts = {name: make_criterion(name) for name in ("rotation", "camera_length", "duration")}
    for kind in ("move", "turn"):
        motions = random_motions(rng, problem.world, problem.model, kind, 20)
        rotation, length, duration = (motion_costs(part, motions) for part in parts.values())
        np.testing.assert_allclose(motion_costs(learnt, motions), 0.5 * rotation + 1.25 * length + 0.02 * duration)
    assert learnt.requires == ("camera",)
    assert learnt.smooth


def test_its_docstring_tells_where_it_is_from() -> None:
    said = Learnt(str(LEARNT)).__doc__ or ""
    assert "learnt from 24 ratings (comfort) of 6 trajectories by 4 people; error on trajectories left out 0.8" in said
    assert "made up for tests" in said


def test_a_scenario_plans_with_it_and_the_front_moves_together_with_its_file(scenario: Path, tmp_path: Path) -> None:
    loaded = load_scenario(scenario)
    front = loaded.problem.solve(loaded.planners[0])
    assert front.names == ("learnt", "turns")
    for point in front:
        assert point.costs["learnt"] == pytest.approx(
            trajectory_cost(own_criterion("learnt"), point.trajectory, loaded.problem.world)
        )
    (tmp_path / "here").mkdir()
    front.save(tmp_path / "here" / "front.json")
    shutil.copytree(tmp_path, tmp_path.parent / "moved")
    (tmp_path / "comfort.json").unlink()
    again = hpop.Front.load(tmp_path.parent / "moved" / "here" / "front.json")
    assert again.problem is not None
    criterion = hpop.Problem.from_description(again.problem).criteria[0]
    assert isinstance(criterion, Learnt)
    assert Path(criterion.file["path"]) == tmp_path.parent / "moved" / "comfort.json"
    assert again.question == front.question


def agrees(problem: hpop.Problem, planner: dict[str, Any]) -> None:
    """Check that planned costs equal the weighted sum of the re-evaluated parts, within the claimed tolerance."""
    learnt, *_ = problem.criteria
    assert isinstance(learnt, Learnt)
    found = make_planner(planner).solve(problem)
    weights, parts = zip(*learnt.parts, strict=True)
    again = trajectory_costs(list(parts), found.trajectories, problem.world) @ weights
    assert len(again)
    assert (np.abs(found.planned[:, 0] - again) <= found.tolerance[:, 0] + 1e-9).all()


@pytest.mark.parametrize(
    "planner",
    [
        {"lattice": {"step": 1.0}},
        {"roadmap": {"samples": 30}},
        {"weighted-sum": {"on": {"lattice": {"step": 1.0}}}},
        {"any-angle": {"step": 1.0}},
        {"epsilon-constraint": {"step": 1.0, "rounds": 1}},
        pytest.param({"smoothing": {}}, marks=pytest.mark.proof),
    ],
    ids=lambda planner: next(iter(planner)),
)
def test_planners_add_it_up_as_it_is_evaluated(planner: dict[str, Any]) -> None:
    room = hpop.World.from_polygons([shapely.box(2, 0, 4, 3)], extent=shapely.box(0, 0, 6, 6))
    agrees(hpop.Problem(room, ROBOT, (1, 1, 0), (5, 1, None), [own_criterion("learnt"), "turns"]), planner)


@pytest.mark.parametrize(
    "planner", [pytest.param({"lattice": {"step": 1.0}}, marks=pytest.mark.proof), {"roadmap": {"samples": 15}}]
)
def test_planners_among_people_who_move_add_it_up_as_it_is_evaluated(tmp_path: Path, planner: dict[str, Any]) -> None:
    parts = [{"criterion": {name: {}}, "weight": weight} for name, weight in
             (("hall_zones", 1.5), ("expected_contacts", 4.0), ("duration", 0.1))]  # fmt: skip
    (tmp_path / "c.json").write_text(changed(parts=parts))
    walker = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0, spread=0.2)
    agrees(through_the_doors(walker, criteria=(Learnt(str(tmp_path / "c.json")), "duration")), planner)


def test_a_file_that_has_changed_is_refused(scenario: Path) -> None:
    described = describe_criterion(make_criterion({"learnt": {"file": str(scenario.with_name("comfort.json"))}}))
    text = scenario.with_name("comfort.json").read_text()
    scenario.with_name("comfort.json").write_text(text.replace("0.5", "0.6"))
    with pytest.raises(CriterionError, match="has changed since the front was saved"):
        make_criterion(described)
    scenario.with_name("comfort.json").unlink()
    with pytest.raises(CriterionError, match="cannot read"):
        make_criterion(described)


def changed(**changes: Any) -> str:
    document = json.loads(LEARNT.read_text())
    for key, value in changes.items():
        document[key] = value
    return json.dumps(document)


PART = {"criterion": {"rotation": {}}, "weight": 1.0}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[", "expected a file from hpop.study.fit_criterion"),
        ("[" * 100_000, "nested too deeply"),
        (changed(schema="hpop-front"), "instead of hpop-learnt, version 1"),
        (changed(more=1), "unknown keys"),
        (changed(parts=[]), "expected 1 to 50 criteria, got 0"),
        (changed(parts=[PART] * 60), "'rotation' twice"),
        (changed(parts=[PART | {"weight": -1.0}]), "the weight of rotation must be a number from 0"),
        (changed(parts=[PART | {"weight": 0.0}]), "no weight above 0"),
        (changed(parts=[{"criterion": {"rotat": {}}, "weight": 1.0}]), "Did you mean 'rotation'"),
        (changed(parts=[{"criterion": {"obstruction": {}}, "weight": 1.0}]), "use 'exposure'"),
        (changed(parts=[{"criterion": {"jerk": {}}, "weight": 1.0}]), "each part must be a sum over motions"),
        (changed(parts=[{"criterion": {"learnt": {"file": str(LEARNT)}}, "weight": 1.0}]), "must not be learnt itself"),
        (changed(learnt={}), "missing keys"),
    ],
)  # fmt: skip
def test_what_is_no_learnt_criterion_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(CriterionError, match=re.escape(said)) as caught:
        Learnt(str(tmp_path / "c.json"))
    assert "Traceback" not in str(caught.value)
    for wrong in (3, None, ""):
        with pytest.raises(CriterionError, match="file must be the path"):
            Learnt(wrong)


def test_a_file_that_is_made_of_itself_is_refused_for_that(tmp_path: Path) -> None:
    for file, part in (("c.json", "c.json"), ("a.json", "b.json"), ("b.json", "a.json")):
        of = {"criterion": {"learnt": {"file": str(tmp_path / part)}}, "weight": 1.0}
        (tmp_path / file).write_text(changed(parts=[of]))
    for file in ("a.json", "c.json"):
        with pytest.raises(CriterionError, match="a part of a learnt criterion must not be learnt itself"):
            Learnt(str(tmp_path / file))


def test_what_is_said_of_its_source_steers_no_terminal() -> None:
    assert "\x1b" not in str(Source("com\x1b[2Jfort", "made \x1b[2J up", 5, 1, 5, 0.5, 0.5))


def test_one_person_is_no_people() -> None:
    assert "by 1 person;" in str(Source("comfort", "made up", 5, 1, 5, 0.5, 0.5))
