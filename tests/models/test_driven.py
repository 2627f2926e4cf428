"""Driven motion: constant wheel accelerations, against an ordinary differential equation solved by scipy."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from hpop.criteria import Length, Rotation, make_criterion, trajectory_cost
from hpop.errors import ModelError
from hpop.models import DifferentialDrive
from hpop.models.driven import driven
from hpop.motions import States
from hpop.motions.by_law import batches
from hpop.problems.problem import Problem
from hpop.problems.verify import collision_free
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive(camera_offset=(0.3, -0.1))
CONTROLS = [
    (1, 0.5, 0.8),
    (0, 1.5, 0.5),
    (-0.2, -3.0, 0.9),
    (0.1, 0.8, 0.7),
    (-0.5, 0, 1.0),
    (0, 2, 0.3),
    (-0.38, 0.78, 0.5),
]

control = st.tuples(st.floats(-0.3, 1.0), st.floats(-3.0, 3.0), st.floats(0.1, 0.6))


def solved(controls, pose=(1.0, 2.0, 0.4), samples=2001):
    """Return times and (x, y, yaw, v, ω) of the same controls, step by step, by scipy."""
    state, t0, times, rows = np.array([*pose, 0.0, 0.0]), 0.0, [], []
    for a, alpha, lasts in controls:

        def rates(t, s, a=a, alpha=alpha):
            return [s[3] * np.cos(s[2]), s[3] * np.sin(s[2]), s[4], a, alpha]

        t = np.linspace(0.0, lasts, samples)
        found = solve_ivp(rates, (0.0, lasts), state, t_eval=t, rtol=1e-11, atol=1e-12).y
        times.append(t0 + t)
        rows.append(found)
        state, t0 = found[:, -1], t0 + lasts
    return np.concatenate(times), np.concatenate(rows, axis=1)


@given(st.lists(control, min_size=1, max_size=4))
def test_the_robot_is_where_the_differential_equation_says(controls):
    trajectory = driven(ROBOT, (1.0, 2.0, 0.4), controls)
    times, rows = solved(controls, samples=50)
    at = trajectory.at(times)
    found = np.stack([at.x, at.y, at.yaw, at.speed, at.turn_rate])
    np.testing.assert_allclose(found, rows, atol=1e-6)
    assert trajectory.duration == pytest.approx(sum(lasts for *_, lasts in controls))


def test_rates_are_the_derivatives_of_the_states():
    trajectory = driven(ROBOT, (0, 0, 0.4), CONTROLS)
    times = np.linspace(0.05, trajectory.duration - 0.05, 200)
    times = times[np.abs(times[:, None] - trajectory.times).min(axis=1) > 1e-3]
    step = 1e-4
    below, above = trajectory.at(times - step), trajectory.at(times + step)
    first, second = trajectory.rates(times)
    for name in trajectory.states.names:
        middle = getattr(trajectory.at(times), name)
        low, high = getattr(below, name), getattr(above, name)
        np.testing.assert_allclose(getattr(first, name), (high - low) / (2 * step), atol=1e-6)
        np.testing.assert_allclose(getattr(second, name), (high - 2 * middle + low) / step**2, atol=2e-4)


def test_a_constant_turn_rate_drives_a_circle():
    trajectory = driven(ROBOT, (0, 0, 0), [(0, 2.0, 0.5), (1.0, 0.0, 1e-9), *[(0.0, 0.0, 0.5)] * 20], speed=0.8)
    s = trajectory.states
    centre = s.x[2] - 0.8 * np.sin(s.yaw[2]), s.y[2] + 0.8 * np.cos(s.yaw[2])
    at = trajectory.at(np.linspace(0.6, trajectory.duration, 300))
    np.testing.assert_allclose(np.hypot(at.x - centre[0], at.y - centre[1]), 0.8, atol=1e-6)


def test_lengths_and_rotations_are_those_of_the_solved_equation():
    trajectory = driven(ROBOT, (1.0, 2.0, 0.4), CONTROLS)
    _, (x, y, yaw, _, _) = solved(CONTROLS)
    ahead, left = ROBOT.camera_offset
    cx, cy = x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw)
    base = np.hypot(np.diff(x), np.diff(y)).sum()
    camera = np.hypot(np.diff(cx), np.diff(cy)).sum()
    of_camera = sum(m.camera.length.sum() for _, m in trajectory.batches(WORLD))
    assert trajectory_cost(Length(), trajectory, WORLD) == pytest.approx(base, rel=1e-6)
    assert of_camera == pytest.approx(camera, rel=1e-4)
    assert trajectory_cost(Rotation(), trajectory, WORLD) == pytest.approx(np.abs(np.diff(yaw)).sum(), rel=1e-6)
    signed = sum(m.base.rotation.sum() for _, m in trajectory.batches(WORLD))
    assert signed == pytest.approx(yaw[-1] - yaw[0])
    # The yaw rate changes its sign in the third interval, so that its rotations do not add up without it.
    assert trajectory_cost(Rotation(), trajectory, WORLD) > np.abs(np.diff(trajectory.states.yaw)).sum() + 0.01


def test_wheels_are_those_of_the_controls():
    trajectory = driven(ROBOT, (0, 0, 0), CONTROLS)
    middles = 0.5 * (trajectory.times[1:] + trajectory.times[:-1])
    track = ROBOT.wheels(trajectory, middles)
    half = 0.5 * ROBOT.wheel_base
    for i, (a, alpha, lasts) in enumerate(CONTROLS):
        assert track.left_acceleration[i] == pytest.approx(a - half * alpha, abs=1e-9)
        assert track.right_acceleration[i] == pytest.approx(a + half * alpha, abs=1e-9)
        speed = sum(c[0] * c[2] for c in CONTROLS[:i]) + a * lasts / 2
        turning = sum(c[1] * c[2] for c in CONTROLS[:i]) + alpha * lasts / 2
        assert track.left_speed[i] == pytest.approx(speed - half * turning)
        assert track.right_speed[i] == pytest.approx(speed + half * turning)


def test_integrals_along_curves_equal_scipy_quad():
    trajectory = driven(ROBOT, (0, 0, 0.3), CONTROLS)

    def rate(t):
        pose = ROBOT.pose("camera", trajectory.at(t))
        return float(np.sin(1.3 * pose.x[0]) + pose.y[0] ** 2 + np.cos(pose.yaw[0]))

    expected = quad(rate, 0.0, trajectory.duration, limit=200, points=trajectory.times[1:-1])[0]
    found = sum(
        m.integrate(lambda s: np.sin(1.3 * s.camera.x) + s.camera.y**2 + np.cos(s.camera.yaw)).sum()
        for _, m in trajectory.batches(WORLD)
    )
    assert found == pytest.approx(expected, rel=1e-5)


# Criteria, against finite differences of the solved equation


def test_bending_energy_is_that_of_the_curve_capped_at_the_rounding():
    _, (x, y, yaw, _, _) = solved(CONTROLS)
    way, turned = np.hypot(np.diff(x), np.diff(y)), np.abs(np.diff(yaw))
    bends = turned > 0
    expected = (turned[bends] ** 2 / np.maximum(way[bends], 0.5 * turned[bends])).sum()
    found = trajectory_cost(make_criterion("bending_energy"), driven(ROBOT, (1, 2, 0.4), CONTROLS), WORLD)
    assert found == pytest.approx(expected, rel=2e-3)


def test_angular_acceleration_is_that_of_the_yaw_rate():
    threshold, expected = np.deg2rad(1.0), 0.0
    for start in range(len(CONTROLS)):
        times, (*_, rate) = solved(CONTROLS)
        part = slice(2001 * start, 2001 * (start + 1))
        change = np.abs(np.diff(rate[part]) / np.diff(times[part]))
        expected += (np.maximum(change - threshold, 0.0) * np.diff(times[part])).sum()
    found = trajectory_cost(make_criterion("angular_acceleration"), driven(ROBOT, (1, 2, 0.4), CONTROLS), WORLD)
    assert found == pytest.approx(expected, rel=1e-6)


def test_curvature_changes_its_sign_as_often_as_finite_differences_say():
    controls = [(1, 0, 1), *[(0, s, 0.7) for s in (1.5, -1.5, -1.5, 1.5, 1.5, -1.5, -1.5, 1.5)], (-1, 0, 1)]
    trajectory = driven(ROBOT, (1, 2, 0.4), controls)
    _, (x, y, *_) = solved(controls)
    line = shapely.LineString(np.stack([x, y], axis=1)[np.append(True, np.hypot(np.diff(x), np.diff(y)) > 1e-9)])
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, np.arange(0.05, line.length, 0.1)))
    bends = np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])))
    signs = np.sign(bends[np.abs(bends) > 0.05 * 0.1])
    flips = np.count_nonzero(np.diff(signs))
    assert flips == 3  # left, right, left, right
    assert trajectory_cost(make_criterion("curvature_sign_changes"), trajectory, WORLD) == flips


@pytest.mark.parametrize("pieces", [1, 7])
def test_jerk_and_smoothness_do_not_depend_on_how_a_curve_is_cut(pieces):
    trajectory = driven(ROBOT, (1, 2, 0.4), CONTROLS)
    cut = trajectory.cut(np.full(len(CONTROLS), pieces))
    h, D, T = 0.1, trajectory_cost(Length(), trajectory, WORLD), trajectory.duration
    fine = np.arange(-2 * h, T + 2 * h, h / 200)
    camera = ROBOT.pose("camera", cut.at(fine))
    total = 0.0
    for axis in (camera.x, camera.y):  # the third difference over h
        third = (axis[600:] - 3 * axis[400:-200] + 3 * axis[200:-400] - axis[:-600]) / h**3
        total += (third**2).sum() * h / 200
    assert trajectory_cost(make_criterion("jerk"), cut, WORLD) == pytest.approx(total, rel=0.02)
    middles = h * (np.arange(int(np.ceil(T / h))) + 0.5)
    eps = 1e-4
    low, here, high = (cut.at(middles + shift) for shift in (-eps, 0.0, eps))
    bends = [
        np.where(middles < T, (getattr(low, n) - 2 * getattr(here, n) + getattr(high, n)) / eps**2, 0.0) for n in "xy"
    ]
    jumps = sum((np.diff(bend, prepend=0.0, append=0.0) ** 2).sum() for bend in bends) / h
    smooth = trajectory_cost(make_criterion("smoothness"), cut, WORLD)
    assert smooth == pytest.approx(T**5 / D**2 * jumps, rel=0.01)


# Trajectories


def test_a_driven_trajectory_executes_as_it_is_and_is_saved_exactly():
    trajectory = driven(ROBOT, (0, 0, 0), CONTROLS)
    assert trajectory.execution().kinds == trajectory.kinds
    again = Trajectory.from_description(ROBOT, json.loads(json.dumps(trajectory.describe())))
    for name in ("x", "y", "yaw", "speed", "turn_rate", "clock"):
        np.testing.assert_array_equal(getattr(again.states, name), getattr(trajectory.states, name))
        np.testing.assert_array_equal(getattr(trajectory.execution().states, name), getattr(again.states, name))


def test_driven_and_planned_trajectories_are_evaluated_together():
    planned = Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    several = [planned, driven(ROBOT, (0, 0, 0), CONTROLS), planned]
    lengths = np.zeros(3)
    for owner, motions in batches(several, WORLD):
        np.add.at(lengths, owner, motions.base.length)
    alone = [trajectory_cost(Length(), trajectory, WORLD) for trajectory in several]
    np.testing.assert_allclose(lengths, alone, rtol=1e-12)


@pytest.mark.parametrize(("name", "by"), [("x", 0.01), ("yaw", 0.01), ("speed", 0.2), ("clock", -5.0)])
def test_states_that_contradict_each_other_are_refused(name, by):
    s = driven(ROBOT, (0, 0, 0), CONTROLS).states
    column = getattr(s, name).copy()
    column[3] += by
    states = States(**{n: column if n == name else getattr(s, n) for n in s.names})
    with pytest.raises(ModelError, match=r"a drive, must end .* that its speeds and turn rates give"):
        Trajectory(ROBOT, states, ("drive",) * len(CONTROLS))


def test_a_curve_needs_its_speeds():
    s = driven(ROBOT, (0, 0, 0), CONTROLS).states
    with pytest.raises(ModelError, match="turn_rate"):
        Trajectory(ROBOT, States(x=s.x, y=s.y, yaw=s.yaw), ("drive",) * len(CONTROLS))


# Collision

ROBOTS = [
    DifferentialDrive(radius=0.25),
    DifferentialDrive(footprint=((0.5, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.5, -0.2)), camera_offset=(0.1, 0.05)),
]


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_collision_along_curves_is_missed_and_hardly_one_made_up(robot):
    rng = np.random.default_rng(3)
    boxes = [shapely.box(x, y, x + 0.02, y + 0.02) for x, y in rng.uniform(-4, 4, (60, 2))]
    world = World.from_polygons(boxes, extent=shapely.box(-20, -20, 20, 20))
    checker, strict = robot.collision(world), 0
    for _ in range(40):
        controls = [(rng.uniform(0.2, 1), rng.uniform(-3, 3), 0.5), (0, rng.uniform(-3, 3), 0.6)]
        trajectory = driven(robot, (*rng.uniform(-3, 3, 2), rng.uniform(-3, 3)), controls)
        dense = trajectory.at(np.linspace(0.0, trajectory.duration, 600))
        free = bool(checker.states_free(dense).all())
        said = all(bool(checker.motions_free(m).all()) for _, m in trajectory.batches(world))
        assert free or not said
        strict += free and not said
    assert strict <= 2


def test_the_independent_check_looks_at_the_curve_not_at_its_chord():
    controls = [(0.0, 3.0, 0.5), (0.0, 0.0, 1.0), (0.0, -3.0, 0.5)]
    trajectory = driven(ROBOTS[0], (0, 0, -0.9), controls, speed=1.0)
    s = trajectory.at(1.0)
    chord = (
        0.5 * (trajectory.states.x[1] + trajectory.states.x[2]),
        0.5 * (trajectory.states.y[1] + trajectory.states.y[2]),
    )
    assert np.hypot(s.x[0] - chord[0], s.y[0] - chord[1]) > 0.1
    nx, ny = np.sin(s.yaw[0]), -np.cos(s.yaw[0])  # to the outside of the bend
    for beyond, free in ((0.27, True), (0.23, False)):
        post = shapely.Point(s.x[0] + nx * beyond, s.y[0] + ny * beyond).buffer(0.001)
        world = World.from_polygons([post], extent=shapely.box(-5, -5, 5, 5))
        problem = Problem(world, ROBOTS[0], (0, 0, 0), (1, 0, 0), ["length"])
        assert collision_free(problem, [trajectory])[0] == free
        batch = next(m for _, m in trajectory.batches(world))
        assert ROBOTS[0].collision(world).motions_free(batch).all() == free
