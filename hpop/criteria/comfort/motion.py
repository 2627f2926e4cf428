"""Motion of base and camera: lengths of paths, angle between view and motion, accelerations, and changes of speed.

The angle (heading mismatch) makes two criteria: its integral over time and its mean over time. Accelerations are those
of the camera: integrals of acceleration, of its square and of jerk.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import angle_between, hypot, is_symbolic, norm, smooth_abs
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort import body_at
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions, States, is_curve
from hpop.motions.laws import SPEED
from hpop.trajectories.history import History


@criterion(
    "length",
    group="C",
    unit="m",
    aggregate="sum",
    requires=("base",),
    role="length",
    instead=("camera_length", "joint_length"),
)
@dataclass(frozen=True)
class Length:
    """Length of the base's path: D = ∫ sqrt(x'² + y'²) dt.

    Unit m; a sum over motions. Source: Becerra et al. 2020 (arXiv 2002.10696), who count it as comfort because a short
    path shortens the exposure to virtual reality.
    """

    def cost(self, m: Motions) -> Column:
        """Return the path length (M,), m."""
        return m.base.length

    def bound(self, start: States, goal: States) -> Column:
        """Return a lower bound (M,), m, on the length of any trajectory between two states: their distance."""
        return hypot(goal.x - start.x, goal.y - start.y)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return the length of a polyline as a convex expression of cvxpy."""
        return ConvexCost(path.length, exact=True)


