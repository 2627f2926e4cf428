"""Base of the export formats: a format turns a trajectory's poses or joints into the content of a file with its axes.

    @export_format("tum", suffix=".tum", axes="right-handed, z up, m; quaternion x, y, z, w; t in s from the start")
    def tum(given: Exported) -> bytes:
        ...

A format returns bytes, or a dict with the files of a folder; its caller writes them atomically. A format must be
deterministic: equal trajectories give equal bytes. Rotations are quaternions x, y, z, w.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from hpop import __version__
from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.registry import formats
from hpop.base.text import HARMFUL, printable, shown
from hpop.errors import OptionError
from hpop.models.serial_arm.jerk import Jerk, jerk_limited
from hpop.motions.bodies import JOINTS, check_body
from hpop.trajectories.poses import JointRows, Poses, joint_rows, poses_at, sample_times
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.named_rows import StopVisit
    from hpop.problems.problem import Problem

Content = bytes | Mapping[str, bytes]
"""Content of a file, or a mapping from file names to contents for a folder."""
PROGRAM = f"hpop {__version__}"
LONGEST = 200  # characters of a frame's name
JOINT_FORMATS = ("csv", "joint-trajectory", "moveit", "follow-joint-trajectory", "mcap", "bag")
RATES = {JOINTS: 100.0}  # Hz, default rate; that of poses is 20


def default_rate(body: str) -> float:
    """Return the default rate, Hz, at which a body is exported."""
    return RATES.get(body, 20.0)


class Format(Protocol):
    """Interface of an export format, as the decorator :func:`export_format` creates it.

    name     in the registry
    suffix   ending of the names of its files
    axes     frame, handedness, units, order of the columns and time base, on one line
    world    whether it contains the problem's world
    """

    name: str
    suffix: str
    axes: str
    world: bool
    __doc__: str | None

    def __call__(self, given: Exported, /) -> Content: ...


@checked_arguments
def export_format(
    name: str, *, suffix: str, axes: str, world: bool = False
) -> Callable[[Callable[[Exported], Content]], Format]:
    """Return a decorator that registers a function as an export format under a name.

    The arguments are the attributes of `Format`.
    """

    def declare(function: Callable[[Exported], Content]) -> Format:
        made = cast(Any, checked_arguments(function))
        made.name, made.suffix, made.axes, made.world = name, suffix, axes, world
        formats.add(name, made)
        return cast(Format, made)

    return declare


@checked_arguments
@dataclass(frozen=True)
class Frames:
    """Names of the coordinate frames of world, base and camera, for formats that contain such names (ROS, glTF)."""

    world: str = "map"
    base: str = "base_link"
    camera: str = "camera_link"

    def __post_init__(self) -> None:
        names = [getattr(self, frame.name) for frame in fields(self)]
        for name in names:
            if not isinstance(name, str) or not 0 < len(name) <= LONGEST or HARMFUL.search(name) or " " in name:
                raise OptionError(f"a frame must be a name without blanks, such as map or base_link, got {shown(name)}")
            if name.startswith("/"):
                raise OptionError(f"the name of a frame must not begin with a slash (tf2), got {shown(name)}")
        if len(set(names)) < len(names):
            raise OptionError(f"the frames of world, base and camera must have different names; got {', '.join(names)}")

    def of(self, body: str) -> str:
        """Return the name of a body's frame; the frame of a body other than base and camera has the body's own name."""
        return {"base": self.base, "camera": self.camera}.get(body, body)


@checked_arguments
@dataclass(frozen=True, eq=False)
class Exported:
    """Trajectory to export, with everything else that a format may write.

    trajectory  as planned
    rate        Hz, poses per second, or rows of joints
    body        body with the exported poses, or "joints" for the values of the robot's joints
    planned     True to export the planned motion, False for the executed one
    jerk        rad/s³ or m/s³, largest jerk of all joints of an arm, or of each by name, for which the executed motion
                is retimed (:func:`hpop.models.serial_arm.jerk.jerk_limited`); None for no limit
    frames      names of frames
    row         row in the front, or None
    name        name of the row, such as "knee", or ""
    costs       values of criteria and reported values, by name; ``units`` by name
    claim       status and certificate of the front, as text, or ""
    problem     problem with the world to write, or None
    visits      of a tour's stops, at the times of the exported motion
    """

    trajectory: Trajectory
    rate: float = 20.0
    body: str = "camera"
    planned: bool = False
    frames: Frames = field(default_factory=Frames)
    jerk: Jerk | None = None
    row: int | None = None
    name: str = ""
    costs: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    claim: str = ""
    problem: Problem | None = None
    visits: tuple[StopVisit, ...] = ()

    @cached_property
    def poses(self) -> Poses:
        """Return the poses of the exported body."""
        return self.of(self.body)

    def of(self, body: str) -> Poses:
        """Return the poses of any body of the robot, at the times of the exported poses."""
        if body == JOINTS:
            raise OptionError(f"this format writes poses, got the body joints; use {', '.join(JOINT_FORMATS)}")
        check_body(self.run.model, body, or_else=", joints" if JOINTS in self.run.model.provides else "")
        times = sample_times(self.run.duration, self.rate)
        return poses_at(self.run, times, body=body, planned=self.planned)

    @cached_property
    def joints(self) -> JointRows:
        """Return the motion of the robot's joints."""
        if self.body != JOINTS:
            raise OptionError(f"this format writes joints: give the body joints (--body joints), got {self.body}")
        return joint_rows(self.run, self.rate)

    @property
    def times(self) -> FloatArray:
        """Return the times (N,), s, of the exported poses or joints."""
        return self.joints.times if self.body == JOINTS else self.poses.times

    @cached_property
    def run(self) -> Trajectory:
        """Return the trajectory to write: the planned one, or its execution, with speed ramps or limited jerk."""
        return self._executed[0]

    @property
    def passed(self) -> FloatArray:
        """Return the times (n+1,), s, at which the trajectory to write passes the n+1 planned states."""
        return self._executed[1]

    @cached_property
    def _executed(self) -> tuple[Trajectory, FloatArray]:
        if self.jerk is None:
            planned = self.trajectory
            return (planned, planned.times) if self.planned else planned.model.execution(planned)
        if self.planned:
            raise OptionError(
                "jerk limits the executed motion, but the planned one is asked for; leave out jerk or planned"
            )
        return jerk_limited(self.trajectory, self.jerk)

    @property
    def _rows(self) -> str:
        return "rows" if self.body == JOINTS else "poses"

    @property
    def has_base(self) -> bool:
        """Return whether the robot has a base."""
        return "base" in self.trajectory.model.provides

    @property
    def title(self) -> str:
        """Return a title such as "knee (row 70)", "row 3", or "trajectory"."""
        if self.row is None:
            return printable(self.name) or "trajectory"
        return f"{printable(self.name)} (row {self.row})" if self.name else f"row {self.row}"

    @property
    def values(self) -> dict[str, str]:
        """Return the costs as text, by name with unit, such as {"length (m)": "33.5"}."""
        headings = {
            name: name if (unit := self.units.get(name, "1")) == "1" else f"{name} ({unit})" for name in self.costs
        }
        return {printable(headings[name]): repr(float(value)) for name, value in self.costs.items()}

    @property
    def told_visits(self) -> list[dict[str, Any]]:
        """Return a dict for each visit: name of the stop, and when the robot arrives and leaves, s from the start."""
        return [{"stop": visit.name, "arrival": visit.begin, "leaving": visit.end} for visit in self.visits]

    def statement(self, axes: str, what: str = "") -> list[str]:
        """Return lines for comments at the top of a file: title and content, the text ``axes``, and any costs.

        ``what`` describes the content; by default it says which body's poses are written, and at which rate. The lines
        do not begin with a comment sign.
        """
        how = "as planned" if self.planned else "as executed" + (" with limited jerk" if self.jerk is not None else "")
        what = what or f"the {self.body} {how}, {self.rate:g} {self._rows} a second and the end"
        lines = [f"{self.title}: {what}; by {PROGRAM}", axes]
        if self.body == JOINTS and self.has_base:
            lines.append("the motion of the base is not in this file")
        if self.costs:
            lines.append("costs: " + ", ".join(f"{name} = {value}" for name, value in self.values.items()))
        return lines


