"""ROS map_server maps: real ones with known counts, every mode, and every way to be broken."""

import re
from contextlib import suppress

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from hpop.errors import MapError
from hpop.world import World
from hpop.world.geometry.shapes import MAX_CELLS
from hpop.world.readers.ros_map import load

YAML = {
    "image": "map.pgm",
    "resolution": 0.5,
    "origin": "[1.0, 2.0, 0.0]",
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def write(folder, content=None, /, **changes):
    """Write a map to a folder; a change to None removes the key."""
    values = {key: value for key, value in {**YAML, **changes}.items() if value is not None}
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items()))
    if content is None:
        content = b"P5\n3 2\n255\n" + bytes([0, 205, 254, 254, 0, 0])
    (folder / "map.pgm").write_bytes(content)
    return path


def three_states(grid):
    """Occupied 100, free 0, unknown -1, as map_server publishes them; row 0 at the bottom."""
    return np.where(grid.occupied, 100, np.where(grid.free, 0, -1)).tolist()


@pytest.mark.parametrize(
    ("name", "size", "free", "occupied", "unknown"),  # from each folder's SOURCE.txt
    [
        ("pal_office/map.yaml", (520, 469), 230421, 13459, 0),
        ("nav2_depot/depot.yaml", (604, 307), 179481, 5947, 0),
        ("nav2_depot/depot_keepout.yaml", (604, 307), 154215, 31213, 0),
        # In mode scale from 0 to 1, of the shades 0, 127, 191, 205 and 254: rint(100 (1 - shade / 255)) is 100 of the
        # first and 0 of the last, whose pixels were counted in the image.
        ("nav2_depot/depot_speed.yaml", (604, 307), 123746, 3735, 57947),
        ("aws_bookstore/map.yaml", (384, 384), 61884, 4954, 80618),
    ],
)
def test_real_maps_have_the_counts_of_their_source(shared_data, name, size, free, occupied, unknown):
    folder, _, file = name.partition("/")
    grid = load(shared_data(folder) / file)
    assert grid.free.shape == size[::-1]
    assert (grid.free.sum(), grid.occupied.sum()) == (free, occupied)
    assert (~grid.free & ~grid.occupied).sum() == unknown


def test_a_real_map_lies_where_its_yaml_says(shared_data):
    world = World.from_ros_map(shared_data("pal_office") / "map.yaml")
    assert world.bounds == pytest.approx((-14.2, -12.2, -14.2 + 26.0, -12.2 + 23.45))
    assert world.cell == 0.05
    assert world.solid().area == pytest.approx(13459 * 0.05**2)


def test_the_keep_out_mask_closes_the_plane_but_not_the_view(shared_data):
    folder = shared_data("nav2_depot")
    plain = World.from_ros_map(folder / "depot.yaml")
    masked = World.from_ros_map(folder / "depot.yaml", keep_out=folder / "depot_keepout.yaml")
    assert masked.keep_out.area == pytest.approx(31213 * 0.05**2)
    assert masked.solid().equals(plain.solid())
    point = shapely.point_on_surface(masked.keep_out.difference(plain.solid()).buffer(-0.1))
    x, y = np.array([point.x]), np.array([point.y])
    assert plain.clearance(x, y)[0] > 0
    assert masked.clearance(x, y)[0] == 0
    assert (masked.obstruction_field(1.0).values == plain.obstruction_field(1.0).values).all()


def test_the_first_row_of_the_image_is_the_top_of_the_map(tmp_path):
    assert three_states(load(write(tmp_path))) == [[0, 100, 100], [100, -1, 0]]


def test_unknown_cells_are_obstacles_unless_asked_otherwise(tmp_path):
    path = write(tmp_path)
    assert World.from_ros_map(path).raster.cells.tolist() == [[False, True, True], [True, True, False]]
    free = World.from_ros_map(path, unknown_is_free=True)
    assert free.raster.cells.tolist() == [[False, True, True], [True, False, False]]
    assert (World.from_ros_map(path).outside_is_obstacle, free.outside_is_obstacle) == (True, False)


