"""An arm as a model: made again from its description, found with its files, started by name, kept within limits."""

from __future__ import annotations

import json
import pickle
import shutil

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import make_model
from hpop.errors import ModelError, QueryError, ScenarioError
from hpop.frontier import FrontFileError
from hpop.models import SerialArm, files
from hpop.models.laws import rest_to_rest
from hpop.motions import Motions, States
from hpop.planners.base import Candidates
from hpop.problems.front import Front
from hpop.scenario import load_scenario
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from tests.models.serial_arm.arms import HERE, arm6, crane

WORLD = World.from_polygons([], extent=shapely.box(-2, -2, 2, 2))


@pytest.fixture(scope="module")
def arm():
    return arm6(fixed={}, field_of_view=(1.2, 0.9), base=(0.1, 0.0, 0.5, 0.0, 0.0, 0.3))


# What it is


def test_an_arm_is_made_again_from_its_description_and_pickled(arm):
    description = arm.describe()
    again = make_model(json.loads(json.dumps(description, allow_nan=False)))
    assert again == arm
    assert hash(again) == hash(arm)
    assert again.describe() == description
    assert pickle.loads(pickle.dumps(arm)) == arm
    assert arm6() != arm
    assert {"camera", "tool", "joints"} <= arm.provides
    assert not arm.provides & {"base", "heading", "plane"}


def test_states_are_as_far_apart_as_joints_need_seconds(arm):
    ready, turned = arm.space.state("ready"), arm.space.by_name("ready", "state") | {"base_to_shoulder": 1.0}
    assert arm.space.apart(ready, arm.space.state(turned))[0] == pytest.approx(1.0 / 2.0)


def test_a_file_that_has_changed_is_refused(tmp_path):
    found = crane(tmp_path)
    description = found.describe()
    (tmp_path / "crane.urdf").write_text(
        (tmp_path / "crane.urdf").read_text().replace('xyz="0.2 0 0"', 'xyz="0.3 0 0"')
    )
    with pytest.raises(ModelError, match="has changed since the front was saved: its SHA-256 differs"):
        make_model(description)


