"""The goal of Nav2's FollowPath action, as YAML."""

from __future__ import annotations

from collections.abc import Sequence

from hpop.base.text import printable
from hpop.errors import OptionError
from hpop.export.base import Exported, export_format
from hpop.ros.spaced import spaced

AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; orientation x, y, z, w of the base (x ahead, y left); "
    "components that are left out are 0; no times"
)
DIGITS = 9  # behind the point: 1 nm, without exponents, which YAML 1.1 takes for text


@export_format("nav2-yaml", suffix=".nav2.yaml", axes=AXES)
def nav2_yaml(given: Exported) -> bytes:
    """The goal of Nav2's ``FollowPath`` action: the path of the base as YAML, to be sent as it is.

    ``ros2 action send_goal --stdin /follow_path nav2_msgs/action/FollowPath < knee_70.nav2.yaml``. ``path`` is a
    nav_msgs/Path in the frame of the world (``map``): poses of the base at the ends of each motion, and between these
    about every 5 cm or 45 degrees; m, quaternion x, y, z, w, right-handed, z up (REP-103); components that are left out
    are 0. A turn in place is a sequence of poses at one position. There are no stamps, which controllers ignore:
    speeds and holds are lost.

    Raises OptionError for a robot without a base.
    """
    if not given.has_base:
        raise OptionError("nav2-yaml is the path of a base, but this robot has none; take mcap, bag, tum or csv")
    path = spaced(given.run, "base", planned=given.planned)
    frame = "'" + printable(given.frames.world).replace("'", "''") + "'"
    lines = [f"# {line}" for line in given.statement(AXES, "the path of the base")]
    lines += ["path:", f"  header: {{frame_id: {frame}}}", "  poses:"]
    for place, turned in zip(path.positions.tolist(), path.quaternions.tolist(), strict=True):
        position, orientation = _components("xyz", place, "xy"), _components("xyzw", turned, "zw")
        pose = f"{{position: {position}, orientation: {orientation}}}"
        lines.append(f"  - {{header: {{frame_id: {frame}}}, pose: {pose}}}")
    lines += ["controller_id: ''", "goal_checker_id: ''"]
    return ("\n".join(lines) + "\n").encode()


def _components(names: str, values: Sequence[float], always: str) -> str:
    """Components by name; those that are 0 are left out, but for some."""
    rounded = {name: round(value, DIGITS) + 0.0 for name, value in zip(names, values, strict=True)}  # no -0.0
    told = [f"{name}: {value:.{DIGITS}f}" for name, value in rounded.items() if value or name in always]
    return f"{{{', '.join(told)}}}"
