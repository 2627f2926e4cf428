"""Claims: lines of a DXF drawing are walls where they were drawn, in metres; what is no wall is told."""

import json
import math

import numpy as np
import pytest
import shapely

from hpop.apart import child as collected
from hpop.apart.child import ChildRefused
from hpop.apart.dxf import extract
from hpop.errors import MapError, ScenarioError
from hpop.scenario import load_scenario
from hpop.world import World
from tests.worlds import dxf, read_here

ROOM = [(0, 0), (6, 0), (6, 4), (0, 4)]


def lines(draw, layers=None):
    """Return the result of `extract`: words, and the lines as arrays (n, 2) with their layers."""
    words, arrays = extract(dxf(draw), {"layers": layers})
    parts = np.split(arrays["points"], arrays["starts"][1:-1])
    return words, [(words["layers"][layer], part) for layer, part in zip(arrays["layer"], parts, strict=True)]


def furnished(drawing):
    space = drawing.modelspace()
    drawing.layers.add("WALLS")
    drawing.layers.add("OLD").off()
    drawing.layers.add("NOTES").freeze()
    space.add_lwpolyline([(1000 * x, 1000 * y) for x, y in ROOM], close=True, dxfattribs={"layer": "WALLS"})
    space.add_line((2000, 0), (2000, 1500), dxfattribs={"layer": "WALLS"})
    space.add_arc((4000, 0), 900, 0, 90, dxfattribs={"layer": "DOORS"})
    space.add_line((0, 0), (6000, 4000), dxfattribs={"layer": "OLD"})
    space.add_line((0, 4000), (6000, 0), dxfattribs={"layer": "NOTES"})
    hatch = space.add_hatch(dxfattribs={"layer": "COLUMNS"})
    for side, flags in ((500, 1), (200, 16)):  # a square column with a hole
        corners = [(4500 + dx * side, 3000 + dy * side) for dx, dy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        hatch.paths.add_polyline_path(corners, is_closed=True, flags=flags)
    space.add_text("Hall")
    pattern = space.add_hatch(dxfattribs={"layer": "FLOOR"})
    pattern.set_pattern_fill("ANSI31")
    pattern.paths.add_polyline_path([(0, 0), (6000, 0), (6000, 4000)], is_closed=True)


@pytest.fixture(autouse=True)
def here():
    with read_here():
        yield


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plans") / "plan.dxf"
    path.write_bytes(dxf(furnished, units=4))
    return path


def test_a_plan_in_millimetres_is_the_room_that_was_drawn(plan):
    world = World.from_file(plan, wall_width=0.1)
    wall = shapely.LinearRing(ROOM).buffer(0.05, cap_style="square", join_style="mitre")
    inner = shapely.LineString([(2, 0), (2, 1.5)]).buffer(0.05, cap_style="square")
    column = shapely.box(4, 2.5, 5, 3.5) - shapely.box(4.3, 2.8, 4.7, 3.2)
    swing = shapely.Point(4, 0).buffer(0.9, quad_segs=64).exterior.buffer(0.05) & shapely.box(4, 0, 5, 1)
    solid = world.solid()
    assert shapely.symmetric_difference(solid, shapely.union_all([wall, inner, column, swing])).area < 0.02
    assert world.bounds == pytest.approx((-0.05, -0.05, 6.05, 4.05), abs=0.002)
    units, what, left, swings, doors = world.notes
    assert "1 arcs look like the swing of a door, 0.9 m wide" in swings
    assert "drawn in millimetres of 0.001 m by its header" in units
    assert "doors drawn as lines close passages" in doors
    assert "5 lines and fills of 6 x 4 m; lines are walls 0.1 m thick" in what
    assert "WALLS (2)" in what
    assert "TEXT (1)" in left
    assert "HATCH of a pattern (1)" in left
    assert "on layers that are off or frozen (2)" in left
    again = World.from_description(json.loads(json.dumps(world.describe())))
    assert again.solid().equals(solid)
    assert again.notes == world.notes


def test_layers_are_chosen_by_name_and_what_cannot_be_reached_is_solid(tmp_path, plan):
    asked = {
        "world": {"dxf": {"path": str(plan), "layers": ["walls"], "wall_width": 0.1, "inside": [1, 1]}},
        "start": [1, 1, 0],
        "goal": [5, 3, 0],
        "criteria": ["length"],
    }
    path = tmp_path / "scenario.yaml"
    path.write_text(json.dumps(asked))
    extent = load_scenario(path).problem.world.extent
    assert extent.area == pytest.approx(5.9 * 3.9 - 0.1 * 1.5)
    asked["world"]["dxf"]["wal_width"] = 0.1
    path.write_text(json.dumps(asked))
    with pytest.raises(ScenarioError, match=r"world\.dxf\.wal_width: no such key; did you mean 'wall_width'"):
        load_scenario(path)


def test_every_kind_of_curve_is_a_polyline_within_a_two_thousandth_of_its_size():
    def draw(drawing):
        space = drawing.modelspace()
        space.add_circle((3, 4), 2, dxfattribs={"layer": "circle"})
        space.add_arc((0, 0), 5, 30, 200, dxfattribs={"layer": "arc"})
        space.add_ellipse((1, 1), (4, 0), 0.5, dxfattribs={"layer": "ellipse"})
        space.add_lwpolyline([(0, 0, 1), (2, 0, 0)], format="xyb", dxfattribs={"layer": "bulge"})  # half a circle
        space.add_circle((9, 0), 1, dxfattribs={"layer": "mirrored", "extrusion": (0, 0, -1)})

    _, found = lines(draw)
    curves = dict(found)
    for name, radius, x, y in (("circle", 2, 3, 4), ("arc", 5, 0, 0), ("bulge", 1, 1, 0), ("mirrored", 1, -9, 0)):
        chords = (curves[name][1:] + curves[name][:-1]) / 2
        off = np.abs(np.hypot(*(np.concatenate([curves[name], chords]) - (x, y)).T) - radius)
        assert off.max() < 2 * math.sqrt(2) * radius / 2000, name
    x, y = (curves["ellipse"] - 1).T
    assert np.abs(np.hypot(x / 4, y / 2) - 1).max() < math.hypot(8, 4) / 2000 / 2


def test_blocks_are_where_they_are_inserted_on_the_layer_of_the_reference():
    def draw(drawing):
        column = drawing.blocks.new("COLUMN")
        column.add_line((0, 0), (1, 0))
        column.add_line((0, 0), (0, 1), dxfattribs={"layer": "OWN"})
        pair = drawing.blocks.new("PAIR")
        pair.add_blockref("COLUMN", (0, 0))
        pair.add_blockref("COLUMN", (10, 0), dxfattribs={"rotation": 90})
        attributes = {"layer": "COLUMNS", "row_count": 2, "row_spacing": 5, "xscale": 2}
        drawing.modelspace().add_blockref("PAIR", (100, 0), dxfattribs=attributes)

    _, found = lines(draw)
    assert [layer for layer, _ in found] == ["COLUMNS", "OWN"] * 4
    ends = [part[-1].tolist() for _, part in found]
    below = [[102, 0], [100, 1], [120, 1], [118, 0]]
    assert np.array(ends) == pytest.approx(np.array([*below, *([x, y + 5] for x, y in below)]))


@pytest.mark.parametrize(
    ("draw", "options", "message"),
    [
        (lambda d: None, {}, "has no lines; its model space is empty"),
        (lambda d: d.layout("Layout1").add_line((0, 0), (1, 1)), {}, "empty, 1 objects are on its layout sheets"),
        (lambda d: d.modelspace().add_text("Hall"), {}, r"has no lines; left out: TEXT \(1\)"),
        (lambda d: d.modelspace().add_line((0, 0), (1e-9, 0)), {}, "a scale of 1 m per unit makes it 1e-09 x 0 m"),
        (lambda d: d.modelspace().add_line((0, 0), (9, 9), dxfattribs={"layer": "WALLS"}), {"layers": "WALS"},
         r"it has no layer 'wals'. Did you mean 'WALLS'\? Its layers are WALLS \(1\)"),
    ],
)  # fmt: skip
def test_what_is_no_plan_is_refused_with_what_there_is(tmp_path, draw, options, message):
    path = tmp_path / "plan.dxf"
    path.write_bytes(dxf(draw))
    with pytest.raises(MapError, match=message):
        World.from_file(path, **options)


def test_a_drawing_that_says_no_units_is_refused_with_its_size_and_read_with_a_scale(tmp_path):
    path = tmp_path / "plan.dxf"
    path.write_bytes(dxf(lambda d: d.modelspace().add_lwpolyline([(0, 0), (24300, 0), (24300, 12500)]), units=0))
    with pytest.raises(MapError, match=r"\$INSUNITS is 0\); it spans 24300 x 12500 units. Give scale, .* 0.001"):
        World.from_file(path)
    assert World.from_file(path, scale=0.001).bounds == pytest.approx((-0.025, -0.025, 24.325, 12.525))


def test_what_would_grow_without_end_is_refused(monkeypatch):
    def nested(drawing):
        for depth in range(14):
            block = drawing.blocks.new(f"B{depth}")
            for _ in range(10):
                if depth:
                    block.add_blockref(f"B{depth - 1}", (0, 0))
        drawing.modelspace().add_blockref("B13", (0, 0), dxfattribs={"row_count": 30000, "column_count": 30000})

    def cyclic(drawing):
        drawing.blocks.new("A").add_blockref("B", (0, 0))
        drawing.blocks.new("B").add_blockref("A", (0, 0))
        drawing.modelspace().add_blockref("A", (0, 0))

    words, _ = extract(dxf(cyclic), {"layers": None})
    assert words["left_out"] == {"blocks more than 16 deep": 1}
    monkeypatch.setattr(collected, "MOST_THINGS", 5000)
    with pytest.raises(ChildRefused, match="more than 5,000 entities"):
        lines(nested)


def test_too_many_points_are_refused_with_the_layers(monkeypatch):
    monkeypatch.setattr(collected, "MOST_POINTS", 5)
    lines = collected.Lines(None)
    assert lines.wants("WALLS")
    with pytest.raises(ChildRefused, match=r"more than 5 points.* with the option layers\. .* this point: WALLS \(1\)"):
        lines.add("WALLS", [[(0.0, float(y)) for y in range(6)]])


def test_more_crossings_than_a_plan_has_are_refused_with_the_layers(tmp_path):
    def tiles(drawing):
        for i in range(190):
            for ends in (((0, i), (190, i)), ((i, 0), (i, 190))):
                drawing.modelspace().add_line(*ends, dxfattribs={"layer": "FLOOR"})

    path = tmp_path / "plan.dxf"
    path.write_bytes(dxf(tiles))
    with pytest.raises(MapError, match=r"outlines that cross .* Use layers to choose .* FLOOR \(380\)"):
        World.from_file(path)


@pytest.mark.parametrize("number", ["1e300", "inf", "nan"])
def test_coordinates_that_are_none_are_refused(number):
    data = dxf(lambda d: d.modelspace().add_circle((77.25, 0), 1)).replace(b"77.25", number.encode())
    with pytest.raises((ChildRefused, ValueError), match=r"finite numbers|float"):
        extract(data, {"layers": None})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scale": 0}, "scale"),
        ({"wall_width": 0}, "wall_width"),
        ({"layers": 3}, "layers must be a name"),
        ({"layers": []}, "layers must be a name"),
        ({"inside": 3}, "inside must be a point"),
        ({"origin": (1,)}, "origin"),
        ({"wal_width": 1}, "Did you mean 'wall_width'"),
    ],
)
def test_wrong_options_are_refused_before_the_file_is_read(tmp_path, options, message):
    with pytest.raises(MapError, match=message):
        World.from_file(tmp_path / "there_is_none.dxf", **options)


