"""Views: what the viewer of a 360-degree camera sees after software has turned the picture back, or narrowed it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import hpop
from hpop.base.registry import make_model
from hpop.criteria import trajectory_cost
from hpop.criteria.base import make_criterion
from hpop.errors import HpopError, ModelError
from hpop.models.view import Restrictor
from hpop.motions import Motions, States
from hpop.testing import conformance
from hpop.world import World
from hpop.world.content.content import Landmark
from tests.models.serial_arm.arms import arm6
from tests.two_arms import TABLE, two_arms

ARM = arm6()
DRIVE = hpop.DifferentialDrive(field_of_view=(2.4, 1.6))
ROOM = World.from_polygons([shapely.box(2.5, 1.2, 3.2, 2.6)], extent=shapely.box(0, 0, 6, 4)).with_content(
    landmarks=[Landmark(5.5, 2.0), Landmark(0.5, 3.5)]
)
STATIC = World.from_solids([], extent=shapely.box(-2, -2, 2, 2))


def turned(pose, size):
    """Return the rotations (N,) of a pose, from its three axes."""
    axes = [[np.broadcast_to(c, (size,)) for c in axis] for axis in (pose.ahead, pose.left, pose.up)]
    return Rotation.from_matrix(np.moveaxis(np.array(axes, dtype=float), 2, 0).transpose(0, 2, 1))


def splines(count, seed=0):
    """Return start and end (count,) of random splines of the arm, from moving to moving, and their law."""
    rng = np.random.default_rng(seed)
    space, law = ARM.space, ARM.laws["spline"]

    def knot(clock):
        values = {name: getattr(space.sample(rng, count), name) for name in space.names}
        rates = {f"{name}_rate": rng.uniform(-0.5, 0.5, count) for name in space.names}
        return States(**values, **rates, clock=clock)

    return knot(np.zeros(count)), knot(rng.uniform(0.5, 3.0, count)), law


def along(start, end, law, shares):
    """Return states and rates (count * shares) of splines at shares of their time, by the motions of hpop."""
    lasts = end.clock - start.clock
    states = {
        n: np.stack([law.interpolate(n, start, end, s + 0 * lasts) for s in shares], 1).ravel() for n in law.names
    }
    return States(**states)


@pytest.mark.proof
def test_with_an_unwound_arm_the_horizon_stands_still_along_500_splines() -> None:
    """The camera's own picture, turned back as the view says, has its horizon level and its middle at the yaw."""
    start, end, law = splines(500)
    states = along(start, end, law, np.linspace(0.0, 1.0, 40))
    camera = turned(ARM.pose("camera", states), states.size)
    assert np.ptp(camera.as_euler("ZYX")[:, 1]) > 1.0  # it tilts
    for turning, yaw in (("unwound", 0.7), ("level", 0.0)):
        view = hpop.ViewModel(ARM, turning, yaw)
        seen = turned(view.pose("camera", states), states.size)
        undo = camera.inv() * seen  # what software does to the picture
        horizon = undo.inv().apply(camera.inv().apply([0.0, 0.0, 1.0]))  # the vertical in the viewer's picture
        assert np.arccos(np.clip(horizon[:, 2], -1, 1)).max() < 1e-6 or np.abs(horizon[:, :2]).max() < 1e-6
        if turning == "unwound":
            north = undo.inv().apply(camera.inv().apply([math.cos(yaw), math.sin(yaw), 0.0]))
            assert np.abs(north - [1.0, 0.0, 0.0]).max() < 1e-6
    unwound = Motions(STATIC, hpop.ViewModel(ARM), law, start, end)
    for name in ("rotation", "turns", "camera_roll", "angular_acceleration"):
        assert np.abs(make_criterion(name).cost(unwound)).max() < 1e-6, name


def quaternion_yaw(rotations):
    """Return the rotation about the vertical of swing and twist: 2 atan2(z, w)."""
    _, _, z, w = rotations.as_quat().T
    return 2.0 * np.arctan2(z, w)


