"""Camera length: the way of the camera in space, whatever carries it."""

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import CameraLength, trajectory_cost
from tests.jointed import Jointed, agrees_everywhere, camera_at, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def test_in_a_hand_it_is_the_length_of_the_places_one_after_another():
    trajectory = tour(Jointed())
    place, _ = camera_at(trajectory, np.linspace(0, trajectory.duration, 1_001))
    expected = np.linalg.norm(np.diff(place, axis=1), axis=0).sum()
    assert agrees_everywhere(CameraLength(), Jointed(), WORLD) == pytest.approx(expected, rel=1e-4)


def test_a_turn_of_the_base_swings_a_camera_beside_its_axis():
    model = hpop.DifferentialDrive(camera_offset=(0.3, -0.4))
    walk = hpop.Trajectory.from_poses(model, [(0, 0, 0), (2, 0, 0), (2, 0, 1.2)])
    assert trajectory_cost(CameraLength(), walk, WORLD) == pytest.approx(2.0 + 0.5 * 1.2)


def test_what_it_declares():
    assert (CameraLength.group, CameraLength.unit, CameraLength.aggregate) == ("C", "m", "sum")
