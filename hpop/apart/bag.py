"""Reader of an occupancy grid from a ROS 1 or ROS 2 bag, with the library rosbags."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from contextlib import ExitStack
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from hpop.apart.child import ChildAnswer, ChildRefused, counts_text

GRID = "nav_msgs/msg/OccupancyGrid"
USUAL = "/map"
MOST_CELLS = 100_000_000
LEVEL = 1e-3
"""Largest tilt of a grid, as the sine of the angle."""


def extract(data: bytes, options: dict[str, Any]) -> ChildAnswer:
    """Return the last occupancy grid on a topic of the bag at ``options["path"]``; ``data`` is not used.

    The array ``cells`` (height, width) holds occupancies in percent, -1 if unknown; row 0 is at the bottom. The words
    of the answer are its topic, resolution, m, origin (x, y, yaw), m and rad, and more.
    """
    try:
        from rosbags import rosbag1, rosbag2  # of an extra
        from rosbags.typesys import Stores, get_typestore  # of an extra
    except ImportError as error:
        raise ChildRefused(
            f"reading bags needs rosbags, which cannot be imported ({error}); run pip install 'hpop[bags]'"
        ) from None
    path = Path(options["path"])
    is_first = path.suffix == ".bag"
    with ExitStack() as stack:
        try:
            bag: Any = stack.enter_context(rosbag1.Reader(path) if is_first else rosbag2.Reader(path))
        except (FileNotFoundError, rosbag1.ReaderError, rosbag2.ReaderError) as error:
            raise ChildRefused(
                f"it cannot be read as a bag ({str(error)[:200]}); expected a ROS 1 .bag file, or for ROS 2 a folder "
                "with metadata.yaml, a .mcap or a .db3"
            ) from None
        topics: Counter[str] = Counter()
        for connection in bag.connections:
            topics[f"{connection.topic} {connection.msgtype}"] += connection.msgcount
        grids = sorted({connection.topic for connection in bag.connections if connection.msgtype == GRID})
        topic = _topic_to_read(options["topic"], grids, topics)
        last, count = b"", 0
        chosen = [each for each in bag.connections if each.topic == topic and each.msgtype == GRID]
        for _, _, message in bag.messages(connections=chosen):
            last, count = bytes(message), count + 1
    if not count:
        raise ChildRefused(
            f"it has no message on {topic}; expected a {GRID}. Start to record before the map is sent, which is only "
            "once"
        )
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    grid: Any = store.deserialize_ros1(last, GRID) if is_first else store.deserialize_cdr(last, GRID)
    width, height = int(grid.info.width), int(grid.info.height)
    if not 0 < width * height <= MOST_CELLS or len(grid.data) != width * height:
        raise ChildRefused(
            f"the grid on {topic} must have width x height cells, at most {MOST_CELLS:,}, got {len(grid.data):,} cells "
            f"for {width:,} x {height:,}"
        )
    pose = grid.info.origin
    return ChildAnswer(
        {
            "topic": topic,
            "messages": count,
            "others": [each for each in grids if each != topic],
            "resolution": float(str(np.float32(grid.info.resolution))),  # 0.05, not 0.05000000074505806
            "origin": [float(pose.position.x), float(pose.position.y), _yaw(pose.orientation, topic)],
            "sha256": hashlib.sha256(last).hexdigest(),
        },
        {"cells": np.asarray(grid.data, dtype="|i1").reshape(height, width)},
    )


def _topic_to_read(asked: str | None, grids: list[str], topics: Counter[str]) -> str:
    """Return the topic to read: the requested one, or else /map, or else the only topic with a grid.

    Raises ChildRefused if there is none. ``grids`` are the topics with grids, ``topics`` counts messages by topic and
    type, for the error.
    """
    there = f"its topics are {counts_text(topics, 30)}" if topics else "it has no topics"
    if not grids:
        raise ChildRefused(f"it has no map, a {GRID}; {there}")
    if asked is None:
        if len(grids) > 1 and USUAL not in grids:
            raise ChildRefused(f"it has several maps; give topic, one of {', '.join(grids[:30])}")
        return USUAL if USUAL in grids else grids[0]
    if asked not in grids:
        near = get_close_matches(asked[:100], grids, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ChildRefused(
            f"it has no map on {asked[:100]!r}; topics with maps: {', '.join(grids[:30])}.{hint} In total, {there}"
        )
    return asked


def _yaw(q: Any, topic: str) -> float:
    """Return the direction of a grid's x axis, rad; raise `ChildRefused` if the grid is tilted."""
    x, y, z, w = (float(value) for value in (q.x, q.y, q.z, q.w))
    size = math.hypot(x, y, z, w)
    if size == 0:  # the orientation is not set
        return 0.0
    if not size < math.inf or math.hypot(x, y) > LEVEL * size:
        raise ChildRefused(f"the grid on {topic} must be horizontal, got the orientation ({x:g}, {y:g}, {z:g}, {w:g})")
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