def test_the_yaw_of_a_level_view_is_the_twist_of_the_camera_and_its_rates_are_derivatives() -> None:
    view, rng, h = hpop.ViewModel(ARM, "level"), np.random.default_rng(3), 1e-4
    at = ARM.space.sample(rng, 200)
    rates = States(**{n: rng.uniform(-1, 1, 200) for n in at.names})
    changes = States(**{n: rng.uniform(-1, 1, 200) for n in at.names})

    def yaw(t):
        s = States(**{n: getattr(at, n) + t * getattr(rates, n) + t * t / 2 * getattr(changes, n) for n in at.names})
        return quaternion_yaw(turned(ARM.pose("camera", s), 200)), view.pose("camera", s).yaw

    (before, _), (now, found), (after, _) = yaw(-h), yaw(0.0), yaw(h)
    assert np.exp(1j * found) == pytest.approx(np.exp(1j * now), abs=1e-9)
    upright = ARM.pose("camera", at).up[2] > -0.9  # near upside down the yaw changes too fast for differences
    step = [np.angle(np.exp(1j * (b - a)))[upright] for a, b in ((before, now), (now, after))]
    rate = view.twist("camera", at, rates).rotation[2][upright]
    assert rate == pytest.approx((step[0] + step[1]) / (2 * h), abs=1e-4)
    change = view.twist_rate("camera", at, rates, changes).rotation[2][upright]
    assert change == pytest.approx((step[1] - step[0]) / h**2, rel=1e-2, abs=1e-2)


def test_a_level_head_follows_pans_and_turns_but_no_tilt() -> None:
    head = hpop.PanTilt(hpop.DifferentialDrive())
    rows = [(1, 1, 0, 0, 0), (1, 1, 0, 1.0, 0), (1, 1, 0, 1.0, 0.4), (1, 1, -0.5, 1.0, 0.4)]
    columns = dict(zip(head.space.names, np.array(rows, float).T, strict=True))
    kinds = ("pan", "tilt", "turn")
    own, level, unwound = (
        hpop.Trajectory(m, States(**columns), kinds)
        for m in (head, hpop.ViewModel(head, "level"), hpop.ViewModel(head))
    )
    rotation = [trajectory_cost(make_criterion("rotation"), t, ROOM) for t in (own, level, unwound)]
    assert rotation == pytest.approx([1.9, 1.5, 0.0])
    for name in ("rotation", "optic_flow", "sickness", "msdv", "net_winding"):
        assert trajectory_cost(make_criterion(name), unwound, ROOM) == pytest.approx(0.0, abs=1e-9), name


def test_a_fixed_view_costs_what_its_robot_costs_bit_for_bit() -> None:
    criteria = ["optic_flow", "rotation", "landmark_visibility", "length"]
    fronts = [
        hpop.Problem(ROOM, m, (0.5, 0.5, 0), (5.5, 3.5, None), criteria).solve(planner={"lattice": {"step": 0.5}})
        for m in (
            DRIVE,
            hpop.ViewModel(DRIVE, "fixed"),
            hpop.ViewModel(DRIVE, "fixed", restrictor={"least": (2.4, 1.6)}),
            hpop.ViewModel(DRIVE, "fixed", restrictor={"least": (1.0, 1.0), "rates": None}),
            hpop.ViewModel(DRIVE, "fixed", restrictor={"least": (1.0, 1.0), "rates": (8, 9)}),
        )
    ]
    for front in fronts[1:4]:  # none of these restrictors ever closes
        assert np.array_equal(front.costs, fronts[0].costs)
    assert fronts[4].costs == pytest.approx(
        fronts[0].costs, rel=1e-6
    )  # it would close only at speeds beyond the robot's


def test_a_restrictor_narrows_linearly_between_its_speeds() -> None:
    restrictor = Restrictor((1.0, 0.5), speeds=(0.5, 1.5), rates=(0.0, 2.0))
    across, up = restrictor.angles((2.0, 1.5), np.array([0.0, 1.0, 1.0, 9.0]), np.array([0.0, 0.0, 1.5, 0.0]))
    assert across == pytest.approx([2.0, 1.5, 1.25, 1.0])
    assert up == pytest.approx([1.5, 1.0, 0.75, 0.5])


