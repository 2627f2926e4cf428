"""A trajectory as a nav_msgs/Path, and a path as a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hpop.arrays import FloatArray
from hpop.errors import ModelError, OptionError, RosError
from hpop.math import wrap
from hpop.motions import Model, States
from hpop.motions.possible import STILL
from hpop.poses import Poses, nanoseconds
from hpop.ros.messages import SECOND, Message, header, mapping, planar_pose, pose_stamped, time_of
from hpop.ros.spaced import spaced
from hpop.trajectory import STRAIGHT, Trajectory

MOST_POSES = 20_000  # of a path, one every 5 cm: 1 km


def path_message(
    trajectory: Trajectory, *, frame_id: str = "map", planned: bool = False, timed: bool = False
) -> Message:
    """The path of the base as a nav_msgs/Path: poses at the ends of motions, between these every 5 cm or 45 degrees.

    A turn in place is a sequence of poses at one position, digit for digit. Stamps are 0, by which tf2 means the
    newest transform, and what stands still has one pose: a path for a controller is geometry.

    Parameters
    ----------
    planned : as it was planned; else what the robot does, from rest to rest
    timed : stamps are s and ns from the start, and a hold is a pose that is there twice, when it is reached and when it
        is left. :func:`trajectory_of` reads it back; a controller that asks tf2 for these stamps fails

    Raises OptionError for a robot without a base.

    >>> from hpop.registry import make_model
    >>> goes = Trajectory.from_poses(make_model("differential_drive"), [(0, 0, 0), (1, 0, 0), (1, 0.1, np.pi / 2)])
    >>> path_message(goes)["poses"][-1]["pose"]["position"]
    {'x': 1.0, 'y': 0.1, 'z': 0.0}
    """
    if "base" not in trajectory.model.provides:
        raise OptionError("a path is that of a base, but this robot has none; hpop.export writes poses of any body")
    run = trajectory if planned else trajectory.execution()
    return message_of(spaced(run, "base", planned=planned, timed=timed), frame_id, stamped=timed)


def message_of(poses: Poses, frame_id: str, *, stamped: bool) -> Message:
    """Poses as a nav_msgs/Path, with their times or with stamps of 0."""
    times = nanoseconds(poses.times).tolist() if stamped else [0] * len(poses)
    rows = zip(times, poses.positions.tolist(), poses.quaternions.tolist(), strict=True)
    return {"header": header(0, frame_id), "poses": [pose_stamped(time, frame_id, *row) for time, *row in rows]}


def trajectory_of(path: Mapping[str, Any], model: Model) -> Trajectory:
    """Turns and moves of a model through the poses of a nav_msgs/Path, as a planner would have planned them.

    Poses in one line become one move, turns one after the other with one sign one turn. Between poses that differ in
    place the robot turns to where the next one is, moves there, and turns to its heading. Where a pose is there twice
    and the second has a later stamp, the robot holds. A path that :func:`path_message` made of a plan, timed, comes
    back as that plan. Times other than those of holds are those of the model.

    Raises RosError for what is no path, has no pose, or more than 20,000; ModelError for a model whose states are not
    x, y and yaw.
    """
    if model.space.names != ("x", "y", "yaw"):
        raise ModelError(f"a path has poses (x m, y m, yaw rad), which are no states of this model: {model.space}")
    rows, times = _read(path)
    ends = [tuple(rows[0])]
    kinds: list[str] = []
    holds: list[tuple[int, float]] = []

    def turn(change: float) -> None:
        x, y, yaw = ends[-1]
        if abs(change) <= STRAIGHT:
            return
        if kinds and kinds[-1] == "turn" and not _is_held(holds, ends) and change * (yaw - ends[-2][2]) > 0.0:
            ends[-1] = (x, y, yaw + change)
        else:
            ends.append((x, y, yaw + change))
            kinds.append("turn")

    def move(to_x: float, to_y: float) -> None:
        x, y, yaw = ends[-1]
        if kinds and kinds[-1] == "move" and not _is_held(holds, ends):
            from_x, from_y, _ = ends[-2]
            if abs(wrap(np.arctan2(to_y - from_y, to_x - from_x) - yaw)) <= STRAIGHT:
                ends[-1] = (to_x, to_y, yaw)
                return
        turn(float(wrap(np.arctan2(to_y - y, to_x - x) - yaw)))
        ends.append((to_x, to_y, ends[-1][2]))
        kinds.append("move")

    for i in range(1, len(rows)):
        x, y, yaw = rows[i].tolist()
        if np.hypot(x - ends[-1][0], y - ends[-1][1]) > STILL:
            move(x, y)
            turn(float(wrap(yaw - ends[-1][2])))
        elif abs(yaw - rows[i - 1, 2]) > STRAIGHT:
            turn(yaw - float(rows[i - 1, 2]))
        elif times[i] > times[i - 1]:
            holds.append((len(ends) - 1, (times[i] - times[i - 1]) / SECOND))
    columns = dict(zip(model.space.names, np.array(ends, float).T, strict=True))
    made = Trajectory(model, States(**columns), tuple(kinds))
    for at, seconds in reversed(holds):
        made = made.with_hold(at=at, seconds=seconds)
    return made


def _is_held(holds: list[tuple[int, float]], ends: list[tuple[float, ...]]) -> bool:
    """Whether the robot holds at the last of the states."""
    return bool(holds) and holds[-1][0] == len(ends) - 1


def _read(path: Any) -> tuple[FloatArray, list[int]]:
    """Poses (N, 3), x, y and continuous yaw, and their stamps in ns."""
    given = mapping(path, "the path").get("poses")
    if not isinstance(given, list | tuple) or not 0 < len(given) <= MOST_POSES:
        size = f"{len(given):,}" if isinstance(given, list | tuple) else "none"
        raise RosError(f"a path has a list of 1 to {MOST_POSES:,} poses, got {size}")
    poses = [planar_pose(one, f"pose {i}") for i, one in enumerate(given)]
    times = [time_of(one, f"pose {i}") for i, one in enumerate(given)]
    rows = np.array([pose[:3] for pose in poses], float)
    rows[:, 2] = np.unwrap(rows[:, 2])
    return rows, times
