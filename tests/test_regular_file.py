"""Only regular files of bounded size are read: nothing is waited for, and nothing has no end."""

import os
import socket
from pathlib import Path

import pytest

from hpop import World
from hpop.base.files import open_regular, read_regular
from hpop.errors import MapError, ScenarioError
from hpop.scenario import load_scenario


@pytest.fixture
def fifo(tmp_path):
    path = tmp_path / "fifo"
    os.mkfifo(path)
    return path


@pytest.fixture
def socket_path(tmp_path):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        yield tmp_path / "socket"


def test_a_regular_file_is_read_whole(tmp_path):
    (tmp_path / "file").write_bytes(b"12345")
    assert read_regular(tmp_path / "file", 5) == b"12345"


def test_a_larger_file_is_refused_by_its_size(tmp_path):
    (tmp_path / "file").write_bytes(b"123456")
    with pytest.raises(OSError, match="expected at most 5 bytes, found 6"):
        read_regular(tmp_path / "file", 5)


def test_a_file_that_tells_no_size_is_read_no_further_than_the_limit():
    assert os.stat("/proc/self/status").st_size == 0
    with pytest.raises(OSError, match="expected at most 5 bytes, found more"):
        read_regular("/proc/self/status", 5)


@pytest.mark.parametrize(("path", "kind"), [("/dev/zero", "a device"), ("/", "a folder")])
def test_what_is_no_regular_file_is_named(path, kind):
    with pytest.raises(OSError, match=f"found {kind}"):
        open_regular(path, 10)


def test_a_fifo_is_refused_at_once(fifo):
    with pytest.raises(OSError, match="expected a regular file, found a FIFO"):
        open_regular(fifo, 10)


def test_a_socket_is_refused(socket_path):
    with pytest.raises(OSError, match=r"No such device|found a socket"):
        open_regular(socket_path, 10)


@pytest.mark.parametrize("path", ["null\0byte", "half \ud800 a pair", "n" * 300, "a/" * 3000])
def test_what_no_path_can_be_is_an_error_of_reading(path):
    with pytest.raises(OSError):
        open_regular(path, 10)


@pytest.mark.parametrize("path", ["/dev/zero", "null\0byte", "half \ud800 a pair", "n" * 300, "/proc/self/mem"])
@pytest.mark.parametrize(
    "read",
    [
        World.from_geojson,
        World.from_moveit_scene,
        World.from_movingai,
        World.from_ros_map,
        lambda path: World.from_image(path, 0.05),
        load_scenario,
    ],
)
def test_no_reader_takes_what_is_no_file(read, path):
    with pytest.raises((MapError, ScenarioError)):
        read(path)


@pytest.mark.parametrize("read", [World.from_geojson, World.from_moveit_scene, World.from_ros_map, load_scenario])
def test_no_reader_waits_for_a_fifo(read, fifo):
    with pytest.raises((MapError, ScenarioError), match="FIFO"):
        read(fifo)


def test_a_map_that_names_a_fifo_as_its_image_is_refused(fifo):
    text = "image: fifo\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    yaml = Path(fifo).with_name("map.yaml")
    yaml.write_text(text)
    with pytest.raises(MapError, match="FIFO"):
        World.from_ros_map(yaml)
