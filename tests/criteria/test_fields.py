"""Criteria of measured fields: closed forms, dense integration, and one value in every planner."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from scipy.integrate import quad

import hpop
from hpop.criteria import FieldExposure, FieldWorst, StaleView, TimeBelow, trajectory_cost
from hpop.errors import CriterionError
from hpop.world import MeasuredField, World

ROOM = World.from_polygons([shapely.box(2.5, 1.2, 3.2, 2.6)], extent=shapely.box(0, 0, 6, 4))
SLOPE = MeasuredField(-40.0 - 5.0 * np.tile(np.arange(7.0), (5, 1)), 1.0, name="wifi", unit="dBm")  # -40 - 5 x
BUMPY = MeasuredField(np.random.default_rng(5).uniform(20, 180, (9, 13)), 0.5, name="latency", unit="ms")
WORLD = ROOM.with_fields([SLOPE, BUMPY])
ROBOT = hpop.DifferentialDrive(speed=0.5, radius=0.2)
STRAIGHT = hpop.Trajectory.from_poses(ROBOT, [(1, 0.5, 0), (5, 0.5, 0)])  # 8 s, from -45 to -65 dBm
GRADED = {"good": 60.0, "bad": 120.0, "field": "latency"}


def test_a_linear_field_costs_what_the_closed_forms_say() -> None:
    cost = {c: trajectory_cost(c, STRAIGHT, WORLD) for c in (FieldExposure(-55.0, -65.0, "wifi"),)}
    assert list(cost.values()) == pytest.approx([4 * 0.5])  # the last 4 s, from 0 to 1
    assert trajectory_cost(FieldWorst(-45.0, -55.0, "wifi"), STRAIGHT, WORLD) == pytest.approx(2.0)
    assert trajectory_cost(FieldWorst(-65.0, -70.0, "wifi"), STRAIGHT, WORLD) == 0.0
    assert trajectory_cost(TimeBelow(-60.0, 1.0, "wifi"), STRAIGHT, WORLD) == pytest.approx(2.0, rel=1e-3)
    rising = FieldExposure(-65.0, -55.0, "wifi")  # low values are good
    assert trajectory_cost(rising, STRAIGHT, WORLD) == pytest.approx(8 * 1.0, rel=1e-3)  # ∫ (f + 65)/10


def test_a_stale_view_is_the_latency_times_the_angle_turned() -> None:
    turn = hpop.Trajectory.from_poses(ROBOT, [(1, 3, 0), (1, 3, 2.0)])
    latency = 1e-3 * BUMPY(np.array([1.0]), np.array([3.0]))[0]
    assert trajectory_cost(StaleView("latency"), turn, WORLD) == pytest.approx(2.0 * latency)
    assert trajectory_cost(StaleView("latency"), STRAIGHT, WORLD) == 0.0
    seconds = MeasuredField(np.full((5, 7), latency), 1.0, name="latency", unit="s")
    assert trajectory_cost(StaleView(), turn, ROOM.with_fields([seconds])) == pytest.approx(2.0 * latency)


def dense(trajectory, rate):
    """Integrate a rate of the camera's position and angular speed over the executed time, motion by motion."""
    model, total, largest = trajectory.model, 0.0, 0.0
    times = np.concatenate([[0.0], np.cumsum(trajectory.durations)])
    for begin, end in pairwise(times):
        t = begin + (end - begin) * (np.arange(4000) + 0.5) / 4000
        states = trajectory.at(t)
        pose = model.pose("camera", states)
        turning = np.abs(np.gradient(np.unwrap(pose.yaw), t))
        values = rate(np.asarray(pose.x), np.asarray(pose.y), turning)
        total, largest = total + values.mean() * (end - begin), max(largest, values.max(initial=0.0))
    return total, largest


def latency(x, y):
    rows, columns = BUMPY.values.shape
    u, v = np.clip(x / 0.5, 0, columns - 1 - 1e-9), np.clip(y / 0.5, 0, rows - 1 - 1e-9)
    j, i = u.astype(int), v.astype(int)
    s, t, c = u - j, v - i, BUMPY.values
    return (1 - t) * ((1 - s) * c[i, j] + s * c[i, j + 1]) + t * ((1 - s) * c[i + 1, j] + s * c[i + 1, j + 1])