def test_grey_that_a_threshold_makes_free_is_told_with_the_threshold_that_does_not(tmp_path):
    """Nav2 wrote free_thresh 0.25 beside 205 for unknown (navigation2, pull request 5278): 1 - 205 / 255 = 0.196."""
    image = b"P5\n3 2\n255\n" + bytes([0, 205, 254, 205, 205, 150])
    world = World.from_ros_map(write(tmp_path, image, free_thresh=0.25))
    assert world.clearance(np.array([1.75]), np.array([2.75])) > 0  # free, as in map_server
    unknown, note = world.notes
    assert "16.7 % of its cells are unknown and count as obstacles" in unknown  # the pixel of 150
    assert "50 % of its cells have the grey 205" in note
    corrected = float(note.partition("write free_thresh: ")[2].removesuffix("."))
    (unknown,) = World.from_ros_map(write(tmp_path, image, free_thresh=corrected)).notes
    assert "66.7 % of its cells are unknown and count as obstacles" in unknown
    assert World.from_ros_map(tmp_path / "map.yaml", unknown_is_free=True).notes == ()
    assert load(tmp_path / "map.yaml").free.sum() == 1


@pytest.mark.parametrize("said", [{"negate": 1}, {"mode": "raw"}])
def test_grey_that_no_map_saver_writes_is_not_told(tmp_path, said):
    notes = World.from_ros_map(write(tmp_path, free_thresh=0.6, **said)).notes
    assert not [note for note in notes if "the grey 205" in note]


def test_the_origin_turns_the_map_about_its_lower_left_corner(tmp_path):
    image = b"P5\n3 2\n255\n" + bytes([254, 254, 254, 254, 254, 0])  # lower right cell
    world = World.from_ros_map(write(tmp_path, image, origin="[1.0, 2.0, 1.5707963267948966]"))
    assert world.solid().bounds == pytest.approx((0.5, 3.0, 1.0, 3.5))


def test_heights_apply_to_all_cells(tmp_path):
    world = World.from_ros_map(write(tmp_path), height=(0, 1.5))
    assert world.solid(1.5, 3).is_empty
    assert not world.solid(1.0, 3).is_empty


def test_negate_swaps_black_and_white(tmp_path):
    assert three_states(load(write(tmp_path, negate="true"))) == [[100, 0, 0], [0, 100, 100]]


def test_ascii_and_binary_pgm_and_comments_are_the_same_map(tmp_path):
    binary = load(write(tmp_path, b"P5\n# CREATOR: map_saver\n3 2\n255\n" + bytes([0, 205, 254, 254, 0, 0])))
    ascii_ = load(write(tmp_path, b"P2\n3 2\n255\n0 205 254\n254 0 0\n"))
    assert three_states(binary) == three_states(ascii_)


def test_a_pgm_with_another_maximum_is_scaled(tmp_path):
    assert three_states(load(write(tmp_path, b"P2\n3 1\n100\n0 80 100\n"))) == [[100, -1, 0]]
    deep = b"P5\n3 1\n65535\n" + np.array([0, 52000, 65535], dtype=">u2").tobytes()
    assert three_states(load(write(tmp_path, deep))) == [[100, -1, 0]]


def png(folder, pixels, **changes):
    Image.fromarray(np.array(pixels, dtype=np.uint8)).save(folder / "map.png")
    return load(write(folder, image="map.png", **changes))


def test_colours_are_averaged(tmp_path):
    pixels = [[[0, 0, 255], [255, 255, 255], [255, 255, 0]]]  # occ 2/3, 0, 1/3
    assert three_states(png(tmp_path, pixels)) == [[100, 0, -1]]


def test_alpha_is_averaged_in_trinary_mode(tmp_path):
    # occ: opaque black 1 - 1/4, transparent black 1, transparent white 1/4, opaque white 0.
    pixels = [[[0, 0, 0, 255], [0, 0, 0, 0], [255, 255, 255, 0], [255, 255, 255, 255]]]
    assert three_states(png(tmp_path, pixels, free_thresh=0.2)) == [[100, 100, -1, 0]]


def test_pixels_that_are_not_opaque_are_unknown_in_scale_mode(tmp_path):
    pixels = [[[0, 0, 0, 255], [0, 0, 0, 254], [255, 255, 255, 255], [128, 128, 128, 255]]]
    assert three_states(png(tmp_path, pixels, mode="scale")) == [[100, -1, 0, -1]]


