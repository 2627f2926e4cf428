"""Every criterion on a serial arm: what it asks for is there, costs agree on edges, and its own links hide a target."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import criteria
from hpop.criteria import Clearance, Occlusion, motion_costs, trajectory_cost
from hpop.criteria.robot.joints import manipulability
from hpop.models.serial_arm.chain import frames
from hpop.motions import lacking
from hpop.world.content.content import Landmark
from tests.jointed import camera_at, jacobian, states_of
from tests.own_criteria import NAMES, own_criterion

URDF = Path(__file__).resolve().parents[2] / "examples/arm/arm6.urdf"
ARM = hpop.SerialArm.from_urdf(
    URDF, tip="tool", acceleration=2.0, camera=(0.05, 0.0, 0.03, 0.0, 0.0, 0.0), field_of_view=(1.2, 0.9)
)
WORLD = hpop.World.from_polygons(
    [(shapely.box(0.7, -0.8, 0.8, 0.4), (0.0, 0.5)), (shapely.box(-0.6, 0.5, 0.2, 0.6), (0.0, 1.5))],
    extent=shapely.box(-2, -2, 2, 2),
).with_content(landmarks=[Landmark(0.9, 0.6, z=0.4)])
ROWS = np.random.default_rng(1).uniform(-1.0, 1.0, (4, len(ARM.joints)))
TOUR = hpop.Trajectory.through(ARM, states_of(ARM, ROWS))
EVALUATED = [name for name in NAMES if not lacking(criteria[name].requires, ARM, WORLD)]


def test_frames_are_those_of_its_bodies():
    states = states_of(ARM, ROWS)
    mount = ARM.chain.mounts["camera"]
    found = frames(ARM.chain, states)[mount.frame] @ mount.pose
    place, axes = camera_at(TOUR, TOUR.times)
    np.testing.assert_allclose(found[:, :3, 3], place.T, atol=1e-12)
    np.testing.assert_allclose(found[:, :3, :3], np.moveaxis(axes, (0, 1, 2), (2, 1, 0)), atol=1e-12)


@pytest.mark.cases(but=("clearance",))
@pytest.mark.parametrize("name", [name for name in EVALUATED if name != "passing_distance"])
def test_costs_of_edges_alone_add_up_to_the_trajectorys(name):
    criterion = own_criterion(name)
    value = trajectory_cost(criterion, TOUR, WORLD)
    assert math.isfinite(value)
    assert value >= 0.0
    if criterion.aggregate == "trajectory":
        return
    ((_, motions),) = TOUR.batches(WORLD)
    costs = np.concatenate([motion_costs(criterion, part(motions, i)) for i in range(len(motions))])
    total = {"sum": costs.sum(), "max": costs.max(), "time-mean": costs.sum() / TOUR.duration}[criterion.aggregate]
    assert value == pytest.approx(total, rel=1e-9, abs=1e-12)


def test_its_clearance_is_that_of_all_its_links_at_the_worst_moment():
    nearest = ARM.collision(WORLD).clearance(TOUR.at(np.linspace(0.0, TOUR.duration, 400))).min()
    found = trajectory_cost(Clearance(enough=0.6), TOUR, WORLD)
    assert found == pytest.approx(0.6 - nearest, abs=WORLD.cell / 4)
    assert found > 0.0


def part(motions, i):
    return type(motions)(WORLD, ARM, motions.law, motions.start.take([i]), motions.end.take([i]))


def test_manipulability_is_that_of_differences_of_the_tools_pose():
    expected = [abs(np.linalg.det(jacobian(ARM, "tool", row))) for row in ROWS]
    np.testing.assert_allclose(manipulability(ARM, states_of(ARM, ROWS)), expected, rtol=1e-5, atol=1e-9)


def test_a_target_behind_its_own_links_is_hidden():
    """From the camera to the middle of the root link: other links, or that one's own surface, are before it."""
    states = states_of(ARM, ROWS)
    _, poses = ARM.bodies(states)[0]
    target = tuple(poses[0, :3, 3])
    found = trajectory_cost(Occlusion(target, radius=0.001), TOUR, hpop.World.from_polygons([], extent=WORLD.extent))
    assert found == pytest.approx(TOUR.duration, rel=1e-3)
