"""Looking at a target: closed forms, an independent integral, and small angles without loss."""

import math

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import LookAt, make_criterion, trajectory_cost
from hpop.criteria.base import describe_criterion
from hpop.errors import CriterionError
from tests.jointed import Jointed, agrees_everywhere, moments, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))
TARGET = (1.0, 0.4, 0.5)


def test_a_turn_towards_a_target_costs_what_is_left_of_the_angle():
    """Half the angle on average, as the profile is the same to and fro."""
    model = hpop.DifferentialDrive(camera_height=1.0)
    turn = hpop.Trajectory.from_poses(model, [(0, 0, 0), (0, 0, 1.3)])
    target = (5 * math.cos(1.3), 5 * math.sin(1.3), 1.0)
    assert trajectory_cost(LookAt(target), turn, WORLD) == pytest.approx(0.65 * turn.duration, rel=1e-9)


def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled():
    trajectory = tour(Jointed())
    _, step, place, (ahead, *_) = moments(trajectory, 20_000)
    d = np.array(TARGET)[:, None] - place
    expected = np.sum(np.arccos(np.sum(ahead * d, axis=0) / np.linalg.norm(d, axis=0))) * step
    assert agrees_everywhere(LookAt(TARGET), Jointed(), WORLD) == pytest.approx(expected, rel=1e-4)


def test_turning_the_world_with_the_robot_changes_nothing():
    angle = 0.8
    turned = Jointed(foot=(0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.3), yaw=angle)
    x, y, z = TARGET
    target = (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z)
    costs = [
        trajectory_cost(criterion, tour(model), WORLD)
        for model, criterion in ((Jointed(foot=(0.2, 0.0, 0.3)), LookAt(TARGET)), (turned, LookAt(target)))
    ]
    assert costs[0] == pytest.approx(costs[1], rel=1e-12)


def test_a_camera_that_is_off_by_a_hair_is_off_by_that():
    model = hpop.DifferentialDrive(camera_height=1.0)
    stands = hpop.Trajectory.from_poses(model, [(0, 0, 0), (1e-3, 0, 0)])
    off = trajectory_cost(LookAt((4.0, 4e-9, 1.0)), stands, WORLD) / stands.duration
    assert off == pytest.approx(1e-9, rel=1e-3)


def test_a_target_is_given_by_whoever_asks():
    again = make_criterion(describe_criterion(LookAt([1, 2.5, 0])))
    assert again == LookAt((1.0, 2.5, 0.0))
    for wrong in ((1.0, 2.0), "here", (1.0, 2.0, math.nan)):
        with pytest.raises(CriterionError, match="target"):
            LookAt(wrong)
    with pytest.raises(CriterionError, match="target"):
        make_criterion("look_at")


def test_what_it_declares():
    assert (LookAt.group, LookAt.unit, LookAt.aggregate) == ("P", "rad s", "sum")
