"""Rotation of the camera: angle, time, number of turns, winding, roll, and angular acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import angle_between, hinge, hypot, norm
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.visits import landmark_seen
from hpop.errors import CriterionError
from hpop.models.rigid import view_angles
from hpop.motions import Motions, Pose
from hpop.trajectories.history import History
from hpop.world.content.content import Landmark


@criterion("rotation", group="C", unit="rad", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Rotation:
    """Total rotation of the camera, about any axis: ∫ |ω| dt.

    It adds up the angles of all turns, pans and tilts, left or right. Unit rad; a sum over motions. Source: Kemeny et
    al. 2017, who name rotation as the strongest cause of sickness.
    """

    def cost(self, m: Motions) -> Column:
        """Return the absolute rotation (M,), rad."""
        return m.camera.turned


STILL = 1e-9  # rad: tolerance for the rotation of a camera whose head turns back while its base turns


@criterion("rotation_time", group="C", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class RotationTime:
    """Time in which the camera turns; waits before and after a turn do not count.

    Unit s; a sum over motions. A turn by |Δθ| from rest to rest lasts |Δθ|/ω + ω/α, or 2 sqrt(|Δθ|/α) if it is too
    short to reach ω. With fast ramps that is Σ |Δθ|/ω. Beside ``rotation`` this distinguishes slow turns from fast
    ones.

    Source: Widdowson et al. 2019: a faster rotation by a given angle shortens the sensory conflict.
    """

    def cost(self, m: Motions) -> Column:
        """Return the duration (M,), s, without waits, of each motion that turns the camera; 0 for all others."""
        busy = sum(phase.duration for phase in m.phases if phase.shape != "hold")
        return np.where(m.camera.turned > STILL, busy, 0.0)


LEAST_TURN = np.deg2rad(1.0)  # rad: smaller changes of heading are not counted


@criterion(
    "turns",
    group="C",
    unit="1",
    aggregate="sum",
    requires=("camera",),
    smooth=False,
    quantum=1.0,
    role="turns",
)
@dataclass(frozen=True)
class Turns:
    """Number of turns of more than one degree, whatever their angle.

    A turn is a rotation of the camera about the vertical, by its base or by a head that pans. Tilts do not count; turns
    at start and goal do. Unit 1; a sum over motions. Source: the cost N of Becerra et al. 2020 (arXiv 2002.10696): few
    and fast rotations spare the semicircular canals.

    Each motion in place counts as one turn, so two turns in place in succession count twice. Planners of hpop make each
    turn in one motion, as the paper does. Along curves a turn is the longest stretch in which the heading changes with
    one sign, however the curve is cut into motions. A change of sign begins another turn, and so does a straight
    stretch. The cost of a curve by itself, for example as an edge of a graph, assumes a constant heading before and
    after it.
    """

    def cost(self, m: Motions) -> Column:
        """Return the number (M,) of turns that end in each motion."""
        return sum(np.where(np.abs(turn) > LEAST_TURN, 1.0, 0.0) for turn in m.camera.turns)


@criterion("longest_turn", group="C", unit="rad", aggregate="max", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class LongestTurn:
    """Angle of the longest turn: max over turns of |Δθ|, with turns as in :class:`Turns`, also those below one degree.

    Unit rad; the worst moment. A path with many short turns costs less than one with a single long turn: list it beside
    ``turns``.

    Source: turns discomfort users of telepresence more the longer they are (doi 10.1007/978-3-030-90739-6_1, as its
    abstract says; the formula is this project's).
    """

    def cost(self, m: Motions) -> Column:
        """Return the largest angle (M,), rad, of the turns that end in each motion."""
        angles = [np.abs(turn) for turn in m.camera.turns]
        return angles[0] if len(angles) == 1 else np.maximum(*angles)


STEP = 0.05  # s between samples of a trajectory
SLOWEST = 1e-3  # rad/s: a view that turns more slowly does not turn
SHORTEST = 0.1  # m: a shorter way after a turn leads nowhere


@criterion(
    "unforeseen_turns", group="C", unit="1", aggregate="trajectory", requires=("camera",), smooth=False, quantum=1.0
)
@dataclass(frozen=True)
class UnforeseenTurns:
    """Number of turns whose cause, the way ahead after the turn, was hardly in sight before the turn began.

    notice  s    a turn is foreseen if the way ahead was in view for this long, in all, before the turn began
    ahead   m    the way ahead is represented by the camera's position this far along the path after the turn, or where
                 the camera turns or stops next if that is nearer
    far     m    largest distance from which the way ahead is seen

    Unit 1, a count; a criterion of the whole trajectory. Turns are those of the executed view: stretches in which it
    turns about the vertical in one direction by more than one degree. The way ahead is in view where no obstacle hides
    it and it is within the field of view, as landmarks are for ``unseen_landmarks``. A turn after which the camera
    stays where it is has no way ahead and does not count. A turn at the very start was never foreseen. The executed
    motion is sampled every 0.05 s.

    Source: lack of predictability makes turns uncomfortable (doi 10.1007/978-3-030-90739-6_1), and unexpected vection
    worsens sickness (doi 10.3389/frvir.2022.860919), as their abstracts say; the formula is this project's.
    """

    notice: float = 1.0
    ahead: float = 2.0
    far: float = 10.0

    def __post_init__(self) -> None:
        set_reals(self, "notice", least=0, most=MOST, kind="a time in s", error=CriterionError)
        set_reals(self, "ahead", "far", least=LEAST, most=MOST, kind="a distance in m", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the number (M,) of unforeseen turns that end by the end of each motion."""
        track = m.track(STEP)
        size, dt = track.times.size, np.diff(track.times)
        x, y, z = (np.broadcast_to(c, (size,)) for c in (track.camera.x, track.camera.y, track.camera.z))
        way = np.append(0.0, np.cumsum(np.sqrt(np.diff(x) ** 2 + np.diff(y) ** 2 + np.diff(z) ** 2)))
        rate = np.broadcast_to(track.twist("camera").rotation[2], (size,))
        sign = np.where(np.abs(rate) > SLOWEST, np.sign(rate), 0.0)
        cuts = np.flatnonzero(np.diff(sign)) + 1
        angles = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * dt))
        unforeseen = np.zeros(len(m))
        view = view_angles(track, m.model)
        begins, ends = np.append(0, cuts), np.append(cuts, size - 1)
        turning = [i for i in range(begins.size) if abs(angles[ends[i]] - angles[begins[i]]) > LEAST_TURN]
        for place, i in enumerate(turning):
            begin, end = int(begins[i]), int(ends[i])
            next_turn = int(begins[turning[place + 1]]) if place + 1 < len(turning) else size - 1
            there = min(int(np.searchsorted(way, way[end] + self.ahead)), max(next_turn, end))
            if way[there] - way[end] < SHORTEST:
                continue
            mark = Landmark(float(x[there]), float(y[there]), float(z[there]))
            seen = landmark_seen(m.world, m.model, track.camera, size, mark, far=self.far, view=view)[: begin + 1]
            if seen[:-1] @ dt[:begin] < self.notice - 1e-9:
                unforeseen += m.passed[1:] >= track.times[end] - STEP
        return unforeseen


