"""Smoothing with a dose: the filter's modes against filters of scipy, and curves against the criterion and `retime`."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
import shapely
from scipy.signal import lsim

import hpop
from hpop.criteria.comfort.sickness import W_F
from hpop.errors import CriterionError, OptionError, UnsupportedCriterion
from hpop.models.driven import driven
from hpop.models.view import ViewModel
from hpop.planners.programs.smoothing.dose import Dose
from hpop.problems.verify import verify
from tests.iso_filters import motion_sickness

SEAT = (0.25, 0.1, 0.6)
ROBOT = hpop.DifferentialDrive(seat=SEAT, camera_offset=(0.3, 0.0))
OPEN = hpop.World.from_polygons([], extent=shapely.box(-60, -60, 60, 60))
ROOM = hpop.World.from_polygons([shapely.box(3, -2, 4, 2), shapely.box(6, 1, 7, 6)], extent=shapely.box(-2, -6, 12, 6))


def random_drive(seed, pieces=1):
    """Return a drive with random accelerations, at rest at its start; each constant one is cut into ``pieces``."""
    rng = np.random.default_rng(seed)
    straight = [(rng.uniform(0.2, 0.8), 0.0, rng.uniform(0.5, 1.5)), (0.0, 0.0, rng.uniform(0.2, 2.0))]
    curves = [(rng.uniform(-0.1, 0.2), rng.uniform(-1, 1), rng.uniform(0.2, 0.8)) for _ in range(4)]
    cut = [(a, b, seconds / pieces) for a, b, seconds in [*straight, *curves] for _ in range(pieces)]
    return driven(ROBOT, (0, 0, rng.uniform(-3, 3)), cut)


def of_intervals(path, dose):
    """Return the dose of a drive by the formulas of a program's intervals, one after the other."""
    before, after = casadi.SX.sym("before", dose.size), casadi.SX.sym("after", dose.size)
    ends, lasts = casadi.SX.sym("ends", 5), casadi.SX.sym("lasts")
    defects, square = dose.formulas(before, after, tuple(casadi.vertsplit(ends)), lasts)
    interval = casadi.Function("interval", [before, after, ends, lasts], [casadi.vertcat(*defects), square])
    s, state, total = path.states, np.zeros(dose.size), 0.0
    for i, seconds in enumerate(path.durations.tolist()):
        at = [s.speed[i], s.speed[i + 1], s.turn_rate[i], s.turn_rate[i + 1], s.yaw[i]]
        off, integral = interval(state, np.zeros(dose.size), at, seconds)
        state, total = -np.array(off).ravel(), total + float(integral)
    return total**0.5


@pytest.mark.seeds(2, of=30)
def test_the_modes_give_the_dose_of_a_filter_from_the_zeros_and_poles_of_the_standard(seed):
    path = random_drive(seed)
    times = np.linspace(0.0, path.duration, 20_001)
    states, (rates, changes) = path.at(times), path.rates(times)
    felt, pose = ROBOT.twist_rate("seat", states, rates, changes).velocity, ROBOT.pose("seat", states)
    signals = [
        sum(np.broadcast_to(a * d, times.shape) for a, d in zip(felt, axis, strict=True))
        for axis in (pose.ahead, pose.left)
    ]
    squares = sum(lsim(motion_sickness(), signal, times)[1] ** 2 for signal in signals)
    expected = np.sqrt(np.sum(0.5 * (squares[1:] + squares[:-1])) * times[1])
    assert of_intervals(path, Dose(W_F, *SEAT[:2])) == pytest.approx(expected, rel=5e-3)


@pytest.mark.seeds(2, of=30)
def test_a_frame_that_does_not_turn_has_the_dose_of_the_acceleration_in_the_world(seed):
    path = random_drive(seed, pieces=3)
    times = np.linspace(0.0, path.duration, 20_001)
    states, (rates, changes) = path.at(times), path.rates(times)
    seen = [np.broadcast_to(a, times.shape) for a in ROBOT.twist_rate("camera", states, rates, changes).velocity[:2]]
    squares = sum(lsim(motion_sickness(), signal, times)[1] ** 2 for signal in seen)
    expected = np.sqrt(np.sum(0.5 * (squares[1:] + squares[:-1])) * times[1])
    assert of_intervals(path, Dose(W_F, 0.3, 0.0, turns=0.0)) == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("turning", ["unwound", pytest.param("level", marks=pytest.mark.proof)])
