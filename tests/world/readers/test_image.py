"""Blueprint images: dark is obstacle."""

import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from hpop.errors import MapError
from hpop.world import World
from hpop.world.geometry.shapes import Raster


def save(folder, pixels):
    path = folder / "plan.png"
    Image.fromarray(np.array(pixels, dtype=np.uint8)).save(path)
    return path


def test_dark_pixels_are_obstacles_and_the_first_row_is_on_top(tmp_path):
    world = World.from_image(save(tmp_path, [[0, 255, 120], [255, 255, 140]]), 0.5, origin=(1, 2, 0))
    assert world.raster.cells.tolist() == [[False, False, False], [True, False, True]]
    assert world.bounds == (1, 2, 2.5, 3)


def test_the_threshold_is_a_brightness(tmp_path):
    path = save(tmp_path, [[0, 100, 200, 255]])
    assert World.from_image(path, 1, threshold=0.0).raster.cells.sum() == 0
    assert World.from_image(path, 1, threshold=0.9).raster.cells.tolist() == [[True, True, True, False]]


def test_colours_are_averaged_and_transparent_ink_is_white_paper(tmp_path):
    world = World.from_image(save(tmp_path, [[[0, 0, 0, 0], [0, 0, 0, 255], [255, 255, 0, 255]]]), 1)
    assert world.raster.cells.tolist() == [[False, True, False]]


