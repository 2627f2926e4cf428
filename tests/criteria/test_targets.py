"""Views of a target: direction, distance and occlusion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi
import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import LookAtCriterion, Occlusion, ViewDistance, make_criterion, motion_costs, trajectory_cost
from hpop.criteria.base import describe_criterion
from hpop.errors import CriterionError, OptionError
from hpop.motions import Motions, States
from hpop.world.geometry.solids import Box, Cylinder, Sphere
from tests.jointed import Jointed, agrees_everywhere, camera_at, moments, states_of, tour
from tests.models.serial_arm.arms import arm6

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))
TARGET_LOOK_AT = (1.0, 0.4, 0.5)


def test_a_turn_towards_a_target_costs_what_is_left_of_the_angle():
    """Half the angle on average, as the profile is the same to and fro."""
    model = hpop.DifferentialDrive(camera_height=1.0)
    turn = hpop.Trajectory.from_poses(model, [(0, 0, 0), (0, 0, 1.3)])
    target = (5 * math.cos(1.3), 5 * math.sin(1.3), 1.0)
    assert trajectory_cost(LookAtCriterion(target), turn, WORLD) == pytest.approx(0.65 * turn.duration, rel=1e-9)


def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled_for_look_at():
    trajectory = tour(Jointed())
    _, step, place, (ahead, *_) = moments(trajectory, 20_000)
    d = np.array(TARGET_LOOK_AT)[:, None] - place
    expected = np.sum(np.arccos(np.sum(ahead * d, axis=0) / np.linalg.norm(d, axis=0))) * step
    assert agrees_everywhere(LookAtCriterion(TARGET_LOOK_AT), Jointed(), WORLD) == pytest.approx(expected, rel=1e-4)


def test_turning_the_world_with_the_robot_changes_nothing():
    angle = 0.8
    turned = Jointed(foot=(0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.3), yaw=angle)
    x, y, z = TARGET_LOOK_AT
    target = (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z)
    costs = [
        trajectory_cost(criterion, tour(model), WORLD)
        for model, criterion in (
            (Jointed(foot=(0.2, 0.0, 0.3)), LookAtCriterion(TARGET_LOOK_AT)),
            (turned, LookAtCriterion(target)),
        )
    ]
    assert costs[0] == pytest.approx(costs[1], rel=1e-12)


def test_a_camera_that_is_off_by_a_hair_is_off_by_that():
    model = hpop.DifferentialDrive(camera_height=1.0)
    stands = hpop.Trajectory.from_poses(model, [(0, 0, 0), (1e-3, 0, 0)])
    off = trajectory_cost(LookAtCriterion((4.0, 4e-9, 1.0)), stands, WORLD) / stands.duration
    assert off == pytest.approx(1e-9, rel=1e-3)


def test_a_target_is_given_by_whoever_asks():
    again = make_criterion(describe_criterion(LookAtCriterion([1, 2.5, 0])))
    assert again == LookAtCriterion((1.0, 2.5, 0.0))
    for wrong in ((1.0, 2.0), "", 7, (1.0, 2.0, math.nan)):
        with pytest.raises(CriterionError, match="target"):
            LookAtCriterion(wrong)
    with pytest.raises(CriterionError, match="target"):
        make_criterion("look_at")


def test_what_it_declares_for_look_at():
    assert (LookAtCriterion.group, LookAtCriterion.unit, LookAtCriterion.aggregate) == ("P", "rad s", "sum")


TARGET_VIEW_DISTANCE = (0.6, 0.5, 0.4)


def test_driving_past_a_band_costs_two_triangles():
    """From 4 m to 1 m before the target at 1 m/s; the band is from 2 to 3 m."""
    model = hpop.DifferentialDrive(camera_height=1.0)
    drive = hpop.Trajectory.from_poses(model, [(0, 0, 0), (3, 0, 0)])
    criterion = ViewDistance((4.0, 0.0, 1.0), near=2.0, far=3.0)
    assert trajectory_cost(criterion, drive, WORLD) == pytest.approx(0.5 + 0.5, rel=1e-6)
    assert trajectory_cost(ViewDistance((4.0, 0.0, 1.0), near=0.5, far=4.5), drive, WORLD) == 0.0


def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled_for_view_distance():
    trajectory = tour(Jointed())
    _, step, place, _ = moments(trajectory, 20_000)
    distance = np.linalg.norm(np.array(TARGET_VIEW_DISTANCE)[:, None] - place, axis=0)
    expected = np.sum(np.maximum(0.3 - distance, 0) + np.maximum(distance - 0.5, 0)) * step
    found = agrees_everywhere(ViewDistance(TARGET_VIEW_DISTANCE, near=0.3, far=0.5), Jointed(), WORLD)
    assert found == pytest.approx(expected, rel=1e-3)


def test_what_it_declares_for_view_distance():
    assert (ViewDistance.group, ViewDistance.unit, ViewDistance.aggregate) == ("P", "m s", "sum")
    with pytest.raises(CriterionError, match="near must not exceed far"):
        ViewDistance(TARGET_VIEW_DISTANCE, near=1.0, far=0.5)


TARGET_OCCLUSION = (2.0, 0.0, 0.3)
EXTENT = shapely.box(-5, -5, 5, 5)
OPEN = hpop.World.from_polygons([], extent=EXTENT)


def share(model, world, criterion, row=(0.0, 0.0, 0.0)):
    """Blocked share in one posture."""
    here, there = (states_of(model, [(row[0] + change, *row[1:])]) for change in (0.0, 1e-9))
    motions = Motions(world, model, model.laws["reach"], here, there)
    return float(motion_costs(criterion, motions)[0] / motions.duration[0])


def panel(y_min, y_max, *, x=1.0, z=(-1.0, 2.0)):
    """Return a world with a thin wall between the camera and the target."""
    return hpop.World.from_polygons([(shapely.box(x, y_min, x + 0.01, y_max), z)], extent=EXTENT)


def test_nothing_is_hidden_where_nothing_stands_and_all_behind_a_wall():
    criterion = Occlusion(TARGET_OCCLUSION)
    assert share(Jointed(), OPEN, criterion) == 0.0
    assert share(Jointed(), panel(-1, 1), criterion) == 1.0
    assert share(Jointed(), panel(-1, 1, x=2.5), criterion) == 0.0  # behind the target
    assert share(Jointed(), panel(-1, 1, z=(-1.0, 0.1)), criterion) == 0.0  # below the lines of sight


@pytest.mark.parametrize("edge", [-0.04, 0.0, 0.03])
def test_a_wall_before_part_of_a_ball_hides_that_part_of_its_disc(edge):
    """Its edge is seen on the plane of the ball's centre at an intercept; a segment of the disc is to its right."""
    place, _ = camera_at(tour(Jointed(), [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]), np.zeros(1))
    x, y, _ = place[:, 0]
    t = y + (edge - y) * (2.0 - x) / (1.0 - x)  # at the target's distance, m from its centre
    radius, d = 0.1, np.clip(t / 0.1, -1, 1)
    hidden = 1 - (math.acos(d) - d * math.sqrt(1 - d * d)) / math.pi
    found = share(Jointed(), panel(-1, edge), Occlusion(TARGET_OCCLUSION, radius=radius, rays=2000))
    assert found == pytest.approx(hidden, abs=0.02)