def test_raw_mode_takes_bytes_as_percent(tmp_path):
    image = b"P5\n5 1\n255\n" + bytes([0, 50, 100, 101, 255])
    assert three_states(load(write(tmp_path, image, mode="raw"))) == [[0, -1, 100, -1, -1]]


def test_numbers_in_quotes_and_with_exponents_are_read_as_map_server_reads_them(tmp_path):
    plain = load(write(tmp_path))
    quoted = load(
        write(
            tmp_path,
            resolution='"0.5"',
            origin="['1.0', \"2\", 0e0]",
            negate="'0'",
            occupied_thresh='"0.65"',
            free_thresh="1.96e-1",
            mode="Trinary",
        )
    )
    assert three_states(quoted) == three_states(plain)
    assert (quoted.resolution, quoted.origin) == (0.5, (1.0, 2.0, 0.0))
    assert three_states(load(write(tmp_path, negate='"yes"'))) == three_states(load(write(tmp_path, negate=1)))


@pytest.mark.parametrize(
    "name", ["/home/ada/maps/map.pgm", r"'C:\Users\Ada\map.pgm'", "MAP.PGM", "map", "~/maps/Map", "../gone/map.pgm"]
)
def test_an_image_that_is_not_where_the_yaml_says_is_looked_for_beside_it_and_told(tmp_path, name):
    grid = load(write(tmp_path, image=name))
    assert three_states(grid) == three_states(load(write(tmp_path)))
    (note,) = grid.notes
    assert "is not there" in note
    assert str(tmp_path / "map.pgm") in note
    assert World.from_ros_map(write(tmp_path, image=name)).notes[0] == note


def test_the_image_of_the_very_name_comes_before_others_and_folders_are_no_images(tmp_path):
    (tmp_path / "plan.png").mkdir()
    Image.fromarray(np.full((2, 3), 255, np.uint8)).save(tmp_path / "plan.pgm")
    assert load(write(tmp_path, image="plan")).free.all()
    with pytest.raises(MapError, match=r"nowhere\.pgm' cannot be opened"):
        load(write(tmp_path, image="/home/ada/nowhere.pgm"))


def test_an_image_in_place_of_its_yaml_is_told_and_a_yaml_is_no_guess_for_an_image(tmp_path):
    path = write(tmp_path)
    for image, said in (("map.pgm", f"names it: '{path}'"), ("plan.pgm", "or read it by World.from_image(")):
        with pytest.raises(MapError, match=re.escape(said)):
            World.from_ros_map(tmp_path / image)
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(MapError, match=r"map\.pgm' cannot be opened: [^?]*$"):
        load(path)


# Masks, as keep-out editors write them: mode scale, black at the threshold 1


def mask(folder, pixels, **changes):
    """Write a mask of one row beside a map; return (the mask's yaml, the map's yaml)."""
    (folder / "masks").mkdir(exist_ok=True)
    image = b"P5\n%d 1\n255\n" % len(pixels) + bytes(pixels)
    given = {"mode": "scale", "occupied_thresh": 1.0, "free_thresh": 0.0, "origin": "[1, 2, 0]", **changes}
    return write(folder / "masks", image, **given), write(folder)


def test_black_closes_in_a_mask_of_mode_scale_whose_threshold_is_1(tmp_path):
    """Nav2's map_io: rint((1 - 0) / (1 - 0) 100) is 100, which its keep-out filter takes as lethal; 99 is not."""
    keep_out, path = mask(tmp_path, [0, 255, 255])
    world = World.from_ros_map(path, keep_out=keep_out)
    assert world.keep_out.bounds == (1, 2, 1.5, 2.5)
    assert not [note for note in world.notes if "of the mask" in note or "the mask closes" in note]
    # shades 1 and 2 have 99.6 and 99.2 percent: 100 and 99
    keep_out, path = mask(tmp_path, [1, 2, 255])
    world = World.from_ros_map(path, keep_out=keep_out)
    assert world.keep_out.area == 0.25
    assert f"{keep_out}: 1 cells of the mask are closed, and 1 are neither occupied nor free" in world.notes[0]


