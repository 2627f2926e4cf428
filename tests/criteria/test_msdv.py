"""Motion sickness dose: Wf against the values of ISO 2631-1, the dose against an analog simulation."""

import numpy as np
import pytest
import shapely
from scipy.signal import TransferFunction, lsim

from hpop.criteria import MSDV, trajectory_cost
from hpop.criteria.comfort.msdv import apply_wf_filter, sections, weighting
from hpop.criteria.costs import running_costs
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 40, 40))
PUBLISHED = [(0.1, 0.695), (0.16, 1.006), (0.2, 0.992), (0.25, 0.854), (0.4, 0.384), (0.63, 0.116)]


@pytest.mark.parametrize(("frequency", "gain"), PUBLISHED)
def test_the_weighting_has_the_gains_of_the_standard(frequency, gain):
    assert weighting(frequency) == pytest.approx(gain, abs=6e-4)


@pytest.mark.parametrize(("frequency", "gain"), PUBLISHED)
def test_the_digital_filter_weighs_a_long_sinusoid_alike(frequency, gain):
    times = np.arange(0, 400, 0.02)
    out = apply_wf_filter(np.sin(2 * np.pi * frequency * times)[:, None], 0.02)[times >= 200, 0]  # whole periods
    assert np.sqrt(2 * np.mean(out**2)) == pytest.approx(gain, rel=3e-3)


def test_a_constant_acceleration_is_not_weighed_in_the_long_run():
    assert abs(apply_wf_filter(np.ones((20_000, 1)), 0.02)[-1, 0]) < 1e-6


@pytest.mark.cases("1.2")
@pytest.mark.parametrize("turn", [0.0, 1.2])
def test_the_dose_of_a_drive_is_that_of_the_analog_filter(turn):
    robot = DifferentialDrive(acceleration=0.5)
    path = Trajectory.from_poses(robot, [(1, 1, 0), (9, 1, 0), (9 + 8 * np.cos(turn), 1 + 8 * np.sin(turn), turn)])
    executed = path.execution()
    times = np.linspace(0, executed.duration, 20_001)
    states, (_, change) = executed.at(times), executed.rates(times)
    ahead = change.x * np.cos(states.yaw) + change.y * np.sin(states.yaw)
    out = ahead
    for numerator, denominator in sections():
        _, out, _ = lsim(TransferFunction(numerator, denominator), out, times)
    expected = np.sqrt(np.trapezoid(out**2, times))
    assert trajectory_cost(MSDV(), path, WORLD) == pytest.approx(expected, rel=0.01)


def test_turning_about_the_camera_has_no_dose_but_a_camera_off_the_axis_swings():
    poses = [(1, 1, 0), (1, 1, 3)]
    doses = [
        trajectory_cost(MSDV(), Trajectory.from_poses(DifferentialDrive(camera_offset=offset), poses), WORLD)
        for offset in ((0.0, 0.0), (0.2, 0.0), (0.0, 0.4))
    ]
    assert doses[0] == 0.0
    assert doses[2] == pytest.approx(2 * doses[1])
    assert doses[1] > 0


def test_the_dose_only_grows():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (9, 1, 0), (9, 9, 2)])
    running = running_costs(MSDV(), path, WORLD)
    assert (np.diff(running) > 0).all()


def test_its_group_unit_and_aggregate():
    assert (MSDV.group, MSDV.unit, MSDV.aggregate) == ("C", "m/s^1.5", "trajectory")