def test_what_is_in_the_ball_is_the_target_and_hides_nothing():
    can = hpop.World.from_polygons([(shapely.Point(2.0, 0.0).buffer(0.05), (0.2, 0.4))], extent=EXTENT)
    assert share(Jointed(), can, Occlusion(TARGET_OCCLUSION, radius=0.2)) == 0.0
    assert share(Jointed(), can, Occlusion(TARGET_OCCLUSION, radius=0.01)) == 1.0  # a target within the can


def test_a_camera_within_the_ball_sees_it():
    place, _ = camera_at(tour(Jointed(), [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]), np.zeros(1))
    assert share(Jointed(), panel(-1, 1), Occlusion(tuple(place[:, 0] + 0.01), radius=0.3)) == 0.0


def poses_of(pose, size):
    """Return poses as matrices (N, 4, 4)."""
    poses = np.tile(np.eye(4), (size, 1, 1))
    for i, column in enumerate((*pose.ahead, *pose.left, *pose.up)):
        poses[:, i % 3, i // 3] = column
    poses[:, :3, 3] = np.stack([pose.x, pose.y, pose.z], axis=1)
    return poses


@dataclass(frozen=True)
class Fingered(Jointed):
    """The double with a palm round its camera and a finger beside the view, or before it."""

    finger: float = 0.0  # m, ahead of the camera; nothing at 0

    def bodies(self, states):
        poses = poses_of(self.pose("camera", states), states.size)
        bodies = [(Sphere(0.05), poses)]
        if self.finger:
            before = poses.copy()
            before[:, :3, 3] += self.finger * poses[:, :3, 0]
            bodies += [(Cylinder(0.02, 0.001), before), (Box((0.01, 0.3, 0.3)), before)]
        return bodies


def test_the_robots_own_bodies_hide_it_but_not_what_holds_the_camera():
    row = (0.0, 0.0, 0.4)
    assert share(Fingered(), OPEN, Occlusion(TARGET_OCCLUSION), row) == 0.0
    assert share(Fingered(finger=0.2), OPEN, Occlusion(TARGET_OCCLUSION), row) == 1.0
    behind = Occlusion((-2.0, 0.0, 0.3))
    assert share(Fingered(finger=0.2), OPEN, behind, row) == 0.0


@dataclass(frozen=True)
class Cased(Jointed):
    """The double with its camera's lens in the front face of a case."""

    def bodies(self, states):
        poses = poses_of(self.pose("camera", states), states.size)
        poses[:, :3, 3] -= 0.05 * poses[:, :3, 0]
        return [(Box((0.1, 0.08, 0.06)), poses)]


@pytest.mark.parametrize("target", [TARGET_OCCLUSION, (-2.0, 0.0, 0.3)])
def test_a_case_with_the_lens_in_its_face_hides_nothing_however_places_round(target):
    """Rounding puts the camera within its case or before it, from posture to posture."""
    for yaw in np.linspace(-3.0, 3.0, 41):
        assert share(Cased(), OPEN, Occlusion(target), (0.1, 0.2, yaw)) == 0.0


def test_it_adds_up_on_edges_and_trajectories():
    world = panel(-1, 0.2)
    value = agrees_everywhere(Occlusion(TARGET_OCCLUSION), Jointed(), world)
    assert 0.0 < value < tour(Jointed()).duration


def test_it_serves_a_base_as_well():
    drive = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (0, 3, 0)])
    assert 0 < trajectory_cost(Occlusion((2.0, 0.0, 1.2)), drive, panel(0.5, 1.5)) < drive.duration


@pytest.mark.parametrize("model", [arm6(), hpop.DifferentialDrive()], ids=["arm", "base"])
def test_occlusion_of_no_motions_is_no_cost_and_that_of_symbols_is_refused(model):
    law, criterion = next(iter(model.laws.values())), Occlusion(TARGET_OCCLUSION)
    nothing = States(**dict.fromkeys(model.space.names, np.zeros(0)))
    assert criterion.cost(Motions(WORLD, model, law, nothing, nothing)).size == 0
    symbols = States(**{name: casadi.SX.sym(name) for name in model.space.names})
    with pytest.raises(OptionError, match="use a planner on a graph"):
        criterion.cost(Motions(WORLD, model, law, symbols, symbols))


def test_what_it_declares_for_occlusion():
    assert (Occlusion.group, Occlusion.unit, Occlusion.aggregate) == ("P", "s", "sum")
    assert make_criterion(describe_criterion(Occlusion(TARGET_OCCLUSION, rays=5))) == Occlusion(
        TARGET_OCCLUSION, rays=5
    )
    for wrong in ({"radius": 0.0}, {"rays": 0}, {"rays": 2.5}):
        with pytest.raises(CriterionError):
            Occlusion(TARGET_OCCLUSION, **wrong)
