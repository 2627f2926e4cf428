"""Every candidate of smoothing keeps limits, turns, the homotopy class, and its costs."""

import json

import numpy as np
import pytest
import shapely

from hpop.criteria import Turns
from hpop.criteria.costs import trajectory_costs
from hpop.models import DifferentialDrive
from hpop.planners.programs.smoothing import Smoothing
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
BLOCK = World.from_polygons([shapely.box(2.8, 1.4, 3.4, 2.6)], extent=shapely.box(0, 0, 6, 4))
COSTS = ["turns", "exposure", "length", "duration", "rotation", "clearance"]
ROUND = Problem(BLOCK, ROBOT, (1, 2, 0), (5, 2, 0), COSTS)
OPTIONS = {"step": 1.0}


@pytest.fixture(scope="module")
def smoothed():
    """Candidates of six costs round a block, and the polylines that they come from."""
    candidates = Smoothing(**OPTIONS, intervals=30).solve(ROUND)
    return candidates, ROUND.solve("lattice", **OPTIONS).trajectories


@pytest.mark.proof
def test_candidates_are_what_they_claim(smoothed):
    candidates, polylines = smoothed
    assert candidates.status is Status.COMPLETE
    assert len(candidates.trajectories) >= 0.9 * len(polylines) > 2
    front = ROUND.front(candidates)
    assert verify(ROUND, front) == []
    assert "NOT VALID" not in front.certificate
    assert "local optima" in front.certificate
    json.dumps(candidates.provenance)
    assert any("begin and end at rest" in note for note in candidates.notes)


def test_no_candidate_has_fewer_turns_than_its_polyline(smoothed):
    candidates, polylines = smoothed
    (before,) = trajectory_costs([Turns()], polylines, BLOCK).T
    (after,) = trajectory_costs([Turns()], candidates.trajectories, BLOCK).T
    for count, provenance in zip(after, candidates.provenance, strict=True):
        assert count >= before[provenance["warm_start"]]
        assert count == provenance["turns"]


def test_candidates_cost_no_more_than_their_polylines_executed(smoothed):
    candidates, polylines = smoothed
    for goes, provenance in zip(candidates.trajectories, candidates.provenance, strict=True):
        planned = polylines[provenance["warm_start"]]
        new, *old = trajectory_costs(candidates.objectives[1:], [goes, planned, planned.execution()], BLOCK)
        assert (new <= 1.021 * np.max(old, axis=0) + 1e-3).all()


def test_the_block_is_passed_on_the_same_side(smoothed):
    candidates, polylines = smoothed
    for goes, provenance in zip(candidates.trajectories, candidates.provenance, strict=True):
        planned = polylines[provenance["warm_start"]]
        sides = []
        for way in (goes, planned):
            at = way.at(np.linspace(0, way.duration, 500))
            sides.append(np.sign(at.y[np.argmin(np.abs(at.x - 3.1))] - 2.0))
        assert sides[0] == sides[1]


def test_the_robot_starts_and_ends_at_rest_and_keeps_its_limits(smoothed):
    for goes in smoothed[0].trajectories:
        s = goes.states
        assert (s.speed[[0, -1]] == 0).all()
        assert (s.turn_rate[[0, -1]] == 0).all()
        track = ROBOT.wheels(goes, np.linspace(0, goes.duration, 2000)[1:-1])
        for speed in (track.left_speed, track.right_speed):
            assert np.abs(speed).max() <= ROBOT.wheel_speed + 1e-4
        for change in (track.left_acceleration, track.right_acceleration):
            assert np.abs(change).max() <= ROBOT.wheel_acceleration + 1e-3
        assert s.speed.min() >= 0.0


def test_every_interval_ends_where_its_speeds_lead(smoothed):
    """Although the solver stops a thousandth before."""
    for goes in smoothed[0].trajectories:
        (index, motions), *others = goes.batches(BLOCK)
        assert not others
        assert len(index) == len(goes)
        assert motions.law.strays(motions.start, motions.end).max() <= 2e-6


def test_planned_costs_are_the_re_evaluated_ones_within_the_tolerance(smoothed):
    candidates, _ = smoothed
    again = trajectory_costs(candidates.objectives, candidates.trajectories, BLOCK)
    assert (np.abs(again - candidates.planned) <= candidates.tolerance).all()
    names = [c.name for c in candidates.objectives]
    exact = [name in ("turns", "length", "duration", "rotation") for name in names]
    exposure = names.index("exposure")
    assert (candidates.tolerance[:, exposure] <= 0.0101 * candidates.planned[:, exposure]).all()
    np.testing.assert_allclose(candidates.planned[:, exact], again[:, exact], rtol=1e-5, atol=1e-6)


def test_driven_fronts_are_saved_loaded_joined_and_pass_the_check(smoothed, tmp_path):
    front = ROUND.front(smoothed[0]) | ROUND.solve("lattice", **OPTIONS)
    front.save(tmp_path / "front.json")
    again = Front.load(tmp_path / "front.json")
    np.testing.assert_array_equal(again.costs, front.costs)
    assert any("drive" in t.kinds for t in again.trajectories)
    assert verify(ROUND, again) == []
