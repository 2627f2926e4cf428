"""Orientation of viewer and operator."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import hpop
from hpop.criteria import HandEyeMisalignment, NetMisalignment, OrientationRetention, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from tests.jointed import Jointed, agrees_everywhere, moments, tour

MODEL = DifferentialDrive()
WORLD_ORIENTATION_RETENTION = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50))


def turning(*degrees):
    """Return turns by these degrees, a move of 1 m between them; None omits a move, so that two turns meet."""
    x, y, yaw, states, kinds = 0.0, 0.0, 0.0, [(0.0, 0.0, 0.0)], []
    for k, turn in enumerate(degrees):
        if turn is None:
            continue
        if k and degrees[k - 1] is not None:
            x, y = x + np.cos(yaw), y + np.sin(yaw)
            states.append((x, y, yaw))
            kinds.append("move")
        yaw += np.deg2rad(turn)
        states.append((x, y, yaw))
        kinds.append("turn")
    columns = np.array(states).T
    return Trajectory(MODEL, States(x=columns[0], y=columns[1], yaw=columns[2]), tuple(kinds))


def degrees(criterion, *turns):
    return np.rad2deg(trajectory_cost(criterion, turning(*turns), WORLD_ORIENTATION_RETENTION))


@pytest.mark.parametrize(
    ("turns", "missed", "net"),
    [
        ([90, -90, 180], 0, 0),
        ([100], 10, 10),
        ([100, -100], 20, 0),
        ([100, 100], 20, 20),
        ([80, 100, 30], 50, 30),
        ([135], 45, 45),  # halfway: the smaller one, 90
        ([45, 45], 90, 90),
        ([40, 40, 40, 40, 40], 200, 160),  # 200 is a turn by -160
        ([], 0, 0),
    ],
)
def test_turns_by_hand(turns, missed, net):
    assert degrees(OrientationRetention(), *turns) == pytest.approx(missed, abs=1e-9)
    assert degrees(NetMisalignment(), *turns) == pytest.approx(net, abs=1e-9)


def test_eighths_of_a_turn_are_round_numbers_if_asked():
    assert degrees(OrientationRetention(np.pi / 4), 45, 135, -90, 50) == pytest.approx(5)
    assert degrees(NetMisalignment(np.pi / 4), 45, 135, -90, 50) == pytest.approx(5)


def test_turns_without_a_move_between_are_one_turn_to_whoever_remembers():
    assert degrees(OrientationRetention(), 45, None, 45) == pytest.approx(90)
    assert degrees(NetMisalignment(), 45, None, 45) == pytest.approx(0, abs=1e-9)
    assert degrees(NetMisalignment(), 100, 30, None, 50) == pytest.approx(0, abs=1e-9)  # 10 + (80 - 90)


def test_the_running_value_is_known_after_each_motion():
    values = running_costs(NetMisalignment(), turning(100, 30, None, 50, -20), WORLD_ORIENTATION_RETENTION)
    assert np.rad2deg(values) == pytest.approx([10, 10, 40, 0, 0, 20], abs=1e-9)


@given(st.lists(st.floats(-179, 179), max_size=8))
def test_the_sum_bounds_the_misalignment_in_the_end(turns):
    assert degrees(NetMisalignment(), *turns) <= degrees(OrientationRetention(), *turns) + 1e-9


@given(st.integers(-179, 179), st.sampled_from([30.0, 45.0, 90.0, 180.0]))
def test_a_turn_is_off_by_its_distance_to_the_nearest_multiple(turn, multiple):
    nearest = min(abs(turn - k * multiple) for k in range(-7, 8))
    assert degrees(OrientationRetention(np.deg2rad(multiple)), turn) == pytest.approx(nearest, abs=1e-6)


@pytest.mark.parametrize("multiple", [0.0, -1.0, 3.2, 90.0, np.nan])
@pytest.mark.parametrize("cls", [OrientationRetention, NetMisalignment])
def test_a_multiple_is_an_angle(cls, multiple):
    with pytest.raises(CriterionError, match="multiple"):
        cls(multiple)


WORLD_HAND_EYE_MISALIGNMENT = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


@pytest.mark.parametrize("heading", [0.0, 0.4, -2.0, math.pi])
def test_a_level_camera_is_off_by_the_difference_of_yaws(heading):
    x, y = math.cos(heading), math.sin(heading)
    drive = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, heading), (x, y, heading)])
    off = abs(math.remainder(heading - 0.4, 2 * math.pi))
    found = trajectory_cost(HandEyeMisalignment(yaw=0.4), drive, WORLD_HAND_EYE_MISALIGNMENT)
    assert found == pytest.approx(off * drive.duration, rel=1e-9, abs=1e-9)


def test_it_adds_up_on_edges_trajectories_and_symbols_as_rotations_by_scipy():
    trajectory = tour(Jointed())
    _, step, _, axes = moments(trajectory, 4000)
    eye = Rotation.from_matrix(np.moveaxis(axes, (0, 1, 2), (2, 1, 0)))  # columns: ahead, left, up
    angle = (Rotation.from_euler("z", 0.4).inv() * eye).magnitude()
    found = agrees_everywhere(HandEyeMisalignment(yaw=0.4), Jointed(), WORLD_HAND_EYE_MISALIGNMENT)
    assert found == pytest.approx(np.sum(angle) * step, rel=1e-4)


def test_what_it_declares():
    assert (HandEyeMisalignment.group, HandEyeMisalignment.aggregate) == ("P", "sum")
    with pytest.raises(CriterionError, match="yaw must be an angle in rad"):
        HandEyeMisalignment(yaw=90.0)
