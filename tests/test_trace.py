"""Traces: rates integrate to running values, and running values end at the costs."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.models.driven import driven
from hpop.trace import in_pieces

NAMES = ["obstruction", "exposure", "turns", "length", "duration", "rotation", "clearance"]


@pytest.fixture
def problem():
    world = hpop.World.from_polygons([shapely.box(4, 0, 6, 3)], extent=shapely.box(0, 0, 10, 8))
    return hpop.Problem(world, hpop.DifferentialDrive(camera_offset=(0.1, 0.0)), (1, 1, 0), (9, 1, 0), NAMES)


@pytest.fixture
def trajectory(problem):
    return hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (2, 4, 0), (8, 4, 0), (9, 1, 1.0)])


def test_every_running_value_ends_at_the_cost(problem, trajectory):
    trace = problem.trace(trajectory)
    costs = problem.evaluate(trajectory)
    assert trace.names == tuple(NAMES)
    for name, last, cost in zip(trace.names, trace.running[-1], trace.cost, strict=True):
        assert cost == costs[name]
        assert last == pytest.approx(cost, rel=1e-3)


@pytest.mark.parametrize("name", ["exposure", "turns", "length", "duration", "rotation"])
def test_the_rate_of_a_sum_integrates_to_its_running_value(problem, trajectory, name):
    trace = problem.trace(trajectory)
    column = NAMES.index(name)
    integral = np.cumsum(trace.rate[:, column] * np.diff(trace.times))
    np.testing.assert_allclose(integral, trace.running[:, column], atol=1e-9)


def test_the_rate_of_obstruction_is_what_the_camera_meets_there(problem, trajectory):
    """Independent of quadrature: phi at the middle of each short piece."""
    trace = problem.trace(trajectory)
    middles = 0.5 * (trace.times[1:] + trace.times[:-1])
    camera = problem.model.pose("camera", trajectory.at(middles))
    phi = problem.world.obstruction(camera, 2.0)
    moving = np.array([kind == "move" for kind in trace.trajectory.kinds])
    np.testing.assert_allclose(trace.rate[moving, 0], phi[moving], atol=2e-3)


def test_the_pieces_stand_where_the_trajectory_is_at_their_times(problem, trajectory):
    fine = in_pieces(trajectory)
    there = trajectory.at(fine.times)
    for name in fine.states.names:
        np.testing.assert_allclose(getattr(fine.states, name), getattr(there, name), atol=1e-9)
    moves = [d for d, kind in zip(fine.durations, fine.kinds, strict=True) if kind == "move"]
    assert max(moves) <= 0.1 + 1e-12


def test_standing_still_has_an_empty_trace(problem):
    trace = problem.trace(hpop.Trajectory.from_poses(problem.model, [(1, 1, 0)]))
    assert trace.running.shape == trace.rate.shape == (0, len(NAMES))
    assert trace.cost.tolist() == [0.0] * len(NAMES)


def test_curves_are_traced_in_pieces_that_add_up_and_turns_where_they_end(problem):
    around = [(0, 1, 1), (0, -1, 1)]
    back = [(0, -1, 1), (0, 1, 1)]
    goes = driven(problem.model, (1, 1, 0.3), [(1, 0, 0.7), *around, (0, 0, 1), *around, *back, (-0.7, 0, 1)])
    trace = problem.trace(goes)
    assert trace.trajectory.kinds == ("drive",) * len(trace.trajectory.kinds)
    assert trace.trajectory.durations.max() <= 0.1 + 1e-12
    costs = problem.evaluate(goes)
    for name, last in zip(trace.names, trace.running[-1], strict=True):
        assert last == pytest.approx(costs[name], rel=2e-3)
    steps = np.diff(trace.running[:, NAMES.index("turns")], prepend=0.0)
    assert trace.times[1:][steps > 0] == pytest.approx([2.7, 5.7, 7.7])  # ends of the stretches of one sign
