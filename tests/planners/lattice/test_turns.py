"""Turns in place of a lattice are free exactly where the collision test finds each of them free."""

from __future__ import annotations

import numpy as np
import pytest

import hpop
from hpop.models.collision.planar import PlanarCollision
from hpop.planners.graphs.arcs import MOVE
from hpop.planners.graphs.lattice import LatticeGraph

FOOTPRINTS = {
    "rectangle": ((0.3, 0.225), (-0.3, 0.225), (-0.3, -0.225), (0.3, -0.225)),
    "off the axis": ((0.6, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.6, -0.1)),
}


def lattice_of(seed: int, footprint: str, headings: int):
    rng = np.random.default_rng(seed)
    cells = np.zeros((80, 80), bool)
    for row, column, high, wide in rng.integers((0, 0, 1, 1), (78, 78, 12, 8), (14, 4)).tolist():
        cells[row : row + high, column : column + wide] = True
    cells[32:48, 32:48] = False
    world = hpop.World.from_cells(cells, 0.05, origin=(-2.0, -2.0, 0.0))
    robot = hpop.DifferentialDrive(footprint=FOOTPRINTS[footprint])
    return LatticeGraph(anchor="world", headings=headings)._lattice(robot, world, world.bounds[:2])


@pytest.mark.parametrize("footprint", FOOTPRINTS)
@pytest.mark.parametrize("headings", [4, 8, 16])
@pytest.mark.seeds(1, of=10)
def test_turns_are_free_where_each_is_free_by_itself(seed, headings, footprint, monkeypatch):
    lattice = lattice_of(seed, footprint, headings)
    arcs = lattice.arcs
    monkeypatch.setattr(PlanarCollision, "turn_part", 0.0)
    each = lattice_of(seed, footprint, headings).arcs
    assert np.array_equal(arcs.start, each.start)
    assert np.array_equal(arcs.heads, each.heads)
    assert np.array_equal(arcs.kinds, each.kinds)
    turns = (arcs.kinds != MOVE).sum()
    assert 0 < turns < lattice.size * (headings - 1)  # some are free, and some are blocked
