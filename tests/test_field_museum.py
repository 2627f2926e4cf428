"""The Field Museum: five costs on a real building among people, planned exactly, verified by other means."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import hpop
from hpop.frontier import is_nondominated
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.view import draw_map

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
DATA = "../../shared/data/field_museum_main"  # where the scenario has them
STEP = 3.0  # m


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("example_field_museum", EXAMPLES / "field_museum.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def problem(shared_data, tmp_path_factory) -> hpop.Problem:
    """Return the scenario's problem, from the data wherever they are."""
    text = (EXAMPLES / "field_museum.yaml").read_text()
    assert text.count(DATA) == 3
    path = tmp_path_factory.mktemp("museum") / "scenario.yaml"
    path.write_text(text.replace(DATA, str(shared_data("field_museum_main"))))
    return load_scenario(path).problem


@pytest.fixture(scope="module")
def front(problem) -> hpop.Front:
    return problem.solve(planner="lattice", step=STEP, time_limit=60.0)


def test_the_script_and_the_scenario_are_one_world(example, problem, shared_data):
    assert example.museum(shared_data("field_museum_main")).describe() == problem.world.describe()


def test_the_museum_has_people_who_talk_landmarks_and_closed_rooms(problem):
    content = problem.world.content
    assert problem.world.contents >= {"people", "groups", "landmarks"}
    assert {"birds", "nature_walk", "penguins"} < {landmark.name for landmark in content.landmarks}
    ada, bo = (content.people[i] for i in content.groups[0])
    # They face each other, 1.2 m apart.
    assert (np.cos(ada.yaw), np.cos(bo.yaw)) == pytest.approx((1.0, -1.0))
    assert bo.x - ada.x == pytest.approx(1.2)


def test_people_and_display_cases_stand_in_the_open(problem):
    world = problem.world
    x, y = np.array([(thing.x, thing.y) for thing in (*world.content.people, *world.content.landmarks)]).T
    assert np.all(world.with_content().clearance(x, y) > 0.1)


def test_the_front_is_complete_and_trades_all_five_costs(front):
    assert front.status == "complete"
    assert front.certificate.startswith("lattice: exact on the lattice of step")
    assert front.names == ("exposure", "turns", "length", "landmark_blindness", "personal_space")
    assert len(front) > 10
    assert is_nondominated(front.costs).all()
    assert np.all(np.ptp(front.costs, axis=0) > 0)


def test_the_front_holds_what_it_claims(problem, front):
    assert verify(problem, front) == []


def test_who_keeps_away_from_people_and_walls_goes_farther_and_sees_less(front):
    calm, short = front.lexicographic(["personal_space", "exposure"]), front.best("length")
    assert calm.costs["length"] > short.costs["length"] + 1.0
    assert calm.costs["landmark_blindness"] > short.costs["landmark_blindness"]


def test_nobody_is_run_over(problem, front):
    bodies = np.array([(person.x, person.y) for person in problem.world.content.people])
    for trajectory in front.trajectories:
        s = trajectory.at(np.linspace(0.0, trajectory.duration, 1000))
        gaps = np.hypot(s.x[:, None] - bodies[:, 0], s.y[:, None] - bodies[:, 1])
        assert gaps.min() > 0.25 + problem.model.radius - 2e-3  # the body is a polygon of 64 corners


def test_the_front_survives_saving_with_its_problem(front, problem, tmp_path):
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    np.testing.assert_array_equal(again.costs, front.costs)
    assert hpop.World.from_description(problem.world.describe()).describe() == problem.world.describe()


def test_the_map_shows_the_gallery_with_all_in_it(problem, front):
    figure = draw_map(problem, front)
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    assert np.diff(axes.get_xlim())[0] < 80.0  # of 213 m
    words = {text.get_text() for text in figure.legends[1].get_texts()}
    assert {"conversation", "landmark, tick: its front", "person (enlarged), tick: heading", "keep-out zone"} <= words
