"""Speed profiles along one path: optima of closed form, toppra, limits on dense samples, and what stays of a path."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import shapely
from scipy.interpolate import CubicSpline

import hpop
from hpop.criteria import trajectory_cost
from hpop.criteria.base import make_criterion
from hpop.models.base import Mount, Part, PlanarModel, plane_space
from hpop.models.driven import driven
from hpop.models.laws import Move, Turn
from hpop.motions import States
from hpop.planners.programs.path_coordinates import coordinates_of
from hpop.planners.programs.speed_profiles import Discomfort, Profiles
from hpop.planners.programs.stretches import PathStretch, stretches_of
from hpop.problems.verify import verify


class Gliding(PlanarModel):
    """A base that has no law with a free speed."""

    name = "gliding"

    space, parts = plane_space(1.0), (Part(((0.0, 0.0),), 0.3, 0.0, 0.2),)
    mounts: ClassVar = {"base": Mount()}
    executed: ClassVar = {}
    laws: ClassVar = {"move": Move(1.0), "turn": Turn(1.0, 2.0, 1.0)}


WORLD = hpop.World.from_polygons([], extent=shapely.box(-30, -30, 30, 30))
ROBOT = hpop.DifferentialDrive(radius=0.3)
ARM = hpop.SerialArm.from_urdf(
    Path(hpop.examples.__file__).parent / "arm/arm6.urdf",
    srdf=Path(hpop.examples.__file__).parent / "arm/arm6.srdf",
    tip="tool",
    acceleration=6.0,
)


def asked(trajectory, criteria=("length", "turns", "rotation"), world=WORLD, **parts):
    """Return the problem from the start of a trajectory to its end."""
    names = trajectory.model.space.names
    ends = [tuple(float(getattr(trajectory.states, name)[i]) for name in names) for i in (0, -1)]
    return hpop.Problem(world, trajectory.model, *ends, list(criteria), **parts)


def poses(seed, robot=ROBOT, count=5):
    """Return a trajectory through random poses."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-9, 9, (2, count))
    ahead = np.arctan2(np.diff(y), np.diff(x))  # one turn at each position
    through = np.column_stack([x, y, np.append(ahead, rng.uniform(-3, 3))])
    return hpop.Trajectory.from_poses(robot, [tuple(row) for row in through.tolist()])


def reaches(seed, count=4):
    """Return a trajectory of an arm through random states near its home."""
    rng, names = np.random.default_rng(seed), ARM.space.names
    low, high = np.maximum(ARM.space.low, -1.5), np.minimum(ARM.space.high, 1.5)
    through = rng.uniform(low, high, (count, len(names)))
    return hpop.Trajectory.through(ARM, States(**dict(zip(names, through.T, strict=True))))


def splined(seed, pieces=5):
    """Return a slow smooth curve of an arm from rest to rest, and its spline by time."""
    rng, law = np.random.default_rng(seed), ARM.laws["spline"]
    times = np.arange(pieces + 1) * 1.0
    curve = CubicSpline(times, rng.uniform(-0.3, 0.3, (times.size, len(law.names))), bc_type="clamped")
    states = law.knots([*curve(times).T], [*curve(times, 1).T], times)
    trajectory = hpop.Trajectory(ARM, states, ("spline",) * pieces)
    assert not list(ARM.faults(trajectory))
    return trajectory, curve


def profiles_of(trajectory, jerk=None, felt=1.0):
    """Return the programs of a path; each step forward accelerates the camera by ``felt`` times the step."""
    stretches = [
        p for p in stretches_of(trajectory.execution(), coordinates_of(trajectory.model)) if type(p) is PathStretch
    ]
    rates = np.concatenate([felt * one.in_middle[0][:, :1] for one in stretches])
    slopes = np.hstack([rates, np.zeros((rates.size, 2))])
    return Profiles(stretches, Discomfort(slopes=slopes, bends=0.0 * slopes), jerk)


@pytest.mark.proof
def test_the_fastest_profile_lasts_as_long_as_trapezoids():
    for seed in range(5):
        path = poses(seed)
        front = hpop.retime(asked(path), path, points=3)
        assert front.costs[0, 0] == pytest.approx(path.execution().duration, rel=1e-6)
        cost = trajectory_cost(make_criterion("squared_acceleration"), path.execution(), WORLD)
        assert front.costs[0, 1] == pytest.approx(cost, rel=1e-4)


