"""A robot of joints with a camera and no base: every criterion gives its cost in space, or is refused by name."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import hpop
from hpop.base.registry import criteria
from hpop.criteria import Clearance, make_criterion, trajectory_cost
from hpop.criteria.base import check_requirements
from hpop.criteria.comfort import body_motion
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import lacking
from hpop.testing import random_world
from hpop.trajectories.history import History
from tests.jointed import Anywhere, Jointed, camera_at, moments, tour
from tests.own_criteria import NAMES, own_criterion

WORLD = random_world(np.random.default_rng(3))
ARM = Jointed(foot=(5.0, 4.5, 0.8))
FLAT = {"passing_distance", "clearance"}  # of a plane, or of a base where nothing measures the whole robot


@pytest.mark.parametrize("name", NAMES)
def test_every_criterion_costs_something_sensible_or_is_refused_by_its_name(name):
    criterion, trajectory = own_criterion(name), tour(ARM)
    if lacking(criteria[name].requires, ARM, WORLD) or name in FLAT:
        with pytest.raises(CriterionError, match=f"'{name}' (requires|cannot be used here: ).*"):
            trajectory_cost(criterion, trajectory, WORLD)
        return
    value = trajectory_cost(criterion, trajectory, WORLD)
    assert math.isfinite(value)
    assert value >= 0.0


def test_what_needs_a_base_a_heading_or_wheels_says_so():
    refused = {name for name in NAMES if lacking(criteria[name].requires, ARM, WORLD)}
    assert {"length", "net_winding", "bending_energy", "curvature_sign_changes", "orientation_retention"} <= refused
    assert {"net_misalignment", "energy", "smoothness", "proximity", "social_force"} <= refused
    of_camera = {"rotation", "jerk", "msdv", "sickness", "optic_flow", "exposure", "landmark_visibility", "openness"}
    assert not refused & (of_camera | {"joint_length", "singularity", "occlusion", "heading_mismatch", "duration"})


INSTEAD = {
    "length": "'camera_length' or 'joint_length'",
    "net_winding": "'rotation' or 'camera_roll'",
    "proximity": "'clearance'",
    "energy": "'joint_energy'",
}


@pytest.mark.parametrize(("name", "others"), INSTEAD.items())
def test_what_an_arm_cannot_have_names_what_it_can(name, others):
    with pytest.raises(CriterionError, match=rf"'{name}' requires .* has; take {others}$"):
        trajectory_cost(own_criterion(name), tour(ARM), WORLD)


def test_what_is_named_instead_is_a_criterion_that_the_model_can_have():
    assert all(other in criteria for name in NAMES for other in getattr(criteria[name], "instead", ()))
    camera_alone = SimpleNamespace(provides=frozenset({"camera"}))
    with pytest.raises(CriterionError, match=r"'length' requires base, .* has; take 'camera_length'$"):
        check_requirements(own_criterion("length"), camera_alone, WORLD)


# Against differences of the camera's places and axes, sampled finely


def steps(trajectory, count=8_000):
    """Rotation vectors (3, N) between neighbouring moments, world frame, the step, s, and places (3, N + 1)."""
    times = np.linspace(0.0, trajectory.duration, count + 1)
    place, axes = camera_at(trajectory, times)
    frames = Rotation.from_matrix(np.moveaxis(axes, (0, 1, 2), (2, 1, 0)))
    return (frames[1:] * frames[:-1].inv()).as_rotvec().T, times[1], place


def test_rotation_is_the_sum_of_small_rotations_about_any_axis():
    turned, _, _ = steps(tour(ARM))
    expected = np.linalg.norm(turned, axis=0).sum()
    assert trajectory_cost(make_criterion("rotation"), tour(ARM), WORLD) == pytest.approx(expected, rel=1e-4)


def test_angular_acceleration_is_how_fast_the_rotation_vector_changes():
    turned, step, _ = steps(tour(ARM), 40_000)
    rates = np.linalg.norm(np.diff(turned / step, axis=1) / step, axis=0)
    rates = rates[rates < 20.0]  # where a phase begins or ends the difference is of two phases
    expected = np.sum(np.maximum(rates - math.radians(1.0), 0.0)) * step
    found = trajectory_cost(make_criterion("angular_acceleration"), tour(ARM), WORLD)
    assert found == pytest.approx(expected, rel=5e-3)


def test_heading_mismatch_is_the_angle_between_view_and_way():
    trajectory = tour(ARM)
    _, step, place, (ahead, *_) = moments(trajectory, 40_000)
    velocity = np.gradient(place, step, axis=1)
    speed = np.linalg.norm(velocity, axis=0)
    cosine = np.sum(velocity * ahead, axis=0) / np.maximum(speed, 1e-12)
    expected = np.sum(np.arccos(np.clip(cosine, -1, 1)) * np.minimum(speed / 0.1, 1.0)) * step
    assert trajectory_cost(make_criterion("heading_mismatch"), trajectory, WORLD) == pytest.approx(expected, rel=2e-3)


def test_what_the_eyes_see_turn_is_the_whole_rotation_in_the_cameras_frame():
    """Also straight up and down, where yaw and roll mean nothing, against the robot's own twists."""
    steep = replace_limits(ARM)
    trajectory = tour(steep, [(0.0, 1.3, 0.0), (0.4, 1.9, 1.0), (-0.2, 1.2, 0.3)])
    visual = body_motion(History(WORLD, trajectory), "camera", 0.005)
    states, (rates, changes) = trajectory.at(visual.times), trajectory.rates(visual.times)
    _, axes = camera_at(trajectory, visual.times)
    for vector, found in (
        (steep.twist("camera", states, rates).rotation, visual.rotation),
        (steep.twist_rate("camera", states, rates, changes).velocity, visual.acceleration),
    ):
        expected = np.einsum("ijn,jn->ni", axes, np.stack(vector))
        away = np.abs(visual.times[:, None] - phase_ends(trajectory)).min(axis=1) > 2 * visual.step
        np.testing.assert_allclose(found[away], expected[away], atol=2e-3)