@pytest.mark.parametrize(
    ("pixels", "changes", "message"),
    [
        ([0, 255, 255], {"mode": "trinary"}, "the mask closes nothing, and 3 are neither"),  # 1 > 1 and 0 < 0 are false
        ([128, 255, 255], {}, "the mask closes nothing, and 1 are neither occupied nor free"),
        ([255, 255, 255], {}, "the mask closes nothing: all of its cells are free"),
        ([60, 0, 0], {"mode": "raw"}, "the mask closes nothing, and 1 are neither"),
    ],
)
def test_a_mask_that_closes_nothing_is_told(tmp_path, pixels, changes, message):
    keep_out, path = mask(tmp_path, pixels, **changes)
    world = World.from_ros_map(path, keep_out=keep_out)
    assert world.keep_out.is_empty
    assert message in world.notes[0]


def test_thresholds_of_one_value_split_a_map_of_mode_scale(tmp_path):
    image = b"P5\n3 1\n255\n" + bytes([0, 100, 255])
    assert three_states(load(write(tmp_path, image, mode="scale", occupied_thresh=0.5, free_thresh=0.5))) == [
        [100, 100, 0]
    ]


def test_the_image_is_found_beside_the_yaml_whatever_the_working_directory(tmp_path, monkeypatch):
    (tmp_path / "maps").mkdir()
    write(tmp_path / "maps")
    monkeypatch.chdir(tmp_path)
    assert World.from_ros_map("maps/map.yaml").source["path"] == str(tmp_path / "maps" / "map.yaml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"resolution": 0}, "resolution must be a number above 0"),
        ({"resolution": -0.05}, "above 0"),
        ({"resolution": ".nan"}, "above 0"),
        ({"resolution": "1.0e-9"}, r"map\.yaml: a resolution of 1e-09 m makes 3 x 2 cells a map 3e-09 m across"),
        ({"resolution": "1.0e+9"}, r"map 3e\+09 m across; give the side of a cell in m as resolution, such as 0\.05"),
        ({"resolution": ".inf"}, "above 0"),
        ({"resolution": "fine"}, "resolution must be a number"),
        ({"resolution": "true"}, "resolution must be a number"),
        ({"resolution": '"0,05"'}, "resolution must be a number"),
        ({"resolution": "0x" + "f" * 5000}, "a whole number of 6,021 digits"),
        ({"origin": "[0, 0]"}, "origin must be three finite numbers"),
        ({"origin": "[0, 0, .nan]"}, "origin"),
        ({"origin": "here"}, "origin"),
        ({"origin": "[0, 0, [1, 2]]"}, "nested"),
        ({"origin": 7}, "origin"),
        ({"occupied_thresh": 1.5}, "occupied_thresh must be a number from 0 to 1"),
        ({"free_thresh": -0.1}, "free_thresh must be a number from 0 to 1"),
        ({"free_thresh": ".nan"}, "free_thresh"),
        ({"free_thresh": '"20 %"'}, "free_thresh must be a number"),
        ({"free_thresh": 0.8}, "must not exceed"),
        ({"negate": 2}, "negate must be"),
        ({"negate": "maybe"}, "negate must be"),
        ({"mode": "ternary"}, "must be one of trinary, scale, raw"),
        ({"mode": "[a, [b]]"}, "mode must be one of"),
        ({"image": ""}, "image must be the path"),
        ({"image": 5}, "image must be the path"),
        ({"image": "nowhere.pgm"}, "map image .*nowhere.pgm.* cannot be opened"),
        ({"image": "."}, "found a folder"),
        ({"image": '"a\\0b"'}, "cannot be opened"),
        ({"resolution": None}, "lacks resolution"),
        ({"resolution": None, "resolutoin": 0.5}, r"free_thresh\. Did you mean 'resolution'\?"),
        ({"image": None, "origin": None}, "lacks image, origin"),
        ({"origin": "!!python/object/apply:os.system ['true']"}, "not a plain yaml file"),
        ({"origin": "[0, 0"}, "not a plain yaml file"),
    ],
)
def test_every_wrong_value_is_named(tmp_path, changes, message):
    with pytest.raises(MapError, match=message):
        World.from_ros_map(write(tmp_path, **changes))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"- a\n- b\n", "mapping"),
        (b"just text", "mapping"),
        ("image: büro.pgm\nresolution: 0.05\n".encode("utf-16-le"), "UTF-16 or UTF-32 without a byte-order mark"),
        ("image: map.pgm\nresolution: 0.05\n".encode("utf-16-be"), "UTF-16 or UTF-32 .*save it as UTF-8"),
        ("image: map.pgm\nresolution: 0.05\n".encode("utf-32-le"), "UTF-16 or UTF-32 .*save it as UTF-8"),
        (b"\xff\xfe\x00\x80", "It is UTF-16, .*save it as UTF-8"),
        ("# Büro im Erdgeschoß\nimage: map.pgm\n".encode("latin-1"), "Latin-1 or Windows-1252, .* save it as UTF-8"),
        (b"image: \x89PNG\x00\x01\xff", "may be another kind of file"),
        (b"[" * 100_000, "nests values"),
        (b"[" * 100_000 + b"]" * 100_000, "nests values"),
        (b"a: 9" + b"9" * 5000, "yaml"),
        (b" " * 1_000_001, "at most"),
    ],
)
def test_a_file_that_is_no_map_is_refused(tmp_path, content, message):
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    with pytest.raises(MapError, match=message):
        World.from_ros_map(path)


