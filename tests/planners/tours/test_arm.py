"""Tours of an arm: goals of the camera as stops, on a roadmap of configurations."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest

import hpop
from hpop.frontier import is_nondominated
from hpop.goals import Tour
from hpop.problems.verify import verify
from hpop.world import Box, Solid, pose_at
from tests.models.serial_arm.arms import arm6

TARGETS = {"left": (0.6, 0.3, 0.3), "right": (0.6, -0.3, 0.4), "ahead": (0.7, 0.0, 0.5)}
WORLD = hpop.World.from_solids([Solid(Box((0.04, 0.04, 0.3)), pose_at((0.6, 0.15, 0.15)), "post")])
HOME = (0.0, -1.2, 1.8, 0.0, 0.4, 0.0)


def problem(order: object, dwell: float = 0.5, **stop: object) -> hpop.Problem:
    look = {"distance": (0.15, 0.35), "angle_tolerance": 0.2, **stop}
    stops = [{"look_at": {"target": place, **look}, "dwell": dwell, "name": name} for name, place in TARGETS.items()]
    criteria = ["duration", "rotation", "joint_length"]
    return hpop.Problem(WORLD, arm6(), HOME, HOME, criteria, tour=Tour(stops, order=order))


@pytest.fixture(scope="module")
def solved() -> tuple[hpop.Problem, hpop.Front]:
    asked = problem("any")
    return asked, asked.solve("roadmap", samples=30)


@pytest.mark.proof
def test_the_front_over_any_order_joins_the_fronts_of_all_orders(solved: tuple[hpop.Problem, hpop.Front]) -> None:
    _, front = solved
    each = [problem(list(pairwise(order))).solve("roadmap", samples=30) for order in permutations(TARGETS)]
    costs = np.unique(np.concatenate([one.integers for one in each]), axis=0)
    expected = costs[is_nondominated(costs)]
    assert len({tuple(v["stop"] for v in origin["visits"]) for origin in front.provenance}) > 1
    assert np.unique(front.integers, axis=0).tolist() == expected.tolist()


def test_the_camera_looks_at_each_target_for_the_dwell(solved: tuple[hpop.Problem, hpop.Front]) -> None:
    asked, front = solved
    assert len(front) > 1
    assert verify(asked, front) == []
    for trajectory, origin in zip(front.trajectories, front.provenance, strict=True):
        assert sorted(visit["stop"] for visit in origin["visits"]) == sorted(TARGETS)
        for visit in origin["visits"]:
            assert visit["end"] - visit["begin"] == pytest.approx(0.5)
            pose = trajectory.model.pose("camera", trajectory.at(np.linspace(visit["begin"], visit["end"], 5)))
            way = np.array(TARGETS[visit["stop"]])[:, None] - np.array([pose.x, pose.y, pose.z])
            distance = np.linalg.norm(way, axis=0)
            assert np.ptp(distance) == pytest.approx(0.0, abs=1e-9)
            assert 0.15 - 1e-6 <= distance[0] <= 0.35 + 1e-6
            assert ((np.array(pose.ahead) * way).sum(axis=0) / distance >= np.cos(0.2) - 1e-9).all()


def test_a_target_out_of_the_arms_reach_is_told_with_its_stop() -> None:
    stops = [{"look_at": {"target": (5.0, 0.0, 0.5), "distance": (0.1, 0.3)}, "name": "far"}]
    asked = hpop.Problem(WORLD, arm6(), HOME, HOME, ["duration"], tour=Tour(stops))
    with pytest.raises(hpop.errors.QueryError, match="stop 'far' cannot be visited"):
        asked.solve("roadmap", samples=10)


@pytest.mark.proof
def test_splines_between_stops_are_better_and_stops_and_dwells_stay() -> None:
    asked = replace(problem("any"), criteria=["duration", "rotation"])
    warm = asked.solve("roadmap", samples=30)
    front = asked.solve("spline", warm_start=warm, pieces=4)
    assert verify(asked, front) == []
    assert "leg by leg" in front.certificate
    for point, origin in zip(front, front.provenance, strict=True):
        before = origin["warm_start"]
        assert (point.costs["rotation"] - warm.costs[before, 1]) < -0.1 * warm.costs[before, 1]
        assert point.costs["duration"] <= warm.costs[before, 0] + 1e-6
        old = warm.provenance[before]["visits"]
        assert [visit["stop"] for visit in origin["visits"]] == [visit["stop"] for visit in old]
        for visit, earlier in zip(origin["visits"], old, strict=True):
            assert visit["end"] - visit["begin"] == pytest.approx(0.5)
            there = point.trajectory.at(np.array([visit["begin"], visit["end"]]))
            then = warm.trajectories[before].at(np.array([earlier["begin"]]))
            for name in asked.model.space.names:
                assert getattr(there, name) == pytest.approx(np.repeat(getattr(then, name), 2), abs=1e-6)
