"""Criteria of the robot: time, energy, smoothness, nearness of obstacles; those of joints are in :mod:`.joints`.

Smoothness is measured by bending energy, sign changes of the curvature, and jerk.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar, cast

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.base.math import hinge, is_symbolic, smooth_abs
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import Curve, Instants, Motions, Wheeled, collision_of, is_coupled
from hpop.trajectories.history import History


@criterion("clearance", group="R", unit="m", aggregate="max", quantum=1e-3)
@dataclass(frozen=True)
class Clearance:
    """Shortfall of the robot's clearance at the moment nearest to obstacles: max over t of (enough - d(p(t)))₊.

    d is the distance from the base's axis p to the nearest obstacle at any height, keep-out zone, standing person, or
    border of the map. A path with smallest clearance c costs ``enough`` - c, or 0 if c is larger than ``enough``. Unit
    m; the worst moment.

    If the model's collision test measures a ``clearance``, d is that of the whole robot: for an arm, the distance of
    its links from all solids of the world. For reaches of an arm, its error is about 0.01 mm at most, and
    programs on CasADi symbols cannot use the criterion. A model needs either such a collision test or a base.
    """

    quantity: ClassVar[str] = "shortfall"
    enough: float = 1.0  # m, clearance from which on the cost is 0

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the largest shortfall of the clearance (M,), m, in each motion."""
        collision = collision_of(m.model, m.world)
        if collision.clearance is None and "base" not in m.model.provides:
            raise UnsupportedCriterion(
                "the criterion needs a model with a base, or with a method clearance of its collision test; add one"
            )
        if collision.clearance is not None and any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
            raise UnsupportedCriterion(
                "nonlinear programs cannot compute distances of this whole robot; plan on a graph, such as by 'roadmap'"
            )
        if collision.least_clearance is not None and not is_coupled(m.law):
            return self.enough - collision.least_clearance(m, self.enough)
        if (clearance := collision.clearance) is not None:
            return m.worst(lambda s: np.maximum(self.enough - clearance(s.state), 0.0))
        return m.worst(lambda s: np.maximum(self.enough - m.world.clearance(s.base.x, s.base.y), 0.0))

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return a convex upper bound on the cost of a polyline.

        Distances are measured to half-planes that contain all obstacles.
        """
        return ConvexCost(path.shortfall(self.enough, path.world.free_space(), "base"), exact=False)


@criterion("proximity", group="R", unit="1", aggregate="sum", requires=("base",), instead=("clearance",))
@dataclass(frozen=True)
class Proximity:
    """Length of the base's path, each metre divided by the clearance there, in metres: ∫ ds / max(d, least).

    d is the clearance of the base. Unit 1; a sum over motions. The integral is over the path, not over time, so
    standing and turning in place cost nothing.

    Source: the path integral of the reciprocal clearance is the usual additive cost beside the smallest clearance, for
    example in OMPL's tutorial on optimal planning (Sucan, Moll, Kavraki, "The Open Motion Planning Library", IEEE RAM
    2012).

    Deviations: d counts as at least ``least``, so that the cost is finite. It is read from the world's distance grid,
    also in nonlinear programs, and differs from the exact distance by at most 0.82 of a cell. Among
    boxes the cost is within 1 % of that of exact distances. Quadrature intervals are at most half of ``least`` long,
    but at least an eighth of a cell. If a path runs into an obstacle, where d falls below ``least``, their error is at
    most 1e-3.
    """

    least: float = 0.1  # m, smallest clearance by which the path is divided

    def __post_init__(self) -> None:
        set_reals(self, "least", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the integral of the reciprocal clearance along each motion (M,)."""
        if m.base.stays:
            return 0.0 * m.duration  # a turn in place has no path
        clearance = m.world.clearance_field()

        def rate(s: Instants) -> Column:
            return smooth_abs(s.speed) / np.maximum(clearance(s.base.x, s.base.y), self.least)

        return m.integrate(rate, detail=self.least)


@criterion("duration", group="R", unit="s", aggregate="sum", role="duration")
@dataclass(frozen=True)
class Duration:
    """Duration of the trajectory: T = ∫ dt.

    Unit s; a sum over motions. Each motion lasts as long as its motion law says; graphs use the laws of planned
    motions.
    """

    def cost(self, m: Motions) -> Column:
        """Return the duration (M,), s."""
        return m.duration


