"""Claims: the map in a bag is the map that map_saver would have saved, whatever the bag's format."""

import json
import math

import numpy as np
import pytest
import yaml
from PIL import Image

from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world import World
from tests.worlds import bag, grid, read_here

RNG = np.random.default_rng(3)
CELLS = RNG.choice([-1, 0, 19, 20, 50, 64, 65, 100], size=(20, 30))
STORED = {"ros1": "walk.bag", "mcap": "walk", "sqlite3": "walk"}


@pytest.fixture(autouse=True)
def here():
    with read_here():
        yield


@pytest.mark.parametrize("storage", STORED)
def test_the_map_is_that_which_map_saver_writes(tmp_path, storage):
    turned = (0.0, 0.0, math.sin(0.15), math.cos(0.15))
    messages = [grid(-CELLS.clip(0, 1), storage=storage), grid(CELLS, 0.05, (1.0, -2.0), turned, storage=storage)]
    path = bag(tmp_path / STORED[storage], {"/map": messages}, storage=storage)
    shades = np.select([(CELLS >= 0) & (CELLS <= 19), CELLS >= 65], [254, 0], 205)  # as map_saver does by default
    Image.fromarray(shades[::-1].astype(np.uint8)).save(tmp_path / "map.pgm")
    saver = {"image": "map.pgm", "resolution": 0.05, "origin": [1.0, -2.0, 0.3], "negate": 0}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({**saver, "occupied_thresh": 0.65, "free_thresh": 0.196}))
    for unknown_is_free in (False, True):
        world = World.from_file(path, unknown_is_free=unknown_is_free)
        same = World.from_ros_map(tmp_path / "map.yaml", unknown_is_free=unknown_is_free)
        assert (world.raster.cells == same.raster.cells).all()
        assert world.raster.resolution == same.raster.resolution
        assert world.raster.origin == pytest.approx(same.raster.origin)
        assert world.outside_is_obstacle == same.outside_is_obstacle
        again = World.from_description(json.loads(json.dumps(world.describe())))
        assert (again.raster.cells == world.raster.cells).all()
    assert "of 2 the last grid on /map" in world.notes[0]


def test_a_storage_file_alone_is_a_bag_and_a_scenario_names_its_topic(tmp_path):
    bag(tmp_path / "walk", {"/costmap": [grid(np.full((40, 60), 100))], "/map": [grid(np.zeros((40, 60)), 0.1)]})
    asked = {"world": {"ros_bag": {"path": "walk/walk.mcap", "topic": "/map", "height": [0, 2]}},
             "start": [1, 2, 0], "goal": [5, 3, 0], "criteria": ["length"]}  # fmt: skip
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    world = load_scenario(tmp_path / "scenario.yaml").problem.world
    assert world.bounds == pytest.approx((0, 0, 6, 4))
    assert not world.raster.cells.any()
    assert world.raster.heights == (0, 2)
    assert World.from_file(tmp_path / "walk").source["options"]["topic"] == "/map"  # of several, the usual one
    assert "other maps are on /costmap" in World.from_file(tmp_path / "walk").notes[0]


GRIDS = {"/a/map": [grid([[0]])], "/b/map": [grid([[0]])]}


@pytest.mark.parametrize(
    ("grids", "options", "message"),
    [
        ({}, {}, r"no map, a nav_msgs/msg/OccupancyGrid; its topics are /chatter std_msgs/msg/String \(1\), /tf"),
        ({"/map": []}, {}, "no message on /map"),
        (GRIDS, {}, "several maps; give topic, one of /a/map, /b/map"),
        (
            GRIDS,
            {"topic": "/a/mapp"},
            r"no map on '/a/mapp'; topics with maps: /a/map, /b/map. Did you mean '/a/map'\?",
        ),
        (GRIDS, {"topic": "/chatter"}, "no map on '/chatter'"),
        (GRIDS, {"topic": 3}, "topic must be the name of a topic"),
        (GRIDS, {"topik": "/map"}, "Did you mean 'topic'"),
        ({"/map": [grid([[0]], resolution=0.0)]}, {}, "resolution"),
        ({"/map": [grid([[0]], 1.0, origin=(math.nan, 0))]}, {}, "origin"),
        (
            {"/map": [grid([[0, 0]], width=3)]},
            {},
            "must have width x height cells, at most 100,000,000, got 2 cells for 3 x 1",
        ),
        ({"/map": [grid([[0, 0]], turned=(0.5, 0.5, 0.5, 0.5))]}, {}, "must be horizontal, got the orientation"),
    ],
)
def test_what_has_no_map_is_refused_with_what_is_there(tmp_path, grids, options, message):
    path = bag(tmp_path / "walk", grids, texts=("/chatter", "/tf"))
    with pytest.raises(MapError, match=message):
        World.from_file(path, **options)


def test_what_is_no_bag_is_refused(tmp_path):
    (tmp_path / "notes.bag").write_text("no bag")
    (tmp_path / "cut.mcap").write_bytes(b"\x89MCAP0\r\n")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "metadata.yaml").write_text("rosbag2_bagfile_information: [1, 2]")
    for name in ("notes.bag", "cut.mcap", "bad"):
        with pytest.raises(MapError, match=r"expected a ROS 1 \.bag|cannot be read"):
            World.from_file(tmp_path / name)
    with pytest.raises(MapError, match="does not exist"):
        World.from_file(tmp_path / "there_is_none.bag")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "walk.db3").symlink_to("/dev/zero")
    with pytest.raises(MapError, match="is no regular file"):
        World.from_file(tmp_path / "odd")
