"""A head that pans and tilts: still it is the base's camera, turning back it keeps the view, its stops are kept."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import make_model
from hpop.criteria.costs import motion_costs, trajectory_costs
from hpop.errors import ModelError, QueryError, ScenarioError
from hpop.motions import Motions, States, integrated
from hpop.motions.symbolic import SymbolicMotions
from hpop.scenario import load_scenario
from hpop.testing import random_motions, random_world
from hpop.trajectories.trajectory import Trajectory
from tests.models.test_twists import rotation_between, stacked
from tests.own_criteria import NAMES, own_criterion

BASE = hpop.DifferentialDrive(camera_offset=(0.2, -0.1))
HEAD = hpop.PanTilt(BASE, pan=(-3.0, 3.0), tilt=(-0.5, 0.8))
ALL_ROUND = replace(HEAD, pan="all round")
PLANNED, EXECUTED = ("move", "turn", "pan", "tilt", "unwind"), ("run", "spin", "swivel", "nod", "counterspin")
POSES = [(2.0, 2.0, 0.3), (4.0, 2.0, 1.0), (5.0, 4.0, -2.0), (3.0, 6.0, 3.0)]


def with_head(states, pan, tilt):
    return States(x=states.x, y=states.y, yaw=states.yaw, pan=pan, tilt=tilt)


def head_motions(seed, world, model, kind, size=40):
    """Random motions of a law, the head anywhere within its stops."""
    rng, law = np.random.default_rng(seed), model.laws[kind]
    base = "move" if "x" in law.varies else "turn"
    motions = random_motions(rng, world, model.base, base, size)
    start, end = motions.start, motions.end if law.varies & {"x", "yaw"} else motions.start
    pans, tilts = rng.uniform(-1.5, 1.5, (2, size)), rng.uniform(-0.5, 0.8, (2, size))
    if kind in ("unwind", "counterspin"):
        end = replace_yaw(end, start.yaw + rng.uniform(-1.4, 1.4, size))
        pans[1] = pans[0] - (end.yaw - start.yaw)
    elif "pan" not in law.varies:
        pans[1] = pans[0]
    if "tilt" not in law.varies:
        tilts[1] = tilts[0]
    ends = (with_head(states, pans[i], tilts[i]) for i, states in enumerate((start, end)))
    return Motions(world, model, law, *ends, t0=motions.t0)


def replace_yaw(states, yaw):
    return States(x=states.x, y=states.y, yaw=yaw)


def still(model, trajectory):
    """Return the trajectory of a base as that of a head that looks ahead all the way."""
    ahead = np.zeros(len(trajectory) + 1)
    return Trajectory(model, with_head(trajectory.states, ahead, ahead), trajectory.kinds)


def by_rows(model, rows, kinds):
    return Trajectory(model, States(**dict(zip(model.space.names, np.array(rows, float).T, strict=True))), kinds)


def looking_about(model):
    """Return a path that uses each law of the head and of the base at least once."""
    rows = [
        (2, 2, 0.0, 0, 0), (4, 2, 0.0, 0, 0), (4, 2, 0.0, 1.2, 0), (4, 2, 1.0, 1.2, 0), (4, 2, 1.0, 1.2, 0.6),
        (4, 2, 2.0, 0.2, 0.6), (4 + math.cos(2.0), 2 + math.sin(2.0), 2.0, 0.2, 0.6),
    ]  # fmt: skip
    return by_rows(model, rows, ("move", "pan", "turn", "tilt", "unwind", "move"))


# A still head


@pytest.mark.proof
def test_a_head_that_never_moves_costs_what_the_base_does_in_every_criterion():
    world, base = random_world(np.random.default_rng(1)), replace(BASE, seat=(-0.1, 0.0, 0.6))
    head, driven = replace(HEAD, base=base), Trajectory.from_poses(base, POSES)
    for criterion in (own_criterion(name) for name in NAMES):
        name = criterion.name
        if "joints" in criterion.requires:
            continue
        expected, found = (trajectory_costs([criterion], [t], world) for t in (driven, still(head, driven)))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9, err_msg=name)
        if criterion.aggregate == "trajectory":
            continue
        for kind in ("move", "turn", "run", "spin"):
            motions = random_motions(
                np.random.default_rng(2), world, base, "move" if kind in ("move", "run") else "turn", 4
            )
            motions, nothing = replace(motions, law=base.laws[kind]), np.zeros(4)
            ends = (with_head(states, nothing, nothing) for states in (motions.start, motions.end))
            headed = Motions(world, head, head.laws[kind], *ends, t0=motions.t0)
            expected, found = (motion_costs(criterion, m) for m in (motions, headed))
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9, err_msg=f"{name} of a {kind}")


# Twists


@pytest.mark.parametrize("kind", [*PLANNED, *EXECUTED])
@pytest.mark.parametrize("body", ["base", "camera"])
def test_closed_forms_are_the_integrals_of_twists(body, kind):
    motions = head_motions(3, random_world(np.random.default_rng(3)), HEAD, kind)
    closed, summed = HEAD.body(body, motions), integrated(body, motions)
    for column in ("length", "turned", "rotation"):
        np.testing.assert_allclose(getattr(closed, column), getattr(summed, column), atol=1e-9, err_msg=column)
    assert closed.stays == (not summed.length.any())
    assert closed.steady == (not np.asarray(summed.turned).any())


def test_rotation_is_what_the_axes_of_the_camera_turn_along_motions_of_every_law():
    """∫|ω| against the angles between poses at 400 moments of each motion."""
    world = random_world(np.random.default_rng(4))
    for kind in (*PLANNED, *EXECUTED):
        motions = head_motions(4, world, HEAD, kind, 5)
        for i in range(5):
            ends = [[getattr(s, n)[i] for n in s.names] for s in (motions.start, motions.end)]
            trajectory = by_rows(HEAD, ends, (kind,))
            states = trajectory.at(np.linspace(0.0, trajectory.duration, 401))
            before, after = (HEAD.pose("camera", states.take(part)) for part in (slice(0, -1), slice(1, None)))
            turned = np.linalg.norm(rotation_between(before, after, 400), axis=0).sum()
            assert motions.camera.turned[i] == pytest.approx(turned, rel=1e-4, abs=1e-9), kind


def test_a_twist_is_how_fast_the_pose_changes_and_its_rate_how_fast_the_twist_does():
    moment = 1e-5
    planned = looking_about(HEAD)
    trajectory = planned.execution()
    assert trajectory.kinds == ("run", "swivel", "spin", "nod", "counterspin", "run")
    # at once on all axes as no law moves them, from a made-up motion: x = sin(a t + b) in each column
    rng = np.random.default_rng(5)
    a, b = rng.uniform(0.3, 1.0, (2, 5))

    def states(t, derivative=0):
        return States(
            **{
                name: a[i] ** derivative * np.sin(a[i] * t + b[i] + 0.5 * np.pi * derivative)
                for i, name in enumerate(HEAD.space.names)
            }
        )

    t = rng.uniform(0.0, 9.0, 50)
    for body in ("base", "camera"):
        before, after = (HEAD.pose(body, states(t + off)) for off in (-moment, moment))
        twist = HEAD.twist(body, states(t), states(t, 1))
        moved = np.stack([after.x - before.x, after.y - before.y, after.z - before.z])
        np.testing.assert_allclose(stacked(twist.velocity, 50), moved / (2 * moment), atol=1e-8)
        turned = rotation_between(before, after, 50)
        np.testing.assert_allclose(stacked(twist.rotation, 50), turned / (2 * moment), atol=1e-8)
        rate = HEAD.twist_rate(body, states(t), states(t, 1), states(t, 2))
        begin, end = (HEAD.twist(body, states(t + off), states(t + off, 1)) for off in (-moment, moment))
        for part in ("velocity", "rotation"):
            found, *ends = (stacked(getattr(one, part), 50) for one in (rate, begin, end))
            np.testing.assert_allclose(found, (ends[1] - ends[0]) / (2 * moment), atol=1e-8)


def test_axes_are_right_handed_and_those_of_the_angles():
    states = with_head(
        States(x=np.zeros(4), y=np.zeros(4), yaw=np.array([0, 1, -2, 3.0])),
        np.array([0, 2, 1, -3.0]),
        np.array([0, 0.5, -0.4, 0.7]),
    )
    pose = HEAD.pose("camera", states)
    ahead, left, up = (stacked(axis, 4) for axis in (pose.ahead, pose.left, pose.up))
    np.testing.assert_allclose(np.cross(ahead, left, axis=0), up, atol=1e-12)
    np.testing.assert_allclose(np.arcsin(ahead[2]), states.tilt)
    np.testing.assert_allclose(np.exp(1j * np.arctan2(ahead[1], ahead[0])), np.exp(1j * (states.yaw + states.pan)))


# Turning back


def test_a_head_that_turns_back_as_the_base_turns_does_not_rotate():
    """Every criterion about rotation is exactly 0, and so is motion sickness from turning."""
    world, names = (
        random_world(np.random.default_rng(6)),
        ["rotation", "rotation_time", "angular_acceleration", "turns", "orientation_retention"],
    )
    for kind in ("unwind", "counterspin"):
        motions = head_motions(6, world, HEAD, kind)
        for name in names:
            assert not motion_costs(hpop.criteria.make_criterion(name), motions).any(), name
        assert not motion_costs(
            hpop.criteria.make_criterion({"angular_acceleration": {"threshold": 0.0}}), motions
        ).any()
        assert motions.base.turned.all()
        assert motions.camera.steady
    head = replace(HEAD, base=hpop.DifferentialDrive())
    rows = [(2, 2, 0.0, 1.0, 0.3), (2, 2, 2.0, -1.0, 0.3)]
    unseen = ["sickness", "msdv", "net_winding", "net_misalignment", "optic_flow", "peak_optic_flow", "jerk"]
    criteria = [hpop.criteria.make_criterion(name) for name in unseen]
    np.testing.assert_allclose(trajectory_costs(criteria, [by_rows(head, rows, ("unwind",))], world), 0.0, atol=1e-9)
    rows[1] = (2, 2, 2.0, 1.0, 0.3)
    assert trajectory_costs(criteria, [by_rows(head, rows, ("turn",))], world)[0, 2:5].all()


def test_turning_back_keeps_the_limits_of_both_and_lasts_no_less_than_either():
    for rates in ({"pan_rate": 0.7}, {"pan_acceleration": 0.9}, {"pan_rate": 3.0, "pan_acceleration": 9.0}):
        head = replace(HEAD, **rates)
        for angle in (0.05, 0.4, 2.5):
            rows = {
                "unwind": [(0, 0, 0, 0, 0), (0, 0, angle, -angle, 0)],
                "turn": [(0, 0, 0, 0, 0), (0, 0, angle, 0, 0)],
                "pan": [(0, 0, 0, 0, 0), (0, 0, 0, -angle, 0)],
            }
            planned = {kind: by_rows(head, ends, (kind,)) for kind, ends in rows.items()}
            longer = max(planned["turn"].duration, planned["pan"].duration)
            assert planned["unwind"].duration >= longer - 1e-12
            if rates != {"pan_rate": 0.7}:  # one of the two is slower in both
                assert planned["unwind"].duration == pytest.approx(longer)
            done = planned["unwind"].execution()
            times = np.linspace(0.0, done.duration, 500)
            speeds, changes = done.rates(times)
            for axis, rate, acceleration in (
                ("yaw", BASE.turn_rate, BASE.turn_acceleration),
                ("pan", head.pan_rate, head.pan_acceleration),
            ):
                assert np.abs(getattr(speeds, axis)).max() <= rate + 1e-9
                assert np.abs(getattr(changes, axis)).max() <= acceleration + 1e-9


def test_motions_in_place_last_rest_to_rest_and_what_stopping_and_starting_lose():
    loss = BASE.speed / BASE.acceleration
    for kind, row, speed, acceleration in (("pan", (0, 0, 0, 2.0, 0), 1.5, 3.0), ("tilt", (0, 0, 0, 0, 0.7), 1.0, 2.0)):
        planned, angle = by_rows(HEAD, [(0, 0, 0, 0, 0), row], (kind,)), max(row)
        assert planned.duration == pytest.approx(angle / speed + speed / acceleration + loss)
        assert planned.execution().duration == pytest.approx(planned.duration - loss)


def test_a_head_that_does_not_turn_back_as_far_is_no_unwinding():
    rows = [(0, 0, 0, 0, 0), (0, 0, 1.0, -0.9, 0)]
    with pytest.raises(ModelError, match=r"motion 0, a unwind, must end .* but its end state is 0\.1 m or rad away"):
        by_rows(HEAD, rows, ("unwind",))


# Stops


def test_a_state_beyond_a_stop_is_refused():
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 6, 4))
    for start, said in (
        ((1, 1, 0, 3.1, 0), "the pan of the start must be an angle in rad from -3 to 3, got 3.1"),
        ((1, 1, 0, 0, -0.6), "the tilt of the start must be an angle in rad from -0.5 to 0.8, got -0.6"),
    ):
        with pytest.raises(QueryError) as error:
            hpop.Problem(world, HEAD, start, (5, 1, 0, None, None), ["length"])
        assert said in str(error.value)
    hpop.Problem(world, ALL_ROUND, (1, 1, 0, 3.1, 0), (5, 1, 0, None, None), ["length"])


def test_a_trajectory_that_passes_a_stop_is_at_fault():
    way = looking_about(HEAD)
    assert [*HEAD.faults(way)] == []
    tight = replace(HEAD, pan=(-3.0, 1.0), tilt=(-0.5, 0.5))
    assert [*tight.faults(replace(way, model=tight))] == [
        "has a pan of 1.2 rad in state 2, beyond its stop at 1 rad",
        "has a tilt of 0.6 rad in state 4, beyond its stop at 0.5 rad",
    ]
    assert [*ALL_ROUND.faults(replace(way, model=ALL_ROUND))] == []
    sideways = by_rows(HEAD, [(0, 0, 0, 0, 0), (0, 2, 0, 0, 0)], ("move",))
    assert [*HEAD.faults(sideways)] == ["goes sideways or backwards in motion 0, a move"]
    for trajectory, model, doubted in ((way, tight, {1, 2, 3, 4, 5}), (way, HEAD, set()), (sideways, HEAD, {0})):
        found = {i for index, m in trajectory.batches(None) for i in index[model.doubtful(m.law, m.start, m.end)]}
        assert doubted - {5} <= found <= doubted


def test_only_a_pan_without_stops_comes_round():
    a, b = (
        with_head(States(x=np.zeros(1), y=np.zeros(1), yaw=np.zeros(1)), np.array([p]), np.zeros(1))
        for p in (2.5, -2.5)
    )
    assert ALL_ROUND.space.differences(a, b)["pan"] == pytest.approx(2 * np.pi - 5.0)
    assert HEAD.space.differences(a, b)["pan"] == pytest.approx(-5.0)


# Symbols


@pytest.mark.cases(but=("landmark_blindness-turn", "angular_acceleration-turn", "exposure-turn"))
@pytest.mark.parametrize("kind", ["move", "turn", "pan"])
@pytest.mark.parametrize("name", ["rotation", "landmark_blindness", "angular_acceleration", "exposure"])
def test_criteria_of_the_camera_have_the_gradients_of_their_differences(name, kind):
    world = random_world(np.random.default_rng(8))
    motions = replace(head_motions(8, world, HEAD, kind, 3), panels=3)
    criterion, step = hpop.criteria.make_criterion(name), 1e-5
    symbols = SymbolicMotions.of(motions)
    function = symbols.function(criterion.cost(symbols.motions))
    value, jacobian = (np.array(part) for part in function(symbols.point))
    np.testing.assert_allclose(value.ravel(), motion_costs(criterion, motions), rtol=1e-6, atol=1e-9)
    for column, ahead in enumerate(step * np.eye(symbols.point.size)):
        below, above = (np.array(function(symbols.point + off)[0]).ravel() for off in (-ahead, ahead))
        np.testing.assert_allclose(jacobian[:, column], (above - below) / (2 * step), atol=1e-3 * max(1.0, value.max()))


# Parameters


def test_it_is_described_and_built_again():
    for model in (HEAD, ALL_ROUND, hpop.PanTilt(BASE, tilt=(0.1, 0.1), field_of_view=(1.9, 1.2))):
        again = make_model(json.loads(json.dumps(model.describe())))
        assert again == model
        assert again.base == BASE
    assert HEAD.describe()["pan_tilt"]["base"] == BASE.describe()
    assert hpop.PanTilt(BASE, pan=np.array([-3.0, 3.0]), tilt=[-0.5, 0.8]) == HEAD


def test_it_has_what_its_base_has_and_joints_but_is_not_rigid():
    assert HEAD.provides == BASE.provides - {"rigid"} | {"joints"}
    assert HEAD.laws.keys() == {*PLANNED, *EXECUTED, *(f"{kind}_ramp" for kind in EXECUTED)}


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"base": "omni"}, "base must be a model in the plane with a camera and without joints"),
        ({"base": hpop.ViewModel()}, "base of a pan_tilt must be a robot without a view"),
        ({"pan": (1.0, -1.0)}, "pan must be (low, high) with low not above high, got (1, -1)"),
        (
            {"pan": (-170, 170)},
            "pan must be (low, high) in rad, or 'all round', each from -12.5664 to 12.5664, got -170",
        ),
        ({"pan": "round"}, "pan must be (low, high) in rad, or 'all round', got 'round'"),
        ({"pan": None}, "pan must be (low, high) in rad, or 'all round', got None"),
        ({"tilt": (-2.0, 0.0)}, "tilt must be (low, high) in rad, each from -1.5708 to 1.5708, got -2"),
        ({"tilt": 0.3}, "tilt must be (low, high) in rad, got 0.3"),
        ({"pan_rate": 0.0}, "pan_rate must be a positive number"),
        (
            {"field_of_view": (110, 70)},
            "field_of_view must be (horizontal, vertical) in rad, each an angle from 1e-06 to 6.28419",
        ),
        ({"field_of_view": 1.9}, "field_of_view must be (horizontal, vertical) in rad, or None for all round, got 1.9"),
    ],
)
def test_a_head_that_makes_no_sense_is_refused(parameters, said):
    with pytest.raises(ModelError) as error:
        hpop.PanTilt(**{"base": BASE, **parameters})
    assert said in str(error.value)


def test_a_scenario_names_base_stops_and_angles_in_words(tmp_path):
    text = """\
