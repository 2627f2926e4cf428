"""The nearest place where a robot is free, against a closed form and against all places of a fine grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.planners.needs import elsewhere, nearest_free

BLOCK = hpop.World.from_polygons([shapely.box(4, 2, 6, 4)], extent=shapely.box(0, 0, 10, 6))
ROBOT = hpop.DifferentialDrive(radius=0.3)


def at(model, x, y, yaw=0.0):
    return model.space.state((x, y, yaw), free=model.space.angles)


@pytest.mark.parametrize(
    ("x", "y", "away"),
    [
        (4.5, 3.0, 0.5 + 0.3),  # in the block, nearest to its left side
        (5.9, 3.0, 0.1 + 0.3),
        (0.1, 3.0, 0.2),  # too near to the border
        (-2.0, 3.0, 2.3),  # beside the map
        (4.0, 4.0, 0.3),  # the corner of the block
    ],
)
def test_the_place_is_free_and_as_near_as_its_spacing_tells(x, y, away):
    found = nearest_free(ROBOT, BLOCK, at(ROBOT, x, y))
    assert ROBOT.collision(BLOCK).states_free(found).all()
    there = math.hypot(found.x[0] - x, found.y[0] - y)
    assert away - 1e-9 <= there <= away + 0.05 * math.sqrt(2)
    assert f"({found.x[0]:.4g}, {found.y[0]:.4g}), {there:.2f} m away" in elsewhere(ROBOT, BLOCK, at(ROBOT, x, y))


def test_no_place_of_the_same_grid_is_nearer():
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.arange(0, 201) / 20, np.arange(0, 121) / 20), axis=-1).reshape(-1, 2)
    free = np.array([BLOCK.clearance(*grid.T) >= 0.3 - 1e-9]).ravel()
    for x, y in rng.uniform((4.0, 2.0), (6.0, 4.0), (10, 2)):
        found = nearest_free(ROBOT, BLOCK, at(ROBOT, x, y))
        nearest = np.hypot(*(grid[free] - (x, y)).T).min()
        # What is farther than 1 m is looked for on a coarser grid.
        assert math.hypot(found.x[0] - x, found.y[0] - y) <= max(nearest + 1e-9, 1.0 + 0.1)


def test_a_goal_whose_heading_is_free_may_be_reached_at_another():
    bar = hpop.DifferentialDrive(footprint=[(-0.6, -0.1), (0.6, -0.1), (0.6, 0.1), (-0.6, 0.1)])
    slot = hpop.World.from_polygons([], extent=shapely.box(0, 0, 0.5, 4))
    assert nearest_free(bar, slot, at(bar, 0.1, 2.0, 0.0)) is None  # across, it is nowhere free
    assert elsewhere(bar, slot, at(bar, 0.1, 2.0, 0.0)) == ""
    found = nearest_free(bar, slot, at(bar, 0.1, 2.0, None))
    assert bar.collision(slot).states_free(found).all()


@pytest.mark.parametrize("planner", ["lattice", "roadmap"])
def test_a_planner_that_refuses_an_end_names_a_place_from_which_it_plans(planner):
    for start, goal in (((5.0, 2.2, 0.0), (9.0, 3.0, 0.0)), ((1.0, 3.0, 0.0), (5.0, 2.2, None))):
        with pytest.raises(QueryError, match=r"free is \(5, 1.7\), 0.50 m away\.$"):
            hpop.Problem(BLOCK, ROBOT, start, goal, ["length"]).solve(planner)
    assert len(hpop.Problem(BLOCK, ROBOT, (5.0, 1.7, 0.0), (9.0, 3.0, 0.0), ["length"]).solve("lattice"))