def test_one_run_without_limits_costs_what_a_linearly_falling_acceleration_costs():
    robot = hpop.DifferentialDrive(speed=50.0, acceleration=30.0)
    path = hpop.Trajectory.from_poses(robot, [(0, 0, 0), (8, 0, 0)])
    front = hpop.retime(asked(path), path, points=4)
    for duration, cost in front.costs[1:]:
        assert cost == pytest.approx(12.0 * 8.0**2 / duration**3, rel=3e-3)


def test_in_a_corridor_the_flow_limits_the_speed():
    walls = [shapely.box(-20, 1, 20, 1.5), shapely.box(-20, -1.5, 20, -1)]
    world = hpop.World.from_polygons(walls, extent=shapely.box(-20, -1.5, 20, 1.5))
    path = hpop.Trajectory.from_poses(ROBOT, [(-5, 0, 0), (5, 0, 0)])
    front = hpop.retime(asked(path, world=world), path, discomfort="peak_optic_flow", points=6)
    assert front.names == ("duration", "peak_optic_flow")
    for duration, flow in front.costs:
        speed = flow * 1.0  # half of the width
        assert duration == pytest.approx(10.0 / speed + speed / ROBOT.acceleration, rel=0.02)


@pytest.mark.seeds(1, of=40)
def test_paths_lengths_turns_and_claims_stay(seed):
    path = poses(seed) if seed % 2 else poses(seed).with_hold(at=3, seconds=4.0)
    discomfort = ("squared_acceleration", "peak_optic_flow")[seed // 2 % 2]
    problem = asked(path)
    front = hpop.retime(problem, path, discomfort=discomfort, points=3)
    assert "NOT VALID" not in front.certificate
    assert verify(hpop.Problem.from_description(front.problem), front) == []
    before = problem.evaluate(path.execution())
    for point in front:
        assert point.reported == pytest.approx(before, rel=1e-6)
        assert point.trajectory.execution() is point.trajectory
        held = np.diff(point.trajectory.states.clock)[[kind == "hold" for kind in point.trajectory.kinds]]
        assert held.sum() == pytest.approx(0.0 if seed % 2 else 4.0)
    faster, gentler = front.costs[:-1], front.costs[1:]
    assert (faster[:, 0] < gentler[:, 0]).all()
    assert (faster[:, 1] > gentler[:, 1]).all()
    assert front.costs[0, 0] <= path.execution().duration * (1 + 1e-6)


@pytest.mark.seeds(1, of=40)
def test_dense_samples_keep_the_limits_and_the_path(seed):
    path = poses(seed)
    for point in hpop.retime(asked(path), path, points=3):
        done = point.trajectory
        step = 1e-3
        times = np.arange(0.0, done.duration, step)
        at = done.at(times)
        moved, turned = np.hypot(np.diff(at.x), np.diff(at.y)) / step, np.diff(at.yaw) / step
        assert moved.max() <= ROBOT.speed * (1 + 1e-6)
        assert np.abs(turned).max() <= ROBOT.turn_rate * (1 + 1e-6)
        assert np.abs(np.diff(moved)).max() <= ROBOT.acceleration * step * (1 + 1e-4)
        assert np.abs(np.diff(turned)).max() <= ROBOT.turn_acceleration * step * (1 + 1e-4)
        line = shapely.LineString(np.column_stack([path.states.x, path.states.y]))
        assert shapely.distance(line, shapely.points(at.x, at.y)).max() < 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(20))
def test_an_arm_keeps_the_limits_of_its_joints_on_dense_samples(seed):
    path = reaches(seed) if seed % 2 else splined(seed)[0]
    front = hpop.retime(asked(path, ["rotation"]), path, points=3)
    speed, acceleration = np.array(ARM.chain.speed), np.array(ARM.chain.acceleration)
    for point in front:
        step = 1e-3
        at = point.trajectory.at(np.arange(0.0, point.trajectory.duration, step))
        joints = np.stack([getattr(at, name) for name in ARM.space.names], axis=1)
        rates = np.diff(joints, axis=0) / step
        assert (np.abs(rates).max(axis=0) <= speed * (1 + 1e-6)).all()
        assert (np.abs(np.diff(rates, axis=0)).max(axis=0) <= acceleration * step * (1 + 1e-4)).all()
        assert list(ARM.faults(point.trajectory)) == []
    assert front.costs[0, 0] <= path.duration * (1 + 1e-6)
    assert verify(hpop.Problem.from_description(front.problem), front) == [] or seed % 2 == 1  # random, in itself


