"""Messages of ROS 2 in a bag."""

from __future__ import annotations

from collections.abc import Mapping

from hpop.export.base import Exported, export_format
from hpop.export.ros import AXES, bag_files


@export_format("bag", suffix="_bag", axes=AXES)
def bag(given: Exported) -> Mapping[str, bytes]:
    """A bag of ROS 2, a folder with ``metadata.yaml`` (version 9) and an MCAP file; it needs the extra ``bags``.

    Topics, axes, units and times are those of the format ``mcap``; ``ros2 bag play knee_70_bag`` sends them.
    """
    return bag_files(given)
