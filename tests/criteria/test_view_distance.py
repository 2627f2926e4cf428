"""View distance: nothing within the band, metres times seconds outside it."""

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import ViewDistance, trajectory_cost
from hpop.errors import CriterionError
from tests.jointed import Jointed, agrees_everywhere, moments, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))
TARGET = (0.6, 0.5, 0.4)


def test_driving_past_a_band_costs_two_triangles():
    """From 4 m to 1 m before the target at 1 m/s; the band is from 2 to 3 m."""
    model = hpop.DifferentialDrive(camera_height=1.0)
    drive = hpop.Trajectory.from_poses(model, [(0, 0, 0), (3, 0, 0)])
    criterion = ViewDistance((4.0, 0.0, 1.0), near=2.0, far=3.0)
    assert trajectory_cost(criterion, drive, WORLD) == pytest.approx(0.5 + 0.5, rel=1e-6)
    assert trajectory_cost(ViewDistance((4.0, 0.0, 1.0), near=0.5, far=4.5), drive, WORLD) == 0.0


def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled():
    trajectory = tour(Jointed())
    _, step, place, _ = moments(trajectory, 20_000)
    distance = np.linalg.norm(np.array(TARGET)[:, None] - place, axis=0)
    expected = np.sum(np.maximum(0.3 - distance, 0) + np.maximum(distance - 0.5, 0)) * step
    found = agrees_everywhere(ViewDistance(TARGET, near=0.3, far=0.5), Jointed(), WORLD)
    assert found == pytest.approx(expected, rel=1e-3)


def test_what_it_declares():
    assert (ViewDistance.group, ViewDistance.unit, ViewDistance.aggregate) == ("P", "m s", "sum")
    with pytest.raises(CriterionError, match="near must not exceed far"):
        ViewDistance(TARGET, near=1.0, far=0.5)