@pytest.mark.seeds(2, of=50)
def test_the_fastest_profile_is_that_of_toppra(seed):
    toppra = pytest.importorskip("toppra")
    toppra.setup_logging("ERROR")
    from toppra import algorithm, constraint

    path = reaches(seed, count=3)
    total, rows = 0.0, np.column_stack([getattr(path.states, name) for name in ARM.space.names])
    for start, end in pairwise(rows):
        line = toppra.SplineInterpolator([0.0, 1.0], np.array([start, end]))
        speed, acceleration = np.array(ARM.chain.speed), np.array(ARM.chain.acceleration)
        limits = [
            constraint.JointVelocityConstraint(np.column_stack([-speed, speed])),
            constraint.JointAccelerationConstraint(np.column_stack([-acceleration, acceleration])),
        ]
        made = algorithm.TOPPRA(limits, line, gridpoints=np.linspace(0, 1, 2001)).compute_trajectory()
        total += made.duration
    fastest = hpop.retime(asked(path, ["rotation"]), path, points=1).costs[0, 0]
    assert fastest == pytest.approx(total, rel=1e-3)


@pytest.mark.seeds(1, of=20)
def test_the_fastest_profile_of_a_curve_is_near_that_of_toppra(seed):
    toppra = pytest.importorskip("toppra")
    toppra.setup_logging("ERROR")
    from toppra import algorithm, constraint

    path, curve = splined(seed)
    speed, acceleration = np.array(ARM.chain.speed), np.array(ARM.chain.acceleration)
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-speed, speed])),
        constraint.JointAccelerationConstraint(np.column_stack([-acceleration, acceleration])),
    ]
    line = toppra.SplineInterpolator(curve.x, curve(curve.x), bc_type="clamped")
    grid = 0.5 * curve.x[-1] * (1.0 - np.cos(np.linspace(0, np.pi, 4001)))
    made = algorithm.TOPPRA(limits, line, gridpoints=grid).compute_trajectory()
    fastest = hpop.retime(asked(path, ["rotation"]), path, points=1).costs[0, 0]
    assert fastest == pytest.approx(made.duration, rel=1e-2)


@pytest.mark.seeds(2, of=30)
def test_no_mixture_of_profiles_is_better_and_costs_are_convex(seed):
    rng = np.random.default_rng(seed)
    programs = profiles_of(poses(seed, count=3))
    fastest = programs.fastest
    least = programs.durations(fastest).sum()
    best = programs.gentlest(1.2 * least, fastest)
    duration, cost = programs.durations(best).sum(), programs.cost(best)
    for _ in range(20):
        knots = np.sort(rng.uniform(0, fastest.size, 8))
        slower = np.interp(np.arange(fastest.size), knots, rng.uniform(0.05, 1.0, 8))
        other = programs.within_limits(fastest * slower)
        share = rng.uniform(0.001, 1.0)
        for one in (other, fastest):
            mixed = (1 - share) * best + share * one
            assert programs.cost(mixed) <= (1 - share) * cost + share * programs.cost(one) + 1e-9
            assert (
                programs.durations(mixed).sum() <= (1 - share) * duration + share * programs.durations(one).sum() + 1e-9
            )
            assert np.allclose(programs.within_limits(mixed), mixed, rtol=1e-6)  # limits are convex
            if programs.durations(mixed).sum() <= duration:
                assert programs.cost(mixed) >= cost * (1 - 1e-5)
            else:  # as fast as the best, if all of it is driven faster
                quicker = programs.within_limits(mixed * (programs.durations(mixed).sum() / duration) ** 2)
                if programs.durations(quicker).sum() <= duration:
                    assert programs.cost(quicker) >= cost * (1 - 1e-5)


def test_a_limit_of_jerk_is_kept_and_costs_the_time_of_s_curves():
    path = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (6, 0, 0)])
    for jerk in (1.0, 3.0):
        front = hpop.retime(asked(path), path, jerk=jerk, points=3)
        assert front.costs[0, 0] == pytest.approx(6.0 / 1.0 + 1.0 / 1.0 + 1.0 / jerk, rel=5e-3)
        for point in front:
            speed, times = point.trajectory.states.speed, point.trajectory.times
            acceleration = np.append(np.append(0.0, np.diff(speed) / np.diff(times)), 0.0)
            middle = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
            assert np.abs(np.diff(acceleration) / np.diff(middle)).max() <= jerk * (1 + 1e-3)
    assert "better profiles may exist" in front.certificate


