"""The Panda, and the problems of MotionBenchMaker that are set for it.

Its meshes and URDF are those of the wheel example-robot-data. The fingers are 40 mm out, as far as they go: the
requests say 65 mm, and 105 mm would put them into obstacles at some goals.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest

from benchmarks import mbm
from benchmarks.mbm import FINGERS, NUMBERS, SETS
from hpop.models.serial_arm.model import SerialArm
from hpop.world import World

__all__ = ["FINGERS", "NUMBERS", "SETS", "asked", "panda"]


@cache
def panda(data: Path, fingers: float = FINGERS) -> SerialArm:
    """The arm with its camera beside the fingers; the test is skipped where its meshes are not installed."""
    arm = mbm.panda(data, fingers)
    if arm is None:
        pytest.skip("the Panda's meshes are in the wheel example-robot-data, which is not installed")
    return arm


def asked(data: Path, name: str, number: int) -> tuple[World, Mapping[str, float], Mapping[str, float]]:
    """World, start and goal of a problem by set and number."""
    return mbm.asked(name, number, data)
