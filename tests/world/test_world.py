"""World: construction, obstruction through fields, pickling, descriptions."""

import json
import math
import pickle
import zlib
from base64 import b64encode
from dataclasses import replace
from types import SimpleNamespace

import casadi
import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Polygon

from hpop.errors import MapError, OptionError
from hpop.world import Ground, Obstacle, Raster, World
from hpop.world.description import unpack_cells
from hpop.world.fields.obstruction import polygon_obstruction
from hpop.world.files import by_names

EXTENT = shapely.box(0, 0, 10, 10)


def at(x, y, z=0.0):
    return SimpleNamespace(x=np.asarray(x, dtype=float), y=np.asarray(y, dtype=float), z=z)


def symbols(x, y, z):
    wrap = casadi.ArrayInterface.MX
    return SimpleNamespace(x=wrap(x, shape=(x.numel(),)), y=wrap(y, shape=(y.numel(),)), z=z)


@pytest.fixture
def pillars():
    shapes = [
        (shapely.box(2, 2, 3, 5), (0.0, 1.0)),
        (shapely.box(5, 1, 8, 2), (0.5, 2.5)),
        shapely.box(7, 7, 8, 9),
    ]
    return World.from_polygons(shapes, extent=EXTENT, keep_out=shapely.box(0, 9, 1, 10))


@pytest.fixture
def positions():
    return np.random.default_rng(4).uniform(0.5, 9.5, (2, 60))


# Construction


def test_the_extent_defaults_to_the_bounding_box_of_the_obstacles():
    world = World.from_polygons([shapely.box(1, 2, 3, 4), shapely.box(5, 0, 6, 1)])
    assert world.bounds == (1, 0, 6, 4)


def test_the_extent_of_cells_is_the_rectangle_of_the_image():
    world = World.from_cells(np.zeros((2, 4), dtype=bool), 0.5, origin=(1, 1, math.pi / 2))
    assert world.bounds == pytest.approx((0, 1, 1, 3))


def test_multipolygons_become_several_obstacles():
    both = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)])
    assert len(World.from_polygons([(both, (0, 2))]).obstacles) == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: World.from_polygons([]), "needs an extent: give the area in which the robot must stay"),
        (lambda: World.from_polygons([], extent=Polygon()), "extent is empty"),
        (lambda: World.from_polygons([LineString([(0, 0), (1, 1)])]), "Polygon"),
        (lambda: World.from_polygons([Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])]), "not valid"),
        (lambda: World.from_polygons([(EXTENT, (2, 1))]), "z_min < z_max"),
        (lambda: World.from_polygons([(EXTENT, (math.nan, 1))]), "z_min < z_max"),
        (lambda: World.from_polygons([(EXTENT, 3)]), "pair"),
        (lambda: World.from_polygons([EXTENT], keep_out=LineString([(0, 0), (1, 1)])), "keep_out"),
        (lambda: World.from_polygons([Polygon([(0, 0), (1, 0), (math.inf, 1)])]), "finite"),
        (lambda: World.from_polygons(EXTENT), "obstacles must be a list of shapely polygons; got <POLYGON"),
        (lambda: World.from_polygons([[(0, 0), (1, 0), (1, 1)]]), r"such as shapely\.Polygon\(.*; got \[\(0, 0\), "),
        (
            lambda: World.from_polygons([], extent=[(0, 0), (1, 0), (1, 1)]),
            r"extent must be a valid .*; got \[\(0, 0\)",
        ),
        (lambda: Ground(raster=np.zeros((2, 2), dtype=bool)), r"raster must be a hpop\.world\.Raster"),
        (lambda: World.from_cells([[1, 0], [0]], 1.0), r"all rows of one length; got \[\[1, 0\], \[0\]\]"),
        (lambda: World.from_cells(np.zeros((2, 2)), 1.0), "bool"),
        (lambda: World.from_cells(np.zeros(4, dtype=bool), 1.0), "2-D"),
        (lambda: World.from_cells(np.zeros((0, 4), dtype=bool), 1.0), "at least one cell"),
        (lambda: World.from_cells(np.zeros((2, 2), dtype=bool), 0.0), "above 0"),
        (lambda: World.from_cells(np.zeros((2, 2), dtype=bool), math.nan), "above 0"),
        (lambda: World.from_cells(np.zeros((2, 2), dtype=bool), 10**400), "above 0"),
        (lambda: World.from_cells(np.zeros((2, 2), dtype=bool), 1.0, origin=(0, 0)), "origin"),
        (lambda: World.from_cells(np.zeros((2, 2), dtype=bool), 1.0, origin=(0, 10**400, 0)), "origin"),
        (lambda: World.from_cells(np.zeros((2, 2), dtype=bool), 1.0, height=(0, 10**400)), "heights"),
    ],
)
def test_a_world_that_makes_no_sense_is_refused(make, message):
    with pytest.raises(MapError, match=message):
        make()