# What is not shown, and what is as thick as it is drawn


def test_what_is_invisible_is_no_wall_and_told():
    def draw(drawing):
        space = drawing.modelspace()
        space.add_line((0, 0), (6, 0))
        space.add_line((1, 0), (1, 4), dxfattribs={"invisible": 1})
        door = drawing.blocks.new("DOOR")  # a dynamic block keeps its other states so
        door.add_line((0, 0), (1, 0))
        door.add_line((0, 0), (0, 1), dxfattribs={"invisible": 1})
        space.add_blockref("DOOR", (3, 3))
        space.add_blockref("DOOR", (4, 3), dxfattribs={"invisible": 1})

    words, found = lines(draw)
    assert [part.tolist() for _, part in found] == [[[0, 0], [6, 0]], [[3, 3], [4, 3]]]
    assert words["left_out"] == {"invisible": 3}


def test_a_block_on_a_frozen_layer_is_hidden_with_all_in_it_and_one_that_is_off_is_not():
    """AutoCAD: freezing the layer of a reference hides the block, turning it off hides what is on layer 0 of it."""

    def draw(drawing):
        drawing.layers.add("FROZEN").freeze()
        drawing.layers.add("OFF").off()
        block = drawing.blocks.new("B")
        block.add_line((0, 0), (1, 0), dxfattribs={"layer": "WALLS"})
        block.add_line((0, 1), (1, 1), dxfattribs={"layer": "0"})
        for x, layer in ((0, "FROZEN"), (10, "OFF")):
            drawing.modelspace().add_blockref("B", (x, 0), dxfattribs={"layer": layer})

    words, found = lines(draw)
    assert [(layer, part.tolist()) for layer, part in found] == [("WALLS", [[10, 0], [11, 0]])]
    assert words["left_out"] == {"on layers that are off or frozen": 2}
    assert len(lines(draw, ["WALLS"])[1]) == 2  # a layer that is asked for is read wherever it is