@criterion("camera_length", group="C", unit="m", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraLength:
    """Length of the camera's path in space: ∫ |v| dt.

    Unit m; a sum over motions. It is for the camera what ``length`` is for the base: a short path shortens the exposure
    to virtual reality (Becerra et al. 2020, arXiv 2002.10696). The two differ if the camera is on an arm, or away from
    the axis of its base, so that turns in place move it too.
    """

    def cost(self, m: Motions) -> Column:
        """Return the path length (M,), m."""
        return m.camera.length


PANELS = 16  # quadrature intervals in each phase of a turn in place; within a few degrees its speed passes ``slow``


@dataclass(frozen=True)
class _Mismatch:
    """Angle between the camera's view and its motion; below ``slow`` m/s it counts in proportion to the speed."""

    slow: float = 0.1  # m/s, below which the angle counts in proportion to the speed

    def __post_init__(self) -> None:
        set_reals(self, "slow", least=LEAST, most=MOST, kind="a speed in m/s", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the angle (M,), rad s."""
        if m.camera.stays:
            return 0.0 * m.duration  # a camera whose position does not change has no direction of motion

        def mismatch(s: Instants) -> Column:
            velocity = s.twist("camera").velocity
            counted = np.minimum(norm(velocity) / self.slow, 1.0)
            return counted * angle_between(s.camera.ahead, velocity)

        return _fine(m).integrate(mismatch)


def _fine(m: Motions) -> Motions:
    """Return motions with ``PANELS`` quadrature intervals in each phase if the base stands, as in turns and lifts.

    The camera's speed changes fast there. Parts of motions, symbols, laws with adaptive quadrature, and motions with
    panels that are set are returned unchanged.
    """
    if not m.whole or m.panels is not None or m.law.quadrature == "adaptive" or {"x", "y"} & m.law.varies:
        return m
    if any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
        return m
    return replace(m, panels=PANELS)


@criterion("heading_mismatch", group="C", unit="rad s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class HeadingMismatch(_Mismatch):
    """Angle between the camera's view and its direction of motion, over time: ∫ γ min(|v|/slow, 1) dt.

    slow  m/s  below this speed the angle counts in proportion to the speed, since at rest there is no direction of
               motion

    γ is the angle in space between the camera's axis ahead and the velocity v of the camera. Unit rad s; a sum over
    motions. A camera that looks down at the floor while driving has a cost. So has a camera that a lift raises while it
    looks ahead (γ is then a right angle). Standing, turning about the camera, panning and tilting cost nothing. A turn
    of the base moves a camera that is not on the axis sideways, which has a cost. The integral is accurate to 0.2 %.

    Source: a user who looks in the direction of motion sees what comes, and unexpected vection best predicts sickness
    (studies of vection in virtual reality, of which only abstracts were read). A view that is turned back while the
    base turns saves rotation (Suomalainen et al., HRI 2022) but has this angle. The definition is this project's own.
    """


@criterion("mean_heading_mismatch", group="C", unit="rad", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class MeanHeadingMismatch(_Mismatch):
    """Angle between the camera's view and its direction of motion, as a mean: (1/T) ∫ γ min(|v|/slow, 1) dt.

    It is the integral of :class:`HeadingMismatch`, which defines γ, divided by the whole duration T, pauses included.
    Unit rad; a mean over time.
    """

    @property
    def integral(self) -> HeadingMismatch:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return HeadingMismatch(self.slow)


@criterion("felt_acceleration", group="C", unit="m/s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class FeltAcceleration:
    """Integral of the camera's acceleration: ∫ |a| dt, a the acceleration of the camera in the world.

    Unit m/s; a sum over motions. On a straight run it is the sum of all changes of speed: a run from rest to rest at
    1 m/s costs 2 m/s, one that also slows down to 0.5 m/s for a while costs 3 m/s. A camera off the axis of a turning
    base also has the acceleration of its circle.

    For a robot with several ``speeds``, starts, stops and changes of speed are motions of the plan, and searches
    minimise their cost. The plan of a robot with one speed has that speed throughout; the cost of starting and
    stopping then appears only in the executed cost, which is reported beside the planned one.

    Source: this project. A seated user sees these accelerations and feels none of them; such conflicts are held to
    cause motion sickness (Reason and Brand, "Motion Sickness", 1975). Unlike ``jerk`` and ``msdv``, it adds up along a
    path, so that searches can minimise it.
    """

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,), m/s."""
        if m.law.varies == {SPEED}:  # a planned change of speed in place
            return smooth_abs(m.end.speed - m.start.speed)
        return m.integrate(lambda s: norm(s.twist_rate("camera").velocity))


@criterion("squared_acceleration", group="C", unit="m²/s³", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class SquaredAcceleration:
    """Integral of the camera's squared acceleration: ∫ |a|² dt, a the acceleration of the camera in the world.

    Unit m²/s³; a sum over motions. Strong accelerations count more than weak ones that last longer: a run from rest to
    rest that reaches the speed v with the acceleration a costs 2 a v. Among all motions from rest to rest over the
    distance d in the time T, the one whose acceleration falls linearly costs least, 12 d²/T³.

    Planned motions at constant speed cost nothing; the cost of their starts and stops appears in the executed cost. For
    a robot with several ``speeds``, planned changes of speed cost what their ramps will. `hpop.retime` minimises this
    cost along a path.

    Source: this project. It is convex in the squared speed along a path, so that programs find its optima.
    """

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,), m²/s³."""
        if m.law.varies == {SPEED}:  # a planned change of speed in place, whose ramp lasts twice as long
            change = smooth_abs(m.end.speed - m.start.speed)
            return change * m.law.acceleration  # type: ignore[attr-defined]
        return m.integrate(_squared_acceleration)


def _squared_acceleration(s: Instants) -> Column:
    x, y, z = s.twist_rate("camera").velocity
    return x * x + y * y + z * z


SPLIT = 10  # samples per smoothing time


@criterion("jerk", group="C", unit="m²/s⁵", aggregate="trajectory", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class Jerk:
    """Squared jerk of the executed camera motion, over time: ∫ |p'''|² dt, at a bandwidth of ``1/smoothing``.

    smoothing  time h, s, over which the motion is smoothed; by default 0.1 (10 Hz)

    Unit m²/s⁵; a criterion of the whole trajectory. The value grows with the bandwidth: compare only values with equal
    ``smoothing``.

    The robot's acceleration jumps (its speed profile is a trapezoid), so its jerk is a series of impulses, whose square
    has no integral. So p''' is a third difference over h, (p(t + 3h/2) - 3 p(t + h/2) + 3 p(t - h/2) - p(t - 3h/2)) /
    h³. This is the jerk smoothed three times by a moving mean of length h. A jump of the acceleration by a then costs
    11 a²/(20 h) if the next jump is at least 3 h away. A straight move from rest to rest with acceleration a has four
    jumps and costs 2.2 a²/h.
    """

    smoothing: float = 0.1

    def __post_init__(self) -> None:
        set_reals(self, "smoothing", least=0.001, most=MOST, kind="a time in s", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the integral (M,), m²/s⁵, of the squared jerk up to the end of each motion.

        The last value includes the time just after the end, into which smoothing spreads the last jump.
        """
        return squared_jerk(m, "camera", self.smoothing)


def squared_jerk(m: History, body: str, smoothing: float) -> FloatArray:
    """Return the integral (M,), m²/s⁵, of a body's squared jerk up to the end of each motion, as :class:`Jerk` does."""
    step, duration = smoothing / SPLIT, m.executed.duration
    half = 3 * SPLIT // 2  # steps from the middle of the third difference to its ends
    index = np.arange(-2 * half, int(np.ceil(duration / step)) + 2 * half + 1)
    times = np.asarray(step * index, dtype=np.float64)
    _, position = body_at(m, body, times)
    position = position - position[0]
    jerk = position[3 * SPLIT :] - 3 * position[2 * SPLIT : -SPLIT] + 3 * position[SPLIT : -2 * SPLIT]
    jerk = (jerk - position[: -3 * SPLIT]) / smoothing**3  # (N, 3)
    done = np.asarray(np.cumsum(np.sum(jerk * jerk, axis=1)) * step, dtype=np.float64)
    running = m.at_motion_ends(times[half:-half], done)
    running[-1] = done[-1]
    return running


LEAST_CHANGE = 1e-6  # m/s: smaller differences of speed are rounding errors


@criterion("speed_changes", group="C", unit="1", aggregate="sum", requires=("base",), smooth=False, quantum=1.0)
@dataclass(frozen=True)
class SpeedChanges:
    """Number of changes between two speeds of the robot while it drives.

    Unit 1; a sum over motions. A change to the next faster or slower speed counts once, and starting and stopping do
    not count: ``turns`` and ``duration`` charge for stops. It is 0 for a robot with one speed, and along curves, where
    the speed changes all the time. Needs a robot with several ``speeds`` to be more than 0.

    Source: this project. Few changes make a ride predictable, which viewers name as a reason for comfort (Suomalainen
    et al. 2021, doi 10.1007/978-3-030-90739-6_1, in open answers about turns).
    """

    def cost(self, m: Motions) -> Column:
        """Return 1 (M,) for each change between two speeds other than 0, and 0 for all other motions."""
        if SPEED not in m.law.varies or is_curve(m.law):
            return 0.0 * m.duration
        before, after = m.start.speed, m.end.speed
        changes = (np.minimum(before, after) > 0.0) & (np.abs(after - before) > LEAST_CHANGE)
        return np.where(changes, 1.0, 0.0)
