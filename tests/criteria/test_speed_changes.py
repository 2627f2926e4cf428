"""Changes of speed on the way: counted in plans and executions, not at starts, stops and turns."""

import numpy as np
import pytest
import shapely

from hpop.criteria import SpeedChanges, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.models.driven import driven
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive(speeds=(0.5, 1.0, 1.5))
KINDS = {"c": "speed_change", "m": "move", "t": "turn"}


@pytest.mark.parametrize(
    ("kinds", "speeds", "changes"),
    [
        ("cmc", (0, 1, 1, 0), 0),
        ("cmcmc", (0, 1, 1, 0.5, 0.5, 0), 1),
        ("cmcmcmc", (0, 1, 1, 1.5, 1.5, 1, 1, 0), 2),
        ("cmctcmc", (0, 1, 1, 0, 0, 0.5, 0.5, 0), 0),  # it stops between the two speeds
        ("cmccmc", (0, 0.5, 0.5, 1, 1.5, 1.5, 0), 2),  # one change to each neighbouring speed
    ],
)
def test_each_change_between_two_speeds_counts(kinds, speeds, changes):
    x = np.cumsum([0.0, *(3.0 * (kind == "m") for kind in kinds)])
    yaw = np.cumsum([0.0, *(np.pi / 2 * (kind == "t") for kind in kinds)])
    y = 0 * x
    if "t" in kinds:  # the second run goes up
        turned = kinds.index("t") + 1
        y[turned:] = x[turned:] - x[turned]
        x[turned:] = x[turned]
    states = States(x=x, y=y, yaw=yaw, speed=np.array(speeds, float))
    plan = Trajectory(ROBOT, states, tuple(KINDS[kind] for kind in kinds))
    assert trajectory_cost(SpeedChanges(), plan, WORLD) == changes
    executed = {"cmccmc": 1}.get(kinds, changes)  # two changes at one position are one ramp
    assert trajectory_cost(SpeedChanges(), plan.execution(), WORLD) == executed


def test_neither_one_speed_nor_a_curve_changes_it():
    plan = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (3, 0, 0), (3, 4, 1)])
    curve = driven(DifferentialDrive(), (0, 0, 0), [(1, 0, 1), (0.5, 0.3, 1), (-0.5, 0, 3)])
    for one in (plan, plan.execution(), curve):
        assert trajectory_cost(SpeedChanges(), one, WORLD) == 0


def test_it_is_a_count_of_comfort():
    assert (SpeedChanges.group, SpeedChanges.unit, SpeedChanges.quantum) == ("C", "1", 1.0)
