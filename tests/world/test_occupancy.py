"""Worlds of occupancy in memory, and changes of a few cells: everything derived equals that of a world made anew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import MapError
from hpop.world import World
from hpop.world.geometry.planar import FreeSpace, without

GRID = np.array([[0, 19, 20, 64], [65, 100, -1, 0]], np.int8)


def cells(rng: np.random.Generator, shape: tuple[int, int] = (40, 60)) -> Any:
    """Return cells with some boxes."""
    made = np.zeros(shape, dtype=bool)
    for row, column, height, width in rng.integers((0, 0, 1, 1), (*shape, 9, 9), (12, 4)):
        made[row : row + height, column : column + width] = True
    return made


def test_thresholds_part_free_unknown_and_occupied_cells() -> None:
    world = World.from_occupancy_grid(GRID, 0.5, (1.0, 2.0, 0.0))
    assert world.raster is not None
    assert world.raster.cells.tolist() == [[False, False, True, True], [True, True, True, False]]
    assert world.bounds == (1.0, 2.0, 3.0, 3.0)
    assert world.outside_is_obstacle
    free = World.from_occupancy_grid(GRID, 0.5, unknown_is_free=True)
    assert free.raster is not None
    assert free.raster.cells.tolist() == [[False, False, False, False], [True, True, False, False]]
    assert not free.outside_is_obstacle
    strict = World.from_occupancy_grid(GRID, 0.5, thresholds=(0, 20), unknown_is_free=True)
    assert strict.raster is not None
    assert strict.raster.cells.sum() == 4


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ([0, 100, -1], r"2-D array \(height, width\) with cells, got shape \(3,\)"),
        (np.zeros((0, 3), np.int8), "with cells, got shape"),
        ([[0.0, 1.0]], "integers from -1 to 100, or bool, got float64"),
        ([["a"]], "integers from -1 to 100"),
        ([[0, 101]], "from -1 .unknown. to 100 percent, got 101"),
        (np.array([[0, 255]], np.uint8), r"got 255; in data of type uint8, 255 is an unknown cell: use data.astype"),
        ([[-2]], "got -2"),
        ([[0, 0], [0]], "rows of one length"),
    ],
    ids=str,
)
def test_data_that_are_no_occupancy_are_refused(data: Any, says: str) -> None:
    with pytest.raises(MapError, match=says):
        World.from_occupancy_grid(data, 0.5)
    with pytest.raises(MapError, match=says):
        World.from_cells(np.zeros((3, 3), dtype=bool), 0.5).updated(data)


@pytest.mark.parametrize("thresholds", [(65, 19), (19, 19), (-1, 50), 50, ("a", 2)], ids=str)
def test_thresholds_must_rise_within_percent(thresholds: Any) -> None:
    with pytest.raises(MapError, match="threshold"):
        World.from_occupancy_grid(GRID, 0.5, thresholds=thresholds)


def test_a_part_beyond_the_map_and_a_world_without_cells_are_refused() -> None:
    world = World.from_cells(np.zeros((3, 4), dtype=bool), 0.5)
    with pytest.raises(MapError, match=r"2 x 1 cells at column 3 and row 0 reaches beyond the map of 4 x 3 cells"):
        world.updated([[0, 0]], at=(3, 0))
    for at in ((-1, 0), (0.5, 0), "a", (1,)):
        with pytest.raises(MapError, match="column"):
            world.updated([[0]], at=at)  # type: ignore[arg-type]
    with pytest.raises(MapError, match="needs a world with occupancy cells"):
        World.from_polygons([shapely.box(0, 0, 1, 1)], extent=shapely.box(0, 0, 3, 3)).updated([[0]])


def test_content_and_options_stay_after_a_change() -> None:
    world = World.from_cells(np.zeros((30, 40), dtype=bool), 0.1, keep_out=shapely.box(1, 1, 2, 2), height=(0.0, 1.0))
    world = world.with_content(people=[hpop.world.Person(3.0, 2.0, 0.3)])
    after = world.updated([[True]], at=(3, 5))
    assert after.content is world.content
    assert after.keep_out is world.keep_out
    assert after.raster is not None
    assert world.raster is not None
    assert (after.raster.heights, after.raster.cells.sum(), world.raster.cells.sum()) == ((0.0, 1.0), 1, 0)


@pytest.mark.seeds(4, of=100)
def test_free_space_of_cells_equals_that_of_their_outline(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = World.from_cells(rng.random(rng.integers(1, 30, 2)) < rng.random(), 0.05, origin=(-14.2, -12.2, 0.0))
    assert world.raster is not None
    rows, columns = world.raster.cells.shape
    region = FreeSpace(without(world.extent, world.solid()))
    x, y = (rng.integers(-1, 2 * count + 3, 600) / 2 for count in (columns, rows))
    x, y = world.raster.to_world(x + rng.choice([0.0, 0.3], 600), y)
    space = world.free_space()
    np.testing.assert_array_equal(space.contains(x, y), region.contains(x, y))
    np.testing.assert_array_equal(space.clearance(x, y), region.clearance(x, y))
    shapes = shapely.linestrings(np.stack([x, y], axis=1).reshape(-1, 2, 2))
    np.testing.assert_array_equal(space.shapes_free(shapes, 0.07), region.shapes_free(shapes, 0.07))


@pytest.mark.seeds(4, of=100)
def test_values_after_many_changes_equal_those_of_a_world_made_anew(seed: int) -> None:
    rng = np.random.default_rng(seed)
    keep_out = (None, shapely.box(1, 0.5, 2, 1), shapely.box(0, 0, 1, 1).buffer(0.3))[seed % 3]
    world = World.from_cells(cells(rng, (300, 330)), 0.05, keep_out=keep_out)
    x, y = rng.uniform((0, 0), (16, 15), (500, 2)).T
    for _ in range(6):
        world.clearance(x, y)
        world.obstruction_field(0.5)(x, y)
        row, column = rng.integers((0, 0), (290, 320))
        height, width = rng.integers(1, 9, 2)
        world = world.updated(np.full((height, width), rng.random() < 0.6), at=(int(column), int(row)))
    assert world.raster is not None
    anew = World.from_cells(world.raster.cells, 0.05, keep_out=keep_out)
    np.testing.assert_array_equal(world.clearance(x, y), anew.clearance(x, y))
    np.testing.assert_array_equal(world.obstruction_field(0.5)(x, y), anew.obstruction_field(0.5)(x, y))
    np.testing.assert_array_equal(world.obstruction_field(0.5).values, anew.obstruction_field(0.5).values)
    ends = rng.uniform((0, 0), (16, 15), (2, 300, 2))
    segments = (*ends[0].T, *(0.9 * ends[0] + 0.1 * ends[1]).T)
    np.testing.assert_array_equal(world.segments_free(*segments, 0.2), anew.segments_free(*segments, 0.2))
    assert world.solid().equals(anew.solid())


def test_a_part_of_the_map_needs_a_place_and_a_whole_map_needs_none():
    world = World.from_cells(np.zeros((3, 4), dtype=bool), 0.5)
    whole = np.arange(12).reshape(3, 4) % 2 * 100
    np.testing.assert_array_equal(world.updated(whole).raster.cells, whole > 0)
    with pytest.raises(MapError, match=r"without at, .* 4 x 3 cells of the map, got 2 x 1; give at=\(column, row\)"):
        world.updated([[100, 100]])
