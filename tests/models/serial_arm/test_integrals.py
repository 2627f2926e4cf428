"""Costs of reaches through the whole space of an arm: as a dense rule on even panels of each phase has them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from hpop.criteria import make_criterion, motion_costs
from hpop.motions import Motions
from hpop.world import World
from hpop.world.geometry.solids import Box, Cylinder, Solid, pose_at
from tests.models.serial_arm.arms import arm6

CAN = (0.7, 0.25, 0.43)
SHELF = World.from_solids(
    [
        Solid(Box((1.0, 1.4, 0.04)), pose_at((0.2, 0.0, -0.02)), "table"),
        Solid(Box((0.3, 1.0, 0.02)), pose_at((0.65, 0.0, 0.36)), "board"),
        Solid(Box((0.3, 0.02, 0.33)), pose_at((0.65, 0.05, 0.535)), "divider"),
        Solid(Cylinder(radius=0.033, length=0.115), pose_at(CAN), "can"),
    ]
)
SMOOTH = [
    "rotation",
    "camera_length",
    {"look_at": {"target": CAN}},
    "singularity",
    "joint_limits",
    {"view_distance": {"target": CAN}},
    "hand_eye_misalignment",
    "camera_roll",
    "angular_acceleration",
    "heading_mismatch",
    "joint_energy",
]
FEW, MANY = 60, 2000
AT_ONCE = 50  # motions whose dense costs are computed together

arm = cache(arm6)


@cache
def reaches(count: int) -> Motions:
    """From random states to others."""
    rng, model = np.random.default_rng(14), arm()
    return Motions(SHELF, model, model.laws["reach"], model.space.sample(rng, count), model.space.sample(rng, count))


def dense(criterion, motions: Motions, panels: int) -> np.ndarray:
    """Costs (M,) by so many panels of two Gauss nodes, or of five, in each phase."""
    parts = []
    for begin in range(0, len(motions), AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        ends = motions.start.take(part), motions.end.take(part)
        parts.append(motion_costs(criterion, Motions(motions.world, motions.model, motions.law, *ends, panels=panels)))
    return np.concatenate(parts)


@pytest.mark.cases(but=("camera_length-60", "rotation-60"))
@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize("asked", SMOOTH, ids=lambda asked: asked if isinstance(asked, str) else next(iter(asked)))
def test_costs_of_long_reaches_are_right_to_a_thousandth(asked, count):
    """Each of its own cost; where that is next to nothing, of a twentieth of their mean.

    A view distance is nothing within its band, which a motion may leave between nodes for a moment.
    """
    criterion, motions = make_criterion(asked), reaches(count)
    exact = dense(criterion, motions, 80 if count == FEW else 150)
    error = np.abs(motion_costs(criterion, motions) - exact)
    assert (error / np.maximum(exact, 0.05 * exact.mean())).max() <= (3e-3 if "view_distance" in asked else 1e-3)
    assert np.median(error / exact.mean()) <= 5e-5


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
def test_occlusion_of_long_reaches_is_timed_to_a_hundredth(count):
    """In the mean of what it costs, and each to .05 s: it jumps from ray to ray."""
    criterion, motions = make_criterion({"occlusion": {"target": CAN}}), reaches(count)
    exact = dense(criterion, motions, 60 if count == FEW else 150)
    error = np.abs(motion_costs(criterion, motions) - exact)
    assert error.mean() <= 0.01 * exact.mean()
    assert error.max() <= 0.05
