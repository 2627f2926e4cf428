"""Turns: N counts turns in place, whatever their angle."""

import numpy as np
import pytest
import shapely

from hpop.criteria import Turns, motion_costs, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive()


@pytest.mark.parametrize(
    ("poses", "count"),
    [
        ([(0, 0, 0)], 0),
        ([(0, 0, 0), (5, 0, 0)], 0),
        ([(0, 0, 1), (5, 0, 0)], 1),  # at the start
        ([(0, 0, 0), (5, 0, 1)], 1),  # at the goal
        ([(0, 0, 0), (5, 0, 0), (5, 5, np.pi / 2)], 1),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], 0),
        ([(0, 0, np.pi), (5, 0, 0), (5, 5, 0)], 3),
        ([(0, 0, 0), (0, 0, 1), (0, 0, 2)], 2),
    ],
)
def test_turns_in_place_are_counted_at_start_goal_and_between(poses, count):
    trajectory = Trajectory.from_poses(ROBOT, poses)
    assert trajectory_cost(Turns(), trajectory, WORLD) == count
    assert trajectory_cost(Turns(), trajectory.execution(), WORLD) == count


@pytest.mark.parametrize("kind", ["turn", "spin"])
def test_a_turn_counts_once_it_exceeds_one_degree_either_way(kind):
    degrees = np.array([0.5, 0.999, 1.001, 179.0, -0.999, -1.001, -90.0])
    nothing = 0.0 * degrees
    start, end = States(x=nothing, y=nothing, yaw=nothing), States(x=nothing, y=nothing, yaw=np.radians(degrees))
    costs = motion_costs(Turns(), Motions(WORLD, ROBOT, ROBOT.laws[kind], start, end))
    assert costs.tolist() == [0, 0, 1, 1, 0, 1, 1]


def test_turns_are_whole_numbers_and_have_no_gradient():
    assert (Turns.group, Turns.unit, Turns.quantum, Turns.smooth) == ("C", "1", 1.0, False)