@pytest.mark.parametrize("wrong", ["x", 3, [shapely.box(0, 0, 1, 1)], None])
def test_a_world_is_not_made_of_anything(wrong):
    with pytest.raises(MapError, match=r"obstacles must be hpop\.world\.Obstacle prisms; got .* World\.from_geojson"):
        Ground(wrong)
    with pytest.raises(MapError, match=r"ground must be a hpop\.world\.Ground, .*; got .* World\.from_geojson"):
        World(wrong)


@pytest.mark.parametrize("path", [3, None, ["map.yaml"]])
def test_a_map_is_named_by_its_path(path):
    for read in (World.from_ros_map, World.from_movingai, World.from_geojson):
        with pytest.raises(MapError, match="must be given by its path"):
            read(path)


def test_a_world_is_told_in_one_line():
    assert (
        repr(World.from_cells(np.eye(3, 5, dtype=bool), 0.5))
        == "<World: 2.5 x 1.5 m from (0, 0), 5 x 3 cells of 0.5 m>"
    )
    world = World.from_polygons([shapely.box(4, 0, 6, 3)], extent=shapely.box(-1, 0, 10, 5))
    assert repr(world) == "<World: 11 x 5 m from (-1, 0), obstacles: 1>"


def test_contents_say_what_is_there(pillars):
    assert pillars.contents == {"obstacles", "keep_out"}
    assert World.from_polygons([], extent=EXTENT).contents == set()


# Obstruction


def test_obstruction_is_the_closed_form_within_the_stated_tolerance(pillars, positions):
    x, y = positions
    for z in (0.3, 1.2):
        expected = polygon_obstruction(pillars.obstacles, x, y, z, 2.0)
        assert pillars.obstruction(at(x, y, z), 2.0) == pytest.approx(expected, abs=0.003)


def test_heights_may_differ_between_positions(pillars, positions):
    x, y = positions
    z = np.where(np.arange(60) % 2 == 0, 0.3, 1.2)
    mixed = pillars.obstruction(at(x, y, z), 1.5)
    for h in (0.3, 1.2):
        assert (mixed[z == h] == pillars.obstruction(at(x[z == h], y[z == h], h), 1.5)).all()


def test_numbers_and_symbols_agree_also_with_several_heights(pillars, positions):
    x, y = positions
    z = np.where(np.arange(60) % 2 == 0, 0.3, 1.2)
    sx, sy = casadi.MX.sym("x", 60), casadi.MX.sym("y", 60)
    for heights in (0.3, z):
        value = pillars.obstruction(symbols(sx, sy, heights), 1.5)
        got = np.array(casadi.Function("f", [sx, sy], [value.to_casadi()])(x, y)).ravel()
        assert got == pytest.approx(pillars.obstruction(at(x, y, heights), 1.5), abs=1e-9)


def test_more_than_sixteen_heights_are_refused_unless_heights_do_not_matter(pillars):
    x = np.linspace(1, 9, 17)
    with pytest.raises(OptionError, match="17 distinct heights"):
        pillars.obstruction(at(x, x, x), 1.0)
    full = World.from_polygons([shapely.box(4, 4, 5, 5)], extent=EXTENT)
    assert full.obstruction(at(x, x, x), 1.0).shape == (17,)


def test_symbolic_heights_are_refused_where_heights_matter(pillars):
    x = casadi.MX.sym("x", 3)
    pose = symbols(x, x, casadi.ArrayInterface.MX(x, shape=(3,)))
    with pytest.raises(OptionError, match="heights as numbers"):
        pillars.obstruction(pose, 1.0)


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_radius_must_be_a_length(pillars, radius):
    with pytest.raises(OptionError, match="radius"):
        pillars.obstruction(at([1], [1]), radius)


def test_an_infinite_camera_height_is_refused(pillars):
    with pytest.raises(OptionError, match="height"):
        pillars.obstruction_field(1.0, math.inf)


@pytest.mark.parametrize("resolution", [0.1, 1.0])
def test_a_raster_and_the_polygons_of_its_cells_are_equally_obstructed(resolution):
    cells = np.random.default_rng(8).random((12, 12)) < 0.2
    raster = World.from_cells(cells, resolution, origin=(1, 2, 0.3), outside_is_obstacle=False)
    same = World.from_polygons([raster.raster.solid()], extent=raster.extent)
    x, y = raster.raster.to_world(*np.random.default_rng(9).uniform(0, 12, (2, 80)))
    radius = 3 * resolution
    expected = polygon_obstruction(same.obstacles, x, y, 0.0, radius)
    assert raster.obstruction(at(x, y), radius) == pytest.approx(expected, abs=0.004)
    assert same.obstruction(at(x, y), radius) == pytest.approx(expected, abs=0.004)


