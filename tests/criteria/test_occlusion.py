"""Occlusion: shares that areas give; what is in the ball or round the camera hides nothing, a robot's own body does."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Occlusion, make_criterion, motion_costs, trajectory_cost
from hpop.criteria.base import describe_criterion
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.world.geometry.solids import Box, Cylinder, Sphere
from tests.jointed import Jointed, agrees_everywhere, camera_at, states_of, tour

TARGET = (2.0, 0.0, 0.3)
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
    criterion = Occlusion(TARGET)
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
    found = share(Jointed(), panel(-1, edge), Occlusion(TARGET, radius=radius, rays=2000))
    assert found == pytest.approx(hidden, abs=0.02)


def test_what_is_in_the_ball_is_the_target_and_hides_nothing():
    can = hpop.World.from_polygons([(shapely.Point(2.0, 0.0).buffer(0.05), (0.2, 0.4))], extent=EXTENT)
    assert share(Jointed(), can, Occlusion(TARGET, radius=0.2)) == 0.0
    assert share(Jointed(), can, Occlusion(TARGET, radius=0.01)) == 1.0  # a target within the can


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
    assert share(Fingered(), OPEN, Occlusion(TARGET), row) == 0.0
    assert share(Fingered(finger=0.2), OPEN, Occlusion(TARGET), row) == 1.0
    behind = Occlusion((-2.0, 0.0, 0.3))
    assert share(Fingered(finger=0.2), OPEN, behind, row) == 0.0


@dataclass(frozen=True)
class Cased(Jointed):
    """The double with its camera's lens in the front face of a case."""

    def bodies(self, states):
        poses = poses_of(self.pose("camera", states), states.size)
        poses[:, :3, 3] -= 0.05 * poses[:, :3, 0]
        return [(Box((0.1, 0.08, 0.06)), poses)]


@pytest.mark.parametrize("target", [TARGET, (-2.0, 0.0, 0.3)])
def test_a_case_with_the_lens_in_its_face_hides_nothing_however_places_round(target):
    """Rounding puts the camera within its case or before it, from posture to posture."""
    for yaw in np.linspace(-3.0, 3.0, 41):
        assert share(Cased(), OPEN, Occlusion(target), (0.1, 0.2, yaw)) == 0.0


def test_it_adds_up_on_edges_and_trajectories():
    world = panel(-1, 0.2)
    value = agrees_everywhere(Occlusion(TARGET), Jointed(), world)
    assert 0.0 < value < tour(Jointed()).duration


def test_it_serves_a_base_as_well():
    drive = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (0, 3, 0)])
    assert 0 < trajectory_cost(Occlusion((2.0, 0.0, 1.2)), drive, panel(0.5, 1.5)) < drive.duration


def test_what_it_declares():
    assert (Occlusion.group, Occlusion.unit, Occlusion.aggregate) == ("P", "s", "sum")
    assert make_criterion(describe_criterion(Occlusion(TARGET, rays=5))) == Occlusion(TARGET, rays=5)
    for wrong in ({"radius": 0.0}, {"rays": 0}, {"rays": 2.5}):
        with pytest.raises(CriterionError):
            Occlusion(TARGET, **wrong)