@criterion(
    "net_winding",
    group="C",
    unit="rad",
    aggregate="trajectory",
    requires=("camera", "heading"),
    smooth=False,
    instead=("rotation", "camera_roll"),
)
@dataclass(frozen=True)
class NetWinding:
    """Angle by which the user is twisted at the end: |Σ Δθ|, the absolute sum of the camera's signed turns.

    Unit rad; a criterion of the whole trajectory. A user who follows the camera's turns with the body is twisted by
    this angle when the robot arrives. Left and right turns cancel. Four left turns by 90 degrees are a whole turn,
    although the heading is as before. The headings at start and goal determine the winding up to whole turns, so the
    criterion distinguishes paths that pass obstacles on different sides. Only the winding at the end counts, not the
    largest one on the way.

    Source: Suomalainen et al. (HRI 2022) found that users prefer unwinding turns and find them more comfortable.
    """

    def cost(self, m: History) -> FloatArray:
        """Return the absolute winding (M,), rad, after each motion."""
        winding: FloatArray = np.abs(np.cumsum(m.of_motions(lambda motions: motions.camera.rotation)))
        return winding


@criterion("camera_roll", group="C", unit="rad s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraRoll:
    """Slant of the camera's picture, over time: ∫ |ρ| cos ε dt, where ρ is the camera's roll and ε its pitch.

    ρ is 0 in an upright picture and π in one that is upside down. Unit rad s; a sum over motions.

    Source: "zero roll" is one of the objectives by which Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019) move a camera
    on a robot's arm, because people lose their bearings in a slanted picture.

    Deviation: the weight cos ε, which is the length of the world's vertical in the picture. A camera that looks
    straight down or up shows no horizon, and near these directions the roll jumps although the picture hardly changes.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the slant (M,), rad s."""
        if m.camera.upright:  # the camera turns about the vertical only, which does not change the slant
            return _slant(m.camera.start) * m.duration
        return m.integrate(lambda s: _slant(s.camera))


def _slant(camera: Pose) -> Column:
    """Return |roll| cos(pitch) of a camera, rad, from the components of the vertical along its axes left and up."""
    aside, along = camera.left[2], camera.up[2]
    return hypot(aside, along) * angle_between((0.0, 1.0, 0.0), (aside, along, 0.0))


FELT = float(np.deg2rad(1.0))  # rad/s², threshold of perception; see AngularAcceleration


@criterion("angular_acceleration", group="C", unit="rad/s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class AngularAcceleration:
    """Angular acceleration of the camera above the threshold of perception: ∫ (|α| - α_th)₊ dt.

    threshold  α_th, rad/s²; 1 deg/s² by default

    A seated user sees this acceleration, but does not feel it: the semicircular canals, which would perceive it in a
    real turn, report nothing. Unit rad/s; a sum over motions. A turn from rest to rest that reaches the turn rate ω
    costs 2 ω (1 - α_th/α), so few and gentle turns are cheap.

    Source of the threshold: Grabherr et al. 2008 measured yaw thresholds as the peak velocity v of one cycle of
    sinusoidal acceleration at frequency f, with the peak acceleration π f v: 0.51 deg/s² for the 0.71 deg/s at 0.23 Hz
    where the plateau begins, 0.44 deg/s² for the 2.8 deg/s at 0.05 Hz. The default, twice that, is this project's
    choice.

    The cost is exact for cameras on a base or a pan-tilt head, because α is then constant within each phase of a motion
    and along each curve. For an arm, whose joints turn one another's axes, it is integrated numerically.
    """

    threshold: float = FELT

    def __post_init__(self) -> None:
        set_reals(self, "threshold", least=0, most=MOST, kind="an angular acceleration in rad/s²", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), rad/s, of the excess of the angular acceleration over the threshold."""
        return m.integrate(lambda s: hinge(norm(s.twist_rate("camera").rotation) - self.threshold))
