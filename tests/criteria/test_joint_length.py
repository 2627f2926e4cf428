"""Joint length: the length of the path in joint space, straight or cut, of an arm or of a head on a base."""

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import JointLength, trajectory_cost
from hpop.errors import CriterionError
from tests.jointed import Jointed, agrees_everywhere, states_of, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def test_a_straight_reach_is_as_long_as_its_chord():
    reach = tour(Jointed(), [(0.0, 0.1, 0.2), (0.3, 0.5, 1.4)])
    assert trajectory_cost(JointLength(), reach, WORLD) == pytest.approx(np.sqrt(0.3**2 + 0.4**2 + 1.2**2), rel=1e-12)


def test_it_adds_up_on_edges_trajectories_and_symbols():
    rows = np.array([(0.0, 0.1, 0.2), (1.1, -0.6, 1.5), (-0.4, 0.9, -0.7), (-0.4, 0.9, 0.8)])
    expected = np.linalg.norm(np.diff(rows, axis=0), axis=1).sum()
    assert agrees_everywhere(JointLength(), Jointed(), WORLD) == pytest.approx(expected, rel=1e-12)


def test_the_joints_of_a_head_on_a_base_are_its_pan_and_tilt():
    head = hpop.PanTilt()
    rows = [(0, 0, 0, 0, 0), (2, 0, 0, 0, 0), (2, 0, 0, 0.5, 0), (2, 0, 1, 0.5, 0), (2, 0, 1, 0.5, -0.2)]
    walk = hpop.Trajectory(head, states_of(head, rows), ("move", "pan", "turn", "tilt"))
    assert trajectory_cost(JointLength(), walk, WORLD) == pytest.approx(0.7)


def test_a_robot_without_joints_is_refused_by_name():
    drive = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(CriterionError, match="'joint_length' requires joints"):
        trajectory_cost(JointLength(), drive, WORLD)


def test_what_it_declares():
    assert (JointLength.group, JointLength.unit, JointLength.aggregate) == ("R", "rad", "sum")
