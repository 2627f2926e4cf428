"""Traces: rates integrate to running values, and running values end at the costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import UnsupportedCriterion
from hpop.models.driven import driven
from hpop.motions import States, lacking
from hpop.planners.programs.spline.knots import Knots
from hpop.problems.evaluation import in_pieces, trace
from hpop.testing.worlds import random_world
from tests.models.serial_arm.arms import arm6
from tests.own_criteria import NAMES as EVERY
from tests.own_criteria import own_criterion

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
    moving = np.array([kind == "move" for kind in trace.pieces.kinds])
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
    assert trace.pieces.kinds == ("drive",) * len(trace.pieces.kinds)
    assert trace.pieces.durations.max() <= 0.1 + 1e-12
    costs = problem.evaluate(goes)
    for name, last in zip(trace.names, trace.running[-1], strict=True):
        assert last == pytest.approx(costs[name], rel=2e-3)
    steps = np.diff(trace.running[:, NAMES.index("turns")], prepend=0.0)
    assert trace.times[1:][steps > 0] == pytest.approx([2.7, 5.7, 7.7])  # ends of the stretches of one sign


# Within motions that speed up and slow down


def executed(model):
    planned = hpop.Trajectory.from_poses(model, [(1, 1, 0), (3, 1, 0), (4, 5, np.pi), (1, 8, -2.0)])
    return planned.execution()


def nodding(model):
    rows = [(1, 1, 0, 0, 0), (3, 1, 0, 1.0, 0.3), (4, 5, np.pi, -0.5, 0.3), (1, 8, -2.0, -1.2, -0.4)]
    columns = np.array(rows, float).T
    return hpop.Trajectory.through(model, States(**dict(zip(model.space.names, columns, strict=True))))


def reaching(model):
    columns = np.array([[-0.27, 0.74, 1.73, 0.87, -0.05, -0.82], [0.5, 0.2, 1.2, 0.6, 0.4, 0.3], [0.1] * 6]).T
    return hpop.Trajectory.through(model, States(**dict(zip(model.space.names, columns, strict=True))))


def splined(model):
    law = model.laws["spline"]
    return Knots.along(reaching(model), law, 6).trajectory(model, law)


ROBOTS = {
    "executed runs and spins": lambda: executed(hpop.DifferentialDrive(camera_offset=(0.1, 0.05))),
    "a head that looks round": lambda: nodding(hpop.PanTilt()),
    "an arm that reaches": lambda: reaching(arm6()),
    "an arm along splines": lambda: splined(arm6()),
}


ROOM = random_world(np.random.default_rng(3))


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=pytest.mark.proof)
        if name in ("a head that looks round", "an arm that reaches", "an arm along splines")
        else name
        for name in ROBOTS
    ],
)
def traced(request):
    """Return a trajectory in a room with everything that criteria need, and its trace in all criteria that apply."""
    trajectory, world = ROBOTS[request.param](), ROOM
    asked = []
    for name in EVERY:
        criterion = own_criterion(name)
        if not lacking(criterion.requires, trajectory.model, world):
            try:
                trajectory_costs([criterion], [trajectory], world)
            except UnsupportedCriterion:
                continue
            asked.append(criterion)
    assert len(asked) > 10
    return trajectory, world, trace(asked, trajectory, world)


def test_every_criterion_ends_at_its_cost_to_rounding(traced):
    trajectory, _, found = traced
    for name, last, cost in zip(found.names, found.running[-1], found.cost, strict=True):
        assert last == pytest.approx(cost, rel=1e-9, abs=1e-12), name
    assert (found.times[0], found.times[-1]) == (0.0, trajectory.duration)


def test_every_total_and_every_worst_moment_is_the_cost_of_the_motions_so_far_where_one_ends(traced):
    trajectory, world, found = traced
    ends = np.cumsum(found.pieces.counts) - 1
    for column, criterion in enumerate(found.criteria):
        if criterion.aggregate in ("sum", "max"):
            each = np.zeros(len(trajectory))
            for place, motions in trajectory.batches(world):
                each[place] = criterion.cost(motions)
            so_far = np.cumsum(each) if criterion.aggregate == "sum" else np.maximum.accumulate(each)
            np.testing.assert_allclose(found.running[ends, column], so_far, rtol=1e-9, atol=1e-12)


def test_the_rate_of_rotation_is_how_fast_the_camera_turns(traced):
    """Independent of quadrature: the twist at the middle of each piece."""
    trajectory, _, found = traced
    middles = 0.5 * (found.times[1:] + found.times[:-1])
    twist = trajectory.model.twist("camera", trajectory.at(middles), trajectory.rates(middles)[0])
    turns = np.linalg.norm(np.stack(np.broadcast_arrays(*twist.rotation), axis=1), axis=1)
    rate = found.rate[:, found.names.index("rotation")]
    whole = np.array([kind == "turn" for kind in found.pieces.kinds])  # planned turns in place
    # Where a ramp begins or ends within a piece, the mean of the piece lies between both.
    assert np.quantile(np.abs(rate - turns)[~whole], 0.9) < 0.01 * turns.max()
    assert np.abs(rate - turns)[~whole].max() < 0.1 * turns.max()


def test_along_one_reach_what_one_looks_away_by_is_the_angle_at_the_time():
    model = arm6()
    reach, target = reaching(model).states.take(slice(0, 2)), np.array([0.7, 0.25, 0.43])
    goes = hpop.Trajectory(model, reach, ("reach",))
    world = hpop.World.from_polygons([], extent=shapely.box(-1, -1, 1, 1))
    found = trace([make_criterion({"look_at": {"target": target.tolist()}})], goes, world)
    camera = model.pose("camera", goes.at(0.5 * (found.times[1:] + found.times[:-1])))
    sight = target - np.stack([camera.x, camera.y, camera.z], axis=1)
    ahead = np.stack(camera.ahead, axis=1)
    angle = np.arccos((sight * ahead).sum(axis=1) / np.linalg.norm(sight, axis=1))
    np.testing.assert_allclose(found.rate[:, 0], angle, rtol=2e-3)
    assert np.ptp(angle) > 0.1


def test_what_counts_motions_is_counted_where_they_end():
    model = arm6()
    goes = reaching(model)
    world = hpop.World.from_polygons([], extent=shapely.box(-1, -1, 1, 1))
    found = trace([Reaches()], goes, world)
    steps = np.diff(found.running[:, 0], prepend=0.0)
    np.testing.assert_allclose(found.times[1:][steps > 0], goes.times[1:])
    assert set(steps) == {0.0, 1.0}


@dataclass(frozen=True)
class Reaches:
    """The number of motions."""

    name = "reaches"
    group = "R"
    unit = "1"
    aggregate = "sum"
    requires = ()
    smooth = False
    quantum = 1.0

    def cost(self, m):
        return np.ones(len(m))
