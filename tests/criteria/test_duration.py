"""Duration: of the planning law, and of what a robot executes."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Duration, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))


@given(st.floats(0.2, 2.0), st.floats(0.2, 3.0), st.floats(0.3, 2.0), st.floats(0.5, 4.0), st.floats(0.05, 3.1))
def test_an_l_shaped_path_lasts_what_pencil_and_paper_give(v, a, w, alpha, angle):
    robot = DifferentialDrive(speed=v, acceleration=a, turn_rate=w, turn_acceleration=alpha)
    trajectory = Trajectory.from_poses(robot, [(0, 0, 0), (3, 0, 0), (3 + 2 * np.cos(angle), 2 * np.sin(angle), angle)])
    spin = angle / w + w / alpha if angle >= w * w / alpha else 2 * np.sqrt(angle / alpha)
    assert trajectory_cost(Duration(), trajectory, WORLD) == pytest.approx(5 / v + spin + v / a)
    runs = [d / v + v / a if d >= v * v / a else 2 * np.sqrt(d / a) for d in (3, 2)]
    assert trajectory_cost(Duration(), trajectory.execution(), WORLD) == pytest.approx(sum(runs) + spin)


def test_duration_is_that_of_the_trajectory():
    trajectory = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (3, 0, 0), (3, 4, 1), (0, 0, 0)])
    for one in (trajectory, trajectory.execution()):
        assert trajectory_cost(Duration(), one, WORLD) == pytest.approx(one.duration, rel=1e-12)


def test_duration_is_a_robot_criterion_in_seconds():
    assert (Duration.group, Duration.unit, Duration.aggregate) == ("R", "s", "sum")
