"""Claims: dark lines on a page of a PDF are walls where they are shown, at the scale that is given."""

import json
import zlib

import numpy as np
import pytest
import shapely

from hpop.apart.child import ChildRefused
from hpop.apart.pdf import extract
from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world import World
from tests.worlds import pdf, read_here, stream

ROOM = b"1 w 50 50 m 350 50 l 350 250 l 50 250 l s\n"  # a rectangle, closed
IMAGE = stream(
    b"\x00", b"/Type /XObject /Subtype /Image /Width 1 /Height 1 /ColorSpace /DeviceGray /BitsPerComponent 8"
)
LETTERS = b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"


@pytest.fixture(autouse=True)
def here():
    with read_here():
        yield


def found(data, layers=None, page=1):
    """Words and the points of each line."""
    words, arrays = extract(data, {"layers": layers, "page": page})
    return words, [part.tolist() for part in np.split(arrays["points"], arrays["starts"][1:-1])]


def saved(folder, data):
    path = folder / "plan.pdf"
    path.write_bytes(data)
    return path


def test_a_plan_at_1_to_100_has_its_true_size(tmp_path):
    column = b"0.2 g 100 100 30 30 re f 0.9 g 60 60 20 20 re f\n"  # a dark fill, and a light one that colours a room
    path = saved(tmp_path, pdf(ROOM + column + b"BT /F 12 Tf 70 70 Td (Hall) Tj ET", resources=b"/Font << /F 5 0 R >>",
                               objects=[LETTERS]))  # fmt: skip
    world = World.from_file(path, ratio=100, wall_width=0.1)
    metre = 0.0254 / 72 * 100
    wall = shapely.box(*(metre * v for v in (50, 50, 350, 250))).exterior.buffer(0.05, join_style="mitre")
    expected = wall | shapely.box(*(metre * v for v in (100, 100, 130, 130)))
    assert shapely.symmetric_difference(world.solid(), expected).area < 1e-4
    assert "2 lines and fills" in world.notes[0]
    assert "light fills and lines (1)" in world.notes[1]
    assert "texts (1)" in world.notes[1]
    assert World.from_description(json.loads(json.dumps(world.describe()))).solid().equals(world.solid())
    assert World.from_file(path, scale=metre, wall_width=0.1).solid().equals(world.solid())


def test_a_page_that_is_turned_or_cropped_is_read_as_it_is_shown():
    line = b"60 60 m 110 80 l S"
    turned = {
        0: [[60, 60], [110, 80]],
        90: [[60, 340], [80, 290]],
        180: [[340, 240], [290, 220]],
        270: [[240, 60], [220, 110]],
    }
    for angle, expected in turned.items():
        assert found(pdf(line, page=b"/Rotate %d" % angle))[1] == [expected]
    assert found(pdf(line, page=b"/CropBox [50 40 250 140]"))[1] == [[[10, 20], [60, 40]]]
    assert found(pdf(line, page=b"/CropBox [50 40 250 140] /Rotate 90"))[1] == [[[20, 190], [40, 140]]]


def test_what_forms_draw_is_where_they_are_placed_and_belongs_to_the_layer_of_its_marks():
    form = stream(b"0 0 m 10 0 l S", b"/Type /XObject /Subtype /Form /BBox [0 0 99 99] /Matrix [1 0 0 1 5 0]")
    content = b"q 2 0 0 2 100 100 cm /X Do Q /OC /L BDC 0 1 -1 0 0 0 cm 20 -20 m 30 -20 l S EMC"
    data = pdf(
        content,
        resources=b"/XObject << /X 5 0 R >> /Properties << /L 6 0 R >>",
        catalog=b"/OCProperties << /OCGs [6 0 R] /D << >> >>",
        objects=[form, b"<< /Type /OCG /Name (Walls) >>"],
    )
    words, lines = found(data)
    assert words["counted"] == {"(no layer)": 1, "Walls": 1}
    assert lines == [[[110, 100], [130, 100]], [[20, 20], [20, 30]]]
    assert found(data, layers=["walls"])[1] == lines[1:]
    with pytest.raises(
        ChildRefused, match=r"no layer 'wals'. Did you mean 'Walls'\? Its layers are \(no layer\) \(1\), Walls \(1\)"
    ):
        found(data, layers=["wals"])