def test_stops_of_reaches_in_one_direction_are_left_out():
    names = ARM.space.names
    states = States(**{name: np.linspace(0.0, 0.5, 6) * (i + 1) / 6 for i, name in enumerate(names)})
    path = hpop.Trajectory.through(ARM, states)
    whole = hpop.Trajectory.through(ARM, states.take([0, 5]))
    assert len(path) == 5
    front = hpop.retime(asked(path, ["rotation"]), path, points=2)
    assert front.costs[0, 0] == pytest.approx(whole.duration, rel=1e-6)


@pytest.mark.proof
def test_curves_of_a_base_keep_their_path_and_the_limits_of_wheels():
    controls = [(0.8, 0, 0.8), (0, 1.0, 0.5), (0, -1.0, 1.0), (0, 1.0, 0.5), (-0.4, 0, 1.6)]
    path = driven(ROBOT, (0, 0, 0), controls)
    front = hpop.retime(asked(path), path, points=2)
    assert verify(hpop.Problem.from_description(front.problem), front) == []
    dense = path.at(np.linspace(0, path.duration, 20_001))
    line = shapely.LineString(np.column_stack([dense.x, dense.y]))
    assert front.costs[0, 0] < path.duration
    for point in front:
        at = point.trajectory.at(np.linspace(0, point.trajectory.duration, 2001))
        assert shapely.distance(line, shapely.points(at.x, at.y)).max() < 1e-4
        wheels = ROBOT.wheels(point.trajectory, np.linspace(0, point.trajectory.duration, 2001))
        assert max(np.abs(wheels.left_speed).max(), np.abs(wheels.right_speed).max()) <= ROBOT.wheel_speed * 1.001
        for change in (wheels.left_acceleration, wheels.right_acceleration):
            assert np.abs(change).max() <= ROBOT.wheel_acceleration * 1.01
    with pytest.raises(hpop.errors.OptionError, match="this path has curves"):
        hpop.retime(asked(path), path, jerk=1.0)


def test_tours_keep_their_dwells_and_robots_with_speeds_their_fastest():
    tour = {"stops": [{"at": [4, 1], "within": 0.5, "dwell": 3.0}]}
    robot = hpop.DifferentialDrive(radius=0.3, speeds=(0.5, 1.0))
    problem = hpop.Problem(WORLD, robot, (0, 0, 0), (8, 2, None), ["duration", "turns"], tour=tour)
    path = problem.solve("lattice", step=1.0).best("duration").trajectory
    front = hpop.retime(problem, path, points=3)
    again = hpop.Problem.from_description(front.problem)
    assert again.tour is not None
    assert verify(again, front) == []
    assert max(point.trajectory.states.speed.max() for point in front) <= 1.0 + 1e-9
    assert front.costs[0, 0] <= path.execution().duration * (1 + 1e-6)


def test_a_saved_front_is_loaded_with_its_profiles(tmp_path):
    path = poses(0)
    front = hpop.retime(asked(path), path, points=3)
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    assert np.array_equal(again.costs, front.costs)
    assert again[1].trajectory.table().headings[0].startswith("t")


def test_a_path_without_discomfort_has_one_profile():
    path = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, 2.0)])
    front = hpop.retime(asked(path), path)
    assert len(front) == 1
    assert any("no squared_acceleration at any speed" in note for note in front.notes)


def test_bad_input_is_refused():
    path = poses(1)
    problem, errors = asked(path), hpop.errors
    for options, message in (
        ({"points": 0}, "points"),
        ({"slowest": 1.0}, "slowest"),
        ({"jerk": 0.0}, "jerk"),
        ({"discomfort": "turns"}, "discomfort must be one of squared_acceleration, peak_optic_flow"),
    ):
        with pytest.raises(errors.OptionError, match=message):
            hpop.retime(problem, path, **options)
    turning = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0)])
    with pytest.raises(errors.ModelError, match="another robot"):
        hpop.retime(asked(path), hpop.Trajectory.from_poses(hpop.DifferentialDrive(radius=0.2), [(0, 0, 0), (3, 0, 0)]))
    gliding = hpop.Trajectory.from_poses(Gliding(), [(0, 0, 0), (3, 0, 0)])
    with pytest.raises(errors.UnsupportedModel, match="needs limits of its acceleration and laws with free speeds"):
        hpop.retime(asked(gliding, ["length"]), gliding)
    standing = hpop.Trajectory(ROBOT, turning.states.take([0]), ())
    with pytest.raises(errors.OptionError, match="does not move"):
        hpop.retime(asked(standing), standing)
    walking = hpop.Person(5, 5, 0.0, velocity=(1.0, 0.0))
    with pytest.raises(errors.QueryError, match="where people walk"):
        hpop.retime(asked(path, world=WORLD.with_content(people=[walking])), path)
