"""Curvature sign changes: inflections of known curves, with noise and without, and turns in place."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import CurvatureSignChanges, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50))


def count(trajectory, **parameters):
    return trajectory_cost(CurvatureSignChanges(**parameters), trajectory, WORLD)


def polyline(*turns):
    """Return a trajectory of moves of one metre with turns in place (rad) between them."""
    heading, x, y, poses = 0.0, 0.0, 0.0, [(0.0, 0.0, 0.0)]
    for turn in (0.0, *turns):
        heading += turn
        x, y = x + np.cos(heading), y + np.sin(heading)
        poses.append((x, y, heading))
    return Trajectory.from_poses(DifferentialDrive(), poses)


@pytest.mark.parametrize(
    ("turns", "flips"),
    [((), 0), ((0.5,), 0), ((0.5, 0.7, 2.0), 0), ((0.5, -0.5), 1), ((0.5, -0.5, 0.5, -0.5), 3), ((-1, -1, 1, 1), 1)],
)
def test_turns_in_place_count_by_their_sense(turns, flips):
    assert count(polyline(*turns)) == flips


@given(st.lists(st.sampled_from([-2.0, -0.3, 0.3, 1.0]), max_size=12))
def test_a_polyline_has_as_many_as_its_turns_change_sense(turns):
    assert count(polyline(*turns)) == sum(a * b < 0 for a, b in pairwise(turns))


def test_a_turn_in_place_of_less_than_a_degree_is_none():
    assert count(polyline(0.5, np.deg2rad(-0.9), 0.5)) == 0
    assert count(polyline(0.5, np.deg2rad(-1.1), 0.5)) == 2


def test_turns_in_place_that_undo_each_other_are_both_seen(arcs):
    assert count(arcs([1.0, 0.0, 0.0, 1.0], [0.0, 1.0, -1.0, 0.0])) == 1


@pytest.mark.parametrize("half_waves", [1, 2, 5])
@pytest.mark.parametrize("pieces", [60, 997])
def test_a_sine_has_an_inflection_between_any_two_half_waves(arcs, half_waves, pieces):
    x = np.linspace(0.0, half_waves * np.pi, pieces)
    length, rotation = np.hypot(np.diff(x), np.diff(np.sin(x))), np.diff(np.arctan(np.cos(x)))
    assert count(arcs(length, rotation)) == half_waves - 1


def test_noise_of_a_recorded_track_is_no_curvature(arcs):
    rng = np.random.default_rng(3)
    rotation = np.full(400, 0.01 / 2.0)  # a circle of radius 2 m in steps of a centimetre
    wobble = np.diff(rng.normal(0.0, 0.004, 401))
    assert np.sum(np.diff(np.sign(rotation + wobble)) != 0) > 100
    assert count(arcs(np.full(400, 0.01), rotation + wobble)) == 0


def test_less_curvature_than_least_is_straight(arcs):
    slalom = arcs([3.0, 3.0, 3.0], [0.12, -0.12, 0.12])  # radius 25 m
    assert count(slalom, least=0.03) == 2
    assert count(slalom, least=0.05) == 0


def test_pieces_are_no_longer_than_the_spacing(arcs):
    slalom = arcs([0.25] * 12, [0.2, -0.2] * 6)  # each bend is one piece
    assert count(slalom, spacing=0.25) == 11


def test_straight_parts_between_bends_to_one_side_are_no_change(arcs):
    assert count(arcs([1.0, 5.0, 1.0], [0.5, 0.0, 0.5])) == 0
    assert count(arcs([1.0, 5.0, 1.0], [0.5, 0.0, -0.5])) == 1


def test_an_arc_to_the_other_side_than_a_turn_in_place_is_one_change(arcs):
    assert count(arcs([2.0, 0.0, 2.0], [0.0, 1.0, -1.0])) == 1
    assert count(arcs([2.0, 0.0, 2.0], [0.0, 1.0, 1.0])) == 0


def test_the_running_count_rises_where_the_sign_flips(arcs):
    trajectory = arcs([1.0, 0.0, 1.0, 1.0, 0.0], [0.4, -1.0, 0.0, 0.5, 1.0])
    assert running_costs(CurvatureSignChanges(), trajectory, WORLD).tolist() == [0, 1, 1, 2, 2]


@pytest.mark.parametrize("parameters", [{"spacing": 0.0}, {"spacing": np.nan}, {"least": -1.0}, {"least": np.inf}])
def test_parameters_must_be_lengths_and_curvatures(parameters):
    with pytest.raises(CriterionError, match=f"{next(iter(parameters))} must be"):
        CurvatureSignChanges(**parameters)