def test_a_missing_file_and_a_directory_are_refused(tmp_path):
    with pytest.raises(MapError, match="cannot be opened"):
        World.from_ros_map(tmp_path / "none.yaml")
    with pytest.raises(MapError, match="found a folder"):
        World.from_ros_map(tmp_path)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (b"", "is empty"),
        (b"not an image", "is no image that can be read"),
        (b"P5\n3 2\n", "cannot be read"),
        (b"P5\n3 2\n255\n\x00\x00", "file is complete"),
        (b"P2\n3 2\n255\n0 0 0", "file is complete"),
        (b"P5\n0 2\n255\n", "is no image that can be read"),
        (b"P5\n50000 50000\n255\n\x00", f"too large: at most {MAX_CELLS:,}"),
        (b"P5\n12000 12000\n255\n\x00", f"at most {MAX_CELLS:,}"),
        (b"P5\n99999999999999999999 2\n255\n\x00", "check that the file is intact"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "read"),
    ],
)
def test_every_broken_image_is_a_map_error(tmp_path, image, message):
    with pytest.raises(MapError, match=message):
        World.from_ros_map(write(tmp_path, image))


def test_a_broken_mask_is_named(tmp_path):
    path = write(tmp_path)
    with pytest.raises(MapError, match=r"mask\.yaml"):
        World.from_ros_map(path, keep_out=tmp_path / "mask.yaml")


def test_a_wrong_height_is_refused(tmp_path):
    with pytest.raises(MapError, match="z_min < z_max"):
        World.from_ros_map(write(tmp_path), height=(2, 1))


def read_again(world):
    """Check that a map is whole: it has a position, and its description builds equal cells."""
    assert world.raster.cells.size > 0
    assert np.isfinite([world.raster.resolution, *world.raster.origin, *world.bounds]).all()
    again = World.from_description(world.describe())
    assert (again.raster.cells == world.raster.cells).all()
    assert again.raster.origin == world.raster.origin


@given(
    head=st.sampled_from(
        [b"", b"P5\n3 2\n255\n", b"P2\n3 2\n255\n", b"\x89PNG\r\n\x1a\n", b"GIF89a", b"BM", b"\xff\xd8\xff"]
    ),
    tail=st.binary(max_size=60),
)
def test_any_bytes_are_an_image_or_a_map_error(tmp_path_factory, head, tail):
    path = write(tmp_path_factory.mktemp("map"), head + tail)
    with suppress(MapError):
        read_again(World.from_ros_map(path))


@given(key=st.sampled_from(sorted(YAML)), value=st.text(max_size=20))
def test_any_text_for_a_value_is_a_map_or_a_map_error(tmp_path_factory, key, value):
    folder = tmp_path_factory.mktemp("map")
    path = write(folder)
    path.write_text(path.read_text().replace(f"{key}: {YAML[key]}", f"{key}: {value}"), encoding="utf-8")
    with suppress(MapError):
        read_again(World.from_ros_map(path))