def graded(x, y, turning):
    return np.maximum((60.0 - latency(x, y)) / -60.0, 0.0)


def below(x, y, turning):
    u = np.clip((90.0 - latency(x, y)) / 20.0 + 0.5, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def stale(x, y, turning):
    return 1e-3 * latency(x, y) * turning


CRITERIA = [
    {"field_exposure": GRADED},
    {"field_worst": GRADED},
    {"time_below": {"limit": 90.0, "width": 20.0, "field": "latency"}},
    {"stale_view": {"field": "latency"}},
    "duration",
    "length",
]
PROBLEM = hpop.Problem(WORLD, ROBOT, (0.7, 0.7, 0), (5.3, 3.3, None), [*CRITERIA[:3], "turns", "length"])


def check_against_dense(problem, front, tolerance=2e-3):
    """Compare the costs of fields on a front with dense integration, and with a second evaluation."""
    assert len(front) > 0
    columns = dict(zip(front.names, front.costs.T, strict=True))
    rates = {"field_exposure": graded, "time_below": below, "stale_view": stale, "field_worst": graded}
    for row in {0, len(front) // 2, len(front) - 1}:
        trajectory = front.trajectories[row]
        for name, rate in rates.items():
            if name in columns:
                total, largest = dense(trajectory, rate)
                expected, slack = (largest, 0.02) if name == "field_worst" else (total, tolerance)
                assert columns[name][row] == pytest.approx(expected, rel=slack, abs=slack), name
                again = trajectory_cost(problem.criteria[front.names.index(name)], trajectory, problem.world)
                assert columns[name][row] == pytest.approx(again, rel=1e-9, abs=1e-12)


def test_the_costs_of_a_lattice_equal_dense_integration() -> None:
    check_against_dense(PROBLEM, PROBLEM.solve(planner={"lattice": {"step": 0.5, "eps": 0.05}}))


PLANNERS = {
    "weighted-sum": {"step": 0.5},
    "roadmap": {"samples": 60, "seed": 1},
    "any-angle": {},
    "epsilon-constraint": {"divisions": 1, "time_limit": 20},
    "smoothing": {"time_limit": 20},
    "rrt": {"runs": 10, "seed": 1},
}


@pytest.mark.proof
@pytest.mark.parametrize("planner", PLANNERS)
def test_the_costs_of_every_planner_equal_dense_integration(planner) -> None:
    criteria = [CRITERIA[0], CRITERIA[3], "length"]
    problem = hpop.Problem(WORLD, ROBOT, (0.7, 0.7, 0), (5.3, 3.3, None), criteria)
    check_against_dense(problem, problem.solve(planner={planner: PLANNERS[planner]}), 5e-3)


def test_unknown_fields_and_wrong_units_are_told() -> None:
    with pytest.raises(
        CriterionError, match=r"'field wify', which no robot of hpop and no world provides.*'field wifi'"
    ):
        hpop.Problem(WORLD, ROBOT, (1, 1, 0), (5, 3, None), [FieldWorst(1.0, 2.0, "wify"), "length"])
    with pytest.raises(CriterionError, match=r"name one of the fields\. This world has wifi, latency"):
        trajectory_cost(FieldExposure(1.0, 2.0), STRAIGHT, WORLD)
    with pytest.raises(CriterionError, match=r"in s or ms and not negative; 'wifi' is in dBm, from -70"):
        trajectory_cost(StaleView("wifi"), STRAIGHT, WORLD)
    with pytest.raises(CriterionError, match="requires fields, which neither"):
        hpop.Problem(ROOM, ROBOT, (1, 1, 0), (5, 3, None), [StaleView(), "length"])
    with pytest.raises(CriterionError, match="two different values"):
        FieldExposure(1.0, 1.0)


def test_a_field_whose_samples_are_far_apart_is_integrated_as_quad_does() -> None:
    exact = quad(lambda x: float(latency(np.array([x]), np.array([0.5]))[0]), 1, 5, limit=200, points=[1.5, 2, 3, 4])[0]
    found = trajectory_cost(FieldExposure(0.0, 1.0, "latency"), STRAIGHT, WORLD)
    assert found == pytest.approx(exact / 0.5, rel=5e-4)