def rows_of_text(table: FloatArray, separator: str) -> str:
    """Return a table (N, k) as N lines of text, with ``separator`` between numbers.

    Each number has the shortest form that reads back as an equal float.
    """
    return "".join(separator.join(map(repr, row)) + "\n" for row in table.tolist())


def matrices(quaternions: FloatArray) -> FloatArray:
    """Return the rotation matrices (N, 3, 3) of unit quaternions (N, 4). Their columns are the axes of the body."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def pitch_of(quaternions: FloatArray) -> FloatArray:
    """Return the pitch (N,) of the x axis of a body, rad, positive upwards."""
    ahead = matrices(quaternions)[:, :, 0]
    return np.arctan2(ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))


def roll_of(quaternions: FloatArray) -> FloatArray:
    """Return the roll (N,) of a body, rad, positive to the right."""
    turned = matrices(quaternions)
    return np.arctan2(turned[:, 2, 1], turned[:, 2, 2])


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the products of quaternions (N, 4): rotations by b, followed by rotations by a (Hamilton)."""
    ax, ay, az, aw = a.T
    bx, by, bz, bw = b.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def back(quaternions: FloatArray) -> FloatArray:
    """Return the inverse rotations of quaternions (N, 4)."""
    turned: FloatArray = quaternions * np.array([-1.0, -1.0, -1.0, 1.0])
    return turned
