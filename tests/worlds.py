"""Worlds, floor plans and problems that several test modules share."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from benchmarks import mbm
from benchmarks.mbm import FINGERS, NUMBERS, SETS
from hpop.apart import child
from hpop.models.serial_arm.model import SerialArm
from hpop.world import World, files

SECOND = "      - {corners: [[4.4, 1.6], [4.8, 1.6], [4.8, 5], [4.4, 5]]}\n"
TWO_WALLS = f"""\
world:
  polygons:
    extent: [[0, 0], [7, 0], [7, 5], [0, 5]]
    obstacles:
      - {{corners: [[2, 0], [2.3, 0], [2.3, 3.2], [2, 3.2]]}}
{SECOND}\
model:
  differential_drive: {{radius: 0.25}}
start: [1, 1, 0]
goal: [6, 4, any]
criteria: [obstruction, turns, length]
planner:
  lattice: {{step: 0.25}}
"""
ONE_WALL = TWO_WALLS.replace(SECOND, "")


def pillars() -> dict[str, Any]:
    """Scenario of a hall of 16 x 12 m with scattered pillars, from corner to corner; without criteria and planner."""
    corners = [(x + 0.37 * (y % 3), y) for x in range(2, 14, 3) for y in range(2, 10, 3)]
    boxes = [{"corners": [[x, y], [x + 0.6, y], [x + 0.6, y + 0.7], [x, y + 0.7]]} for x, y in corners]
    extent = [[0, 0], [16, 0], [16, 12], [0, 12]]
    world = {"polygons": {"extent": extent, "obstacles": boxes}}
    return {"world": world, "start": [1.0, 1.0, 0], "goal": [14.8, 10.6, "any"]}


__all__ = ["FINGERS", "NUMBERS", "SETS", "asked", "panda"]


@cache
def panda(data: Path, fingers: float = FINGERS) -> SerialArm:
    """Return the arm with its camera beside the fingers; skip the test where its meshes are not installed."""
    arm = mbm.panda(data, fingers)
    if arm is None:
        pytest.skip("the Panda's meshes are in the wheel example-robot-data, which is not installed")
    return arm


def asked(data: Path, name: str, number: int) -> tuple[World, Mapping[str, float], Mapping[str, float]]:
    """World, start and goal of a problem by set and number."""
    return mbm.asked(name, number, data)


GRID = "nav_msgs/msg/OccupancyGrid"


def dxf(draw: Callable[[Any], Any], units: int = 6) -> bytes:
    """Return a DXF drawing; ``draw`` is given the document."""
    import ezdxf  # takes half a second, which each process of `make test` would spend

    drawing = ezdxf.new(units=units)
    draw(drawing)
    text = io.StringIO()
    drawing.write(text)
    return text.getvalue().encode()


def pdf(
    content: bytes, *, page: bytes = b"", resources: bytes = b"", catalog: bytes = b"", objects: Sequence[bytes] = ()
) -> bytes:
    """Return a PDF of one page of 400 x 300 points; further ``objects`` are numbered from 5."""
    bodies = [
        b"<< /Type /Catalog /Pages 2 0 R " + catalog + b" >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 400 300] /Contents 4 0 R /Resources << %b >> %b >>"
        % (resources, page),
        stream(content),
        *objects,
    ]
    data, offsets = b"%PDF-1.6\n", []
    for number, body in enumerate(bodies, 1):
        offsets.append(b"%010d 00000 n \n" % len(data))
        data += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    table = b"xref\n0 %d\n0000000000 65535 f \n" % (len(bodies) + 1) + b"".join(offsets)
    trailer = b"trailer << /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(bodies) + 1, len(data))
    return data + table + trailer


def stream(content: bytes, entries: bytes = b"") -> bytes:
    """Return a stream object of a PDF."""
    return b"<< /Length %d %b >>\nstream\n" % (len(content), entries) + content + b"\nendstream"


def bag(
    path: Path, grids: dict[str, list[Any]], *, storage: str = "mcap", texts: Sequence[str] = ("/chatter",)
) -> Path:
    """Write a bag with grids (`grid`) and texts by topic; storage "ros1", "mcap" or "sqlite3"."""
    store = store_of(storage)
    if storage == "ros1":
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    packed = store.serialize_ros1 if storage == "ros1" else store.serialize_cdr
    with writer:
        for topic in texts:
            connection = writer.add_connection(topic, "std_msgs/msg/String", typestore=store)
            writer.write(connection, 1, packed(store.types["std_msgs/msg/String"]("hello"), connection.msgtype))
        for topic, messages in grids.items():
            connection = writer.add_connection(topic, GRID, typestore=store)
            for time, message in enumerate(messages):
                writer.write(connection, time, packed(message, GRID))
    return path


@contextmanager
def read_here() -> Iterator[None]:
    """Files of others are read in this process, as in that which is otherwise started: half a second less for each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "_child_output", lambda asked, data, path: child.answer_bytes(asked, data))
        yield


@cache
def store_of(storage: str) -> Any:
    return get_typestore(Stores.ROS1_NOETIC if storage == "ros1" else Stores.ROS2_HUMBLE)


def grid(
    cells: Any,
    resolution: float = 0.05,
    origin: tuple[float, float] = (0.0, 0.0),
    turned: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    *,
    storage: str = "mcap",
    **info: int,
) -> Any:
    """Return an occupancy grid (H, W), percent; ``turned`` is the quaternion x, y, z, w of its origin."""
    types = store_of(storage).types
    time = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="map", **({"seq": 0} if storage == "ros1" else {}))
    position = types["geometry_msgs/msg/Point"](*origin, 0.0)
    pose = types["geometry_msgs/msg/Pose"](position, types["geometry_msgs/msg/Quaternion"](*turned))
    data = np.asarray(cells, dtype=np.int8)
    size = {"width": data.shape[1], "height": data.shape[0], **info}
    about = types["nav_msgs/msg/MapMetaData"](map_load_time=time, resolution=resolution, origin=pose, **size)
    return types[GRID](header=header, info=about, data=data.ravel())


def square(x0, y0, x1, y1):
    """Return a closed ring of corners."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def feature(*coordinates, kind="Polygon", **properties):
    """Return a GeoJSON feature; coordinates are rings, points or numbers, as its kind has them."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": list(coordinates)}}


def geojson_file(folder, *features, name="plan.geojson", **members):
    """Write a FeatureCollection to a file, and return its path."""
    path = folder / name
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path