def test_a_restrictor_spares_flow_and_hides_landmarks_while_the_robot_moves() -> None:
    """In the middle of a corridor of half-width w, the flow at a bearing b is v sin² b / w."""
    corridor = World.from_polygons(
        [shapely.box(-20, 1, 20, 2), shapely.box(-20, -2, 20, -1)], extent=shapely.box(-20, -2, 20, 2)
    ).with_content(landmarks=[Landmark(0.0, 0.6)])
    path = [(-2, 0, 0), (2, 0, 0)]
    closed = hpop.ViewModel(hpop.DifferentialDrive(), "fixed", restrictor={"least": (1.6, 1.2), "speeds": (0, 0.5)})
    free, narrow = (hpop.Trajectory.from_poses(m, path) for m in (hpop.DifferentialDrive(), closed))
    b = np.linspace(-0.8, 0.8, 4001)
    flow = make_criterion({"optic_flow": {"bearings": 180}})
    assert trajectory_cost(flow, narrow, corridor) == pytest.approx(4.0 * np.mean(np.sin(b) ** 2), rel=0.02)
    assert trajectory_cost(flow, free, corridor) == pytest.approx(4.0 * 0.5, rel=0.02)
    seen = make_criterion({"landmark_blindness": {"near": 9.0, "far": 10.0}})
    ahead = 2.0 - 0.6 / math.tan(0.8)  # it leaves the view at half of 1.6 rad aside
    assert trajectory_cost(seen, free, corridor) == pytest.approx(0.0, abs=0.02)
    assert trajectory_cost(seen, narrow, corridor) == pytest.approx(4.0 - ahead, abs=0.1)


def test_on_an_arm_a_restrictor_leaves_out_rays_beyond_its_angles() -> None:
    walls = World.from_solids(
        [hpop.world.Solid(hpop.world.Box((0.1, 4, 4)), hpop.world.pose_at((1.5, 0, 0.5)))],
        extent=shapely.box(-3, -3, 3, 3),
    )
    start = ARM.space.state("home")
    end = States(**{n: getattr(start, n) + 0.4 for n in start.names})
    flow, costs = make_criterion("optic_flow"), []
    for m in (
        ARM,
        *(hpop.ViewModel(ARM, "fixed", restrictor=r) for r in (None, {"least": (6.0, 3.0)}, {"least": (1, 1)})),
    ):
        costs.append(
            trajectory_cost(
                flow,
                hpop.Trajectory.through(
                    m, States(**{n: np.concatenate([getattr(start, n), getattr(end, n)]) for n in start.names})
                ),
                walls,
            )
        )
    assert costs[0] == costs[1]
    assert costs[2] == pytest.approx(costs[0], rel=0.1)
    assert abs(costs[3] - costs[0]) > 1e-3 * costs[0]


@pytest.mark.proof
@pytest.mark.parametrize("turning", ["unwound", "level", "fixed"])
@pytest.mark.parametrize(
    "robot", [ARM, hpop.PanTilt(), hpop.MobileArm(arm6(base=(0, 0, 0.4, 0, 0, 0)))], ids=["arm", "head", "mobile"]
)
def test_views_of_all_robots_pass_every_check(robot: Any, turning: Any) -> None:
    view = hpop.ViewModel(robot, turning, restrictor={"least": (1.0, 0.8)})
    assert [check for check in conformance(view, rng=2) if check.fault] == []  # 0: a reach passes by upside down
    assert make_model(view.describe()) == view


@pytest.mark.parametrize("turning", ["unwound", "level", "fixed"])
def test_a_view_of_two_arms_turns_as_that_of_the_viewing_arm_alone(turning: Any) -> None:
    """The camera is on the viewing arm, so its view is that of this arm; plans and their costs follow the view."""
    arms = two_arms()
    view, alone = hpop.ViewModel(arms, turning, yaw=0.3), hpop.ViewModel(arms.view, turning, yaw=0.3)
    assert make_model(view.describe()) == view
    states = arms.space.sample(np.random.default_rng(3), 60)
    joints = States(**{name: getattr(states, name) for name in arms.joints})
    for axis in ("ahead", "left", "up"):
        ours, theirs = (getattr(one.pose("camera", s), axis) for one, s in ((view, states), (alone, joints)))
        assert [np.allclose(a, b, atol=1e-12) for a, b in zip(ours, theirs, strict=True)] == [True] * 3
    assert np.array_equal(view.pose("work_tool", states).x, arms.pose("work_tool", states).x)
    problem = hpop.Problem(TABLE, view, "home", "ready", ["rotation", "duration", {"look_at": {"target": "work_tool"}}])
    front = problem.solve("roadmap", samples=30, seed=1)
    assert len(front)
    if turning == "unwound":
        assert front.costs[:, 0].max() == 0.0
    assert problem.evaluate(front).costs == pytest.approx(front.costs)


