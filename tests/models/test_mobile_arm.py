"""An arm on a mobile base: where its bodies are, how it gets about, what blocks it, and what it refuses."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.arrays import FloatArray
from hpop.base.registry import make_model
from hpop.criteria import make_criterion
from hpop.criteria.others import reach
from hpop.errors import ModelError, QueryError, UnsupportedModel
from hpop.models import MobileArm
from hpop.motions import Motions, Pose, States
from hpop.planners.graph_planners import Roadmap
from hpop.problems.verify import verify
from hpop.testing import check_model
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Box, Cylinder, Solid, World, pose_at
from tests.models.serial_arm.arms import arm6, crane

PLUGIN = Path(__file__).resolve().parents[2] / "examples/plugin"
BASE = hpop.DifferentialDrive(radius=0.25, body_height=0.4, speed=0.5, acceleration=0.5)
ON_TOP = (0.05, -0.02, 0.4, 0.0, 0.0, 0.3)
ROOM = World.from_solids(
    [
        Solid(Box((0.3, 1.2, 0.02)), pose_at((3.0, 1.5, 0.75)), "board"),
        Solid(Box((0.5, 0.5, 0.9)), pose_at((1.5, 1.2, 0.45)), "crate"),
        Solid(Cylinder(0.03, 0.12), pose_at((3.05, 1.6, 0.82)), "can"),
        Solid(Box((9.0, 9.0, 0.1)), pose_at((2.0, 2.0, -0.05)), "floor"),
    ],
    extent=shapely.box(0, 0, 3.5, 3),
)


@pytest.fixture(scope="module")
def robot() -> MobileArm:
    return MobileArm(arm6(base=ON_TOP), BASE)


@pytest.fixture(scope="module")
def home(robot: MobileArm) -> tuple[float, ...]:
    return tuple(robot.arm.space.named["home"])


def drawn(robot: MobileArm, number: int, seed: int = 0) -> States:
    return robot.space.bounded(x=(0.0, 3.5), y=(0.0, 3.0)).sample(np.random.default_rng(seed), number)


def vector(parts: Any, size: int) -> FloatArray:
    return np.stack([np.broadcast_to(part, (size,)) for part in parts], axis=1)


def axes(pose: Pose, size: int) -> FloatArray:
    """(N, 3, 3), columns ahead, left and up."""
    return np.stack([vector(part, size) for part in (pose.ahead, pose.left, pose.up)], axis=2)


def turned(yaw: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) about the vertical."""
    rotations = np.zeros((yaw.size, 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(yaw)
    rotations[:, 1, 0], rotations[:, 0, 1], rotations[:, 2, 2] = np.sin(yaw), -np.sin(yaw), 1.0
    return rotations


# Where its bodies are


@pytest.mark.parametrize("body", ["camera", "tool"])
def test_a_body_in_the_hand_is_where_the_arm_has_it_on_its_base(robot, body):
    states = drawn(robot, 200)
    alone, found = robot.arm.pose(body, states), robot.pose(body, states)
    rotation = turned(states.yaw)
    place = np.einsum("nij,nj->ni", rotation, vector((alone.x, alone.y, alone.z), 200))
    place[:, :2] += np.stack([states.x, states.y], axis=1)
    np.testing.assert_allclose(vector((found.x, found.y, found.z), 200), place, atol=1e-12)
    np.testing.assert_allclose(axes(found, 200), rotation @ axes(alone, 200), atol=1e-12)


@pytest.mark.parametrize("body", ["camera", "tool"])
def test_its_twist_is_that_of_the_base_and_that_of_the_arm_on_it(robot, body):
    rng, states = np.random.default_rng(1), drawn(robot, 200)
    rates = States(**{name: rng.normal(size=200) for name in robot.space.names})
    found, alone, base = robot.twist(body, states, rates), robot.arm.twist(body, states, rates), turned(states.yaw)
    pose, spin = robot.pose(body, states), np.stack([0 * states.x, 0 * states.x, rates.yaw], axis=1)
    lever = np.stack([pose.x - states.x, pose.y - states.y, pose.z], axis=1)
    velocity = np.stack([rates.x, rates.y, 0 * states.x], axis=1) + np.cross(spin, lever)
    velocity += np.einsum("nij,nj->ni", base, vector(alone.velocity, 200))
    rotation = spin + np.einsum("nij,nj->ni", base, vector(alone.rotation, 200))
    np.testing.assert_allclose(vector(found.velocity, 200), velocity, atol=1e-12)
    np.testing.assert_allclose(vector(found.rotation, 200), rotation, atol=1e-12)


def test_its_own_shapes_are_where_its_links_and_its_base_are(robot):
    states = drawn(robot, 1)
    places = np.array([poses[0, :3, 3] for _, poses in robot.bodies(states)])
    alone = np.array([poses[0, :3, 3] for _, poses in robot.arm.bodies(states)])
    x, y = states.x[0], states.y[0]
    np.testing.assert_allclose(places[:-1], alone @ turned(states.yaw)[0].T + (x, y, 0.0), atol=1e-12)
    np.testing.assert_allclose(places[-1], (x, y, 0.2), atol=1e-12)


# How it gets about


def test_it_folds_turns_moves_turns_and_reaches_out(robot, home):
    a = robot.space.state([1.0, 1.0, 0.0, *(0.1,) * 6])
    b = robot.space.state([2.0, 2.0, np.pi, *(0.2,) * 6])
    legs = robot.connect(a, b)
    assert [leg.kind for leg in legs] == ["reach", "spin", "run", "spin", "reach"]
    assert all(leg.present[0] for leg in legs)
    for leg in legs[:-1]:
        np.testing.assert_allclose([getattr(leg.end, name)[0] for name in robot.joints], home)
    assert robot.space.values(legs[-1].end) == pytest.approx(robot.space.values(b))


def test_at_one_place_it_reaches_without_folding(robot):
    a = robot.space.state([1.0, 1.0, 0.5, *(0.1,) * 6])
    b = robot.space.state([1.0, 1.0, None, 0.3, None, *(0.2,) * 4], free=robot.space.angles)
    legs = robot.connect(a, b)
    assert [leg.present[0] for leg in legs] == [False] * 4 + [True]
    assert robot.space.values(legs[-1].end) == pytest.approx((1.0, 1.0, 0.5, 0.3, 0.1, *(0.2,) * 4))


def test_an_arm_whose_joints_the_goal_leaves_free_arrives_folded(robot, home):
    a = robot.space.state([1.0, 1.0, 0.0, *(0.1,) * 6])
    b = robot.space.state([2.0, 1.0, *(None,) * 7], free=robot.space.angles)
    end = robot.connect(a, b)[-1].end
    assert robot.space.values(end) == pytest.approx((2.0, 1.0, 0.0, *home))


def test_moves_in_one_line_are_driven_as_one_and_reaches_between_them_end_them(robot, home):
    places = [(1.0, 1.0, 0.0, *home), (1.5, 1.0, 0.0, *home), (2.0, 1.0, 0.0, *home), (2.0, 1.0, 0.0, *(0.1,) * 6)]
    planned = Trajectory.through(robot, robot_states(robot, [*places, (3.0, 1.0, 0.0, *home)]))
    done, _ = robot.execution(planned)
    assert planned.kinds == ("run", "run", "reach", "reach", "run")
    assert done.kinds == ("run", "reach", "reach", "run")
    assert list(robot.faults(planned)) == list(robot.faults(done)) == []


def robot_states(robot: MobileArm, rows: list[tuple[float, ...]]) -> States:
    return States(**dict(zip(robot.space.names, np.array(rows).T, strict=True)))


def test_a_base_that_drives_with_its_arm_out_is_a_fault(robot):
    out = Trajectory(robot, robot_states(robot, [(1, 1, 0, *(0.1,) * 6), (2, 1, 0, *(0.1,) * 6)]), ("run",))
    assert list(robot.faults(out)) == ["drives with its arm unfolded in motion 0, a run"]
    assert robot.doubtful(robot.laws["run"], out.states.take([0]), out.states.take([1])).all()


def test_a_joint_beyond_its_limit_is_a_fault_while_the_base_drives_too(robot, home):
    beyond = (*home[:2], 2.6, *home[3:])
    out = Trajectory(robot, robot_states(robot, [(1, 1, 0, *beyond), (2, 1, 0, *beyond)]), ("run",))
    assert any("upper_arm_to_elbow at 2.6 rad" in fault for fault in robot.faults(out))


def test_half_of_what_is_drawn_has_the_arm_folded(robot, home):
    states = drawn(robot, 2000)
    folded = np.all([getattr(states, n) == value for n, value in zip(robot.joints, home, strict=True)], axis=0)
    assert 0.45 < folded.mean() < 0.55
    assert np.unique(states.yaw).size == 2000


# What blocks it


def chains(robot: MobileArm, number: int) -> Iterator[Motions]:
    at, to = drawn(robot, number, 2), drawn(robot, number, 3)
    for leg in robot.connect(at, to):
        yield Motions(ROOM, robot, robot.laws[leg.kind], at, leg.end)
        at = leg.end


def test_what_is_called_free_touches_nothing_at_many_states_of_it(robot):
    """The judge is asked state by state, so that neither its steps nor certificates count."""
    collision, judge, seen = robot.collision(ROOM), robot.judge(ROOM), 0
    for motions in chains(robot, 10):
        free = np.flatnonzero(collision.motions_free(motions))
        for share in np.linspace(0.0, 1.0, 5):
            start, end = motions.start.take(free), motions.end.take(free)
            columns = {n: (1 - share) * getattr(start, n) + share * getattr(end, n) for n in robot.space.names}
            assert judge.states_free(States(**columns)).all()
        seen += free.size
    assert seen > 15


def test_planning_and_the_judge_agree_on_nearly_all_states(robot):
    states = drawn(robot, 150, 4)
    planned, judged = robot.collision(ROOM).states_free(states), robot.judge(ROOM).states_free(states)
    assert not (planned & ~judged).any()
    assert 0.2 < judged.mean() < 0.9
    assert (judged & ~planned).mean() < 0.03


def test_the_hand_may_be_beyond_the_border_and_the_base_may_not(robot, home):
    upright = (0.0, 0.9, 0.0, 0.0, 0.0, 0.0)  # it leans forward
    over, out = ((x, 2.5, 0.0, *upright) for x in (3.2, 3.4))
    tool = robot.pose("tool", robot.space.state(over))
    assert tool.x[0] > 3.5
    collision, judge = robot.collision(ROOM), robot.judge(ROOM)
    assert collision.why_blocked(robot.space.state(over)) == judge.why_blocked(robot.space.state(over)) == ""
    for asked in (collision, judge):
        assert "the nearest obstacle, keep-out zone or map border" in asked.why_blocked(robot.space.state(out))


def test_an_arm_that_reaches_into_its_own_base_is_told_so(robot):
    down = robot.space.state([0.6, 0.6, 0.0, 0.0, 1.9, 1.7, 0.0, 0.0, 0.0])
    for asked in (robot.collision(ROOM), robot.judge(ROOM)):
        assert "'mobile base'" in asked.why_blocked(down)


def test_a_keep_out_zone_is_closed_to_its_base(robot, home):
    world = ROOM.with_content(zones=[hpop.world.content.content.Zone("keep-out", shapely.box(0, 0, 1, 1))])
    state = robot.space.state([0.5, 0.5, 0.0, *home])
    assert robot.collision(ROOM).states_free(state).all()
    assert not robot.collision(world).states_free(state).any()
    assert not robot.judge(world).states_free(state).any()


def test_clearance_is_that_of_the_base_or_of_the_hand_whichever_is_less(robot, home):
    """Beside the crate the base; before the board, which is above it, the hand."""
    collision = robot.collision(ROOM)
    beside = robot.space.state([1.5, 0.5, np.pi, *home])  # the crate begins at y = 0.95
    np.testing.assert_allclose(collision.clearance(beside), 0.2, atol=2e-3)
    states = drawn(robot, 50)
    free = collision.states_free(states)
    assert (collision.clearance(states)[free] > 0).all()


# Planned with


@pytest.fixture(scope="module")
def problem(robot: MobileArm, home: tuple[float, ...]) -> hpop.Problem:
    look = {"look_at": {"target": [3.05, 1.6, 0.82]}}
    goal = {"look_at": {"target": [3.05, 1.6, 0.82], "distance": [0.2, 0.5]}}
    return hpop.Problem(ROOM, robot, (0.5, 1.2, 0.0, *home), goal, ["duration", "rotation", look])


@pytest.fixture(scope="module")
def front(problem: hpop.Problem) -> hpop.Front:
    return problem.solve(Roadmap(samples=80, neighbours=6, far=4, trees=3))


def test_its_roadmap_has_folded_arms_on_the_way_and_postures_where_it_stops(problem, home):
    """Uniform samples would unfold everywhere, and no two of them would be at one place."""
    roadmap = Roadmap(samples=80, neighbours=6, far=4, trees=3).roadmap(problem)
    rows = np.stack([getattr(roadmap.nodes, name) for name in problem.model.space.names], axis=1)
    samples = slice(roadmap.goals[0] - 80, roadmap.goals[0])
    x_min, y_min, x_max, y_max = ROOM.bounds
    assert ((rows[:, :2] >= (x_min, y_min)) & (rows[:, :2] <= (x_max, y_max))).all()
    folded = (rows[:, 3:] == home).all(axis=1)
    _, place, several = np.unique(rows[:, :3], axis=0, return_inverse=True, return_counts=True)
    assert 0.25 < folded[samples].mean() < 0.75
    assert (folded | (several[place.ravel()] > 1))[samples].all()


@pytest.mark.proof
def test_a_plan_is_verified_and_ends_with_the_can_in_view(problem, front):
    assert len(front) > 0
    assert verify(problem, front) == []
    for trajectory in front.trajectories:
        camera, last = problem.model.pose("camera", trajectory.states), trajectory.states.size - 1
        apart = np.array([3.05 - camera.x[last], 1.6 - camera.y[last], 0.82 - camera.z[last]])
        assert 0.2 - 1e-3 < np.linalg.norm(apart) < 0.5 + 1e-3
        ahead = np.array([part[last] for part in camera.ahead])
        assert ahead @ apart == pytest.approx(np.linalg.norm(apart), rel=1e-5)


def test_costs_of_a_plan_are_those_of_its_trajectory(problem, front):
    for costs, trajectory in zip(front.costs, front.trajectories, strict=True):
        again = problem.evaluate(trajectory)
        np.testing.assert_allclose(costs, [again[name] for name in front.names], atol=0.01)


def test_a_plan_is_executed_in_the_time_that_it_was_planned_to_take(front):
    """Runs and spins go from rest to rest on the roadmap as well: no turn is charged with a stop that is none."""
    assert any(trajectory.kinds.count("spin") > trajectory.kinds.count("run") for trajectory in front.trajectories)
    for trajectory in front.trajectories:
        assert trajectory.execution() is trajectory  # so pictures draw one line for both


def test_a_saved_plan_is_of_the_same_robot(problem, front, tmp_path):
    front.save(tmp_path / "front.json")
    loaded = hpop.Front.load(tmp_path / "front.json")
    assert loaded.trajectories[0].model == problem.model
    np.testing.assert_array_equal(loaded.costs, front.costs)


def test_criteria_of_bases_joints_and_cameras_can_be_asked_of_it(problem, front):
    names = ["energy", "bending_energy", "net_winding", "joint_length", "camera_length", "length"]
    asked = hpop.Problem(ROOM, problem.model, problem.start, problem.goal, names)
    assert all(np.isfinite(value) for value in asked.evaluate(front.trajectories[0]).values())


@pytest.mark.parametrize("planner", ["any-angle", "spline", "smoothing"])
def test_planners_that_cannot_are_refused_by_name(problem, planner):
    with pytest.raises(UnsupportedModel, match="mobile_arm"):
        problem.solve(planner)


def test_a_blocked_start_names_the_link_and_what_it_touches(robot, problem):
    into = (2.6, 1.5, 0.0, 0.0, 1.2, 0.6, 0.0, 0.0, 0.0)
    with pytest.raises(QueryError, match="the obstacle"):
        hpop.Problem(ROOM, robot, into, problem.goal, ["duration"]).solve(Roadmap(samples=10))


# As it is given


def test_it_is_made_again_from_its_description_with_joints_by_name(robot, home):
    folded = dict(zip(robot.joints, home, strict=True))
    by_name = MobileArm(robot.arm, BASE, folded=folded)
    again = make_model(json.loads(json.dumps(by_name.describe())))
    assert again == by_name
    assert again.connect(*(drawn(robot, 3, seed) for seed in (0, 1)))[0].end.names == robot.space.names


REFUSED: dict[str, dict[str, Any]] = {
    "arm must be a serial arm": {"arm": BASE},
    "base must be a model in the plane without joints": {"base": arm6()},
    "such as base=DifferentialDrive": {"base": hpop.PanTilt()},
    "joints, such as .*, got ViewModel": {"base": hpop.ViewModel()},
    "Did you mean 'home'": {"folded": "hoem"},
    "the folded arm must be given as": {"folded": (0.0, 0.0)},
    "base_to_shoulder": {"folded": (9.0, *(0.0,) * 5)},
}


@pytest.mark.parametrize(("said", "given"), REFUSED.items(), ids=REFUSED)
def test_what_makes_no_mobile_arm_is_refused(said, given):
    with pytest.raises(ModelError, match=said):
        MobileArm(**{"arm": arm6(base=ON_TOP), "base": BASE} | given)


def test_an_arm_whose_joint_is_called_as_a_state_of_the_base_is_refused(tmp_path):
    arm = crane(tmp_path)
    text = (tmp_path / "crane.urdf").read_text().replace('name="swing"', 'name="yaw"')
    (tmp_path / "crane.urdf").write_text(text)
    with pytest.raises(ModelError, match="must not have names of states of the base, but a joint is called 'yaw'"):
        MobileArm(hpop.SerialArm.from_urdf(tmp_path / "crane.urdf", tip="eye", acceleration=2.0), BASE)
    assert MobileArm(arm, BASE, folded=(0.0,) * 4).joints == arm.joints


@pytest.mark.parametrize("name", ["hall_zones", "time_to_collision"])
def test_what_people_see_of_it_is_as_wide_as_its_base(robot, name):
    criterion = make_criterion(name)
    assert reach(robot, criterion.robot_radius) == max(part.reach for part in robot.base.body_parts)


# On a base of another kind


@pytest.fixture(scope="module")
def slider() -> MobileArm:
    """Return an arm on the example plugin's base, which slides in any direction; its mast is as low as its box."""
    sys.path.insert(0, str(PLUGIN))
    try:
        base = importlib.import_module("hpop_example_plugin.holonomic").Holonomic(camera_height=0.4)
    finally:
        sys.path.remove(str(PLUGIN))
    return MobileArm(arm6(base=ON_TOP), base)


def test_any_base_in_the_plane_carries_an_arm(slider, home):
    assert set(slider.laws) == {"glide", "reach", "reach_ramp"}
    assert "wheels" not in slider.provides
    a, b = drawn(slider, 5, 1), drawn(slider, 5, 2)
    legs = slider.connect(a, b)
    assert [leg.kind for leg in legs] == ["reach", "glide", "reach"]
    for name, value in zip(slider.joints, home, strict=True):
        np.testing.assert_allclose(getattr(legs[0].end, name), value)
    off = slider.space.differences(legs[-1].end, b)
    assert all(np.abs(column).max() < 1e-9 for column in off.values())


@pytest.mark.proof
def test_an_arm_on_a_base_that_slides_passes_every_check(slider):
    check_model(slider)


def test_an_arm_is_planned_on_a_base_that_slides(slider, home):
    problem = hpop.Problem(ROOM, slider, (0.6, 0.6, 0.0, *home), (2.6, 0.7, None, *home), ["camera_length", "duration"])
    front = problem.solve(Roadmap(samples=40, rng=0))
    assert len(front)
    assert {"glide"} <= {kind for trajectory in front.trajectories for kind in trajectory.kinds} <= {"glide", "reach"}
    assert verify(problem, front) == []