def test_a_curve_is_a_polyline_near_it():
    k = 0.5522847498
    quarter = b"100 0 m 100 %f %f 100 0 100 c S" % (100 * k, 100 * k)
    (points,) = found(pdf(quarter))[1]
    chords = (np.array(points[1:]) + points[:-1]) / 2
    assert np.abs(np.hypot(*np.concatenate([points, chords]).T) - 100).max() < 0.1


def test_lines_as_light_as_paper_and_what_is_not_drawn_are_none():
    words, lines = found(
        pdf(b"1 G 0 0 m 9 9 l S 0 0 m 9 9 l n 0 G 1 1 m 5 5 l S 0 0 400 300 re W n 1 g 0 0 400 300 re f")
    )
    assert lines == [[[1, 1], [5, 5]]]
    assert words["left_out"] == {"light fills and lines": 2}


@pytest.mark.parametrize(
    ("data", "options", "message"),
    [
        (pdf(ROOM), {}, "a PDF does not state its scale. Give either ratio, .* got none"),
        (pdf(ROOM), {"scale": 0.01, "ratio": 100}, "got both"),
        (pdf(b""), {"ratio": 100}, "has no lines; page 1 of 1 is empty"),
        (pdf(b"q 400 0 0 300 0 0 cm /I Do Q", resources=b"/XObject << /I 5 0 R >>", objects=[IMAGE]), {"ratio": 100},
         r"no lines; left out: images \(1\)\. If the page is a scan.* pdftoppm -r 150 .* image and resolution 0.01693"),
        (pdf(b"BT /F 12 Tf (Hall) Tj ET", resources=b"/Font << /F 5 0 R >>", objects=[LETTERS]), {"ratio": 100},
         r"has no lines; left out: texts \(1\)"),
        (pdf(ROOM), {"ratio": 100, "page": 2}, "it has 1 pages; page must be from 1 to 1, got 2"),
        (pdf(ROOM), {"ratio": 100, "page": 0}, "page must be a whole number"),
        (pdf(ROOM), {"ratio": 0.001}, "expected the size of a building. Give another scale"),
        (pdf(ROOM), {"ratio": 100, "inside": (0, 0)}, r"inside \(0, 0\) is in a wall or outside the plan"),
        (b"%PDF-1.6 but nothing else", {"ratio": 100}, "cannot be read as a PDF"),
        (b"plain text", {"ratio": 100}, "cannot be read as a PDF"),
        (pdf(ROOM), {"ratio": 1e8}, "expected the size of a building. Give another scale"),
    ],
)  # fmt: skip
def test_what_is_no_plan_is_refused_with_the_way_out(tmp_path, data, options, message):
    with pytest.raises(MapError, match=message):
        World.from_file(saved(tmp_path, data), **options)


def test_a_scenario_reads_a_plan_and_closes_what_cannot_be_reached(tmp_path):
    saved(tmp_path, pdf(ROOM + b"60 60 m 340 60 l S"))
    asked = {"world": {"pdf": {"path": "plan.pdf", "scale": 0.02, "inside": [3, 3], "origin": [50, 50]}},
             "start": [1, 2, 0], "goal": [5, 3, 0], "criteria": ["length"]}  # fmt: skip
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    world = load_scenario(tmp_path / "scenario.yaml").problem.world
    assert world.bounds == pytest.approx((0.025, 0.025, 5.975, 3.975))
    assert world.extent.area == pytest.approx(5.95 * 3.95 - 0.05 * 5.65)
    with pytest.raises(MapError, match=r"outside the plan, which spans x -0\.03 to 6\.03 m"):
        World.from_file(tmp_path / "plan.pdf", scale=0.02, origin=(50, 50), inside=(9, 9))


def test_compressed_content_is_read():
    packed = stream(zlib.compress(b"10 10 m 20 20 l S"), b"/Filter /FlateDecode")
    data = pdf(b"").replace(stream(b""), packed)
    assert found(data)[1] == [[[10, 10], [20, 20]]]


