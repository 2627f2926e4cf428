"""Openness: means of closed-form isovists along a way."""

import numpy as np
import pytest
import shapely
from scipy.integrate import quad

from hpop.criteria import Enclosure, Openness, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

MODEL = DifferentialDrive()


def closed(d, r):
    """Share of a disc beyond a wall at distance d of its centre: a circular segment."""
    return (r * r * np.arccos(d / r) - d * np.sqrt(r * r - d * d)) / (np.pi * r * r) if d < r else 0.0


def test_the_way_to_a_wall_costs_the_mean_of_the_segments_that_it_cuts_off():
    r = 2.0
    world = World.from_polygons([shapely.box(9, -30, 10, 30)], extent=shapely.box(0, -10, 9, 10))
    way = Trajectory.from_poses(MODEL, [(3, 0, 0), (8.5, 0, 0)])
    expected, _ = quad(lambda x: closed(9 - x, r), 3, 8.5, points=[7])
    assert trajectory_cost(Openness(r), way, world) == pytest.approx(expected / 5.5, abs=2e-3)
    assert trajectory_cost(Openness(r).integral, way, world) == pytest.approx(expected / MODEL.speed, abs=1e-2)


def test_nothing_to_see_but_free_space_costs_nothing():
    world = World.from_polygons([], extent=shapely.box(0, 0, 10, 5))
    assert trajectory_cost(Openness(), Trajectory.from_poses(MODEL, [(1, 1, 0), (8, 4, 2)]), world) == 0.0


def test_a_thin_wall_closes_as_much_as_a_thick_one():
    way = Trajectory.from_poses(MODEL, [(1, 4, 0), (5, 4, 0)])
    costs = []
    for thickness in (0.05, 2.0):
        world = World.from_polygons([shapely.box(6, 0, 6 + thickness, 8)], extent=shapely.box(0, 0, 12, 8))
        costs.append(trajectory_cost(Openness(), way, world))
    assert costs[0] == pytest.approx(costs[1], abs=1e-9)
    assert costs[0] > 0.05


def test_the_mean_stands_for_its_integral():
    assert Openness(3.0).integral == Enclosure(3.0)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan, 1e4])
@pytest.mark.parametrize("cls", [Openness, Enclosure])
def test_an_isovist_needs_a_radius(cls, radius):
    with pytest.raises(CriterionError, match="radius"):
        cls(radius)