def test_a_reference_to_another_drawing_is_told():
    def draw(drawing):
        drawing.modelspace().add_line((0, 0), (1, 0))
        drawing.add_xref_def("other.dxf", "OTHER")
        drawing.modelspace().add_blockref("OTHER", (0, 0))

    assert lines(draw)[0]["left_out"] == {"references to other drawings (XREF)": 1}


def test_wide_polylines_are_as_thick_as_they_are_drawn(tmp_path):
    def draw(drawing):
        space = drawing.modelspace()
        space.add_lwpolyline([(0, 0), (10, 0), (10, 6), (0, 6)], close=True)
        space.add_lwpolyline([(1, 4.5), (9, 4.5)], dxfattribs={"const_width": 0.2})
        space.add_polyline2d([(1, 1.5), (5, 1.5)], dxfattribs={"default_start_width": 0.4, "default_end_width": 0.0})
        block = drawing.blocks.new("B")
        block.add_lwpolyline([(0, 0), (1, 0)], dxfattribs={"const_width": 0.1})
        space.add_blockref("B", (6, 2), dxfattribs={"xscale": 2, "yscale": 4})

    path = tmp_path / "plan.dxf"
    path.write_bytes(dxf(draw))
    world = World.from_file(path)
    x = np.array([5.0, 5.0, 5.0, 1.1, 4.9, 7.0, 7.0])
    y = np.array([4.59, 4.41, 4.65, 1.68, 1.6, 2.19, 2.25])
    # A taper from 0.4 to 0 is 0.39 wide at x = 1.1 and 0.01 at 4.9; in the block 0.1 times 4.
    assert (world.clearance(x, y) > 0).tolist() == [False, False, True, False, True, False, True]
    assert world.clearance(np.array([5.0]), np.array([4.65])) == pytest.approx(0.05)
    assert [note for note in world.notes if "lines as thick as they are drawn: 3" in note]


