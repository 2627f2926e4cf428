"""Outlines of cells are the union of their squares; crossings of outlines are counted, and too many are refused."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
import shapely

from hpop import World
from hpop.base.arrays import BoolArray
from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world.content.content import Zone
from hpop.world.geometry import outlines
from hpop.world.geometry.outlines import check_joinable, check_mendable, check_widenable, outlined
from hpop.world.readers import geojson_content


def joined(cells: BoolArray) -> shapely.Geometry:
    """Return the union of all squares by GEOS, independent of rows and columns."""
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


SECONDS = 5.0  # of the processor; GEOS takes 22 for what the first test gives


@pytest.fixture(autouse=True)
def quick():
    began = time.process_time()
    yield
    assert time.process_time() - began < SECONDS


def random_ring(count):
    return np.random.default_rng(count).random((count, 2)) * 10


def comb(teeth):
    """Return a polygon whose many teeth reach up; turned by a quarter, it crosses itself teeth squared times."""
    x, y = np.arange(2 * teeth) / (2 * teeth), np.where(np.arange(2 * teeth) % 2, 1.0, 0.01)
    return np.concatenate([np.column_stack([x, y]), [[1, 0], [0, 0]]])


def written(path, kind, coordinates, properties=None):
    feature = {
        "type": "Feature",
        "properties": properties or {},
        "geometry": {"type": kind, "coordinates": coordinates},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


@pytest.mark.parametrize("count", [300, 500])
@pytest.mark.parametrize("polygons", ["obstacles", "free"])
def test_a_random_outline_is_refused_with_its_count_and_what_to_do(tmp_path, count, polygons):
    path = written(tmp_path / "plan.geojson", "Polygon", [random_ring(count).tolist()])
    with pytest.raises(
        MapError, match=r"feature 0 crosses itself at least [\d,]+ times; .* Simplify it, or leave it out"
    ):
        World.from_geojson(path, polygons=polygons)


def test_many_outlines_each_just_below_the_bound_are_refused_together(tmp_path):
    ring = comb(15)
    turned = np.column_stack([ring[:, 1], ring[:, 0]])
    crossed = np.concatenate([ring, turned])  # the teeth of both combs cross
    features = [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [(crossed + 3 * i).tolist()]},
        }
        for i in range(100)
    ]
    path = tmp_path / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(MapError, match=r"100 of its outlines cross themselves [\d,]+ times in all, .* Simplify them"):
        World.from_geojson(path)


def test_a_figure_of_eight_is_mended_as_ever(tmp_path):
    path = written(tmp_path / "plan.geojson", "Polygon", [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]])
    world = World.from_geojson(path)
    assert "mended" in world.notes[0]
    assert world.solid().area == pytest.approx(2.0)


def test_crossings_are_counted_as_shapely_counts_them(monkeypatch):
    ring = shapely.Polygon(random_ring(60))
    points = shapely.get_coordinates(ring)
    lines = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
    first, second = shapely.STRtree(lines).query(lines, predicate="crosses")
    count = np.count_nonzero(first < second)
    assert count > 100
    monkeypatch.setattr(outlines, "MOST_MENDED", count)
    check_mendable(ring, "ring")
    monkeypatch.setattr(outlines, "MOST_MENDED", count - 1)
    with pytest.raises(MapError, match=f"crosses itself at least {count:,} times"):
        check_mendable(ring, "ring")


def test_rooms_that_share_walls_do_not_cross():
    rooms = shapely.box(*np.array([(i % 60, i // 60, i % 60 + 1, i // 60 + 1) for i in range(3600)]).T)
    check_joinable(list(rooms), "rooms")
    check_mendable(shapely.MultiPolygon(list(rooms[:900])), "rooms")


def test_an_outline_that_runs_over_itself_again_and_again_is_refused():
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    with pytest.raises(MapError, match="touches itself"):
        check_mendable(shapely.Polygon(np.tile(square, (300, 1))), "square")


def test_two_combs_across_each_other_are_refused_wherever_they_come_from(tmp_path):
    up, across = comb(200), comb(200)[:, ::-1]
    crossing = [shapely.Polygon(up), shapely.Polygon(across)]
    with pytest.raises(MapError, match=r"the world has outlines that cross at least [1-9]"):
        World.from_polygons(crossing)
    with pytest.raises(MapError, match="the world has outlines that cross"):
        World.from_polygons([], extent=crossing[0]).with_content(zones=[Zone("keep-out", crossing[1])])
    polygons = [[up.tolist()], [across.tolist()]]
    path = written(tmp_path / "plan.geojson", "MultiPolygon", polygons)
    with pytest.raises(MapError, match="has outlines that cross"):
        World.from_geojson(path, polygons="free")
    scenario = tmp_path / "scenario.yaml"
    section = {"polygons": {"extent": [[0, 0], [2, 0], [2, 2]], "keep_out": [up.tolist(), across.tolist()]}}
    parts = {"world": section, "start": [0, 0, 0], "goal": [1, 1, 0], "criteria": ["length"]}
    scenario.write_text(json.dumps(parts))
    with pytest.raises(MapError, match=r"keep_out has outlines that cross at least [1-9]"):
        load_scenario(scenario)


def test_segments_that_all_lie_across_each_other_are_refused_before_they_are_tested_for_crossings(monkeypatch):
    monkeypatch.setattr(outlines, "MOST_PAIRS", 1_000_000)
    count = 2000
    number = np.arange(count)
    slanting = np.column_stack([number * 1e-6 + number % 2, number % 2])
    with pytest.raises(MapError, match=r"2,002 segments, of which more than .* pairs lie so near that they may cross"):
        check_joinable([shapely.Polygon([*slanting, (2, -1), (-1, -1)])], "hatching")


@pytest.mark.parametrize(
    "line",
    [random_ring(1000), np.column_stack([np.arange(2000) / 200, np.arange(2000) % 2 * 5])],
    ids=["random", "zigzag"],
)
def test_a_flow_whose_strip_would_cover_itself_is_refused(tmp_path, line):
    path = written(tmp_path / "flow.geojson", "LineString", line.tolist())
    with pytest.raises(MapError, match=r"feature 0: the flow comes near to itself at least"):
        geojson_content.read(flows=path, width=3.0)


def test_a_long_flow_that_winds_through_a_building_is_kept():
    along = np.arange(5000) / 10
    check_widenable(shapely.LineString(np.column_stack([along, np.sin(along)])), 1.5, "flow")