@pytest.mark.parametrize(
    ("parameter", "value", "said"),
    [
        ("camera", (0, 0, 0), r"camera must be \(x, y, z, roll, pitch, yaw\) in m and rad"),
        ("camera", (0, 0, 0, 0, -90, 0), "write math.radians"),
        ("base", (0, 0, 0, 0, 0, "east"), "base must be"),
        ("base", 3, "base must be"),
        ("tip", 7, "tip must be the name of a link"),
        ("urdf", 7, "urdf must be the path of a file"),
        ("packages", ["meshes"], "packages must map names to folders"),
        ("fixed", {"a": "b"}, "fixed of a"),
        ("field_of_view", 1.0, "field_of_view"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(parameter, value, said):
    given = {"urdf": HERE / "arm6.urdf", "tip": "tool", "acceleration": 1.0} | {parameter: value}
    with pytest.raises(ModelError, match=said):
        SerialArm(**given)


# How it moves


def test_a_reach_keeps_the_limits_of_every_joint_and_one_of_them_is_reached(arm):
    """Speeds where it goes on evenly, accelerations where it speeds up."""
    rng, law = np.random.default_rng(1), arm.laws["reach"]
    start, end = arm.space.sample(rng, 200), arm.space.sample(rng, 200)
    motions = Motions(WORLD, arm, law, start, end)
    ways = np.array([np.abs(getattr(end, n) - getattr(start, n)) for n in arm.chain.names])  # (n, M)
    up, cruise, _ = motions.phases
    first, second = up.share_rates(np.ones(200))
    speeds, accelerations = ways * first / arm.chain.speed[:, None], ways * second / arm.chain.acceleration[:, None]
    assert speeds.max() <= 1 + 1e-9
    assert accelerations.max() <= 1 + 1e-9
    np.testing.assert_allclose(accelerations.max(axis=0), 1.0)
    np.testing.assert_allclose(speeds.max(axis=0)[cruise.duration > 0], 1.0)


def test_a_reach_of_one_joint_lasts_what_a_profile_from_rest_to_rest_does(arm):
    names, way = arm.chain.names, np.array([1e-4, 0.3, 2.0])
    start = States(**{n: np.zeros(3) for n in names})
    end = States(**{n: way if n == names[0] else np.zeros(3) for n in names})
    expected = sum(phase.duration for phase in rest_to_rest(way, arm.chain.speed[0], arm.chain.acceleration[0]))
    np.testing.assert_allclose(Motions(WORLD, arm, arm.laws["reach"], start, end).duration, expected)


def test_a_joint_without_limits_takes_the_shorter_way_round(tmp_path):
    found = crane(tmp_path)
    a, b = (found.space.state((0.0, swing, 0.0, 0.0)) for swing in (3.0, -3.0))
    (leg,) = found.connect(a, b)
    assert leg.present.all()
    assert leg.end.swing[0] == pytest.approx(2 * np.pi - 3.0)
    (stays,) = found.connect(a, found.space.state((None, None, None, None), free=found.space.names))
    assert not stays.present.any()


def test_joints_beyond_their_limits_are_told(arm):
    names = arm.chain.names
    rows = np.zeros((2, 6))
    rows[1, 1] = 2.5
    beyond = Trajectory(arm, States(**dict(zip(names, rows.T, strict=True))), ("reach",))
    (fault,) = arm.faults(beyond)
    assert fault == "has joint shoulder_to_upper_arm at 2.5 rad in motion 0, beyond its limit of 1.9 rad"
    assert list(arm.doubtful(arm.laws["reach"], beyond.states.take([0]), beyond.states.take([1]))) == [True]
    within = Trajectory.through(arm, States(**dict(zip(names, (0.5 * rows).T, strict=True))))
    assert list(arm.faults(within)) == []
    done, passed = arm.execution(within)
    assert done is within
    np.testing.assert_array_equal(passed, within.times)


# States with a name


def test_a_named_state_is_start_and_goal(arm):
    problem = hpop.Problem(WORLD, arm, "home", ["ready", "upright"], ["duration"])
    assert problem.start == arm.space.named["home"]
    assert problem.goals == (arm.space.named["ready"], arm.space.named["upright"])
    with pytest.raises(
        QueryError,
        match=r"'read', but no state has this name. Did you mean 'ready'\?.*by a name: home, ready, upright",
    ):
        hpop.Problem(WORLD, arm, "read", "ready", ["duration"])


SCENARIO = """
world: {{polygons: {{extent: [[-2, -2], [2, -2], [2, 2], [-2, 2]]}}}}
model:
  serial_arm:
    urdf: robot/arm6.urdf
    srdf: robot/arm6.srdf
    tip: tool
    acceleration: 6.0
    camera: [-0.06, 0, -0.08, 0, -90 deg, 0]
start: {start}
goal: [ready, upright]
criteria: [duration, rotation]
planner: roadmap
"""


@pytest.fixture
def scenario(tmp_path):
    shutil.copytree(HERE, tmp_path / "robot")

    def written(start="home"):
        path = tmp_path / "arm.yaml"
        path.write_text(SCENARIO.format(start=start))
        return path

    return written


def test_a_scenario_names_its_files_from_its_own_folder_and_states_by_name(scenario):
    problem = load_scenario(scenario()).problem
    assert problem.model == arm6()
    assert problem.start == arm6().space.named["home"]
    assert len(problem.goals) == 2
    with pytest.raises(QueryError, match=r"arm.yaml, line \d+, start: .*by a name: home, ready, upright"):
        load_scenario(scenario("elsewhere"))
    with pytest.raises((ScenarioError, QueryError), match="start"):
        load_scenario(scenario("[0, 0]"))


def test_a_named_state_beyond_a_limit_is_refused_where_a_scenario_names_it(scenario, tmp_path):
    srdf = tmp_path / "robot" / "arm6.srdf"
    path = scenario()
    srdf.write_text(srdf.read_text().replace('value="-1.2"', 'value="-2.2"'))
    with pytest.raises(QueryError, match=r"arm.yaml, line 10, start: .*shoulder_to_upper_arm .*got -2.2"):
        load_scenario(path)


def test_a_front_and_the_files_of_its_arm_are_found_where_both_were_moved(scenario, tmp_path):
    problem = load_scenario(scenario()).problem
    rows = zip(problem.model.space.names, problem.start, problem.goals[0], strict=True)
    through = States(**{name: np.array(ends) for name, *ends in rows})
    trajectory = Trajectory.through(problem.model, through)
    costs = np.array([list(problem.evaluate(trajectory).values())])
    given = problem.criteria, (trajectory,), costs, 0 * costs, hpop.Status.COMPLETE, "as given", ({},)
    front = problem.front(Candidates(*given))
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    shutil.move(tmp_path / "robot", here / "robot")
    moved = files.with_absolute_paths(str(here), files.with_relative_paths(str(tmp_path), problem.model.describe()))
    assert make_model(moved) == problem.model
    shutil.move(here / "robot", tmp_path / "robot")
    front.save(tmp_path / "front.json")
    assert str(tmp_path) not in (tmp_path / "front.json").read_text()
    there.mkdir()
    for name in ("robot", "front.json"):
        shutil.move(tmp_path / name, there / name)
    loaded = Front.load(there / "front.json")
    assert loaded.question == front.question
    assert loaded.trajectories[0].model == problem.model
    assert loaded.problem["model"]["serial_arm"]["urdf"]["path"] == str(there / "robot/arm6.urdf")
    shutil.rmtree(there / "robot")
    once, seen = f"{tmp_path}/robot/arm6.urdf", f"{there}/robot/arm6.urdf"
    with pytest.raises(FrontFileError, match=f"the URDF is not at '{seen}', where the saved front expects it; put it"):
        Front.load(there / "front.json")
    saved = json.loads((there / "front.json").read_text())
    saved["problem"]["model"]["serial_arm"]["urdf"]["path"] = once  # as in files of earlier versions
    (there / "front.json").write_text(json.dumps(saved))
    with pytest.raises(FrontFileError, match=f"the URDF is neither at '{once}', where it was, nor at '{seen}', where"):
        Front.load(there / "front.json")


@pytest.mark.parametrize(
    "given", [{"urdf": None}, {"urdf": "a.urdf", "packages": {"m": None}}, {"urdf": "a.urdf", "srdf": np.zeros(3)}]
)
def test_what_is_no_path_is_refused_in_the_place_of_one(given):
    with pytest.raises(ModelError, match="must be the path of a file, got"):
        SerialArm(**given, tip="tool", acceleration=3.0)
