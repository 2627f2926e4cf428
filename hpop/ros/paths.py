"""Conversion of a trajectory to a nav_msgs/Path message, and of such a path to a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.errors import ModelError, OptionError, RosError
from hpop.motions import Model, States
from hpop.motions.by_law import STILL
from hpop.motions.laws import CLOCK
from hpop.ros.messages import SECOND, Message, header, mapping, planar_pose, pose_stamped, time_of
from hpop.trajectories.poses import Poses, nanoseconds, poses_at
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

APART = 0.05  # m between the poses of a path, at most; a cell of a usual map
TURNED = np.deg2rad(45.0)  # largest turn between poses, so that its direction is clear
FINE = 0.02  # s between sampled times, from which the poses are chosen
STEPS = 8  # least samples per motion
SAME = 1e-9  # distance of poses below which nothing has moved


def spaced(run: Trajectory, body: str, *, planned: bool, timed: bool = False) -> Poses:
    """Return poses of a body along a trajectory: at the ends of all motions, and every 5 cm or 45 degrees between.

    A turn in place has several poses at exactly one position. A hold (wait) has no pose of its own, unless poses are
    ``timed``: then its pose occurs twice, at the beginning and the end of the hold.

    Parameters
    ----------
    run : the planned trajectory if ``planned``, else the executed one
    """
    durations = run.durations
    pieces = np.maximum(STEPS, np.ceil(durations / FINE)).astype(np.int64)
    owner = np.repeat(np.arange(len(run)), pieces)
    within = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    times = np.append(run.times[owner] + within * (durations / pieces)[owner], run.duration)
    times, first = np.unique(times, return_index=True)  # drops motions of no duration
    owner, within = np.append(owner, len(run))[first], np.append(within, 0)[first]
    fine = poses_at(run, times, body=body, planned=planned)
    moved = np.linalg.norm(np.diff(fine.positions, axis=0), axis=1)
    chords = np.linalg.norm(np.diff(fine.quaternions, axis=0), axis=1)
    turned = 4.0 * np.arcsin(np.minimum(1.0, 0.5 * chords))
    far = np.append(0.0, np.cumsum(np.maximum(moved / APART, turned / TURNED)))
    begins = within == 0
    since = far - np.maximum.accumulate(np.where(begins, far, 0.0))
    kept = begins | (np.diff(np.floor(since + 1e-9), prepend=0.0) > 0)
    chosen = np.flatnonzero(kept)
    early = np.append(np.diff(far[chosen]) < SAME, False) & ~begins[chosen]  # the half of a turn that stands, its end
    chosen = chosen[~early]
    again = np.append(False, np.diff(far[chosen]) < SAME)  # the end of a hold
    return poses_at(run, times[chosen if timed else chosen[~again]], body=body, planned=planned)


MOST_POSES = 20_000  # 1 km at 5 cm, below the 10 MB of a bridge's max_message_size


@checked_arguments
def path_message(
    trajectory: Trajectory, *, frame_id: str = "map", planned: bool = False, timed: bool = False
) -> Message:
    """Return the path of the base as a nav_msgs/Path: poses at the ends of motions, and every 5 cm or 45 degrees.

    A turn in place is a sequence of poses at exactly one position. By default all stamps are 0, which means the newest
    transform to tf2, because a controller needs only geometry; a hold (wait) then has one pose.

    Parameters
    ----------
    planned : write the planned motion; else the executed one, from rest to rest
    timed : write stamps from the start, and the pose of a hold twice, at its begin and its end. :func:`trajectory_of`
        reads this back; a controller that asks tf2 for these stamps fails

    Raises OptionError for a robot without a base.

    >>> from hpop.base.registry import make_model
    >>> goes = Trajectory.from_poses(make_model("differential_drive"), [(0, 0, 0), (1, 0, 0), (1, 0.1, np.pi / 2)])
    >>> path_message(goes)["poses"][-1]["pose"]["position"]
    {'x': 1.0, 'y': 0.1, 'z': 0.0}
    """
    if "base" not in trajectory.model.provides:
        raise OptionError(
            "a path needs a robot with a base, but this one has none; hpop.export writes poses of any body"
        )
    run = trajectory if planned else trajectory.execution()
    return message_of(spaced(run, "base", planned=planned, timed=timed), frame_id, stamped=timed)


def message_of(poses: Poses, frame_id: str, *, stamped: bool) -> Message:
    """Return poses as a nav_msgs/Path; the stamps are their times if ``stamped``, else 0."""
    times = nanoseconds(poses.times).tolist() if stamped else [0] * len(poses)
    rows = zip(times, poses.positions.tolist(), poses.quaternions.tolist(), strict=True)
    return {"header": header(0, frame_id), "poses": [pose_stamped(time, frame_id, *row) for time, *row in rows]}


@checked_arguments
def trajectory_of(path: Mapping[str, Any], model: Model) -> Trajectory:
    """Return a trajectory of a model through the poses of a nav_msgs/Path, as turns, moves and holds (waits).

    Poses on one line become one move, and successive turns in one direction become one turn. Between different
    positions the robot turns towards the next, moves there, and turns to its heading. A repeated pose with a later
    stamp is a hold. A timed path from :func:`path_message` is converted back to its plan. Durations other than those of
    holds come from the model.

    Raises RosError for an invalid path, or one with 0 or more than 20,000 poses; ModelError for a model with states
    other than x, y and yaw, and for holds of more than an hour in total.
    """
    if model.space.names != ("x", "y", "yaw"):
        raise ModelError(f"expected a model with the states x m, y m, yaw rad of a path's poses, got {model.space}")
    rows, times = _read(path)
    way = _MotionSequence(rows[0].tolist())
    for i in range(1, len(rows)):
        x, y, yaw = rows[i].tolist()
        turned = yaw - rows[i - 1, 2] + wrap(rows[i - 1, 2] - way.yaw)
        if np.hypot(x - way.x, y - way.y) > STILL:
            way.move(x, y)
            way.turn(float(wrap(yaw - way.yaw)))
        elif abs(turned) > STRAIGHT:
            way.turn(float(turned))
        elif times[i] > times[i - 1]:
            way.hold((times[i] - times[i - 1]) / SECOND)
    return way.of(model)


class _MotionSequence:
    """Sequence of motions under construction; a motion that continues the last one extends it.

    It keeps the state before, between and after the motions: x and y, m; yaw, rad, without jumps at a full turn; and
    the total time of holds until then, s.

    kinds  (n,) kind of each motion: "turn", "move" or "hold"
    """

    def __init__(self, first: list[float]) -> None:
        self._states: list[tuple[float, ...]] = [(*first, 0.0)]
        self.kinds: list[str] = []

    @property
    def x(self) -> float:
        return self._states[-1][0]

    @property
    def y(self) -> float:
        return self._states[-1][1]

    @property
    def yaw(self) -> float:
        return self._states[-1][2]

    def turn(self, change: float) -> None:
        """Append a turn in place by an angle, rad."""
        x, y, yaw, clock = self._states[-1]
        if abs(change) > STRAIGHT:
            goes_on = self._last() == "turn" and change * (yaw - self._states[-2][2]) > 0.0
            self._put("turn", (x, y, yaw + change, clock), goes_on)

    def move(self, to_x: float, to_y: float) -> None:
        """Append a turn towards a position, m, and a straight move to it, or extend the last move if it leads there."""
        if self._last() == "move":
            from_x, from_y, yaw, clock = self._states[-2]
            along = (to_x - from_x) * np.cos(yaw) + (to_y - from_y) * np.sin(yaw)
            heading = np.arctan2(to_y - from_y, to_x - from_x)
            if along > np.hypot(self.x - from_x, self.y - from_y) and abs(wrap(heading - yaw)) <= STRAIGHT:
                self._put("move", (to_x, to_y, yaw, clock), True)
                return
        self.turn(float(wrap(np.arctan2(to_y - self.y, to_x - self.x) - self.yaw)))
        self._put("move", (to_x, to_y, *self._states[-1][2:]), False)

    def hold(self, seconds: float) -> None:
        """Append a wait of some seconds."""
        x, y, yaw, clock = self._states[-1]
        self._put("hold", (x, y, yaw, clock + seconds), self._last() == "hold")

    def of(self, model: Model) -> Trajectory:
        """Return the motions as a trajectory of a model."""
        columns = np.array(self._states).T[: 4 if "hold" in self.kinds else 3]
        states = States(**dict(zip((*model.space.names, CLOCK), columns, strict=False)))
        return Trajectory(model, states, tuple(self.kinds))

    def _last(self) -> str:
        return self.kinds[-1] if self.kinds else ""

    def _put(self, kind: str, state: tuple[float, ...], goes_on: bool) -> None:
        """Append a motion that ends in ``state``; if it ``goes_on`` with the last one, move the end of that instead."""
        if goes_on:
            self._states[-1] = state
        else:
            self._states.append(state)
            self.kinds.append(kind)


def _read(path: Any) -> tuple[FloatArray, list[int]]:
    """Return the poses of a path as rows (N, 3) of x, y and continuous yaw, and their stamps, ns."""
    given = mapping(path, "the path").get("poses")
    if not isinstance(given, list | tuple) or not 0 < len(given) <= MOST_POSES:
        size = f"{len(given):,}" if isinstance(given, list | tuple) else "none"
        raise RosError(f"a path must have a list of 1 to {MOST_POSES:,} poses, got {size}")
    poses = [planar_pose(pose, f"pose {i}") for i, pose in enumerate(given)]
    times = [time_of(pose, f"pose {i}") for i, pose in enumerate(given)]
    rows = np.array([pose[:3] for pose in poses], float)
    rows[:, 2] = np.unwrap(rows[:, 2])
    return rows, times