def test_near_upside_down_a_level_view_turns_fast_and_a_note_says_so() -> None:
    """Random reaches of the arm that tilt its camera by over 120 degrees have the note, with their tilt."""
    view = hpop.ViewModel(ARM, "level")
    states = ARM.space.sample(np.random.default_rng(5), 60)
    tilt = np.degrees(np.arccos(np.clip(ARM.pose("camera", states).up[2], -1, 1)))
    steep, upright = int(np.argmax(tilt)), int(np.argmin(tilt))
    assert tilt[steep] > 150
    for row, is_told in ((steep, True), (upright, False)):
        run = hpop.Trajectory.through(
            view, States(**{n: getattr(states, n)[[row, row]] + [0.0, 0.01] for n in ARM.joints})
        )
        notes = view.notes_on([run])
        assert bool(notes) == is_told
        assert not hpop.ViewModel(ARM, "unwound").notes_on([run])
        if is_told:
            assert "on 1 of 1 trajectories the camera tilts by over 120 degrees" in notes[0]
            assert float(notes[0].split("at most by ")[1].split(":")[0]) == pytest.approx(tilt[steep], abs=2)


def test_a_goal_for_the_camera_asks_for_the_robot_s_own() -> None:
    goal = hpop.goals.LookAt((0.7, 0.25, 0.43), (0.15, 0.3))
    states = ARM.space.sample(0, 500)
    assert np.array_equal(goal.reached(ARM, states), goal.reached(hpop.ViewModel(ARM), states))


def test_a_scenario_says_what_the_viewer_sees(tmp_path) -> None:
    from hpop.scenario import load_scenario

    text = (
        "world: {polygons: {extent: [[0, 0], [5, 0], [5, 3], [0, 3]]}}\nmodel: {pan_tilt: {}}\n"
        "start: [1, 1, 0, 0, 0]\ngoal: [4, 2, any, any, any]\ncriteria: [rotation, length]\n"
    )
    path = tmp_path / "s.yaml"
    path.write_text(f"{text}view: {{turning: level, restrictor: {{least: [60 deg, 50 deg], speeds: [0, 1]}}}}\n")
    model = load_scenario(path).problem.model
    assert (model.turning, model.carrier) == ("level", hpop.PanTilt())
    assert model.restrictor == Restrictor((math.radians(60), math.radians(50)), speeds=(0.0, 1.0))
    path.write_text(f"{text}view: {{turning: loose, model: pan_tilt}}\n")
    with pytest.raises(HpopError, match=r"(?s)view.*given by model, beside view.*turning"):
        load_scenario(path)


REFUSED: dict[str, dict[str, Any]] = {
    "model must be a robot with a camera": {"model": 3},
    "it is a view itself": {"model": hpop.ViewModel()},
    "turning must be one of fixed, level, unwound, got 'free'": {"turning": "free"},
    "restrictor must have the key least": {"restrictor": {"speeds": (0, 1)}},
    r"rates must be \(from, to\) with from below to": {"restrictor": {"least": (1, 1), "rates": (1, 1)}},
    "field_of_view must be": {"restrictor": {"least": 1}},
}


@pytest.mark.parametrize("said", REFUSED)
def test_a_view_that_makes_no_sense_is_refused(said) -> None:
    with pytest.raises(ModelError, match=said):
        hpop.ViewModel(**REFUSED[said])


def test_former_options_of_a_drive_in_files_become_a_view() -> None:
    drive = hpop.DifferentialDrive(radius=0.4)
    assert make_model({"differential_drive": {"radius": 0.4, "view": "fixed", "view_yaw": 0.0}}) == drive
    unwound = make_model({"differential_drive": {"radius": 0.4, "view": "unwound", "view_yaw": 0.5}})
    assert unwound == hpop.ViewModel(drive, "unwound", yaw=0.5)
    with pytest.raises(ModelError, match=r"has no parameter 'view'.*wrap the robot in a view"):
        make_model({"differential_drive": {"view": "turned"}})


def test_a_front_saved_with_the_former_view_is_one_of_its_problem() -> None:
    world = hpop.World.from_polygons([shapely.box(4, 1, 5, 3)], extent=shapely.box(0, 0, 9, 4))
    robot = hpop.ViewModel(hpop.DifferentialDrive(), "unwound", yaw=0.5)
    problem = hpop.Problem(world, robot, (1, 2, 0), (8, 2, 0), ["rotation", "length"])
    front = problem.solve("lattice", step=1.0)
    drive = dict(front.problem["model"]["view"]["model"]["differential_drive"], view="unwound", view_yaw=0.5)
    former = replace(front, problem={**front.problem, "model": {"differential_drive": drive}})
    assert problem.evaluate(former).costs.tolist() == front.costs.tolist()
