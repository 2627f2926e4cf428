"""The example plugin's robot, which hpop does not have: a base that slides, written in one short file."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import make_model
from hpop.criteria.costs import trajectory_cost
from hpop.errors import CriterionError, ModelError, UnsupportedModel
from hpop.motions import States, lacking
from hpop.planners import Candidates
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.testing import conformance, random_world
from hpop.trajectories.trajectory import Trajectory
from hpop.view.map import draw_map
from hpop.view.trace import draw_trace
from hpop.view.where import draw_where
from tests.own_criteria import NAMES, own_criterion

PLUGIN = Path(__file__).resolve().parents[2] / "examples/plugin"
HALL = hpop.World.from_polygons([shapely.box(2.0, 0.0, 2.4, 2.0)], extent=shapely.box(0, 0, 5, 4))


@pytest.fixture(scope="module")
def robot() -> type:
    """Its class, registered as an installed plugin's would be."""
    sys.path.insert(0, str(PLUGIN))
    try:
        return importlib.import_module("hpop_example_plugin.holonomic").Holonomic
    finally:
        sys.path.remove(str(PLUGIN))


def slides(model, rows):
    columns = dict(zip(("x", "y", "yaw"), np.array(rows, float).T, strict=True))
    return Trajectory(model, States(**columns), ("slide",) * (len(rows) - 1))


def found(problem, trajectories):
    """Return a front of trajectories that no planner made."""
    planned = np.array([[problem.evaluate(t)[c.name] for c in problem.criteria] for t in trajectories])
    origin = tuple({"planner": "by hand"} for _ in trajectories)
    return problem.front(
        Candidates(problem.criteria, trajectories, planned, 0 * planned, Status.COMPLETE, "drawn by hand", origin)
    )


@pytest.fixture
def problem(robot):
    return hpop.Problem(HALL, robot(), (1, 1, 0), (4, 1, None), ["length", "rotation", "duration"])


def over_the_wall(model):
    """Two ways round the wall: one slides upright all along, the other turns on its way."""
    straight = slides(model, [(1, 1, 0), (1.6, 2.8, 0), (2.8, 2.8, 0), (4, 1, 0)])
    turning = slides(model, [(1, 1, 0), (1.5, 2.5, 0.7), (2.9, 2.5, -0.5), (4, 1, -1.0)])
    return straight, turning


def test_its_file_is_short_and_none_of_hpops_files_names_it():
    text = (PLUGIN / "hpop_example_plugin/holonomic.py").read_text()
    assert len(text.splitlines()) <= 150
    house = Path(hpop.__file__).parent
    assert not any("holonomic" in file.read_text().lower() for file in house.rglob("*.py"))


@pytest.mark.cases("-2.0")
@pytest.mark.parametrize("sideways", [0.0, 0.5 * np.pi, -2.0])
def test_sliding_costs_what_a_differential_drive_pays_for_the_same_way_at_the_same_speed(robot, sideways):
    """Every criterion, except those about a heading, wheels or the camera's direction; 0.3 m is half the diagonal."""
    world = random_world(np.random.default_rng(0))
    drive, base = hpop.DifferentialDrive(radius=0.3), robot(length=0.48, width=0.36)
    compared = set()
    for start, end in (((1.0, 1.0), (3.0, 1.5)), ((7.0, 8.0), (9.5, 6.0))):
        ahead = np.arctan2(end[1] - start[1], end[0] - start[0])
        driven = Trajectory.from_poses(drive, [(*start, ahead), (*end, ahead)])
        slid = slides(base, [(*start, ahead + sideways), (*end, ahead + sideways)])
        for criterion in (own_criterion(name) for name in NAMES):
            name = criterion.name
            if lacking(criterion.requires, base, world):
                assert {"heading", "wheels", "joints", "seat"} & set(criterion.requires)
                continue
            if name in ("look_at", "hand_eye_misalignment") and sideways:
                continue
            expected, cost = (trajectory_cost(criterion, t, world) for t in (driven, slid))
            if "mismatch" in name:
                expected = abs(sideways) * (1.0 if criterion.aggregate == "time-mean" else slid.duration)
            assert cost == pytest.approx(expected, rel=1e-9, abs=1e-12), name
            compared |= {name} if expected else set()
    assert {"length", "duration", "proximity", "social_force", "exposure", "jerk", "smoothness"} <= compared


def test_turning_on_its_way_costs_the_turn_and_no_time_where_the_way_takes_longer(robot):
    model = robot(speed=1.0, turn_rate=1.0)
    problem = hpop.Problem(HALL, model, (1, 3, 0), (4, 3, None), ["length", "rotation", "duration"])
    for turn, lasts in ((0.0, 3.0), (2.0, 3.0), (3.1, 3.1)):
        costs = problem.evaluate(slides(model, [(1, 3, 0), (4, 3, -turn)]))
        assert costs == pytest.approx({"length": 3.0, "rotation": turn, "duration": lasts})


def test_each_slide_that_turns_its_camera_is_a_turn(robot):
    problem = hpop.Problem(HALL, robot(), (1, 3, 0), (4, 3, None), ["turns"])
    rows = [(1, 3, 0), (2, 3, 0.5), (3, 3, 0.5), (4, 3, -0.5), (4, 3, 1.0)]
    assert problem.evaluate(slides(problem.model, rows)) == {"turns": 3.0}


