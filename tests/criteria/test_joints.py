"""Joints of arms: length, energy, limits and singularity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import JointEnergy, JointLength, JointLimits, Singularity, motion_costs, trajectory_cost
from hpop.criteria.robot.joints import manipulability
from hpop.errors import CriterionError
from hpop.motions import Motions, States
from tests.jointed import Jointed, agrees_everywhere, jacobian, moments, states_of, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def test_a_straight_reach_is_as_long_as_its_chord():
    reach = tour(Jointed(), [(0.0, 0.1, 0.2), (0.3, 0.5, 1.4)])
    assert trajectory_cost(JointLength(), reach, WORLD) == pytest.approx(np.sqrt(0.3**2 + 0.4**2 + 1.2**2), rel=1e-12)


def test_it_adds_up_on_edges_trajectories_and_symbols_for_joint_length():
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


def test_what_it_declares_for_joint_length():
    assert (JointLength.group, JointLength.unit, JointLength.aggregate) == ("R", "rad", "sum")


def test_a_reach_of_one_joint_costs_its_trapezoid():
    """Ramps of v/a = .5 s whose speed squared is a third of v² on average, and cruising at v = 1 in between."""
    reach = tour(Jointed(), [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0)])
    assert reach.duration == pytest.approx(2.0)
    assert trajectory_cost(JointEnergy(), reach, WORLD) == pytest.approx(2 * 0.5 / 3 + 1.0, rel=1e-12)


@pytest.mark.parametrize("angle", [0.1, 0.7, 2.2])
def test_none_is_cheaper_than_an_even_motion_of_the_same_duration(angle):
    reach = tour(Jointed(), [(0.0, 0.0, 0.0), (angle, 0.0, 0.0)])
    assert trajectory_cost(JointEnergy(), reach, WORLD) >= angle**2 / reach.duration


def test_it_adds_up_on_edges_trajectories_and_symbols_for_joint_energy():
    agrees_everywhere(JointEnergy(), Jointed(), WORLD)


def test_what_it_declares_for_joint_energy():
    assert (JointEnergy.group, JointEnergy.unit, JointEnergy.aggregate) == ("R", "rad²/s", "sum")


def share(model, row):
    """Cost a second in a posture that hardly changes."""
    here, there = (states_of(model, [(row[0] + change, *row[1:])]) for change in (0.0, 1e-7))
    motions = Motions(WORLD, model, model.laws["reach"], here, there)
    return float(motion_costs(JointLimits(), motions)[0] / motions.duration[0])


def test_stops_cost_one_the_middle_nothing_and_half_way_a_quarter():
    model = Jointed()  # "twist" turns without end: it has no stops
    assert share(model, (0.0, 0.0, 2.0)) == pytest.approx(0.0, abs=1e-12)
    assert share(model, (2.5, -1.2, 0.0)) == pytest.approx(1.0, rel=1e-6)
    assert share(model, (1.25, 0.6, 0.0)) == pytest.approx(0.25, rel=1e-6)
    assert share(model, (2.5, 0.0, 0.0)) == pytest.approx(0.5, rel=1e-6)


def test_it_is_the_mean_square_of_what_is_sampled():
    model, trajectory = Jointed(), tour(Jointed())
    count = 20_000
    states = trajectory.at((np.arange(count) + 0.5) * trajectory.duration / count)
    rate = 0.5 * ((states.swing / 2.5) ** 2 + (states.lift / 1.2) ** 2)
    assert agrees_everywhere(JointLimits(), model, WORLD) == pytest.approx(rate.mean() * trajectory.duration, rel=1e-5)


def test_a_head_that_cannot_tilt_and_pans_all_round_has_no_stops():
    head = hpop.PanTilt(pan="all round", tilt=(0.0, 0.0))
    pan = hpop.Trajectory(head, states_of(head, [(0, 0, 0, 0, 0), (0, 0, 0, 1, 0)]), ("pan",))
    assert trajectory_cost(JointLimits(), pan, WORLD) == 0.0
    stops = replace(head, pan=(-1.0, 1.0))
    at_a_stop = hpop.Trajectory(stops, states_of(stops, [(0, 0, 0, 1, 0), (3, 0, 0, 1, 0)]), ("move",))
    assert trajectory_cost(JointLimits(), at_a_stop, WORLD) == pytest.approx(at_a_stop.duration)


def test_what_it_declares_for_joint_limits():
    assert (JointLimits.group, JointLimits.unit, JointLimits.aggregate) == ("R", "s", "sum")


def test_manipulability_is_the_root_of_the_determinant_of_the_jacobian_by_differences():
    rng = np.random.default_rng(0)
    model = Jointed()
    rows = rng.uniform(-1.1, 1.1, (30, 3))
    found = manipulability(model, states_of(model, rows))
    expected = [math.sqrt(np.linalg.det(j.T @ j)) for j in (jacobian(model, "camera", row) for row in rows)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


class Many:
    """Joints that move a tool by given columns of a Jacobian, whatever the state."""

    def __init__(self, columns):
        self.columns = np.array(columns)  # (n, 6)
        self.joints = tuple(f"q{i}" for i in range(len(self.columns)))
        self.provides = frozenset({"tool", "joints"})
        self.space = type("Space", (), {"names": self.joints})

    def twist(self, body, states, rates):
        assert body == "tool"
        total = sum(getattr(rates, name)[:, None] * row for name, row in zip(self.joints, self.columns, strict=True))

        class Twist:
            velocity, rotation = tuple(total.T[:3]), tuple(total.T[3:])

        return Twist


@pytest.mark.parametrize("joints", [2, 6, 7, 9])
def test_it_is_the_product_of_the_singular_values_of_any_jacobian(joints):
    rng = np.random.default_rng(joints)
    columns = rng.normal(size=(joints, 6))
    states = States(**{f"q{i}": np.zeros(2) for i in range(joints)})
    product = np.prod(np.linalg.svd(columns, compute_uv=False))
    np.testing.assert_allclose(manipulability(Many(columns), states), product, rtol=1e-9)
    columns[0] = 0.0 if joints <= 6 else columns[0]
    columns[:, 0] *= joints <= 6  # seven joints that cannot move the tool along x
    np.testing.assert_allclose(manipulability(Many(columns), states), 0.0, atol=1e-9)


def test_a_second_costs_half_where_manipulability_is_the_half_and_all_where_there_is_none():
    """Tilted up to the zenith the pan turns the camera about its own view, but the head turns still: μ is 1 always."""
    head = hpop.PanTilt(tilt=(-1.5, 1.5))
    tilt = hpop.Trajectory(head, states_of(head, [(0, 0, 0, 0.3, -1), (0, 0, 0, 0.3, 1.4)]), ("tilt",))
    for half in (1.0, 3.0):
        expected = tilt.duration / (1 + 1 / half)
        assert trajectory_cost(Singularity(half=half), tilt, WORLD) == pytest.approx(expected, rel=1e-9)


def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled():
    trajectory = tour(Jointed())
    times, step, *_ = moments(trajectory, 4_000)
    mu = manipulability(Jointed(), trajectory.at(times))
    expected = np.sum(1.0 / (1.0 + mu / 0.2)) * step
    assert agrees_everywhere(Singularity(half=0.2), Jointed(), WORLD) == pytest.approx(expected, rel=1e-4)


def test_what_it_declares_for_singularity():
    assert (Singularity.group, Singularity.unit, Singularity.aggregate) == ("R", "s", "sum")
    with pytest.raises(CriterionError, match="half must be a manipulability"):
        Singularity(half=0.0)
