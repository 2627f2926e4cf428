"""Poses of a body and values of joints along a trajectory, sampled evenly in time, for rides and other programs."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray, frozen
from hpop.base.options import LEAST, MOST, real
from hpop.errors import OptionError
from hpop.motions.bodies import JOINTS, check_body
from hpop.motions.states import Pose, States, Vector
from hpop.trajectories.trajectory import MOST_ROWS, Trajectory

SLOWEST = 20.0  # Hz: least rate at which yaw is sampled, so that no turn between two samples is lost
NEXT = 0.01  # share of a step: a shorter last step is merged with the step before


@dataclass(frozen=True, eq=False, repr=False)
class Poses:
    """Poses of a body at N times, in the world's frame: right-handed, x and y on the floor, z up (REP-103).

    times        (N,)    s      as given; of :func:`poses`, from 0 to the end, strictly increasing even in whole ns
    positions    (N, 3)  m      x, y, z
    quaternions  (N, 4)  1      x, y, z, w: they turn the axes of the world to those of the body, x ahead, y left, z up.
                                Unit; w >= 0 in the first; signs without jumps: q · q_before >= 0
    yaws         (N,)    rad    of the direction ahead, counter-clockwise from the world's x; continuous,
                                except for half a turn when the body passes straight up or down
    speeds       (N,)    m/s    forward: the velocity along the direction ahead
    yaw_rates    (N,)    rad/s  about the vertical, counter-clockwise
    velocities   (N, 3)  m/s    in the world's frame
    rotations    (N, 3)  rad/s  angular velocity, in the world's frame
    states       (N,)           states of the robot
    body                        name of the body
    planned                     True for the planned motion, False for the execution, from rest to rest
    """

    times: FloatArray
    positions: FloatArray
    quaternions: FloatArray
    yaws: FloatArray
    speeds: FloatArray
    yaw_rates: FloatArray
    velocities: FloatArray
    rotations: FloatArray
    states: States
    body: str
    planned: bool

    def __len__(self) -> int:
        return self.times.size

    def __repr__(self) -> str:
        how = "as planned" if self.planned else "as executed"
        return f"<Poses: {len(self):,} of the {self.body} in {self.times[-1]:.3f} s, {how}>"


def poses(trajectory: Trajectory, *, rate: float = 20.0, body: str = "camera", planned: bool = False) -> Poses:
    """Return the poses of a body along a trajectory, ``rate`` times a second and at its end.

    Parameters
    ----------
    rate : Hz; the last step is shorter if the duration is no multiple of a step
    body : "camera", "base" or "tool", as far as the model has them
    planned : the planned trajectory, in which a robot is at full speed at once; else the executed one
        (:meth:`Trajectory.execution`), from rest to rest

    Raises OptionError for an invalid rate, one that gives over a million poses, and an unknown body.

    >>> from hpop.base.registry import make_model
    >>> goes = Trajectory.from_poses(make_model("differential_drive"), [(0, 0, 0), (3, 0, 0), (3, 4, 0)])
    >>> seen = poses(goes, rate=2)
    >>> seen, seen.positions[-1].tolist(), seen.quaternions[0].tolist()
    (<Poses: 26 of the camera in 12.094 s, as executed>, [3.0, 4.0, 1.2], [0.0, 0.0, 0.0, 1.0])
    """
    check_body(trajectory.model, body)
    run = trajectory if planned else trajectory.execution()
    return poses_at(run, sample_times(run.duration, rate), body=body, planned=planned)


def poses_at(run: Trajectory, times: FloatArray, *, body: str = "camera", planned: bool = False) -> Poses:
    """Return the poses of a body at times (N,), s, of a trajectory.

    ``planned`` only labels the result as planned or executed: give ``trajectory.execution()`` as ``run`` for the poses
    of the execution.
    """
    check_body(run.model, body)
    states, rates = run.at(times), run.rates(times)[0]
    pose, twist = run.model.pose(body, states), run.model.twist(body, states, rates)
    ahead = _stacked(pose.ahead, times.size)
    velocities, rotations = _stacked(twist.velocity, times.size), _stacked(twist.rotation, times.size)
    axes = np.stack([ahead, _stacked(pose.left, times.size), _stacked(pose.up, times.size)], axis=-1)
    found = {
        "times": times,
        "positions": _stacked((pose.x, pose.y, pose.z), times.size),
        "quaternions": on_one_side(quaternions_of(axes)),
        "yaws": _continuous(run, body, times, pose),
        "speeds": np.einsum("ni,ni->n", velocities, ahead),
        "yaw_rates": rotations[:, 2],
        "velocities": velocities,
        "rotations": rotations,
    }
    return Poses(**{name: frozen(column) for name, column in found.items()}, states=states, body=body, planned=planned)


def quaternions_of(axes: FloatArray) -> FloatArray:
    """Return quaternions (N, 4) x, y, z, w of rotations (N, 3, 3), whose columns are the axes of a body in the world.

    The largest of the four components is computed first, to avoid dividing by a small number (Shepperd 1978, J.
    Guidance and Control 1(3)).
    """
    r = axes
    xx, yy, zz = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    squares = np.stack(
        [1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=1
    )  # of each, by 4
    sums = r + r.transpose(0, 2, 1)  # 4 xy, 4 xz, 4 yz
    less = r.transpose(0, 2, 1) - r  # 4 wz at (0, 1), -4 wy at (0, 2), 4 wx at (1, 2)
    products = np.empty((len(r), 4, 4))  # of each two, by 4
    products[:, range(4), range(4)] = squares
    for i, j, value in (
        (0, 1, sums[:, 0, 1]),
        (0, 2, sums[:, 0, 2]),
        (1, 2, sums[:, 1, 2]),
        (0, 3, less[:, 1, 2]),
        (1, 3, -less[:, 0, 2]),
        (2, 3, less[:, 0, 1]),
    ):
        products[:, i, j] = products[:, j, i] = value
    found: FloatArray = products[np.arange(len(r)), np.argmax(squares, axis=1)]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found


def on_one_side(quaternions: FloatArray) -> FloatArray:
    """Return quaternions (N, 4) of the given rotations, with signs chosen so that they do not jump.

    The first has w >= 0. Interpolation between successive quaternions then goes the shorter way.
    """
    along = np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1])
    first = 1.0 if quaternions[0, 3] >= 0.0 else -1.0
    signs = first * np.cumprod(np.append(1.0, np.where(along < 0.0, -1.0, 1.0)))
    turned: FloatArray = quaternions * signs[:, None] + 0.0  # no -0.0
    return turned


def nanoseconds(times: FloatArray) -> IntArray:
    """Return times (N,), s, in whole nanoseconds.

    >>> nanoseconds(np.array([0.1, 0.9999999999])).tolist()
    [100000000, 1000000000]
    """
    return np.rint(np.asarray(times) * 1e9).astype(np.int64)


def sample_times(duration: float, rate: float, what: str = "poses") -> FloatArray:
    """Return times every 1/rate seconds from 0, and the end, s; ``what`` names the samples in messages.

    Raises OptionError for an invalid rate, and one that gives over a million times.
    """
    rate = real("rate", rate, LEAST, MOST, f"a number of {what} a second, in Hz,")
    if duration * rate >= MOST_ROWS:
        raise OptionError(
            f"there may be at most {MOST_ROWS:,} {what}, but {rate:g} Hz gives more in {duration:g} s; choose a lower "
            "rate"
        )
    steps = max(ceil(duration * rate - NEXT), int(duration > 0.0))  # the last one ends there
    return np.append(np.arange(steps) / rate, duration)


def _continuous(run: Trajectory, body: str, times: FloatArray, pose: Pose) -> FloatArray:
    """Return the yaw (N,), rad, without jumps by whole turns.

    Moments between the times are sampled too, so that no turn is missed.
    """
    steps = np.diff(times)
    several = ceil(SLOWEST * steps.max(initial=0.0) - 2.0 * NEXT)
    if several <= 1:
        return np.unwrap(np.broadcast_to(pose.yaw, times.shape))
    within = np.arange(several) / several
    between = np.append((times[:-1, None] + steps[:, None] * within).ravel(), times[-1])
    yaw: FloatArray = np.unwrap(np.broadcast_to(run.model.pose(body, run.at(between)).yaw, between.shape))
    return yaw[::several]


def _stacked(vector: Vector, size: int) -> FloatArray:
    """Return three columns, or constant numbers, as rows (N, 3)."""
    return np.stack([np.broadcast_to(np.asarray(column, float), (size,)) for column in vector], axis=1)


class JointRows(NamedTuple):
    """Motion of n joints at N times.

    names          names of the joints, from base to tip
    times          (N,)    s, from 0 to the end, strictly increasing
    positions      (N, n)  rad or m
    velocities     (N, n)  rad/s or m/s, 0 at both ends if the motion begins and ends at rest
    accelerations  (N, n)  rad/s² or m/s²; where they jump, those of the motion that begins
    """

    names: tuple[str, ...]
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray


def joint_rows(run: Trajectory, rate: float) -> JointRows:
    """Return the motion of the joints ``rate`` times a second, and at the end, of a planned or executed trajectory.

    Raises OptionError for an invalid rate, one that gives over a million rows, and for a robot without joints.
    """
    if JOINTS not in run.model.provides:
        raise OptionError(f"joints need a robot with joints, got {run.model.name}; give another body, such as camera")
    names = run.model.joints
    times = sample_times(run.duration, rate, "rows")
    sampled = (run.at(times), *run.rates(times))
    return JointRows(names, times, *(np.stack([getattr(row, name) for name in names], axis=1) for row in sampled))