def test_a_view_gets_a_curve_of_less_dose_than_the_polyline(turning):
    """The candidate is kept only if its planned dose is that of the criterion, in the frame of the view."""
    view = ViewModel(ROBOT, turning=turning)
    problem = hpop.Problem(OPEN, view, (0, 0, 0), (0, 3, None), ["duration", "length", "msdv"])
    path = hpop.Trajectory.from_poses(view, [(0, 0, 0), (3, 0, 0), (3, 3, 1.6), (0, 3, 3.1)])
    (found,) = problem.solve("smoothing", minimise="msdv", intervals=24, warm_start=[path])
    assert found.costs["msdv"] < 0.9 * problem.evaluate(path.execution())["msdv"]


def test_a_smoothed_path_of_least_dose_is_far_gentler_than_the_same_time_on_the_quickest_one():
    names = ["duration", "length", "felt_msdv"]
    problem = hpop.Problem(ROOM, ROBOT, (0, 0, 0), (10, 3, None), names)
    quick = problem.solve("smoothing", step=0.5).best("duration").trajectory
    front = problem.solve("smoothing", step=0.5, minimise="felt_msdv")
    assert front.names == ("duration", "length", "felt_msdv")
    assert "NOT VALID" not in front.certificate
    assert "local optima in (duration, length, felt_msdv)" in front.certificate
    assert verify(hpop.Problem.from_description(front.problem), front) == []
    best = front.best("felt_msdv")
    least = hpop.retime(problem, quick, discomfort="felt_msdv", points=1).costs[0, 0]
    slowed = hpop.retime(problem, quick, discomfort="felt_msdv", points=2, slowest=best.costs["duration"] / least)
    assert slowed.costs[-1, 0] == pytest.approx(best.costs["duration"], rel=1e-3)
    assert best.costs["felt_msdv"] < 0.6 * slowed.costs[-1, 1]


@pytest.mark.proof
@pytest.mark.parametrize("criterion", ["felt_msdv", "msdv"])
def test_another_speed_profile_hardly_lowers_the_dose_of_a_smoothed_path(criterion):
    problem = hpop.Problem(ROOM, ROBOT, (0, 0, 0), (10, 3, None), ["duration", "length", criterion])
    best = problem.solve("smoothing", step=0.5, minimise=criterion).best(criterion)
    if criterion == "felt_msdv":
        least = hpop.retime(problem, best.trajectory, discomfort="felt_msdv", points=1).costs[0, 0]
        slowest = best.costs["duration"] / least
        again = hpop.retime(problem, best.trajectory, discomfort="felt_msdv", points=2, slowest=slowest).costs[-1]
        assert again[1] > 0.95 * best.costs["felt_msdv"]
    quick = problem.solve("smoothing", step=0.5).best("duration")
    assert best.costs[criterion] < 0.3 * quick.costs[criterion]


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(6))
def test_planned_doses_are_those_of_the_criterion_in_random_rooms(seed):
    rng = np.random.default_rng(seed)
    boxes = [shapely.box(x, y, x + 0.7, y + 0.7) for x, y in rng.uniform([1, -4], [8, 4], (8, 2)).tolist()]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-2, -6, 12, 6))
    problem = hpop.Problem(
        world, ROBOT, (-1, 0, 0), (11, rng.uniform(-4, 4), None), ["duration", "length", "felt_msdv"]
    )
    candidates = problem.solve("smoothing", step=0.5, minimise="felt_msdv")
    assert len(candidates) > 0
    assert "NOT VALID" not in candidates.certificate
    assert not any("off by more" in note for note in candidates.notes)


def test_a_straight_path_has_a_speed_to_choose():
    problem = hpop.Problem(OPEN, ROBOT, (0, 0, 0), (6, 0, 0), ["duration", "length", "felt_msdv"])
    path = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (6, 0, 0)])
    (found,) = problem.solve("smoothing", minimise="felt_msdv", warm_start=[path])
    assert found.costs["length"] == pytest.approx(6.0, rel=1e-3)
    assert found.costs["felt_msdv"] < 0.99 * problem.evaluate(path.execution())["felt_msdv"]


def test_only_a_dose_that_is_listed_is_minimised():
    problem = hpop.Problem(OPEN, ROBOT, (0, 0, 0), (6, 0, 0), ["duration", "length"])
    with pytest.raises(OptionError, match="minimise must be the name of a smooth criterion"):
        problem.solve("smoothing", minimise="felt_msdv")
    with pytest.raises(UnsupportedCriterion, match="only criteria with memory"):
        hpop.Problem(OPEN, ROBOT, (0, 0, 0), (6, 0, 0), ["felt_msdv"]).solve("smoothing", minimise="felt_msdv")
    bare = hpop.DifferentialDrive()
    with pytest.raises(CriterionError, match="requires seat"):
        hpop.Problem(OPEN, bare, (0, 0, 0), (6, 0, 0), ["duration", "felt_msdv"]).solve(
            "smoothing", minimise="felt_msdv"
        )