def test_heights_and_the_outside_can_be_chosen(tmp_path):
    world = World.from_image(save(tmp_path, [[0, 255]]), 1, height=(0, 2), outside_is_obstacle=False)
    assert world.raster.heights == (0, 2)
    assert not world.outside_is_obstacle


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resolution": 0}, "resolution"),
        ({"resolution": 1e-9}, r"\.png: a resolution of 1e-09 m makes 2 x 1 cells a map 2e-09 m across"),
        ({"resolution": float("nan")}, "resolution"),
        ({"threshold": 1.5}, "threshold"),
        ({"threshold": "dark"}, "threshold"),
        ({"origin": (0, 0)}, "origin"),
        ({"height": (1, 0)}, "z_min"),
        ({"smallest_obstacle": 0}, "smallest_obstacle"),
        ({"inside": 3}, r"a point \[x, y\] in m; got 3"),
        ({"inside": (3, "a")}, r"a point \[x, y\] in m"),
        ({"inside": (5, 0.5)}, r"inside \(5, 0.5\) is not on the image, which is 2 x 1 m"),
        ({"inside": (0.5, 0.5)}, "is in an obstacle"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    with pytest.raises(MapError, match=message):
        World.from_image(save(tmp_path, [[0, 255]]), **{"resolution": 1.0, **options})


def test_a_truncated_png_and_a_huge_one_are_refused(tmp_path):
    path = save(tmp_path, np.random.default_rng(0).integers(0, 255, (60, 60)))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(MapError, match="file is complete"):
        World.from_image(path, 1.0)
    Image.new("1", (12_000, 12_000)).save(path)
    with pytest.raises(MapError, match="at most"):
        World.from_image(path, 1.0)


def test_memory_of_reading_is_that_of_a_block_and_the_cells(tmp_path):
    """Beside the decoder's own four bytes a pixel, which are not counted here."""
    pixels = np.full((2000, 2000, 3), 255, np.uint8)
    pixels[::100] = 0
    path = tmp_path / "large.png"
    Image.fromarray(pixels).save(path)
    tracemalloc.start()
    world = World.from_image(path, 0.05)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert world.raster.cells.sum() == 20 * 2000
    assert taken < 3 * pixels[..., 0].size + 60 * 1_000_000  # cells, read and kept, and a block of brightness


# A floor plan as people have them: thin walls, statues in grey, lettering, dust

METRE = 20  # pixels
WALLS = ([(1, 1), (15, 1), (15, 9), (1, 9), (1, 1)], [(8, 1), (8, 6)], [(10, 9), (14, 5)])  # m, from the top left
STATUES = {(4, 4): 110, (11, 3): 160, (3, 7): 205}
WORDS = {(4.2, 2): "Hall 3", (4.5, 5.5): "Cafe"}


def pixel(*metres):
    return tuple(round(METRE * value) for value in metres)


def drawn(folder, *, words=True, statues=True):
    """Draw a plan of 16 x 10 m; return the picture and its solid parts: everything but the lettering."""
    font = ImageFont.load_default(14)
    plan, solid = Image.new("L", pixel(16, 10), 255), Image.new("1", pixel(16, 10), 0)
    for picture, ink in ((plan, 0), (solid, 1)):
        pen = ImageDraw.Draw(picture)
        for line in WALLS:
            pen.line([pixel(*corner) for corner in line], fill=ink)  # a pixel wide
        for (x, y), grey in STATUES.items():
            if statues:
                pen.ellipse((*pixel(x - 0.4, y - 0.4), *pixel(x + 0.4, y + 0.4)), fill=grey if picture is plan else 1)
    for (x, y), word in WORDS.items():
        if words:
            ImageDraw.Draw(plan).text(pixel(x, y), word, fill=0, font=font)
    path = folder / "plan.png"
    plan.save(path)
    return path, np.array(solid)[::-1]


def test_thin_walls_are_obstacles_pixel_for_pixel_and_nothing_is_noted(tmp_path):
    path, solid = drawn(tmp_path, words=False, statues=False)
    world = World.from_image(path, 1 / METRE)
    assert (world.raster.cells == solid).all()
    assert not world.notes


def test_what_is_not_what_was_drawn_is_noted_with_its_place_and_the_way_out(tmp_path):
    path, solid = drawn(tmp_path)
    world = World.from_image(path, 1 / METRE)
    counted, grey, words = world.notes
    shades = np.asarray(Image.open(path))
    between = (shades >= 64) & (shades <= 229)
    assert f"{np.count_nonzero(between):,} of 64,000 pixels" in counted
    assert f"{np.count_nonzero(between & (shades < 127.5)):,} below the threshold 0.5 are obstacles" in counted
    assert np.array(re.findall(r"at \((.*?), (.*?)\), brightness (.*?)[;.] ", grey), dtype=float) == pytest.approx(
        np.array([[x, 10 - y, shade / 255] for (x, y), shade in STATUES.items() if shade > 127][::-1]), abs=0.05
    )
    lettered = world.raster.cells & ~solid
    assert lettered.any()
    assert "in 2 words at" in words

    mended = World.from_image(path, 1 / METRE, **asked(grey, "threshold"), **asked(words, "smallest_obstacle"))
    assert (mended.raster.cells == solid).all()
    assert "left out" in mended.notes[-1]


def asked(note, option):
    """Return the option that a note proposes."""
    return {option: float(re.search(rf"{option}: ([0-9.]+[0-9])", note)[1])}


def test_lettering_is_told_from_a_row_of_columns_and_from_walls(tmp_path):
    plan = Image.new("L", (300, 200), 255)
    pen = ImageDraw.Draw(plan)
    for i in range(8):
        pen.rectangle((20 + 14 * i, 30, 28 + 14 * i, 38), fill=0)
        pen.rectangle((20 + 30 * i, 120, 45 + 30 * i, 123), fill=0)
    path = tmp_path / "plan.png"
    plan.save(path)
    assert not World.from_image(path, 0.05).notes
    pen.text((60, 60), "Foyer", fill=0, font=ImageFont.load_default(20))
    turned = Image.new("L", plan.size, 255)
    turned.paste(plan)
    turned.rotate(90, expand=True).save(path)
    (note,) = [note for note in World.from_image(path, 0.05).notes if "look like" in note]
    assert "in 1 word at" in note


def test_obstacles_smaller_than_asked_are_left_out_and_told(tmp_path):
    pixels = np.full((20, 30), 255)
    pixels[5:8, 5:8] = pixels[12, 3] = pixels[2, 20:25] = 0  # 9, 1 and 5 pixels of 0.25 m²
    world = World.from_image(save(tmp_path, pixels), 0.5, smallest_obstacle=1.5)
    assert world.raster.cells.sum() == 9
    assert world.notes == (
        f"{tmp_path / 'plan.png'}: 2 obstacles smaller than 1.5 m² are left out, 1.5 m² in all, the largest 1.25 m²; "
        "the smallest that stay are 2.25 m² at (3.25, 6.75).",
    )


def test_what_cannot_be_reached_from_a_point_inside_is_solid(tmp_path):
    path, solid = drawn(tmp_path, words=False, statues=False)
    world = World.from_image(path, 1 / METRE, inside=(5, 5))
    rows, columns = np.indices(solid.shape)
    within = (rows > METRE) & (rows < 9 * METRE) & (columns > METRE) & (columns < 15 * METRE)
    outside = ~(within[::-1] | solid)
    assert (world.raster.cells == (solid | outside)).all()  # no wall within the room closes a part of it
    outside = np.count_nonzero(outside) / METRE**2
    assert f"{outside:.4g} m² that cannot be reached from inside (5, 5) are solid" in world.notes[0]
    assert "the edge of the image" not in world.notes[0]
    assert "the edge of the image" in World.from_image(path, 1 / METRE, inside=(0.5, 0.5)).notes[0]


def test_lines_of_pixels_that_touch_at_corners_are_closed(tmp_path):
    pixels = 255 * (1 - np.eye(9))
    below = World.from_image(save(tmp_path, pixels), 1, inside=(0.5, 0.5), origin=(0, 0, 0))
    assert below.raster.cells.sum() == 9 + 36


def test_a_point_inside_is_of_the_world_wherever_the_image_lies(tmp_path):
    pixels = np.full((4, 6), 255)
    pixels[:, 2] = 0
    turned = World.from_image(save(tmp_path, pixels), 1, inside=(10 - 0.5, 20 + 4.5), origin=(10, 20, np.pi / 2))
    assert turned.raster.cells.tolist() == [[True] * 3 + [False] * 3] * 4


def test_the_choice_is_kept_with_a_saved_world(tmp_path):
    path, _ = drawn(tmp_path)
    world = World.from_image(path, 1 / METRE, threshold=0.9, smallest_obstacle=0.1, inside=(5, 5))
    again = World.from_description(world.describe())
    assert (again.raster.cells == world.raster.cells).all()
    assert again.notes == world.notes


# Lines thinner than walls, and pictures as cameras and other programs save them


def with_a_door(folder, walls=6, arc=1):
    """Two rooms of 4 x 4 m at 0.05 m a pixel; the swing of a door of 0.9 m closes the passage between them."""
    plan = Image.new("L", (180, 100), 255)
    pen = ImageDraw.Draw(plan)
    for box in ((0, 0, 179, walls - 1), (0, 100 - walls, 179, 99), (0, 0, walls - 1, 99), (180 - walls, 0, 179, 99)):
        pen.rectangle(box, fill=0)
    pen.rectangle((88, 0, 87 + walls, 40), fill=0)
    pen.rectangle((88, 59, 87 + walls, 99), fill=0)
    pen.line((88, 59, 70, 59), fill=0, width=arc)  # the leaf, open
    pen.arc((70, 41, 106, 77), 180, 270, fill=0, width=arc)
    path = folder / "plan.png"
    plan.save(path)
    return path


def test_a_thin_line_that_closes_a_passage_is_told_and_left_out_where_that_is_asked_for(tmp_path):
    path = with_a_door(tmp_path)
    closed = World.from_image(path, 0.05)
    (note,) = [note for note in closed.notes if "close passages" in note]
    assert "1 line of up to 0.15 m close passages, thinner than the walls, at (" in note
    x, y = map(float, re.search(r"at \(([\d.]+), ([\d.]+)\)", note).groups())
    assert (x, y) == pytest.approx((79 * 0.05, 50 * 0.05), abs=0.1)  # the middle of the swing
    opened = World.from_image(path, 0.05, thinnest_obstacle=float(re.search(r"obstacle: ([\d.]+)", note).group(1)))
    walls = 2 * 6 * 180 + 2 * 6 * 88 + 6 * (35 + 35)  # pixels
    assert walls <= np.count_nonzero(opened.raster.cells) <= walls + 12  # stubs where lines meet walls
    rooms = [ndimage.label(~world.raster.cells)[1] for world in (closed, opened)]
    assert rooms == [2, 1]
    assert "lines thinner than 0.2 m are left out" in opened.notes[0]


@pytest.mark.parametrize("pixels", [2, 3, 4, 5])
def test_lines_are_left_out_by_their_thickness(tmp_path, pixels):
    cells = np.full((40, 60), 255, np.uint8)
    for i in range(1, 7):
        cells[5:35, 8 * i : 8 * i + i] = 0  # a line of each thickness, in pixels
    world = World.from_image(save(tmp_path, cells), 0.1, thinnest_obstacle=pixels / 10)
    assert [int(world.raster.cells[20, 8 * i : 8 * i + i].sum()) for i in range(1, 7)] == [
        i if i >= pixels else 0 for i in range(1, 7)
    ]
    assert world.raster.cells.sum() == 30 * sum(i for i in range(1, 7) if i >= pixels)


def test_where_walls_are_lines_themselves_none_is_told_from_them(tmp_path):
    path = with_a_door(tmp_path, walls=2)
    assert not [note for note in World.from_image(path, 0.05).notes if "close passages" in note]


def test_a_photograph_is_turned_as_it_is_shown(tmp_path):
    """Orientation 6: the first row is the right side of what is shown (EXIF 2.3, 4.6.4)."""
    image = Image.fromarray(np.array([[0, 255, 255], [255, 255, 255]], np.uint8))
    exif = Image.Exif()
    exif[0x0112] = 6
    image.save(tmp_path / "plan.png", exif=exif)
    world = World.from_image(tmp_path / "plan.png", 1)
    assert world.raster.cells.tolist() == [[False, False], [False, False], [False, True]]
    assert "it is turned as its EXIF orientation says" in world.notes[0]


def test_a_picture_without_a_dark_pixel_is_told(tmp_path):
    white_on_nothing = [[[255, 255, 255, 255], [255, 255, 255, 0]]]
    (note,) = World.from_image(save(tmp_path, white_on_nothing), 1).notes
    assert "no pixel is darker than the threshold 0.5, so there are no obstacles" in note


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "P", "1", "I;16", "CMYK"])
def test_every_kind_of_pixels_is_read(tmp_path, mode):
    grey = Image.fromarray(np.array([[0, 255]], np.uint8)).resize((16, 8), Image.Resampling.NEAREST)
    if mode == "I;16":
        image = Image.fromarray(np.asarray(grey).astype(np.uint16) * 257)
    else:
        image = grey.convert("RGB").convert(mode)
    path = tmp_path / ("plan.jpg" if mode == "CMYK" else "plan.png")
    image.save(path)
    cells = World.from_image(path, 1).raster.cells
    assert cells[:, :8].all()
    assert not cells[:, 8:].any()