def test_a_wide_arc_is_a_ring():
    """A half circle of radius 2 and width 0.5 covers pi 2 0.5 / 2 on either side: pi in all."""
    _, found = lines(
        lambda drawing: drawing.modelspace().add_lwpolyline(
            [(0, 0, 0.5, 0.5, 1), (4, 0, 0.5, 0.5, 0)], format="xyseb", dxfattribs={}
        )
    )
    faces = shapely.union_all([shapely.Polygon(part) for _, part in found[1:]])
    assert faces.area == pytest.approx(math.pi, rel=0.02)


def test_an_mline_is_two_walls(tmp_path):
    def draw(drawing):
        style = {"scale_factor": 0.3, "justification": 1}
        drawing.modelspace().add_mline([(0, 0), (6, 0), (6, 4), (0, 4)], close=True, dxfattribs=style)
        drawing.modelspace().add_lwpolyline([(-1, -1), (7, -1), (7, 5), (-1, 5)], close=True)

    words, found = lines(draw)
    assert not words["left_out"]
    walls = shapely.MultiLineString([part for _, part in found])
    for point in ((3, 0.15), (3, -0.15), (6.15, 2), (5.85, 2)):  # 0.3 apart, about the line
        assert shapely.distance(walls, shapely.Point(point)) == pytest.approx(0, abs=1e-9)
    path = tmp_path / "plan.dxf"
    path.write_bytes(dxf(draw))
    assert World.from_file(path, inside=(3, 2)).clearance(np.array([3.0]), np.array([0.0]))[0] == 0