@criterion("energy", group="R", unit="J", aggregate="sum", requires=("wheels",), instead=("joint_energy",))
@dataclass(frozen=True)
class Energy:
    """Energy of both drive motors: ∫ P dt with P = (c1 a² + c2 v² + c3 v + c4 + c5 a + c6 v a)₊ for each wheel.

    v and a are the speed and acceleration of a wheel. For a base with speed V, acceleration A, turn rate ω, angular
    acceleration α and wheel base b they are V ± ω b/2 and A ± α b/2. Unit J; a sum over motions.

    Source: the power of a direct-current motor, from Tokekar, Karnad and Isler, "Energy-optimal trajectory planning for
    car-like robots", Autonomous Robots 37, 2014.

    The constants must be calibrated on each robot. The defaults were not measured; they are placeholders of a plausible
    size for 30 kg on two wheels (c6 is the mass on a wheel divided by an efficiency of 0.75). Use them to compare
    trajectories, not to predict how long a battery lasts.

    Deviations: a wheel that turns backwards takes as much power as forwards, with c3 |v| and c5 a sign(v). Energy from
    braking is lost, so P counts only where it is positive. Planned moves are at cruise speed throughout. Speeding up
    and braking appear only in the cost of the executed motion, which is reported beside the planned one.
    """

    c1: float = 1.0  # W s⁴/m²
    c2: float = 2.0  # W s²/m²
    c3: float = 5.0  # W s/m
    c4: float = 2.0  # W, at rest
    c5: float = 1.0  # W s²/m
    c6: float = 20.0  # W s³/m², which is kg

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        set_reals(self, *names, least=0, most=MOST, kind="a number", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the energy (M,), J."""
        half = 0.5 * cast(Wheeled, m.model).wheel_base

        def power(s: Instants) -> Column:
            v, a, turn, change = s.speed, s.acceleration, half * s.turn_rate, half * s.turn_acceleration
            return self._wheel(v - turn, a - change) + self._wheel(v + turn, a + change)

        if not m.whole or m.law.varies != {"yaw"} or is_symbolic(m.base.rotation):
            return m.integrate(power)
        # Turns in place differ only in their angles, and a graph has many turns but few different angles.
        _, first, inverse = np.unique(m.base.turned, return_index=True, return_inverse=True)
        different = replace(m, start=m.start.take(first), end=m.end.take(first), t0=None)
        return different.integrate(power)[inverse]

    def _wheel(self, v: Column, a: Column) -> Column:
        """Return the power (M,) of one wheel, W."""
        even = self.c1 * a * a + self.c2 * v * v + self.c3 * np.abs(v) + self.c4
        return hinge(even + self.c5 * a * np.sign(v) + self.c6 * v * a)


@criterion(
    "bending_energy",
    group="R",
    unit="1/m",
    aggregate="sum",
    requires=("base", "heading"),
    instead=("rotation", "joint_energy"),
)
@dataclass(frozen=True)
class BendingEnergy:
    """Bending energy of the base's path: ∫ κ² ds, where κ is its curvature and corners are rounded to arcs.

    Unit 1/m; a sum over motions. The base drives in the direction of its heading, so the curvature is its rotation per
    metre. Along curves with speed v and yaw rate ω the cost is the integral of ω²/max(|v|, rounding |ω|) over time. In
    straight moves, turns in place and arcs the curvature is constant.

    A sharp corner would have an infinite cost. So a turn in place by Δθ costs |Δθ|/rounding, as much as an arc with the
    radius ``rounding``. This also holds at start and goal, and if the segments beside the turn are too short for the
    arc. A motion that bends more sharply than the radius ``rounding`` costs as much as that arc: a motion of length L
    costs Δθ²/max(L, rounding |Δθ|). Polylines are therefore ranked by their total rotation, so also use the criterion
    ``turns``.

    Source: the energy of a thin rod along the path (Euler's elastica; Horn, "The curve of least energy", ACM TOMS 9(4),
    1983).
    """

    rounding: float = 0.5  # m

    def __post_init__(self) -> None:
        set_reals(self, "rounding", least=LEAST, most=MOST, kind="a positive radius in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,) of the squared curvature, 1/m."""
        if isinstance(m.law, Curve):
            return m.integrate(lambda s: self._bent(np.abs(s.turn_rate), np.abs(s.speed)))
        return self._bent(m.base.turned, m.base.length)

    def _bent(self, turned: Column, length: Column) -> Column:
        """Return turned²/max(length, rounding turned): the cost of whole motions, or the cost per second.

        turned  absolute rotation, rad, or yaw rate, rad/s
        length  m, or speed, m/s
        """
        stretch = np.maximum(length, self.rounding * turned)
        bends = stretch > 0
        return np.where(bends, turned * turned / np.where(bends, stretch, 1.0), 0.0)


@criterion(
    "curvature_sign_changes",
    group="R",
    unit="1",
    aggregate="trajectory",
    requires=("base", "heading"),
    smooth=False,
    quantum=1.0,
    instead=("turns",),
)
@dataclass(frozen=True)
class CurvatureSignChanges:
    """Number of times that the path changes its bending side: the number of sign changes of the curvature κ.

    Unit 1; a criterion of the whole trajectory. Source: Becerra et al. 2020 (arXiv 2002.10696), who chose the one of
    1000 RRT trajectories with the fewest sign changes.

    κ is the change of the base's heading per metre. Each stretch between turns in place is cut into equal pieces of at
    most ``spacing`` metres. A piece with |κ| < ``least`` counts as straight and is ignored: left, straight, left is no
    sign change. A turn in place of more than one degree counts as a bend to its side, whatever its angle. The heading
    is taken to change evenly within each motion.
    """

    spacing: float = 0.25  # m, largest length of a piece
    least: float = 0.05  # 1/m, curvature below which a piece counts as straight

    def __post_init__(self) -> None:
        set_reals(self, "spacing", least=0.001, most=MOST, kind="a positive length in m", error=CriterionError)
        set_reals(self, "least", least=0, most=MOST, kind="a curvature per metre", error=CriterionError)

    def cost(self, m: History) -> Column:
        """Return the number of sign changes (M,) up to the end of each motion."""
        length = m.of_motions(lambda motions: motions.base.length)
        rotation = m.of_motions(lambda motions: motions.base.rotation)
        in_place = (length == 0) & (rotation != 0)  # a hold does not end a stretch
        stretch = np.cumsum(np.diff(in_place, prepend=in_place[0]))  # (M,) number of each motion's stretch
        motions, signs = [], []
        for number in range(stretch[-1] + 1):
            (index,) = np.nonzero(stretch == number)
            if in_place[index[0]]:
                motions.append(index)
                signs.append(np.where(np.abs(rotation[index]) > LEAST_TURN, np.sign(rotation[index]), 0.0))
            else:
                ends, bends = self._bends(length[index], rotation[index])
                motions.append(index[ends])
                signs.append(bends)
        motion, sign = np.concatenate(motions), np.concatenate(signs)
        motion, sign = motion[sign != 0], sign[sign != 0]
        flips = motion[1:][np.diff(sign) != 0]
        return np.cumsum(np.bincount(flips, minlength=len(m)))

    def _bends(self, length: FloatArray, rotation: FloatArray) -> tuple[IntArray, FloatArray]:
        """Cut a stretch into P pieces; return for each the motion in which it ends, and the sign of its curvature.

        length, rotation  m and rad, of the motions of the stretch
        """
        arc_length = np.concatenate([[0.0], np.cumsum(length)])
        heading = np.concatenate([[0.0], np.cumsum(rotation)])
        cuts = np.linspace(0.0, arc_length[-1], int(np.ceil(arc_length[-1] / self.spacing - 1e-9)) + 1)
        curvature = np.diff(np.interp(cuts, arc_length, heading)) / np.diff(cuts)
        ends = np.minimum(np.searchsorted(arc_length[1:], cuts[1:] * (1.0 - 1e-12)), length.size - 1)
        return ends, np.where(np.abs(curvature) >= self.least, np.sign(curvature), 0.0)


@criterion(
    "smoothness",
    group="R",
    unit="1",
    aggregate="trajectory",
    requires=("base",),
    smooth=False,
    instead=("jerk", "angular_acceleration"),
)
@dataclass(frozen=True)
class Smoothness:
    """Dimensionless squared jerk of the base's executed motion: (T⁵/D²) ∫ |p'''|² dt.

    p is the position of the base, T the duration and D the length of its path. Unit 1; a criterion of the whole
    trajectory. The value depends neither on the speed nor on the size of the path. The smoothest movement from rest to
    rest along a line costs about 720 - 1800 ramp/T: 720 in the limit of a ``ramp`` of 0, and 685 for 5 s and the
    default ramp. A trajectory in which the base does not move costs 0.

    Source: Hogan and Sternad, "Sensitivity of smoothness measures to movement duration, amplitude, and arrests", J.
    Motor Behavior 41(6), 2009. Deviation: their D is the distance between the ends, which would be 0 on a round trip.

    The acceleration of an executed move jumps, and a jump has infinite jerk. So the acceleration, which is 0 before the
    start and after the end, is sampled at the middles of intervals of ``ramp`` seconds and interpolated linearly. A
    jump then contributes |Δp''|²/ramp to the integral. Compare only values with equal ``ramp``.
    """

    ramp: float = 0.1  # s, time over which a jump of the acceleration is spread

    def __post_init__(self) -> None:
        set_reals(self, "ramp", least=LEAST, most=MOST, kind="a positive time in s", error=CriterionError)

    def cost(self, m: History) -> Column:
        """Return the dimensionless squared jerk (M,) of the trajectory up to the end of each motion."""
        executed = m.executed
        samples = int(np.ceil(executed.duration / self.ramp))
        middles = self.ramp * (np.arange(samples, dtype=np.float64) + 0.5)
        acceleration = m.at(middles).twist_rate("base").velocity
        x, y = (np.where(middles < executed.duration, a, 0.0) for a in acceleration[:2])
        jumps = np.diff(x, prepend=0.0, append=0.0) ** 2 + np.diff(y, prepend=0.0, append=0.0) ** 2
        times = np.minimum(self.ramp * np.arange(samples + 1), executed.duration)
        elapsed = m.passed[1:]
        done = np.searchsorted(times, elapsed, side="right")
        jerk = np.concatenate([[0.0], np.cumsum(jumps / self.ramp)])[done]
        path = np.cumsum(m.of_motions(lambda motions: motions.base.length))
        return elapsed**5 * jerk / np.where(path > 0, path, np.inf) ** 2