def test_a_transparent_colour_of_a_palette_is_paper(tmp_path):
    image = Image.fromarray(np.array([[0, 1, 2]], np.uint8)).convert("P")
    image.putpalette([0, 0, 0, 10, 10, 10, 255, 255, 255])
    image.save(tmp_path / "plan.png", transparency=1)
    assert World.from_image(tmp_path / "plan.png", 1).raster.cells.tolist() == [[True, False, False]]


def test_an_image_without_a_scale_is_refused_with_the_call_that_reads_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.new("L", (4, 4), 255).save("map.pgm")
    advice = r"needs resolution, .* such as World.from_file\('map.pgm', resolution=0.05\)"
    with pytest.raises(MapError, match=advice + r"\. `hpop explain image`") as raised:
        World.from_file("map.pgm")
    assert "float" not in str(raised.value)  # no signature
    with pytest.raises(MapError, match=r"cannot be opened: .* Did you mean 'map.pgm'\?"):
        World.from_image("mpa.pgm", 0.05)
    Path("map.yaml").touch()
    with pytest.raises(MapError, match=advice + "; or give map.yaml, which states it"):
        World.from_file("map.pgm")


def test_colours_set_the_contrast_of_obstacles_by_their_luminance(tmp_path):
    """Four blocks on white: black, pure red, middle grey, light grey; the rule is written down anew here."""
    pixels = np.full((20, 80, 3), 255)
    colours = {0: (0, 0, 0), 20: (255, 0, 0), 40: (128, 128, 128), 60: (204, 204, 204)}
    for column, colour in colours.items():
        pixels[5:15, column + 4 : column + 14] = colour
    path = save(tmp_path, pixels)
    world = World.from_image(path, 0.1, threshold=0.9, contrast=True)
    luminances = {0: 0.0, 20: 0.2126, 40: ((128 / 255 + 0.055) / 1.055) ** 2.4, 60: ((0.8 + 0.055) / 1.055) ** 2.4}
    for column, y in luminances.items():
        shade = world.raster.contrast(np.array([(column + 8) / 10]), np.array([1.0]))
        assert shade == pytest.approx((1 - y) / (1 + y), abs=0.005)
    assert world.raster.contrast(np.array([0.05, 99.0]), np.array([0.05, 0.0])).tolist() == [1, 1]  # free, and outside
    assert any("contrast of their colours against white, 0.25 to 1.00 (median" in note for note in world.notes)
    plain = World.from_image(path, 0.1, threshold=0.9)
    assert plain.raster.contrasts is None
    assert plain.raster.cells.tolist() == world.raster.cells.tolist()
    assert "contrast" not in plain.describe()["options"]
    for again in (World.from_description(world.describe()), World.from_description({**as_geometry(world)})):
        assert again.raster.contrasts.tolist() == world.raster.contrasts.tolist()


