"""Speed profiles keep the limits of speed zones: dense samples of shapely, times by hand, and the criterion."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.motions import States
from hpop.world.content.content import Zone

WORLD = hpop.World.from_polygons([], extent=shapely.box(-60, -60, 60, 60))
SEAT = (0.2, 0.0, 0.6)
WHEELED = hpop.DifferentialDrive(seat=SEAT, speed=1.5)
CAR = hpop.Ackermann(seat=SEAT, speed=2.0)
BLUR = 3.0 * WORLD.cell  # m: how far beyond its border a zone may slow the robot down


def asked(path, zones, criteria=("length", "speeding")):
    ends = [tuple(float(getattr(path.states, name)[i]) for name in ("x", "y", "yaw")) for i in (0, -1)]
    return hpop.Problem(WORLD.with_content(zones=zones), path.model, *ends, list(criteria))


def straight(length=12.0, robot=WHEELED):
    return hpop.Trajectory.from_poses(robot, [(0, 0, 0), (length, 0, 0)])


def through(robot, *poses):
    states = States(**dict(zip(("x", "y", "yaw"), np.array(poses, float).T, strict=True)))
    return hpop.Trajectory.through(robot, states)


def speeds_at(trajectory, count=5001):
    """Return positions x and y, and the speed of the base, at dense times of a trajectory."""
    times = np.linspace(0.0, trajectory.duration, count)
    states, (rates, _) = trajectory.at(times), trajectory.rates(times)
    return states.x, states.y, np.hypot(rates.x, rates.y)


def least_time(slow, speed, acceleration, limit, length):
    """Return the least duration, s, of a straight ride with one slow stretch (m, m), by trapezoids."""
    at = np.linspace(0.0, length, 400_001)
    most = np.where((at >= slow[0]) & (at <= slow[1]), limit**2, speed**2)
    most[[0, -1]] = 0.0
    gain = 2.0 * acceleration * at
    most = np.minimum(most, np.minimum.accumulate(most - gain) + gain)  # the robot speeds up behind a limit
    most = np.minimum(most, (np.minimum.accumulate((most + gain)[::-1]))[::-1] - gain)  # and brakes before it
    root = np.sqrt(np.maximum(most, 0.0))
    return float((2.0 * np.diff(at) / (root[1:] + root[:-1])).sum())


@pytest.mark.parametrize("discomfort", ["squared_acceleration", "peak_optic_flow", "felt_msdv"])
def test_the_fastest_profile_is_slow_in_a_zone_and_only_there(discomfort):
    slow = (4.0, 7.03)
    path = straight()
    problem = asked(path, [Zone("speed", shapely.box(slow[0], -1, slow[1], 1), limit=0.5)])
    front = hpop.retime(problem, path, discomfort=discomfort, points=2)
    wide = least_time((slow[0] - BLUR, slow[1] + BLUR), 1.5, WHEELED.acceleration, 0.5, 12.0)
    assert least_time(slow, 1.5, WHEELED.acceleration, 0.5, 12.0) < front.costs[0, 0] < wide
    assert "NOT VALID" not in front.certificate
    assert any("faster than speed zones allow; the profiles keep their limits" in note for note in front.notes)
    for point in front:
        assert point.reported["speeding"] == pytest.approx(0.0, abs=1e-9)
        x, _, speed = speeds_at(point.trajectory)
        assert speed[(x >= slow[0]) & (x <= slow[1])].max() <= 0.5 * (1 + 1e-6)


@pytest.mark.seeds(2, of=40)
def test_dense_samples_keep_the_limits_of_random_zones(seed):
    rng = np.random.default_rng(seed)
    zones = [
        Zone("speed", shapely.Point(*rng.uniform(-5, 5, 2)).buffer(rng.uniform(0.3, 3)), limit=rng.uniform(0.2, 2.5))
        for _ in range(4)
    ]
    poses = [(*rng.uniform(-6, 6, 2), rng.uniform(-3, 3)) for _ in range(3)]
    path = through(CAR if seed % 2 else WHEELED, *poses)
    problem = asked(path, zones)
    front = hpop.retime(problem, path, points=2)
    assert "NOT VALID" not in front.certificate
    for point in front:
        x, y, speed = speeds_at(point.trajectory)
        for zone in zones:
            inside = shapely.contains_xy(zone.area, x, y)
            assert (speed[inside] <= zone.limit * (1 + 1e-6)).all()
        assert point.reported["speeding"] == pytest.approx(0.0, abs=1e-6)
        assert not list(path.model.faults(point.trajectory))


def test_a_zone_that_is_fast_enough_changes_nothing():
    path = straight()
    free = hpop.retime(asked(path, [], ["length"]), path, points=3)
    zones = [Zone("speed", shapely.box(4, -1, 7, 1), limit=1.5), Zone("speed", shapely.box(4, 5, 7, 6), limit=0.1)]
    front = hpop.retime(asked(path, zones), path, points=3)
    assert front.costs == pytest.approx(free.costs, rel=1e-4)
    assert not any("zones" in note for note in front.notes)


def test_the_limit_of_jerk_is_kept_in_a_zone_too():
    path = straight()
    zone = Zone("speed", shapely.box(4, -1, 7, 1), limit=0.5)
    for point in hpop.retime(asked(path, [zone]), path, points=2, jerk=2.0):
        assert point.reported["speeding"] == pytest.approx(0.0, abs=1e-9)


def test_a_plan_that_is_too_fast_for_a_zone_says_so_unless_a_criterion_does():
    zone = Zone("speed", shapely.box(3, -5, 6, 5), limit=0.5)
    world = WORLD.with_content(zones=[zone])
    crossing, beside = ((0, 0, 0), (8, 0, None)), ((0, 0, 0), (2, 0, None))
    for ends, criteria, speed, said in (
        (crossing, ["duration", "turns"], 1.0, True),
        (crossing, ["duration", "speeding"], 1.0, False),
        (crossing, ["duration", "turns"], 0.5, False),
        (beside, ["duration", "turns"], 1.0, False),
    ):
        front = hpop.Problem(world, hpop.DifferentialDrive(speed=speed), *ends, criteria).solve("lattice", step=1.0)
        assert any("too fast for speed zones" in note for note in front.notes) is said


def test_with_several_speeds_a_search_finds_a_plan_that_keeps_the_limits_executed_too():
    zone = Zone("speed", shapely.box(3, -50, 5, 50), limit=0.5)
    robot = hpop.DifferentialDrive(speeds=(0.5, 1.0))
    problem = hpop.Problem(WORLD.with_content(zones=[zone]), robot, (0, 0, 0), (8, 0, None), ["duration", "speeding"])
    best = problem.solve("lattice", step=0.5).best("speeding").trajectory
    x, _, speed = speeds_at(best.execution())
    assert speed[(x >= 3) & (x <= 5)].max() <= 0.5 * (1 + 1e-9)
    assert speed.max() == pytest.approx(1.0)
