"""Bending energy: circles in closed form, rounded corners by finite differences."""

import numpy as np
import pytest
import shapely

from hpop.criteria import BendingEnergy, Rotation, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50))


def cost(trajectory, **parameters):
    return trajectory_cost(BendingEnergy(**parameters), trajectory, WORLD)


def along(line, samples=4001):
    """∫ κ² ds of a polyline that is dense in every bend, by finite differences of its heading."""
    way = np.linspace(0.0, line.length, samples)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, way))
    heading = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    return np.sum(np.diff(heading) ** 2) / way[1]


def test_a_half_circle_costs_pi_over_its_radius(arcs):
    assert cost(arcs([3 * np.pi], [np.pi])) == pytest.approx(np.pi / 3, rel=1e-12)


def test_a_circle_in_many_pieces_costs_the_same_as_in_one(arcs):
    assert cost(arcs([0.1] * 60, [0.05] * 60)) == pytest.approx(cost(arcs([6.0], [3.0])), rel=1e-12)


def test_straight_moves_cost_nothing():
    assert cost(Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (5, 0, 0)])) == 0.0


@pytest.mark.cases("0.5")
@pytest.mark.parametrize("rounding", [0.3, 0.5, 1.0])
def test_corners_cost_what_the_path_with_rounded_corners_bends(rounding):
    corners = [(0, 0), (4, 0), (4, 4), (9, 4)]
    left = [(0, 0), (4 - rounding, 0)]
    angles = np.linspace(0, np.pi / 2, 2001)
    first = np.stack([4 - rounding + rounding * np.sin(angles), rounding - rounding * np.cos(angles)], axis=1)
    second = np.stack([4 + rounding - rounding * np.cos(angles), 4 - rounding + rounding * np.sin(angles)], axis=1)
    smooth = shapely.LineString(np.concatenate([left, first, second, [(9, 4)]]))
    poses = [(*corner, yaw) for corner, yaw in zip(corners, (0, 0, np.pi / 2, 0), strict=True)]
    trajectory = Trajectory.from_poses(DifferentialDrive(), poses)
    assert cost(trajectory, rounding=rounding) == pytest.approx(along(smooth), rel=0.02)


def test_a_curve_sharper_than_the_rounding_costs_as_the_rounded_corner(arcs):
    corner = cost(arcs([0.0], [np.pi / 2]), rounding=0.5)
    assert corner == pytest.approx(np.pi)
    assert cost(arcs([0.1 * np.pi / 2], [np.pi / 2]), rounding=0.5) == pytest.approx(corner)
    assert cost(arcs([0.6 * np.pi / 2], [np.pi / 2]), rounding=0.5) < corner


def test_piecewise_linear_trajectories_rank_by_their_total_rotation():
    poses = [(0, 0, 1), (3, 1, 2), (2, 5, -1), (8, 8, 0)]
    trajectory = Trajectory.from_poses(DifferentialDrive(), poses)
    assert cost(trajectory, rounding=0.25) == pytest.approx(trajectory_cost(Rotation(), trajectory, WORLD) / 0.25)


@pytest.mark.parametrize("rounding", [0.0, -1.0, np.inf, np.nan])
def test_the_rounding_must_be_a_radius(rounding):
    with pytest.raises(CriterionError, match="rounding must be a positive radius"):
        BendingEnergy(rounding)
