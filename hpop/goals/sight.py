"""Lines of sight from the camera to a target, for goals that look at it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.motions import Model, States
from hpop.world.geometry.rays_in_space import Surfaces, rows, surfaces_of, towards_ball
from hpop.world.geometry.solids import Solid

if TYPE_CHECKING:
    from hpop.goals.base import Goal
    from hpop.world import World

TARGET_RADIUS = 0.05  # m: a target is a ball of this radius; solids within the ball do not hide it
RAYS = 37  # number of rays to this ball
MOST_HIDDEN = 0.5  # share of the rays that may be blocked on the way to a target that must be visible


def hidden_share(
    world: World, model: Model, states: States, target: tuple[float, float, float], *, by_robot: bool
) -> FloatArray:
    """Return the share (N,) of the rays from the camera to a ball about a target that solids of the world block.

    ``by_robot`` says whether the bodies of the robot block rays too, except bodies that contain or touch the camera.
    """
    pose = model.pose("camera", states)
    camera = rows((pose.x, pose.y, pose.z), states.size)
    bodies = model.bodies(states) if by_robot else []
    shapes = Surfaces.of([Solid(shape, np.eye(4)) for shape, _ in bodies])
    poses = np.stack([each for _, each in bodies]) if bodies else np.empty((0, states.size, 4, 4))
    rays = towards_ball(camera, target, TARGET_RADIUS, RAYS)
    return np.asarray(surfaces_of(world).blocked(shapes, poses, camera, *rays))


def sees_target(world: World, model: Model, states: States, target: tuple[float, float, float]) -> BoolArray:
    """Return whether at least half of a target, a ball of 5 cm radius, is visible from the camera (N,)."""
    return np.asarray(hidden_share(world, model, states, target, by_robot=True) <= MOST_HIDDEN)


def reached_in(world: World, goal: Goal, model: Model, states: States) -> BoolArray:
    """Return which states (M,) reach a goal in a world, with a visible target if the goal requires this."""
    found = np.zeros(states.size, dtype=bool)
    for each in goal.alternatives():
        there = np.flatnonzero(each.reached(model, states) & ~found)
        if each.visible and each.looked_at is not None and there.size:
            there = there[sees_target(world, model, states.take(there), each.looked_at)]
        found[there] = True
    return found