world: {polygons: {extent: [[0, 0], [6, 0], [6, 4], [0, 4]]}}
model:
  pan_tilt:
    base: {differential_drive: {radius: 0.25}}
    pan: [-170 deg, 170 deg]
    field_of_view: [110 deg, 1.2]
start: {x: 1.0, y: 1.0, yaw: 0, pan: 90 deg, tilt: 0}
goal: [5.0, 1.0, any, any, any]
criteria: [length]
"""
    scenario = tmp_path / "room.yaml"
    scenario.write_text(text)
    problem = load_scenario(scenario).problem
    stops = math.radians(170)
    assert problem.model == hpop.PanTilt(
        hpop.DifferentialDrive(radius=0.25), pan=(-stops, stops), field_of_view=(math.radians(110), 1.2)
    )
    assert hpop.Problem.from_description(problem.describe()).model == problem.model
    scenario.write_text(
        text.replace("[-170 deg, 170 deg]", "all round").replace(
            "{differential_drive: {radius: 0.25}}", "differential_drive"
        )
    )
    assert load_scenario(scenario).problem.model == hpop.PanTilt(
        hpop.DifferentialDrive(), pan="all round", field_of_view=(math.radians(110), 1.2)
    )
    for old, new, said in (
        (
            "radius: 0.25",
            "radius: -1",
            r"line 4, model\.pan_tilt\.base\.differential_drive: radius must be a positive length",
        ),
        (
            "radius: 0.25",
            "radios: 1",
            r"model\.pan_tilt\.base\.differential_drive\.radios: no such key; did you mean 'radius'",
        ),
        (
            "{differential_drive: {radius: 0.25}}",
            "7",
            r"model\.pan_tilt\.base: expected text or keys with values, got 7",
        ),
        ("170 deg]", "170 degrees]", r"line 5, model\.pan_tilt\.pan"),
        (
            "pan: 90 deg",
            "pan: 175 deg",
            r"line 7, start\.pan: a pan must be an angle in rad from -2\.96706 to 2\.96706",
        ),
    ):
        scenario.write_text(text.replace(old, new))
        with pytest.raises((ModelError, ScenarioError, QueryError), match=said):
            load_scenario(scenario)