# The page as it is shown: its unit, its border, clip paths, thick strokes


def test_a_page_of_another_unit_has_its_true_size(tmp_path):
    """UserUnit 2: a unit is 2/72 inch, so that 300 x 200 of them at 1:100 are 21.17 x 14.11 m."""
    world = World.from_file(saved(tmp_path, pdf(ROOM, page=b"/UserUnit 2")), ratio=100)
    x0, y0, x1, y1 = world.bounds
    metre = 2 * 0.0254 / 72 * 100
    assert (x1 - x0, y1 - y0) == pytest.approx((300 * metre + 0.05, 200 * metre + 0.05))
    assert (x0, y0) == pytest.approx((50 * metre - 0.025, 50 * metre - 0.025))
    assert "the page 1 says (UserUnit) that its unit is 2 points; this is applied" in world.notes[0]


def test_a_unit_that_stands_in_a_compressed_object_is_found_and_one_in_the_text_of_a_page_is_not():
    inside = stream(b"3 0", b"/Type /ObjStm /N 1 /First 4")  # only its name matters here: no object is in it
    words, _ = found(pdf(b"% /UserUnit 7\n" + ROOM, page=b"/UserUnit 1.5", objects=[inside]))
    assert words["unit"] == 1.5
    assert found(pdf(b"% /UserUnit 7\n" + ROOM, objects=[inside]))[0]["unit"] == 1
    assert found(pdf(ROOM, page=b"/UserUnit 0", objects=[inside]))[0]["unit"] == 1


def test_what_lies_outside_of_the_page_is_not_shown():
    outside = b"500 10 m 500 90 l S 390 100 m 450 100 l S 0.1 g 380 200 100 50 re f\n"
    words, parts = found(pdf(ROOM + outside))
    assert parts[0][:2] == [[50, 50], [350, 50]]
    assert parts[1] == pytest.approx(np.array([[390, 100], [400.01, 100]]))
    assert shapely.Polygon(parts[2]).bounds == pytest.approx((380, 200, 400.01, 250))
    assert words["left_out"] == {"partly or fully outside the page or a clip path": 3}
    cropped = found(pdf(ROOM, page=b"/CropBox [0 0 200 300]"))[1]
    assert max(x for part in cropped for x, _ in part) == pytest.approx(200.01)


def test_clip_paths_cut_what_is_drawn():
    box = b"q 100 100 100 100 re W n 1 w 0 150 m 400 150 l S 0 10 m 400 10 l S Q\n"
    triangle = b"q 0 0 m 100 0 l 0 100 l h W n 1 w 0 50 m 400 50 l S Q\n"
    words, parts = found(pdf(box + triangle))
    assert [sorted(part) for part in parts] == [
        [pytest.approx([99.99, 150]), pytest.approx([200.01, 150])],
        [pytest.approx([0, 50]), pytest.approx([50, 50])],
    ]
    assert words["left_out"] == {"partly or fully outside the page or a clip path": 3}
    fill = found(pdf(b"q 100 100 m 300 100 l 100 300 l h W n 0 g 0 0 200 200 re f Q"))[1]
    assert shapely.Polygon(fill[0]).area == pytest.approx(100 * 100)


def test_a_form_shows_what_lies_in_its_box_and_in_the_clip_around_it():
    form = stream(b"1 w 0 10 m 300 10 l S", b"/Type /XObject /Subtype /Form /BBox [0 0 99 99] /Matrix [1 0 0 1 7 0]")
    inner = found(pdf(b"q 1 0 0 1 50 0 cm /X Do Q", resources=b"/XObject << /X 5 0 R >>", objects=[form]))[1]
    assert inner[0] == pytest.approx(np.array([[57, 10], [156.01, 10]]))
    around = b"q 0 0 100 100 re W n 1 0 0 1 50 0 cm /X Do Q"
    assert found(pdf(around, resources=b"/XObject << /X 5 0 R >>", objects=[form]))[1][0][1] == pytest.approx(
        [100.01, 10]
    )