def test_beyond_the_image_is_obstacle_only_if_asked():
    empty = np.zeros((40, 40), dtype=bool)
    closed, open_ = (World.from_cells(empty, 0.1, outside_is_obstacle=v) for v in (True, False))
    wall = (1.0 - 0.5) ** 2 * (2 + 0.5) / 4
    assert closed.obstruction(at([0.5, 2], [2, 2]), 1.0) == pytest.approx([wall, 0], abs=0.003)
    assert open_.obstruction(at([0.5, 2], [2, 2]), 1.0).tolist() == [0, 0]


def test_beyond_a_polygon_extent_is_obstacle_only_if_asked():
    wall = (1.0 - 0.5) ** 2 * (2 + 0.5) / 4
    column = Obstacle(shapely.box(-3, 4, 0.2, 5))  # half of it beyond the extent: counts once
    for outside, expected in ((True, wall), (False, 0.0)):
        world = World(Ground((column,), extent=EXTENT, outside_is_obstacle=outside))
        assert world.obstruction(at([0.5, 5], [8, 5]), 1.0) == pytest.approx([expected, 0], abs=0.003)
    inside_out = World(Ground((column,), extent=EXTENT, outside_is_obstacle=True))
    assert inside_out.obstruction(at([0.1], [4.5]), 0.05) == pytest.approx([1.0])


def test_what_cells_and_prisms_both_fill_counts_once():
    cells = np.zeros((40, 40), dtype=bool)
    cells[:, 20:] = True  # x > 2, up to 1 m
    raster = Raster(cells, 0.1, (0, 0, 0), 0.0, 1.0)
    prism = Obstacle(shapely.box(1.5, -1, 3, 5), 0.5, 2.0)
    world = World(Ground((prism,), raster, outside_is_obstacle=False))
    squares = Obstacle(raster.solid(), 0.0, 1.0)
    x, y, z = np.array([1.0, 1.8, 2.5]), np.full(3, 2.0), 0.8
    expected = polygon_obstruction([prism, squares], x, y, z, 0.7)
    assert world.obstruction(at(x, y, z), 0.7) == pytest.approx(expected, abs=0.004)


def test_obstruction_stays_in_range_on_a_real_map_and_sees_the_unknown(shared_data):
    path = shared_data("aws_bookstore") / "map.yaml"
    shut, clear = World.from_ros_map(path), World.from_ros_map(path, unknown_is_free=True)
    x0, y0, x1, y1 = shut.bounds
    x, y = np.random.default_rng(1).uniform((x0, y0), (x1, y1), (2000, 2)).T
    a, b = shut.obstruction(at(x, y), 2.0), clear.obstruction(at(x, y), 2.0)
    assert (a >= 0).all()
    assert (a <= 1).all()
    assert (a >= b - 1e-9).all()
    assert (a - b).max() > 0.5


# Clearance field


def test_the_clearance_field_is_within_its_stated_bound(pillars):
    x, y = np.random.default_rng(2).uniform(0, 10, (2, 2000))
    exact, field = pillars.clearance(x, y), pillars.clearance_field()
    inside = exact > 0
    assert np.abs(field(x, y) - exact)[inside].max() <= math.sqrt(2 / 3) * pillars.cell
    assert field(x, y)[~inside].max() <= math.sqrt(2 / 3) * pillars.cell


def test_clearance_of_symbols_is_the_field(pillars):
    x, y = casadi.MX.sym("x", 2), casadi.MX.sym("y", 2)
    pose = symbols(x, y, 0.0)
    value = pillars.clearance(pose.x, pose.y)
    got = np.array(casadi.Function("f", [x, y], [value.to_casadi()])([4.0, 2.5], [4.0, 3.0])).ravel()
    assert got == pytest.approx(pillars.clearance_field()(np.array([4.0, 2.5]), np.array([4.0, 3.0])), abs=1e-9)
    assert got[1] < 0  # in an obstacle: the way out is uphill


# Pickling and descriptions


def test_pickling_keeps_the_world_and_drops_what_was_derived(pillars, positions):
    bare = len(pickle.dumps(pillars))
    expected = pillars.obstruction(at(*positions, 0.3), 2.0)
    assert len(pickle.dumps(pillars)) == bare
    again = pickle.loads(pickle.dumps(pillars))
    assert (again.obstruction(at(*positions, 0.3), 2.0) == expected).all()


def same(a, b):
    assert a.describe() == b.describe()
    assert [(o.polygon, o.heights) for o in a.obstacles] == [(o.polygon, o.heights) for o in b.obstacles]
    assert a.extent == b.extent
    assert a.keep_out.equals(b.keep_out)
    assert a.outside_is_obstacle == b.outside_is_obstacle
    assert [*map(by_names, a.notes)] == [*map(by_names, b.notes)]  # a description names no folder
    assert (a.raster is None) == (b.raster is None)
    if a.raster is not None:
        assert (a.raster.cells == b.raster.cells).all()
        assert (a.raster.resolution, a.raster.origin) == (b.raster.resolution, b.raster.origin)
        assert a.raster.heights == b.raster.heights