# Doors


def door_plan(drawing):
    """Two rooms of 3 x 4 m; in the wall between them a door of 0.9 m whose arc closes the passage."""
    space = drawing.modelspace()
    space.add_lwpolyline(ROOM, close=True)
    space.add_line((3, 0), (3, 1))
    space.add_line((3, 1.9), (3, 4))
    space.add_line((3, 1), (3.9, 1))  # the leaf, open
    space.add_arc((3, 1), 0.9, 0, 90)


def test_arcs_of_doors_are_told_and_left_out_where_that_is_asked_for(tmp_path):
    path = tmp_path / "plan.dxf"
    path.write_bytes(dxf(door_plan))
    closed, opened = World.from_file(path), World.from_file(path, door_arcs="open")
    place = 3 + 0.9 * math.cos(math.pi / 4), 1 + 0.9 * math.sin(math.pi / 4)
    told = "1 arcs look like the swing of a door, 0.9 m wide, such as at (3.64, 1.64)"
    assert [
        note for note in closed.notes if f"{told}, and close passages; to leave them out, give door_arcs: open" in note
    ]
    assert [note for note in opened.notes if f"{told}: they are left out" in note]
    x, y = np.array([[place[0]], [place[1]]])
    assert closed.clearance(x, y)[0] == 0
    assert opened.clearance(x, y)[0] == pytest.approx(0.64 - 0.025, abs=0.01)  # the leaf and the jamb are as far
    assert (
        len(shapely.get_parts(shapely.difference(closed.extent, closed.solid()))) == 2
    )  # what is swept lies with the left room
    assert len(shapely.get_parts(shapely.difference(opened.extent, opened.solid()))) == 1
    assert World.from_description(opened.describe()).solid().equals(opened.solid())
    with pytest.raises(MapError, match="door_arcs must be one of closed, open"):
        World.from_file(path, door_arcs="ajar")


@pytest.mark.parametrize(
    ("draw", "count"),
    [
        (lambda space: space.add_lwpolyline([(4, 1, 0), (3.9, 1, 0.41421356), (3, 1.9, 0)], format="xyb"), 1),  # a leaf
        (lambda space: space.add_arc((3, 1), 0.9, 0, 180), 0),  # half a circle: an alcove
        (lambda space: space.add_arc((3, 1), 3.0, 0, 90), 0),  # a round hall
        (lambda space: space.add_circle((3, 1), 0.9), 0),
        (lambda space: space.add_spline([(1, 1), (2, 2), (3, 1), (4, 3)]), 0),
        (lambda space: space.add_lwpolyline([(x, x * x / 9) for x in range(9)]), 0),
    ],
)
def test_which_curves_are_arcs_of_doors(tmp_path, draw, count):
    path = tmp_path / "plan.dxf"

    def both(drawing):
        drawing.modelspace().add_lwpolyline([(-9, -9), (9, -9), (9, 9), (-9, 9)], close=True)
        draw(drawing.modelspace())

    path.write_bytes(dxf(both))
    assert len([note for note in World.from_file(path).notes if "swing of a door" in note]) == count
    world = World.from_file(path, door_arcs="open")
    leaf = world.clearance(np.array([3.95]), np.array([1.0]))[0]
    assert (leaf == 0) == (count == 1)  # what a line has beside its arc stays
