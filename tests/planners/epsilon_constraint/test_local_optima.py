"""A local optimum by the planner's claim is one by a search that shares no code with it."""

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.planners import EpsilonConstraint
from tests.planners.perturbed import Perturbation, random_question

BETTER = 1e-3  # share of the cost: what less can be gained is none


def gains(seed, points):
    """Return the possible gain near each point of a random room."""
    obstacles, problem, minimise = random_question(seed)
    try:
        found = EpsilonConstraint(step=0.5, minimise=minimise, max_points=points).solve(problem)
    except QueryError:  # the start or the goal is blocked
        return []
    search = Perturbation(obstacles, problem, minimise, seed)
    origins = zip(found.trajectories, found.provenance, strict=True)
    return [search.improvable(trajectory, origin["epsilon"]) for trajectory, origin in origins]


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.proof) for seed in (6, 8))])
def test_no_small_step_of_the_corners_gains_anything(seed):
    assert max(gains(seed, 1)) <= BETTER


@pytest.mark.proof
def test_of_three_hundred_points_in_random_rooms_hardly_one_can_be_improved():
    found, seed = [], 100
    while len(found) < 300:
        found += gains(seed, 3)
        seed += 1
    assert np.mean(np.array(found) > BETTER) <= 0.02


def test_one_corner_slides_back_until_the_block_is_as_near_as_it_may_be():
    """Straight on, then to the goal: shortest where the second segment is tangent to the circle round a corner."""
    block = shapely.box(3.0, 0.0, 4.0, 2.0)
    world = hpop.World.from_polygons([block], extent=shapely.box(0, 0, 9, 6))
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.3), (0.8, 3.0, 0.0), (8.2, 1.0, None), ["length"])
    corners = [(0.8, 3.0, 0.0), (7.0, 3.0, 0.0), (7.0, 3.0, float(np.arctan2(-2.0, 1.2)))]
    warm = hpop.Trajectory.from_poses(problem.model, [*corners, (8.2, 1.0, float(np.arctan2(-2.0, 1.2)))])
    found = EpsilonConstraint(warm_start=[warm], rounds=1).solve(problem)
    (length,) = found.planned[:, 0]
    # From the goal, the tangent to the circle of radius .3 round (4, 2), up to y = 3.
    far, bearing = np.hypot(4.2, 1.0), np.arctan2(1.0, -4.2)
    slope = np.tan(bearing - np.arcsin(0.3 / far))
    corner = 8.2 + 2.0 / slope
    assert length == pytest.approx(corner - 0.8 + np.hypot(8.2 - corner, 2.0), rel=1e-3)