def through_json(world):
    return World.from_description(json.loads(json.dumps(world.describe(), allow_nan=False)))


def test_polygon_worlds_survive_their_description(pillars):
    same(through_json(pillars), pillars)


def test_cell_worlds_survive_their_description():
    cells = np.random.default_rng(0).random((33, 21)) < 0.3
    world = World.from_cells(cells, 0.1, origin=(1, 2, 0.3), height=(0, 2), keep_out=shapely.box(0, 0, 1, 1))
    same(through_json(world), world)


@pytest.mark.parametrize(
    ("name", "build"),
    [
        ("pal_office/map.yaml", lambda p: World.from_ros_map(p, unknown_is_free=True, height=(0, math.inf))),
        (
            "nav2_depot/depot.yaml",
            lambda p: World.from_ros_map(p, keep_out=p.parent / "depot_keepout.yaml", height=(0, 2)),
        ),
        ("movingai/den312d/den312d.map", lambda p: World.from_movingai(p, resolution=0.5)),
        (
            "field_museum_main/main_level_outline.geojson",
            lambda p: World.from_geojson(p, scale=0.7447, origin=(-9.7e6, 5.1e6), polygons="outline"),
        ),
        ("pal_office/map.pgm", lambda p: World.from_image(p, 0.05, threshold=0.3, origin=(1, 2, 3))),
    ],
)
def test_worlds_from_files_survive_their_description(shared_data, name, build):
    folder, _, rest = name.partition("/")
    world = build(shared_data(folder) / rest)
    same(through_json(world), world)


def test_a_map_that_was_added_to_is_described_with_what_was_added(shared_data):
    world = World.from_ros_map(shared_data("pal_office") / "map.yaml")
    table = Obstacle(shapely.box(0, 0, 1, 1), 0, 0.8)
    added = replace(world, ground=replace(world.ground, obstacles=(table,)))
    same(through_json(added), added)


def test_a_changed_map_is_noticed(tmp_path):
    path = tmp_path / "a.map"
    path.write_text("type octile\nheight 1\nwidth 3\nmap\n.@.\n")
    description = World.from_movingai(path).describe()
    same(World.from_description(description), World.from_movingai(path))
    path.write_text("type octile\nheight 1\nwidth 3\nmap\n...\n")
    with pytest.raises(MapError, match="changed"):
        World.from_description(description)
    path.unlink()
    with pytest.raises(MapError, match="cannot be opened"):
        World.from_description(description)


def test_a_packed_bomb_is_not_inflated():
    bomb = b64encode(zlib.compress(bytes(50_000_000), 9)).decode()
    with pytest.raises(MapError, match="exactly 8 x 8"):
        unpack_cells(bomb, 8, 8)
    with pytest.raises(MapError, match="at most"):
        unpack_cells("", 50_000, 50_000)


def broken(world, **changes):
    return {**world.describe(), **changes}


@pytest.mark.parametrize(
    "changes",
    [
        {"kind": "teapot"},
        {"kind": "ros_map"},
        {"kind": ["geometry"]},
        {"obstacles": None},
        {"obstacles": [{"polygon": {"type": "Polygon"}, "z": [0, 1]}]},
        {"obstacles": [{"polygon": {"type": "Point", "coordinates": [0, 0]}, "z": [0, 1]}]},
        {"extent": {"type": "Polygon", "coordinates": [[[0, 0], [1]]]}},
        {"extent": "everywhere"},
        {
            "raster": {
                "shape": [2, 2],
                "cells": "???",
                "resolution": 1,
                "origin": [0, 0, 0],
                "z": [None, None],
            }
        },
        {"raster": {"shape": [2, 2], "cells": "", "resolution": 1, "origin": [0, 0, 0], "z": [None, None]}},
        {"raster": {"shape": [2.5, 2], "cells": ""}},
        {"raster": {"shape": [-1, 2], "cells": ""}},
        {"raster": 7},
    ],
)
def test_malformed_descriptions_are_map_errors(pillars, changes):
    with pytest.raises(MapError):
        World.from_description(broken(pillars, **changes))


@pytest.mark.parametrize("description", [None, 3, [], {}, {"kind": "movingai", "path": None}])
def test_what_is_no_description_is_a_map_error(description):
    with pytest.raises(MapError):
        World.from_description(description)


def test_unknown_reader_options_are_map_errors(tmp_path):
    with pytest.raises(MapError, match="it has no option shell"):
        World.from_description({"kind": "movingai", "path": "x", "options": {"shell": "rm"}, "sha256": []})