def test_thick_strokes_are_as_thick_as_they_are_drawn(tmp_path):
    """At 1:100 a stroke of 8.504 points (3 mm) is 0.3 m thick, one of half of that, stretched twice, too."""
    frame = b"0.1 w 10 10 m 390 10 l 390 290 l 10 290 l s\n"
    strokes = b"8.504 w 100 100 m 300 100 l S q 2 0 0 2 0 0 cm 4.252 w 50 100 m 150 100 l S Q 0.1 w 50 50 m 350 50 l S"
    world = World.from_file(saved(tmp_path, pdf(frame + strokes)), ratio=100)
    metre = 0.0254 / 72 * 100
    x, y = (np.array(axis) * metre for axis in ((200.0, 200, 200, 98), (100.0, 200, 50, 100)))
    above = world.clearance(x, y + np.array([0.2, 0.2, 0.2, 0.0]))
    assert above == pytest.approx([0.05, 0.05, 0.175, 2 * metre], abs=1e-4)  # ends are cut off, as a stroke's are
    assert [note for note in world.notes if "lines as thick as they are drawn: 2" in note]


def test_annotations_are_told():
    note = b"<< /Type /Annot /Subtype /Line /L [0 0 100 100] /Rect [0 0 100 100] >>"
    assert found(pdf(ROOM, page=b"/Annots [5 0 R]", objects=[note]))[0]["left_out"] == {"annotations": 1}


def test_the_arc_of_a_door_is_left_out_where_that_is_asked_for(tmp_path):
    """A quarter of a circle of 25.5 points (0.9 m at 1:100) as drawing programs write it, with its leaf."""
    k = 0.5523 * 25.5
    swing = (200, 100, 225.5, 100, 225.5, 100 + k, 200 + k, 125.5, 200, 125.5)
    door = b"%.2f %.2f m %.2f %.2f l %.2f %.2f %.2f %.2f %.2f %.2f c S" % swing
    path = saved(tmp_path, pdf(ROOM + door))
    metre = 0.0254 / 72 * 100
    x, y = np.array([[200 + 25.5 / 2**0.5], [100 + 25.5 / 2**0.5]]) * metre
    closed, opened = World.from_file(path, ratio=100), World.from_file(path, ratio=100, door_arcs="open")
    assert (closed.clearance(x, y) > 0, opened.clearance(x, y) > 0.5) == (False, True)
    assert opened.clearance(np.array([212 * metre]), np.array([100 * metre]))[0] == 0  # the leaf


@pytest.mark.parametrize(
    ("default", "seen"),
    [
        (b"<< /Order [5 0 R] /OFF [6 0 R] >>", ["WALLS", "Möbel"]),
        (b"<< /BaseState /OFF /ON [7 0 R] >>", ["Möbel"]),
        (b"8 0 R", ["WALLS"]),
        (b"<< >>", ["WALLS", "(Old)", "Möbel"]),
    ],
)
def test_layers_that_are_off_are_left_out_unless_they_are_asked_for(default, seen):
    content = b" ".join(b"/OC /L%d BDC 1 w %d 10 m %d 90 l S EMC" % (i, x, x) for i, x in enumerate((10, 20, 30)))
    names = (b"(WALLS)", b"(\\(Ol\\144\\))", b"<FEFF004D00F600620065006C>")
    layers = [b"<< /Type /OCG /Name %b >>" % name for name in names]
    data = pdf(
        content,
        resources=b"/Properties << /L0 5 0 R /L1 6 0 R /L2 7 0 R >>",
        catalog=b"/OCProperties << /OCGs [5 0 R 6 0 R 7 0 R] /D %b /Configs [<< /OFF [5 0 R] >>] >>" % default,
        objects=[*layers, b"<< /OFF [6 0 R 7 0 R] >>"],
    )
    words, _ = found(data)
    assert words["layers"] == seen
    hidden = {"on layers that are off or frozen": 3 - len(seen)} if len(seen) < 3 else {}
    assert words["left_out"] == hidden
    assert found(data, layers=["(old)", "walls"])[0]["layers"] == ["WALLS", "(Old)"]
