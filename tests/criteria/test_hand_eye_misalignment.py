"""Hand-eye misalignment: the angle of the rotation between what the hand does and what the eye sees."""

import math

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import hpop
from hpop.criteria import HandEyeMisalignment, trajectory_cost
from hpop.errors import CriterionError
from tests.jointed import Jointed, agrees_everywhere, moments, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


@pytest.mark.parametrize("heading", [0.0, 0.4, -2.0, math.pi])
def test_a_level_camera_is_off_by_the_difference_of_yaws(heading):
    x, y = math.cos(heading), math.sin(heading)
    drive = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, heading), (x, y, heading)])
    off = abs(math.remainder(heading - 0.4, 2 * math.pi))
    found = trajectory_cost(HandEyeMisalignment(yaw=0.4), drive, WORLD)
    assert found == pytest.approx(off * drive.duration, rel=1e-9, abs=1e-9)


def test_it_adds_up_on_edges_trajectories_and_symbols_as_rotations_by_scipy():
    trajectory = tour(Jointed())
    _, step, _, axes = moments(trajectory, 4000)
    eye = Rotation.from_matrix(np.moveaxis(axes, (0, 1, 2), (2, 1, 0)))  # columns: ahead, left, up
    angle = (Rotation.from_euler("z", 0.4).inv() * eye).magnitude()
    found = agrees_everywhere(HandEyeMisalignment(yaw=0.4), Jointed(), WORLD)
    assert found == pytest.approx(np.sum(angle) * step, rel=1e-4)


def test_what_it_declares():
    assert (HandEyeMisalignment.group, HandEyeMisalignment.aggregate) == ("P", "sum")
    with pytest.raises(CriterionError, match="yaw must be an angle in rad"):
        HandEyeMisalignment(yaw=90.0)
