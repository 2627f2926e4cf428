"""MovingAI maps: known counts, where cells lie, and broken files."""

import numpy as np
import pytest

from hpop.errors import MapError
from hpop.world import World

SMALL = "type octile\nheight 2\nwidth 3\nmap\n.@G\nSTW\n"


def write(folder, text):
    path = folder / "a.map"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "file", "size", "free"),  # from each folder's SOURCE.txt
    [
        ("Berlin_1_256", "Berlin_1_256.map", (256, 256), 47540),
        ("den312d", "den312d.map", (65, 81), 2445),
        ("room-64-64-8", "room-64-64-8.map", (64, 64), 3232),
    ],
)
def test_real_maps_have_the_counts_of_their_source(shared_data, name, file, size, free):
    world = World.from_movingai(shared_data("movingai") / name / file)
    assert world.raster.cells.shape == size[::-1]
    assert (~world.raster.cells).sum() == free


def test_starts_and_goals_of_the_scenarios_are_passable(shared_data):
    folder = shared_data("movingai") / "den312d"
    world = World.from_movingai(folder / "den312d.map", resolution=0.5)
    rows = [line.split() for line in (folder / "den312d.map.scen").read_text().splitlines()]
    rows = [row for row in rows if len(row) == 9]  # bucket, map, size, start, goal, length
    columns = np.array([[int(r[4]), int(r[6])] for r in rows]).ravel()
    lines = np.array([[int(r[5]), int(r[7])] for r in rows]).ravel()
    assert (world.clearance((columns + 0.5) * 0.5, (81 - 1 - lines + 0.5) * 0.5) >= 0.25 - 1e-12).all()


def test_only_dots_g_and_s_are_passable_and_the_first_row_is_on_top(tmp_path):
    world = World.from_movingai(write(tmp_path, SMALL), resolution=2.0)
    assert world.raster.cells.tolist() == [[False, True, True], [False, True, False]]
    assert world.clearance(np.array([1.0, 3.0]), np.array([3.0, 3.0])).tolist() == [1.0, 0.0]
    assert world.bounds == (0, 0, 6, 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("map\n..\n", "must begin with"),
        ("type tile\nheight 1\nwidth 1\nmap\n.\n", "must begin with"),
        ("type octile\nheight two\nwidth 1\nmap\n.\n", "whole number"),
        ("type octile\nheight -2\nwidth 1\nmap\n.\n", "whole number"),
        ("type octile\nheight 2 3\nwidth 1\nmap\n.\n", "whole number"),
        ("type octile\nheight 0\nwidth 1\nmap\n", "at least one cell"),
        ("type octile\nheight 50000\nwidth 50000\nmap\n.\n", "at most"),
        ("type octile\nheight 2\nwidth 1\nmap\n.\n", "got 1 rows"),
        ("type octile\nheight 1\nwidth 2\nmap\n...\n", r"rows of \[3\]"),
        ("type octile\nheight 1\nwidth 2\nmap\n.x\n", "'x'"),
        ("type octile\nheight 1\nwidth 2\nmap\n.é\n", "'é'"),
    ],
)
def test_broken_maps_are_refused(tmp_path, text, message):
    with pytest.raises(MapError, match=message):
        World.from_movingai(write(tmp_path, text))


def test_binary_files_directories_and_missing_ones_are_refused(tmp_path):
    (tmp_path / "b.map").write_bytes(b"\xff\xff")
    for path in (tmp_path / "b.map", tmp_path, tmp_path / "none"):
        with pytest.raises(MapError):
            World.from_movingai(path)


@pytest.mark.parametrize("resolution", [0, -1, float("nan"), "1", 1e-9, 1e9])
def test_the_resolution_must_be_a_length(tmp_path, resolution):
    with pytest.raises(MapError, match="resolution"):
        World.from_movingai(write(tmp_path, SMALL), resolution=resolution)
