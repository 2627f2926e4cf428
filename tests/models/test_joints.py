"""Parts and bodies that joints carry: where they are, how fast they move, and what they meet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import ModelError
from hpop.models.base import Joint, Mount, Part, PlanarModel, plane_space
from hpop.models.collision.planar import PlanarCollision
from hpop.models.collision.solid import SolidCollision
from hpop.models.laws import Move, Turn, joint_laws
from hpop.motions import Motions, States

LIFT = Joint("lift", "up", 0.0, 0.8)
HINGE = Joint("hinge", "round", -math.pi / 2, math.pi / 2, at=(0.2, 0.0))
SLIDE = Joint("slide", "ahead", 0.0, 0.5)
CHAIN = (LIFT, HINGE, SLIDE)
BOOM = Part(((0.2, 0.05), (0.8, 0.05), (0.8, -0.05), (0.2, -0.05)), 0.0, 1.0, 1.1, on=CHAIN)


@dataclass(frozen=True)
class Crane(PlanarModel):
    """A disc with a boom on a lift, a hinge 0.2 m ahead of its axis, and a slide along the boom."""

    name = "crane"
    executed = {"move": "move", "turn": "turn"}  # noqa: RUF012

    @cached_property
    def space(self):
        return plane_space(1.0, CHAIN)

    @cached_property
    def laws(self):
        return {"move": Move(1.0), "turn": Turn(1.0, 2.0, 1.0), **joint_laws(CHAIN, 1.0)}

    @property
    def parts(self):
        return (Part(((0.0, 0.0),), 0.3, 0.0, 0.4), BOOM)

    @property
    def mounts(self):
        return {"base": Mount(), "camera": Mount(0.8, 0.0, 1.05, on=CHAIN)}


def states(*rows):
    return States(**dict(zip(Crane().space.names, np.array(rows, float).T, strict=True)))


def test_a_camera_is_where_its_joints_carry_it():
    pose = Crane().pose(
        "camera", states((1, 2, 0, 0, 0, 0), (1, 2, 0, 0.5, math.pi / 2, 0.1), (1, 2, math.pi / 2, 0, 0, 0.1))
    )
    # the hinge is 0.2 m ahead; beyond it the boom is 0.6 m long, and 0.7 m where the slide is out by 0.1 m
    np.testing.assert_allclose(pose.x, [1.8, 1.2, 1.0], atol=1e-12)
    np.testing.assert_allclose(pose.y, [2.0, 2.7, 2.9], atol=1e-12)
    np.testing.assert_allclose(pose.z, [1.05, 1.55, 1.05], atol=1e-12)
    np.testing.assert_allclose(pose.yaw, [0, math.pi / 2, math.pi / 2], atol=1e-12)


def test_velocity_and_acceleration_are_the_differences_of_places_while_all_joints_move():
    rng, step = np.random.default_rng(0), 1e-4
    start, rate, change = (rng.uniform(-0.4, 0.4, 6) for _ in range(3))
    at = [states(start + rate * t + 0.5 * change * t * t) for t in (-step, 0.0, step)]
    places = [
        np.array([float(np.ravel(getattr(Crane().pose("camera", one), axis))[0]) for axis in "xyz"]) for one in at
    ]
    twist = Crane().twist("camera", at[1], states(rate))
    twist_rate = Crane().twist_rate("camera", at[1], states(rate), states(change))
    np.testing.assert_allclose(np.ravel(twist.velocity), (places[2] - places[0]) / (2 * step), atol=1e-7)
    second = (places[2] - 2 * places[1] + places[0]) / step**2
    np.testing.assert_allclose(np.ravel(twist_rate.velocity), second, atol=1e-6)
    assert float(np.ravel(twist.rotation[2])[0]) == pytest.approx(rate[2] + rate[4])


def test_what_a_part_sweeps_holds_it_in_every_posture():
    rng = np.random.default_rng(1)
    rows = np.zeros((200, 6))
    rows[:, 3:] = rng.uniform([j.low for j in CHAIN], [j.high for j in CHAIN], (200, 3))
    swept = BOOM.swept
    region = shapely.convex_hull(shapely.MultiPoint(np.array(swept.corners))).buffer(swept.radius + 1e-9)
    assert shapely.covers(region, shapely.MultiPoint(BOOM.placed(states(*rows)).reshape(-1, 2)))
    assert (swept.z_min, swept.z_max, swept.on) == (1.0, pytest.approx(1.9), ())
    assert BOOM.reach == pytest.approx(math.hypot(1.3, 0.05), abs=2e-3)  # the slide out by 0.5 m
    assert Crane().platform == (Crane().parts[0], swept)


SHELF = hpop.World.from_polygons([(shapely.box(2.5, 0, 3.0, 4), (1.2, 3.0))], extent=shapely.box(0, 0, 6, 4))


def test_a_part_meets_what_is_at_the_height_to_which_it_is_lifted():
    collision = PlanarCollision(Crane().parts, SHELF)
    low, high, aside = (2, 2, 0, 0, 0, 0), (2, 2, 0, 0.4, 0, 0), (2, 2, 0, 0.4, math.pi / 2, 0)
    assert collision.states_free(states(low, high, aside)).tolist() == [True, False, True]
    assert collision.why_blocked(states(low)) == ""
    assert "is 0.500 m away and the robot reaches" in collision.why_blocked(states(high))
    assert not collision.clear(np.array([2.0]), np.array([2.0]))[0]
    assert collision.yaw_matters


def test_a_motion_of_a_joint_meets_what_is_in_its_way():
    law = Crane().laws
    cases = {
        "lift": ((2, 2, 0, 0, 0, 0), (2, 2, 0, 0.05, 0, 0), (2, 2, 0, 0.4, 0, 0)),
        "hinge": ((2, 2, 0, 0.4, 1.5, 0), (2, 2, 0, 0.4, 1.2, 0), (2, 2, 0, 0.4, 0.3, 0)),
        "slide": ((1.6, 2, 0, 0.4, 0, 0), (1.6, 2, 0, 0.4, 0, 0.05), (1.6, 2, 0, 0.4, 0, 0.3)),
    }
    for kind, (begin, free, blocked) in cases.items():
        motions = Motions(SHELF, Crane(), law[kind], states(begin, begin), states(free, blocked))
        assert PlanarCollision(Crane().parts, SHELF).motions_free(motions).tolist() == [True, False]
        assert SolidCollision(Crane().parts, SHELF).motions_free(motions).tolist() == [True, False]


def test_no_motion_is_free_to_plan_by_that_collides_to_the_judge():
    rng, model = np.random.default_rng(2), Crane()
    low, high = np.array([0.5, 0.5, -3, *(j.low for j in CHAIN)]), np.array([5.5, 3.5, 3, *(j.high for j in CHAIN)])
    planned, judged = PlanarCollision(model.parts, SHELF), SolidCollision(model.parts, SHELF)
    for kind in ("turn", "lift", "hinge", "slide"):
        start = rng.uniform(low, high, (60, 6))
        end = start.copy()
        column = model.space.names.index(next(iter(model.laws[kind].varies)))
        end[:, column] = rng.uniform(low[column], high[column], 60)
        motions = Motions(SHELF, model, model.laws[kind], states(*start), states(*end))
        free, right = planned.motions_free(motions), judged.motions_free(motions)
        assert not (free & ~right).any()
        assert free.sum() >= 0.9 * right.sum()


def test_joints_are_checked():
    for wrong, said in (
        ({"along": "down"}, "along must be one of up, ahead, left, round"),
        ({"low": 1.0, "high": 0.0}, "low must not be above high for the joint 'lift'"),
        ({"speed": 0.0}, "speed of the joint 'lift' must be a positive number, got 0.0"),
    ):
        with pytest.raises(ModelError, match=said):
            Joint(**{"name": "lift", "along": "up", "low": 0.0, "high": 1.0, **wrong})


def test_a_joint_beyond_its_stop_is_a_fault():
    rows = states((1, 1, 0, 0, 0, 0), (1, 1, 0, 1.0, 0, 0))
    trajectory = hpop.trajectories.trajectory.Trajectory(Crane(), rows, ("lift",))
    assert list(Crane().faults(trajectory)) == ["has a lift of 1 m in state 1, beyond its stop at 0.8 m"]
    assert Crane().doubtful(Crane().laws["lift"], rows.take([0]), rows.take([1])).tolist() == [True]
