"""A front of a small room, planned once: its rows are what studies show."""

from __future__ import annotations

import pytest
import shapely

import hpop
from hpop import study

CONSENT = "You will ride along with a robot.\n\nYou may stop at any time."


@pytest.fixture(scope="session")
def front() -> hpop.Front:
    """Six ways about a pillar, which last 14 to 17 s."""
    world = hpop.World.from_polygons([shapely.box(2, 1, 3, 3)], extent=shapely.box(0, 0, 5, 4))
    robot = hpop.DifferentialDrive(radius=0.2)
    return hpop.Problem(world, robot, (0.5, 2, 0), (4.5, 2, None), ["exposure", "turns", "length"]).solve(step=0.5)


@pytest.fixture(scope="session")
def design(front: hpop.Front) -> study.Design:
    """Three rows, twelve people in six orders, one f and one m in each."""
    rows = study.pick(front, 3, always=("knee", "least turns"))
    return study.Design.of(front, rows, participants=12, strata={"sex": ("f", "m")}, consent=CONSENT, seed=7)
