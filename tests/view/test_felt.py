"""Chart of what a passenger feels: speed, way and accelerations against formulas by hand."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.motions import States
from hpop.view import draw_felt, save_pictures

WORLD = hpop.World.from_polygons([], extent=shapely.box(-30, -30, 30, 30))
G = 9.80665  # m/s²


def ridden(path):
    """Return the problem of riding along a path, and a front that has this path alone."""
    ends = [tuple(float(getattr(path.states, name)[i]) for name in ("x", "y", "yaw")) for i in (0, -1)]
    problem = hpop.Problem(WORLD, path.model, *ends, ["length", "duration"])
    costs = problem.evaluate(path)
    return problem, hpop.Front.of(
        np.array([[costs["length"], costs["duration"]]]), (path,), names=("length", "duration"), units=("m", "s")
    )


def curves(figure):
    """Return the curve of the only trajectory in each panel: the way, m, and the value."""
    return [next(line.get_data() for line in axes.lines if len(line.get_xdata()) > 2) for axes in figure.axes[:3]]


def test_a_straight_ride_speeds_up_and_brakes_by_the_acceleration_of_the_robot():
    robot = hpop.DifferentialDrive(seat=(0.2, 0.1, 0.5), speed=2.0, acceleration=0.8)
    _, front = ridden(hpop.Trajectory.from_poses(robot, [(0, 0, 0), (10, 0, 0)]))
    speed, ahead, left = curves(draw_felt(front))
    assert speed[0].max() == pytest.approx(10.0, rel=1e-4)
    assert speed[1].max() == pytest.approx(2.0)
    assert [ahead[1].max(), ahead[1].min()] == pytest.approx([0.8 / G, -0.8 / G])
    assert left[1] == pytest.approx(0.0, abs=1e-9)
    at = speed[0] < 2.4  # m: it speeds up for v²/2a = 2.5 m
    assert speed[1][at] == pytest.approx(np.sqrt(2 * 0.8 * speed[0][at]), rel=1e-2, abs=1e-2)


def test_a_curve_loads_the_seat_by_the_square_of_the_speed_times_the_curvature():
    car = hpop.Ackermann(seat=(0.0, 0.0, 0.5), speed=1.2, steering_rate=None)
    radius = 2.0
    angles = np.array([0.0, 2.0])
    ends = States(x=radius * np.sin(angles), y=radius * (1 - np.cos(angles)), yaw=angles)
    _, front = ridden(hpop.Trajectory(car, ends, ("arc",)))
    speed, _, left = curves(draw_felt(front))
    assert speed[0].max() == pytest.approx(4.0, rel=1e-4)
    assert left[1] == pytest.approx(speed[1] ** 2 / radius / G, abs=1e-6)


def test_pictures_have_it_only_for_a_robot_with_a_seat(tmp_path):
    for seat in (None, (0.2, 0.0, 0.5)):
        robot = hpop.DifferentialDrive(seat=seat)
        problem, front = ridden(hpop.Trajectory.from_poses(robot, [(0, 0, 0), (5, 0, 0)]))
        written = {path.name for path in save_pictures(problem, front, tmp_path, dpi=40)}
        assert ("felt.png" in written) == (seat is not None)


def test_a_robot_without_a_seat_is_refused():
    _, front = ridden(hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (5, 0, 0)]))
    with pytest.raises(hpop.errors.OptionError, match="has no seat for a passenger"):
        draw_felt(front)
