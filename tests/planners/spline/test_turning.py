"""Splines of an arm whose joints slide and turn on and on, from paths and from splines."""

import numpy as np
import pytest

import hpop
from hpop.motions import States
from hpop.planners.base import make_planner
from hpop.planners.programs.spline.knots import Knots
from hpop.trajectories.trajectory import Trajectory
from hpop.world.geometry.solids import Box, Solid
from tests.models.serial_arm.arms import crane

ROWS = ((0.7, 0.0, 0.0, 0.0), (0.2, 2.5, 0.1, 0.5), (0.6, 5.0, 0.3, -1.5), (-0.2, 8.0, 0.0, 2.0))


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Return a problem with a goal over a turn away, at the limits of three joints; a path to it; its spline."""
    arm = crane(tmp_path_factory.mktemp("crane"))
    pose = np.eye(4)
    pose[:3, 3] = 5.0
    world = hpop.World.from_solids([Solid(Box((0.2, 0.2, 0.2)), pose)])
    path = Trajectory.through(arm, States(**dict(zip(arm.space.names, np.array(ROWS).T, strict=True))))
    problem = hpop.Problem(world, arm, ROWS[0], ROWS[-1], ["duration", "rotation"])
    return problem, path, splines(problem, path)


def splines(problem, path):
    return make_planner({"spline": {"warm_start": [path], "pieces": 6}}).solve(problem)


def test_a_joint_without_limits_may_be_any_number_of_turns_away(planned):
    problem, path, found = planned
    assert path.states.swing[-1] - path.states.swing[0] == pytest.approx(8.0)
    quickest = found.trajectories[0]
    assert quickest.kinds[0] == "spline"
    assert quickest.duration < 0.9 * path.duration
    assert quickest.states.swing[-1] == pytest.approx(8.0)
    assert all(list(problem.model.faults(trajectory)) == [] for trajectory in found.trajectories)


@pytest.mark.proof
def test_what_is_a_spline_already_stays_the_same_spline_and_goes_on_from_there(planned):
    problem, _, found = planned
    spline = found.trajectories[0]
    law = problem.model.laws["spline"]
    again = Knots.along(spline, law, 6).trajectory(problem.model, law)
    assert again.duration == pytest.approx(spline.duration)
    moments = np.linspace(0.0, spline.duration, 50)
    for name in problem.model.space.names:
        there = getattr(again.at(moments * again.duration / spline.duration), name)
        np.testing.assert_allclose(there, getattr(spline.at(moments), name), atol=1e-9)
    further = splines(problem, spline)
    assert len(further.trajectories) > 1
    assert further.planned[0].sum() < found.planned[0].sum()


def test_a_path_half_spline_half_reach_stops_where_the_reach_begins_and_nowhere_else(planned):
    problem, _, found = planned
    spline, arm = found.trajectories[0], problem.model
    law = arm.laws["spline"]
    reach = {
        name: np.append(getattr(spline.states, name), getattr(spline.states, name)[-1]) for name in spline.states.names
    }
    reach["swing"][-1] += 1.0
    mixed = Trajectory(arm, States(**reach), (*spline.kinds, "reach"))
    knots = Knots.along(mixed, law, 6)
    moving = np.abs(knots.slopes).max(axis=1) > 1e-9
    count = len(spline)
    assert moving[1:count].all()
    assert not moving[[0, count, -1]].any()
