"""Simulated drives with delay, slip and noise among people: on the plan within the bound, in contact with nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError
from hpop.simulation import Crowd, DriveLimits, SimulatedBase, TrackedPeople, farthest_off
from hpop.world import Person, World
from tests.simulation.rooms import ROBOT, room

HALL = World.from_polygons([shapely.box(4.0, 2.4, 5.0, 6.0)], extent=shapely.box(0, 0, 9, 6))
WAY = hpop.Trajectory.from_poses(ROBOT, [(1, 1, 0), (8, 1, 0), (8, 4, 0)])
WORST = {"delay": 0.2, "slip": 0.1, "noise": 0.05}


def asked(*people: Person, criteria: tuple[str, ...] = ("duration", "length")) -> hpop.Problem:
    """Return the problem of driving along the hall."""
    return hpop.Problem(HALL.with_content(people=people), ROBOT, (1, 1, 0), (8, 4, 0), criteria)


def gaps(simulated: Any) -> np.ndarray:
    """Return the distance (N, P), m, between the surfaces of the robot and of each person."""
    off = simulated.people[..., :2] - simulated.poses[:, None, :2]
    return np.hypot(off[..., 0], off[..., 1]) - ROBOT.radius - simulated.radius


def check_limits(simulated: Any) -> None:
    """Check that commands keep to the speeds and accelerations of the robot and of its wheels."""
    v, w = simulated.commands.T
    step, half = np.diff(simulated.times), 0.5 * ROBOT.wheel_base
    assert (np.abs(v) + half * np.abs(w)).max() <= ROBOT.wheel_speed + 1e-9
    assert np.abs(w).max() <= ROBOT.turn_rate + 1e-9
    dv, dw = np.abs(np.diff(v)) / step, np.abs(np.diff(w)) / step
    assert dv.max() <= ROBOT.acceleration + 1e-6
    assert dw.max() <= ROBOT.turn_acceleration + 1e-6
    assert (dv + half * dw).max() <= ROBOT.wheel_acceleration + 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(300))
def test_in_random_rooms_a_drive_keeps_its_bound_and_its_limits_and_touches_nothing(seed: int) -> None:
    problem, disturbances, bound = room(seed)
    front = problem.solve("lattice", step=0.5, eps=0.05, time_limit=10)
    if not len(front):
        pytest.skip("an obstacle or a person bars the way")
    simulated = hpop.simulate(problem, front, robot=ROBOT, seed=seed, **disturbances)
    assert simulated.contacts == ()
    assert simulated.farthest <= simulated.bound == bound
    assert not (gaps(simulated) <= 0).any()  # NaN while a person is absent
    check_limits(simulated)
    assert simulated.arrived


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(100))
def test_among_a_crowd_that_reacts_a_drive_keeps_its_bound_and_touches_nothing(seed: int) -> None:
    pytest.importorskip("jupedsim")
    problem, disturbances, bound = room(seed)
    alone = hpop.Problem(
        problem.world.with_content(), problem.model, problem.start, problem.goal, [c.name for c in problem.criteria]
    )
    front = alone.solve("lattice", step=0.5, eps=0.05, time_limit=10)
    if not len(front):
        pytest.skip("an obstacle bars the way")
    crowd = Crowd(alone.world, 1 + seed % 8, seed=seed)
    simulated = hpop.simulate(alone, front, robot=ROBOT, people=crowd, seed=seed, **disturbances)
    assert simulated.contacts == ()
    assert simulated.farthest <= bound
    check_limits(simulated)
    assert simulated.arrived


@pytest.mark.parametrize("seed", range(3))
def test_on_a_random_way_the_worst_disturbances_keep_the_bound_and_the_limits(seed: int) -> None:
    places = np.random.default_rng(seed).uniform((0.5, 0.5, -3.0), (8.5, 5.5, 3.0), (3, 3)).tolist()
    way = hpop.Trajectory.from_poses(ROBOT, [(1.0, 1.0, 0.0), *places])
    simulated = hpop.simulate(asked(), way, seed=seed, **WORST)
    assert simulated.arrived
    assert simulated.farthest <= simulated.bound
    check_limits(simulated)


def test_a_crowd_walks_and_keeps_off_the_robot() -> None:
    pytest.importorskip("jupedsim")
    simulated = hpop.simulate(asked(), WAY, people=Crowd(HALL, 5, seed=3), dt=0.04)
    walked = np.hypot(*np.moveaxis(np.diff(simulated.people[..., :2], axis=0), 2, 0)).sum(axis=0)
    assert (walked > 1.0).all()
    assert gaps(simulated).min() > 0
    with pytest.raises(hpop.errors.MapError, match="fewer"):
        Crowd(HALL, 900).advance(0.0, (1, 1, 0))


def test_equal_seeds_give_equal_drives_and_driven_costs_are_those_of_the_true_motion() -> None:
    first, second, other = (hpop.simulate(asked(), WAY, seed=seed, **WORST) for seed in (1, 1, 2))
    assert (first.poses == second.poses).all()
    assert not np.array_equal(first.poses, other.poses)
    steps = np.diff(first.poses[:, :2], axis=0)
    assert first.driven["length"] == pytest.approx(np.hypot(*steps.T).sum(), abs=0.02)
    assert first.driven["duration"] == pytest.approx(first.times[-1])
    assert first.planned == asked().evaluate(WAY)


def test_people_of_the_problem_wait_before_the_robot_and_recordings_walk_on() -> None:
    walker = Person(3.0, 1.0, velocity=(-0.6, 0.0), until=30.0)
    way = hpop.Trajectory.from_poses(ROBOT, [(1, 1, 0), (3, 1, 0)])
    waits = hpop.simulate(asked(walker), way)
    assert waits.contacts == ()
    assert not waits.arrived  # the person stands in the way and waits for the robot
    assert waits.braked > 5.0
    recorded = hpop.simulate(asked(walker), way, people=TrackedPeople([walker]))
    assert any("touches person 0" in contact for contact in recorded.contacts)


def test_a_robot_that_has_stopped_for_a_person_goes_on_once_the_way_is_free() -> None:
    crosses = Person(4.0, 3.2, velocity=(0.0, -0.5), until=6.0)  # into the way of a robot that does not know it
    simulated = hpop.simulate(asked(), WAY, people=[crosses])
    assert simulated.contacts == ()
    assert simulated.braked > 0.5
    assert simulated.arrived
    assert simulated.off.max() < simulated.bound


def test_walls_in_the_way_are_contacts() -> None:
    through = hpop.Trajectory.from_poses(ROBOT, [(1, 4, 0), (8, 4, 0)])
    simulated = hpop.simulate(asked(), through)
    assert simulated.contacts[0].startswith("touches an obstacle at ")
    reaches = float(simulated.contacts[0].split()[-2])
    assert simulated.poses[round(reaches / 0.02), 0] == pytest.approx(4.0 - ROBOT.radius, abs=0.05)


class Orbiting:
    """A person who walks in a circle about the middle of the hall's south, far from the robot's way."""

    radius = 0.2

    def advance(self, t: float, robot_pose: tuple[float, float, float]) -> list[tuple[float, float, float, float]]:
        x, y = 2.0 + 0.5 * math.cos(t), 4.5 + 0.5 * math.sin(t)
        return [(x, y, -0.5 * math.sin(t), 0.5 * math.cos(t))]


def test_people_may_be_moved_by_a_class_of_ones_own() -> None:
    simulated = hpop.simulate(asked(), WAY, people=Orbiting())
    assert simulated.people.shape == (simulated.times.size, 1, 4)
    assert np.hypot(*(simulated.people[:, 0, :2] - (2.0, 4.5)).T) == pytest.approx(0.5)
    assert simulated.radius == 0.2


def test_a_base_without_disturbances_drives_as_commanded_and_a_late_one_as_it_was_commanded_before() -> None:
    prompt, late = (SimulatedBase(ROBOT, (0, 0, 0), delay=delay) for delay in (0.0, 0.1))
    for k in range(100):
        for base in (prompt, late):
            base.command(0.5, 0.3, 0.02 * k)
            base.advance(0.02 * (k + 1))
    assert prompt.pose[2] == pytest.approx(0.3 * (2.0 - 0.01))  # half a step to reach the command
    assert late.pose[2] == pytest.approx(0.3 * (2.0 - 0.01 - 0.1))
    radius = 0.5 / 0.3
    assert prompt.pose[:2] == pytest.approx(
        (radius * math.sin(prompt.pose[2]), radius * (1 - math.cos(prompt.pose[2]))), abs=1e-9
    )
    assert prompt.measured == prompt.pose


def test_measured_poses_are_within_the_noise_of_the_true_one_and_slip_slows_down() -> None:
    base, errors = SimulatedBase(ROBOT, (0, 0, 0), slip=0.1, noise=0.05, seed=5), []
    for k in range(500):
        base.command(1.0, 0.0, 0.02 * k)
        base.advance(0.02 * (k + 1))
        errors.append(math.dist(base.measured[:2], base.pose[:2]))
        assert 0.89 < base.velocity.v <= 1.0
    assert 0.045 < max(errors) <= 0.05
    assert 9.0 < math.hypot(*base.pose[:2]) < 9.99


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(OptionError, match="disturbances are delay"):
        hpop.simulate(asked(), WAY, lag=1)
    with pytest.raises(OptionError, match="slip"):
        hpop.simulate(asked(), WAY, slip=2)
    with pytest.raises(OptionError, match="Person"):
        hpop.simulate(asked(), WAY, people=[(1, 2)])
    assert farthest_off(DriveLimits.of(ROBOT)) < farthest_off(DriveLimits.of(ROBOT), **WORST) < 0.3
