"""Camera roll: the slant of the horizon, as far as there is one in view."""

import math

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import CameraRoll, trajectory_cost
from tests.jointed import Jointed, agrees_everywhere, moments, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


@pytest.mark.parametrize(("lift", "twist"), [(0.0, 0.5), (0.7, 0.5), (0.7, -2.0), (0.0, math.pi)])
def test_a_posture_costs_its_roll_times_the_cosine_of_its_pitch(lift, twist):
    swing = tour(Jointed(), [(0.0, lift, twist), (1.0, lift, twist)])
    expected = abs(twist) * math.cos(lift) * swing.duration
    assert trajectory_cost(CameraRoll(), swing, WORLD) == pytest.approx(expected, rel=1e-9)


@pytest.mark.proof
def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled():
    trajectory = tour(Jointed())
    _, step, _, (_, left, up) = moments(trajectory, 4_000)
    expected = np.sum(np.hypot(left[2], up[2]) * np.abs(np.arctan2(left[2], up[2]))) * step
    assert agrees_everywhere(CameraRoll(), Jointed(), WORLD) == pytest.approx(expected, rel=1e-3)


def test_bases_and_heads_keep_the_horizon_level():
    walk = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (2, 0, 0), (2, 0, 1.2)])
    assert trajectory_cost(CameraRoll(), walk, WORLD) == 0.0


def test_what_it_declares():
    assert (CameraRoll.group, CameraRoll.unit, CameraRoll.aggregate) == ("C", "rad s", "sum")
