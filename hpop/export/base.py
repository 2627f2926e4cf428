"""Base of the export formats, and the jerk-limited execution of an arm for controllers that refuse jumps.

    @export_format("tum", suffix=".tum", axes="right-handed, z up, m; quaternion x, y, z, w; t in s from the start")
    def tum(given: Exported) -> bytes:
        ...

A format returns bytes, or a dict with the files of a folder; its caller writes them atomically. A format must be
deterministic: equal trajectories give equal bytes. Rotations are quaternions x, y, z, w.

The share of a reach grows from rest to rest with a constant jerk in each of seven phases (Biagiotti and Melchiorri
2008, Trajectory Planning for Automatic Machines and Robots, section 3.4). In each phase the joints are cubic functions
of time, so the result is a trajectory of splines. Its path is that of the reaches, which was proved free of collisions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from hpop import __version__
from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.registry import formats
from hpop.base.text import HARMFUL, printable, shown
from hpop.errors import OptionError, did_you_mean
from hpop.models.serial_arm.laws import Reach, rate_of
from hpop.motions import HOLD, States
from hpop.motions.bodies import JOINTS, check_body
from hpop.motions.by_law import extras
from hpop.motions.laws import CLOCK
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
                is retimed (:func:`hpop.export.base.jerk_limited`); None for no limit
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
    """Return the roll (N,), rad, positive to the right, of bodies with quaternions (N, 4) in the order x, y, z, w."""
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


LEAST_JERK = 1e-3  # rad/s³ or m/s³
SHORT = 1e-9  # s: shorter phases are left out
Jerk = float | Mapping[str, float]


class _Executed(NamedTuple):
    """Jerk-limited trajectory, and the times (n+1,), s, at which it passes the n+1 states of the planned one."""

    trajectory: Trajectory
    passed: FloatArray


@checked_arguments
def jerk_limited(trajectory: Trajectory, jerk: Jerk) -> _Executed:
    """Return a trajectory along the same path, slowed down so that no joint exceeds its largest jerk.

    The times at which it passes the planned states are returned too.

    trajectory  reaches of a serial arm, and holds
    jerk        rad/s³ or m/s³, largest jerk of all joints, or of each by name

    Speeds and accelerations keep the limits of the arm. Raises OptionError for another robot, for other motions, which
    are not from rest to rest, and for a jerk that is no positive number.
    """
    law = trajectory.model.laws.get("reach")
    if not isinstance(law, Reach) or "spline" not in trajectory.model.provides:
        raise OptionError("jerk limits need a serial_arm, got another robot; leave the jerk out")
    reaches = {kind: each for kind, each in trajectory.model.laws.items() if isinstance(each, Reach)}
    if other := sorted({*trajectory.kinds} - {*reaches, HOLD.kind}):
        raise OptionError(
            f"jerk limits need reaches, which begin and end at rest, got {', '.join(other)}, whose acceleration jumps "
            "between motions, however slow they are; export a trajectory of the planner roadmap, or leave the jerk out"
        )
    most = _checked_jerk(jerk, law.names)
    rows = np.stack([getattr(trajectory.states, name) for name in law.names], axis=1)
    knots, rates, times, passed = [rows[0]], [np.zeros(len(most))], [0.0], [0.0]
    kinds: list[str] = []
    for i, kind in enumerate(trajectory.kinds):
        change, lasts = rows[i + 1] - rows[i], float(trajectory.durations[i])
        if kind == HOLD.kind:
            shares = [(lasts, 1.0, 0.0)]
        else:
            size = np.abs(change)
            limits = (np.divide(limit, size, out=np.full(size.size, np.inf), where=size > 0) for limit in
                      (np.array(reaches[kind].speeds), np.array(law.accelerations), most))  # fmt: skip
            shares = _share_knots(*(float(each.min()) for each in limits)) if size.any() else []
        for lasted, share, speed in shares:
            knots.append(rows[i + 1] if share == 1.0 else rows[i] + share * change)
            rates.append(speed * change)
            times.append(times[-1] + lasted)
            kinds.append(kind if kind == HOLD.kind else "spline")
        passed.append(times[-1])
    columns = dict(zip(law.names, np.array(knots).T, strict=True))
    columns |= dict(zip(map(rate_of, law.names), np.array(rates).T, strict=True)) | {CLOCK: np.array(times)}
    names = (*trajectory.model.space.names, *extras(trajectory.model, kinds))
    states = States(**{name: columns[name] for name in names})
    return _Executed(Trajectory(trajectory.model, states, tuple(kinds), trajectory.punctual), np.array(passed))


def _share_knots(speed: float, acceleration: float, jerk: float) -> list[tuple[float, float, float]]:
    """Return the phases of a motion in which the share of the way done grows from 0 to 1, from rest to rest.

    Each has its duration, s, and the share and its speed, 1/s, at the end. Limits are those of the share: 1/s, 1/s²
    and 1/s³.
    """
    ramp = min(acceleration / jerk, (speed / jerk) ** 0.5)  # time in which the acceleration grows
    speeding = ramp + (speed / acceleration if speed * jerk > acceleration**2 else ramp)
    cruise = 1.0 / speed - speeding
    if cruise < 0.0:  # the share never reaches its largest speed
        cruise, ramp = 0.0, min(acceleration / jerk, (0.5 / jerk) ** (1 / 3))
        speeding = max(2.0 * ramp, 0.5 * ramp + (0.25 * ramp**2 + 1.0 / (jerk * ramp)) ** 0.5)
    found, share, rate, push = [], 0.0, 0.0, 0.0
    steady = speeding - 2.0 * ramp
    for lasts, sign in zip([ramp, steady, ramp, cruise, ramp, steady, ramp], [1, 0, -1, 0, -1, 0, 1], strict=True):
        change = sign * jerk
        share += lasts * (rate + lasts * (push / 2.0 + lasts * change / 6.0))
        rate += lasts * (push + lasts * change / 2.0)
        push += lasts * change
        if lasts > SHORT:
            found.append((lasts, share, rate))
    found[-1] = (found[-1][0], 1.0, 0.0)  # exactly
    return found


def _checked_jerk(jerk: Jerk, names: tuple[str, ...]) -> FloatArray:
    """Return the largest jerk (n,) of each joint; raise OptionError for an unknown joint, a missing or wrong number."""
    if isinstance(jerk, Mapping):
        if unknown := [name for name in jerk if name not in names]:
            hint = did_you_mean(unknown[0], names)
            raise OptionError(
                f"jerk names {shown(unknown[0])}, which is no joint that moves.{hint} Name {', '.join(names)}"
            )
        if missing := [name for name in names if name not in jerk]:
            raise OptionError(f"jerk must name every joint that moves, got none for {', '.join(missing)}; add them")
        given = [jerk[name] for name in names]
    else:
        given = [jerk] * len(names)
    return np.array([real("jerk", value, LEAST_JERK, MOST, "rad/s³ or m/s³,") for value in given], float)
