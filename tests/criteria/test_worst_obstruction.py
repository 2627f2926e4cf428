"""Worst obstruction: against the cap of a ball, and against dense sampling."""

import numpy as np
import pytest
import shapely

from hpop.criteria import Obstruction, WorstObstruction, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

MODEL = DifferentialDrive()


def test_driving_up_to_a_wall_costs_the_cap_at_the_end():
    r, d = 2.0, 1.0
    world = World.from_polygons([shapely.box(8, -20, 20, 20)], extent=shapely.box(0, -5, 8, 5))
    up_and_back = Trajectory.from_poses(MODEL, [(1, 0, 0), (8 - d, 0, 0), (1, 0, 0)])
    cap = (r - d) ** 2 * (2 * r + d) / (4 * r**3)
    assert trajectory_cost(WorstObstruction(r), up_and_back, world) == pytest.approx(cap, abs=3e-3)


def test_a_short_squeeze_in_a_long_walk_costs_what_it_costs_there():
    posts = [shapely.box(14, 0.8, 15, 6), shapely.box(14, -6, 15, -0.8)]
    world = World.from_polygons(posts, extent=shapely.box(0, -6, 30, 6))
    walk = Trajectory.from_poses(MODEL, [(1, 0, 0), (29, 0, 0)])
    s = walk.at(np.linspace(0, walk.duration, 20_001))
    phi = world.obstruction_field(2.0, MODEL.camera_height)(s.x, s.y)
    worst, mean = (trajectory_cost(c, walk, world) for c in (WorstObstruction(), Obstruction()))
    assert worst == pytest.approx(phi.max(), abs=1e-3)
    assert mean < worst / 4


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan, 1e4])
def test_a_ball_needs_a_radius(radius):
    with pytest.raises(CriterionError, match="radius"):
        WorstObstruction(radius)