def replace_limits(arm):
    """Return the arm with a link that may go over the top."""
    over = Jointed(foot=arm.foot)
    over.__dict__["space"] = replace(over.space, low=(-2.5, -3.0, -np.pi), high=(2.5, 3.0, np.pi))
    return over


def phase_ends(trajectory):
    """Return the times (P,), s, at which a phase of a motion begins or ends."""
    ends = [0.0]
    for i in range(len(trajectory)):
        states = (trajectory.states.take([j]) for j in (i, i + 1))
        begin = trajectory.times[i]
        for phase in trajectory.model.laws["reach"].phases(*states):
            begin = begin + phase.duration[0]
            ends.append(begin)
    return np.array(ends)


# Frames, and the whole robot's clearance


def test_turning_the_robot_together_with_the_world_changes_no_cost():
    angle, about = 0.7, (5.0, 4.5)
    world = hpop.World.from_polygons(
        [(shapely.box(5.6, 4.0, 5.8, 5.0), (0.0, 1.1)), (shapely.box(3.0, 5.0, 6.0, 5.2), (0.5, 2.0))],
        extent=shapely.box(0, 0, 10, 10),
    )
    turned = hpop.World.from_polygons(
        [(shapely.affinity.rotate(o.polygon, angle, about, use_radians=True), o.heights) for o in world.obstacles],
        extent=world.extent,
    )
    arms = replace(ARM, field_of_view=(1.5, 1.0)), replace(ARM, yaw=angle, field_of_view=(1.5, 1.0))
    compared = 0
    for name in NAMES:
        if lacking(criteria[name].requires, ARM, world) or name in FLAT or criteria[name].world_frame:
            continue
        costs = [
            trajectory_cost(own_criterion(name), tour(arm), here)
            for arm, here in zip(arms, (world, turned), strict=True)
        ]
        share = {"worst_obstruction": 0.05, "enclosure": 5e-3, "openness": 5e-3}.get(
            name, 1e-6
        )  # rays stay as they are
        share = 0.03 if name in ("exposure", "obstruction") else share
        assert costs[0] == pytest.approx(costs[1], rel=share, abs=1e-9), name
        compared += costs[0] > 0.0
    assert compared >= 18


def test_clearance_is_of_the_whole_robot_where_its_collision_measures_it():
    class Measured(Anywhere):
        def clearance(self, states):
            return 0.5 + 0.2 * np.cos(states.swing)

    class Careful(Jointed):
        def collision(self, world):
            return Measured()

    swing = tour(Careful(), [(-0.5, 0.0, 0.0), (1.2, 0.0, 0.0)])
    found = trajectory_cost(Clearance(enough=1.0), swing, WORLD)
    assert found == pytest.approx(1.0 - 0.5 - 0.2 * math.cos(1.2))


def test_a_robot_that_nobody_measures_has_no_clearance():
    with pytest.raises(UnsupportedCriterion, match="'clearance' cannot be used here: the criterion needs a model"):
        trajectory_cost(Clearance(), tour(ARM), WORLD)
