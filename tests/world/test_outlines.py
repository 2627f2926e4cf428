"""Claim: outlines of cells are the union of their squares, whatever touches what, with no point where they go on."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from hpop.base.arrays import BoolArray
from hpop.errors import MapError
from hpop.world import World
from hpop.world.geometry import outlines
from hpop.world.geometry.outlines import outlined


def joined(cells: BoolArray) -> shapely.Geometry:
    """The union of all squares by GEOS, which knows nothing of rows and columns."""
    y, x = np.nonzero(cells)
    return shapely.union_all(shapely.box(x, y, x + 1, y + 1))


def noise(seed: int) -> BoolArray:
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 30, 2)
    cells: BoolArray = rng.random(shape) < rng.uniform(0, 1)
    return cells


TOUCHING = [
    [[1, 0], [0, 1]],  # at a corner
    [[1, 1, 1], [1, 0, 1], [1, 1, 1]],  # a hole
    [[1, 1, 1], [1, 0, 1], [0, 1, 1]],  # a hole that touches what is outside
    [[1, 1, 1, 1], [1, 0, 1, 1], [1, 1, 0, 1], [1, 1, 1, 1]],  # two holes that touch
    [[1, 1, 1, 1, 1], [1, 0, 0, 0, 1], [1, 0, 1, 0, 1], [1, 0, 0, 0, 1], [1, 1, 1, 1, 1]],  # an island in a hole
    [[1, 1, 1, 1], [1, 0, 0, 1], [1, 0, 1, 1], [1, 1, 1, 1]],
    [[1]],
    [[0]],
]


@pytest.mark.parametrize("cells", [np.array(rows, bool) for rows in TOUCHING] + [noise(seed) for seed in range(40)])
def test_outlines_are_those_of_the_union_of_all_squares(cells: BoolArray) -> None:
    found, expected = outlined(cells), joined(cells)
    assert shapely.is_valid(found)
    assert shapely.equals(found, expected)
    assert found.area == np.count_nonzero(cells)
    assert shapely.get_num_geometries(found) == shapely.get_num_geometries(expected)
    assert shapely.get_num_coordinates(found) == shapely.get_num_coordinates(shapely.simplify(expected, 0.0))


def test_very_many_corners_are_refused_with_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outlines, "MOST_CORNERS", 99)
    board = np.indices((10, 10)).sum(axis=0) % 2 == 0  # its corners: the 11 x 11 vertices but two
    with pytest.raises(MapError, match=r"have 119 corners, expected at most 99.*remove specks"):
        World.from_cells(board, 0.1).solid()


def test_very_many_corners_of_a_map_are_refused_with_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outlines, "MOST_CORNERS", 99)
    path = tmp_path / "noise.map"
    path.write_text("type octile\nheight 10\nwidth 10\nmap\n" + ".@.@.@.@.@\n@.@.@.@.@.\n" * 5)
    with pytest.raises(MapError, match=rf"^{re.escape(str(path))}: the outlines of 10 x 10 cells have 119 corners"):
        World.from_movingai(path).solid()