def test_its_fronts_are_verified_saved_loaded_and_drawn(problem, tmp_path):
    front = found(problem, over_the_wall(problem.model))
    assert len(front) >= 1
    assert "NOT VALID" not in front.certificate
    assert verify(problem, front) == []
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    asked = hpop.Problem.from_description(again.problem)
    assert asked.model == problem.model
    assert again.costs.tolist() == front.costs.tolist()
    assert verify(asked, again) == []
    _, turning = over_the_wall(problem.model)
    assert draw_map(asked, again).axes
    assert draw_trace(asked, turning).axes
    assert draw_where(asked, turning).axes
    trace = problem.trace(turning)
    assert trace.running[-1] == pytest.approx(trace.cost)


def test_what_it_cannot_do_is_found_by_verification(problem):
    through = slides(problem.model, [(1, 1, 0), (4, 1, 0)])
    far = slides(problem.model, [(1, 1, 0), (1, 2.8, 0)])
    faults = verify(problem, found(problem, [through])) + verify(problem, found(problem, [far]))
    assert faults == ["trajectory 0 collides", "trajectory 0 ends 3.499 m from the goal"]


def test_it_is_executed_from_rest_to_rest(problem):
    model = problem.model
    planned = slides(model, [(1, 3, 0), (2, 3, 0.5), (3, 3, 1.0), (3, 2, 1.0)])
    executed, passed = model.execution(planned)
    assert executed.kinds == ("glide", "glide")
    assert executed.duration == pytest.approx(2.0 + 1.0 + 1.0 + 1.0)  # v/a is lost at each stop, each run 1 m or longer
    assert executed.at(passed).x == pytest.approx(planned.states.x, abs=1e-3)


ROADMAP = {"roadmap": {"samples": 60}}
SUMS = {"weighted-sum": {"on": ROADMAP}}


def test_in_an_empty_hall_it_slides_straight_to_the_goal_and_turns_no_more_than_it_must(robot):
    hall = hpop.World.from_polygons([], extent=HALL.extent)
    for yaw, rotation in ((None, 0.0), (1.0, 1.0)):
        front = hpop.Problem(hall, robot(), (1, 1, 0), (4, 2, yaw), ["length", "rotation"]).solve(ROADMAP)
        assert front.costs == pytest.approx(np.array([[np.hypot(3, 1), rotation]]))
        assert front.trajectories[0].kinds == ("slide",)


def test_planners_that_serve_any_model_plan_for_it_and_their_fronts_are_joined(problem):
    exact, sums, joined = (problem.solve(planner) for planner in (ROADMAP, SUMS, [SUMS, ROADMAP]))
    for front in (exact, sums, joined):
        assert len(front) > 1
        assert verify(problem, front) == []
        assert all(set(trajectory.kinds) == {"slide"} for trajectory in front.trajectories)
    every = set(map(tuple, exact.integers.tolist()))
    assert set(map(tuple, sums.integers.tolist())) <= every == set(map(tuple, joined.integers.tolist()))
    assert {origin["planner"] for origin in joined.provenance} <= {"roadmap", "weighted-sum"}


def test_planners_that_need_turns_and_moves_refuse_it_by_name_and_say_who_can(problem):
    for planner in ("lattice", "any-angle", "smoothing"):
        said = f"{planner} needs a model with .*turn-move.*, which holonomic .*Planners that can.*: exact, roadmap"
        with pytest.raises(UnsupportedModel, match=said):
            problem.solve(planner)


def test_a_drive_of_it_on_the_graph_of_another_robot_is_refused(problem):
    with pytest.raises(
        UnsupportedModel,
        match=r"a drive needs a robot with straight moves and turns in place \(turn-move\).*holonomic lacks them",
    ):
        hpop.follow(problem, problem.solve(ROADMAP), "knee", planner={"lattice": {"step": 0.5}})


def test_criteria_that_need_a_heading_say_so(robot):
    with pytest.raises(CriterionError, match="'net_winding' requires heading"):
        hpop.Problem(HALL, robot(), (1, 1, 0), (4, 1, 0), ["net_winding"])


@pytest.mark.parametrize("length", [0.0, -1, float("inf"), "wide", None])
def test_parameters_that_make_no_robot_are_refused(robot, length):
    with pytest.raises(ModelError, match="length must be a positive number"):
        robot(length=length)


def test_it_is_made_by_its_name(robot):
    assert make_model({"holonomic": {"speed": 0.5}}) == robot(speed=0.5)
    with pytest.raises(ModelError, match=r"no parameter 'sped'.*Did you mean 'speed'\?"):
        make_model({"holonomic": {"sped": 0.5}})


def test_a_pan_tilt_head_is_carried_by_a_base_that_slides(robot, monkeypatch):
    monkeypatch.setattr("hpop.testing.models.JUDGED", 30)
    monkeypatch.setattr("hpop.testing.models.PAIRS", 4)
    head = hpop.PanTilt(base=robot(), pan=(-1.5, 1.5), tilt=(-0.4, 0.4))
    assert head.provides == {"base", "camera", "plane", "joints"}
    assert set(head.laws) == {"slide", "glide", "pan", "tilt", "swivel", "nod", "swivel_ramp", "nod_ramp"}
    assert head.space.weights[3:] == pytest.approx(
        (1.0 / 1.5, 1.0)
    )  # m that the base slides while the head turns 1 rad
    assert [check for check in conformance(head) if check.fault] == []
    assert make_model(head.describe()) == head


def test_a_front_of_a_head_on_a_base_that_slides(robot):
    head = hpop.PanTilt(base=robot())
    problem = hpop.Problem(HALL, head, (1, 1, 0, 0, 0), (4, 1, None, 1.0, 0.2), ["length", "rotation", "duration"])
    front = problem.solve({"roadmap": {"samples": 60, "seed": 0}})
    assert len(front)
    assert verify(problem, front) == []
    assert front.trajectories[0].states.pan[-1] == pytest.approx(1.0)
