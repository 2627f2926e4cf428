"""Sickness along a trajectory: what the model says of its seen accelerations."""

import math

import numpy as np
import pytest
import shapely
from scipy.signal import TransferFunction, cont2discrete, lfilter, lsim

from hpop.criteria import Sickness, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 40, 40))


@pytest.mark.parametrize("vection", [1.0, 0.4])
def test_a_straight_drive_agrees_with_the_linear_model_of_its_ramps(vection):
    path = Trajectory.from_poses(DifferentialDrive(acceleration=0.5), [(1, 1, 0.5), (15, 1 + 14 * math.tan(0.5), 0.5)])
    count = math.ceil(path.execution().duration / 0.01)
    times, step = np.linspace(0, path.execution().duration, count + 1, retstep=True)
    ahead = vection * 0.5 * ((times < 2.0) * 1.0 - (times > times[-1] - 2.0) * 1.0)
    system = ([1, 0], [3, 1, 5])  # with a still head, v_hat - g: 3 x'' + x' + 5 x = a'
    numerator, denominator, _ = cont2discrete(system, step, method="euler")
    for tilt, tolerance in (
        (lfilter(numerator.ravel(), denominator, ahead), 0.01),
        (lsim(TransferFunction(*system), ahead, times)[1], 0.06),  # what Euler's method errs by at 0.01 s
    ):
        share = tilt**2 / (0.25 + tilt**2)
        # M at T: the impulse response of the double lag is t exp(-t/720)/720².
        lag = times[-1] - times
        expected = np.trapezoid(85 * share * lag * np.exp(-lag / 720) / 720**2, times)
        assert trajectory_cost(Sickness(vection), path, WORLD) == pytest.approx(expected, rel=tolerance)


def test_stopping_often_is_worse_than_driving_on():
    robot = DifferentialDrive()
    on = Trajectory.from_poses(robot, [(1, 1, 0), (21, 1, 0), (21, 11, 1.57)])
    stops = [(1 + 2 * i, 1 + 0.3 * (i % 2), 0) for i in range(11)]
    often = Trajectory.from_poses(robot, [*stops, (21, 11, 1.57)])
    assert trajectory_cost(Sickness(), often, WORLD) > 2 * trajectory_cost(Sickness(), on, WORLD)


def test_turning_about_the_camera_gives_none_and_no_vection_gives_none():
    turn = [(1, 1, 0), (1, 1, 3)]
    on_axis, off_axis = (
        Trajectory.from_poses(DifferentialDrive(camera_offset=offset), turn) for offset in ((0, 0), (0.3, 0))
    )
    assert trajectory_cost(Sickness(), on_axis, WORLD) < 1e-20
    assert trajectory_cost(Sickness(), off_axis, WORLD) > 1e-9
    assert trajectory_cost(Sickness(0.0), off_axis, WORLD) < 1e-20


def test_it_builds_up_along_the_way():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (9, 1, 0), (9, 9, 2)])
    assert (np.diff(running_costs(Sickness(), path, WORLD)) > 0).all()


@pytest.mark.parametrize("vection", [-0.1, 1.1, math.nan])
def test_vection_is_a_share(vection):
    with pytest.raises(CriterionError, match="vection must be a share"):
        Sickness(vection)


def test_its_group_unit_and_aggregate():
    assert (Sickness.group, Sickness.unit, Sickness.aggregate) == ("C", "%", "trajectory")
