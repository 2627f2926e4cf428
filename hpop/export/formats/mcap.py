"""Messages of ROS 2 in one MCAP file."""

from __future__ import annotations

from hpop.export.base import Exported, export_format
from hpop.export.ros import AXES, FOLDER, bag_files


@export_format("mcap", suffix=".mcap", axes=AXES)
def mcap(given: Exported) -> bytes:
    """An MCAP file of ROS 2 messages, for Foxglove and MCAP readers; it needs the extra ``bags``.

    ``/plan`` (nav_msgs/Path, of the base, or of the body where there is none: poses at the ends of motions, and between
    these about every 5 cm or 45 degrees; a hold is a pose that is there twice, when it is reached and when it is left),
    ``/camera_pose`` (geometry_msgs/PoseStamped; ``/base_pose`` of a base),
    ``/tf`` (the base in ``map``, and what moves on it), ``/tf_static`` (the camera on the base, where it is fixed),
    ``/costs`` (diagnostic_msgs/DiagnosticArray, a key and a value a criterion). Right-handed, z up (REP-103), m,
    quaternions x, y, z, w. ``camera_link`` looks along its x: it is no optical frame. Stamps are s and ns from the
    start, as are the times at which messages are sent.
    """
    return bag_files(given)[f"{FOLDER}.mcap"]
