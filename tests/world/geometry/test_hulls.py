"""Convex hulls in free space, decided by a compiled loop: against GEOS and against distances to squares."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hpop.world import World
from hpop.world.geometry._hulls import FEW, is_worth_compiling
from hpop.world.geometry.planar import convex_hulls

MARGINS = (0.0, 1e-3, 0.05, 0.3)
AROUND = shapely.box(0, 0, 8, 8)


@pytest.fixture(autouse=True, scope="module")
def compiled() -> None:
    """Take the compiled loop from the first hull on."""
    assert is_worth_compiling(FEW)


def a_world(kind: str, rng: np.random.Generator) -> World:
    if kind == "cells":
        return World.from_cells(rng.random((16, 16)) < 0.1, 0.5)
    if kind == "cells and a zone":
        return World.from_cells(rng.random((16, 16)) < 0.1, 0.5, keep_out=shapely.box(3.1, 3.1, 5.2, 4.4))
    boxes = [
        shapely.affinity.rotate(shapely.box(x, y, x + w, y + h), 30 * turn)
        for x, y, w, h, turn in rng.uniform((0, 0, 0.2, 0.2, 0), (7, 7, 2, 2, 3), (9, 5))
    ]
    return World.from_polygons(boxes, extent=AROUND)


def corners_of_hulls(rng: np.random.Generator, corners: int, *, on_grid: bool) -> np.ndarray:
    """Corners near each other; on a grid, many hulls touch the border, and some are lines or points."""
    corners = rng.uniform(0, 8, (300, 1, 2)) + rng.uniform(-0.6, 0.6, (300, corners, 2))
    return np.round(corners * 20) / 20 if on_grid else corners


@given(
    seed=st.integers(0, 10_000),
    kind=st.sampled_from(["cells", "cells and a zone", "polygons"]),
    corners=st.sampled_from([1, 2, 3, 4, 8]),
    margin=st.sampled_from(MARGINS),
    on_grid=st.booleans(),
)
@example(seed=1, kind="polygons", corners=3, margin=1e-3, on_grid=True)  # thin hulls
@settings(max_examples=settings.default.max_examples // 2)
def test_hulls_are_free_where_geos_finds_them_free(seed, kind, corners, margin, on_grid):
    rng = np.random.default_rng(seed)
    space, hulls = a_world(kind, rng).free_space(), corners_of_hulls(rng, corners, on_grid=on_grid)
    assert (space.hulls_free(hulls, margin) == space.shapes_free(convex_hulls(hulls), margin)).all()


@given(seed=st.integers(0, 10_000), margin=st.sampled_from(MARGINS))
@settings(max_examples=settings.default.max_examples // 4)
def test_a_hull_is_free_if_no_square_comes_closer_than_its_margin(seed, margin):
    rng = np.random.default_rng(seed)
    cells, hulls = rng.random((16, 16)) < 0.1, corners_of_hulls(rng, 5, on_grid=False)
    rows, columns = np.nonzero(cells)
    squares = shapely.box(columns / 2, rows / 2, columns / 2 + 0.5, rows / 2 + 0.5)
    blocked = np.append(squares, shapely.difference(shapely.box(-9, -9, 17, 17), AROUND))
    away = shapely.distance(convex_hulls(hulls)[:, None], blocked).min(axis=1)
    expected = away >= margin if margin else away > 0
    assert (World.from_cells(cells, 0.5).free_space().hulls_free(hulls, margin) == expected).all()


def test_hulls_are_compared_with_changed_cells():
    cells = np.zeros((16, 16), dtype=bool)
    cells[4:9, 4:6] = True
    world = World.from_cells(cells, 0.5)
    hulls = corners_of_hulls(np.random.default_rng(3), 4, on_grid=True)
    before = world.free_space().hulls_free(hulls, 0.05)
    changed = world.updated(np.ones((2, 3), dtype=bool), at=(10, 12)).updated(np.zeros((3, 2), dtype=bool), at=(4, 4))
    after = changed.free_space().hulls_free(hulls, 0.05)
    cells[12:14, 10:13], cells[4:7, 4:6] = True, False
    assert (after == World.from_cells(cells, 0.5).free_space().hulls_free(hulls, 0.05)).all()
    assert (after & ~before).any()
    assert (before & ~after).any()


def test_a_square_that_fills_a_gap_of_cells_is_free_and_one_wider_is_not():
    cells = np.zeros((4, 6), dtype=bool)
    cells[:, [1, 4]] = True
    space = World.from_cells(cells, 0.1).free_space()
    square = np.array([[0.2, 0.1], [0.4, 0.1], [0.4, 0.3], [0.2, 0.3]])
    wider = square + np.array([0, 0, 1, 0])[:, None] * (1e-6, 0)
    assert space.hulls_free(np.stack([square, wider]), 0.0).tolist() == [True, False]


@pytest.mark.parametrize("margin", [0.0, 0.3])
def test_hulls_in_a_world_without_a_border_nearby_are_free_or_not_by_one_corner(margin):
    space = World.from_cells(np.pad(np.ones((40, 40), dtype=bool), 40), 0.1).free_space()
    inside, outside = np.array([[5.9, 5.9], [6.1, 6.0], [6.0, 6.1]]), np.array([[1.9, 1.9], [2.1, 2.0], [2.0, 2.1]])
    assert space.hulls_free(np.stack([inside, outside]), margin).tolist() == [False, True]