@pytest.mark.parametrize(("grey", "contrast"), [(0, "1.00"), (128, "0.64")])
def test_areas_closed_from_inside_have_no_contrast_of_their_own(tmp_path, grey, contrast):
    """A room whose walls are two lines, on a white sheet with pale furniture; the sheet outside is closed."""
    pixels = np.full((80, 80), 255)
    pixels[10:15, 60:70] = 220  # too light for an obstacle
    pixels[20:60, 20:60], pixels[21:59, 21:59] = grey, 255
    pixels[30:50, 30:50], pixels[31:49, 31:49] = grey, 255
    world = World.from_image(save(tmp_path, pixels), 0.1, threshold=0.6, inside=(4, 4), contrast=True)
    expected = f"{contrast} to {contrast} (median {contrast};"
    assert any(expected in note for note in world.notes)
    solid = world.raster.contrasts[world.raster.cells]
    assert set(solid.tolist()) == {100, round(100 * float(contrast))}
    beside = world.raster.contrast(np.array([1.95]), np.array([4.0]))  # just outside the outer line
    assert beside == pytest.approx(float(contrast), abs=0.005)


def as_geometry(world):
    """Return the description of a world without its file."""
    return World(world.ground).describe()


def test_a_blurred_edge_has_the_contrast_of_the_inside(tmp_path):
    pixels = np.full((20, 30), 255)
    pixels[5:15, 5:25], pixels[6:14, 6:24] = 120, 0
    world = World.from_image(save(tmp_path, pixels), 0.1, contrast=True)
    assert (world.raster.contrasts[world.raster.cells] == 100).all()
    with pytest.raises(MapError, match="contrasts must have the shape of the cells"):
        Raster(np.zeros((2, 3), dtype=bool), 1.0, contrasts=np.zeros((3, 2), dtype=np.uint8))
