"""Joints of arms: how far and how fast they move, how near they are to their end stops, and singularity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import dot, norm
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Model, Motions, States


def joint_rates(m: Motions, s: Instants) -> list[Column]:
    """Return the speed of each joint at the moments ``s``, rad/s or m/s, as a list of columns."""
    return [getattr(s.rates, name) for name in m.model.joints]


@criterion("joint_length", group="R", unit="rad", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointLength:
    """Length of the path in the space of the joints q: ∫ |q'| dt.

    Unit rad; a sum over motions. All joints have equal weight; a metre of a sliding joint counts as a radian. For a
    robot that also drives, only the joints of its arm or head count; ``length`` measures the path of the base.

    Source: planners for arms minimise it by default, and studies compare paths of arms by it (path length in
    MotionBenchMaker and OMPL, Chamzas et al., RA-L 2022).
    """

    def cost(self, m: Motions) -> Column:
        """Return the length (M,), rad."""
        return m.integrate(lambda s: norm(joint_rates(m, s)))


@criterion("joint_energy", group="R", unit="rad²/s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointEnergy:
    """Effort of the joints: Σ ∫ q'² dt over the joints q.

    Unit rad²/s; a sum over motions. One fast joint costs more than several slow ones, and a fast motion more than a
    slow one: a joint that moves by the angle θ from rest to rest in the time T costs at least θ²/T. This is not an
    energy in joules, since it ignores masses and gravity. A metre of a sliding joint counts as a radian.

    Source: the usual quadratic effort of trajectories (the velocity term of RelaxedIK, Rakita, Mutlu and Gleicher, RSS
    2018; of CHOMP, Zucker et al., IJRR 2013).
    """

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,), rad²/s."""
        return m.integrate(lambda s: sum(rate * rate for rate in joint_rates(m, s)))


@criterion("joint_limits", group="R", unit="s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointLimits:
    """Nearness of the joints to their end stops, over time: ∫ mean over joints of ((q - middle) / (half range))² dt.

    The integrand is 0 if all joints are in the middle of their ranges, and 1 if every joint is at a stop. Unit s; a sum
    over motions. Joints that turn without end and fixed joints have no stops and do not count. For a robot with such
    joints only, the cost is 0.

    Source: Liégeois, "Automatic supervisory control of the configuration and behavior of multibody mechanisms", IEEE
    Trans. SMC 7(12), 1977. The square involves all joints, but most of all those near their stops.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), s, of the nearness to stops, 0 to 1, averaged over the joints with stops."""
        space = m.model.space
        stops = [(name, space.low[i], space.high[i]) for i, name in enumerate(space.names) if name not in space.turning]
        ranges = [
            (name, 0.5 * (low + high), 0.5 * (high - low))
            for name, low, high in stops
            if name in m.model.joints and low < high
        ]
        if not ranges:
            return 0.0 * m.duration

        def nearness(s: Instants) -> Column:
            return sum(((getattr(s.state, name) - middle) / half) ** 2 for name, middle, half in ranges) / len(ranges)

        return m.integrate(nearness)


FLAT = 1e-12  # a pivot below this share of its diagonal entry counts as a rounding error


@criterion("singularity", group="R", unit="s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class Singularity:
    """Time near singular states of the arm: ∫ 1 / (1 + μ/μ0) dt, where μ = sqrt(det(J Jᵀ)) is the manipulability.

    half  μ0, the manipulability at which a second costs half a second

    A second in a singular state costs 1 s; far from any, it costs almost nothing. Unit s; a sum over motions.

    Source: Yoshikawa, "Manipulability of robotic mechanisms", IJRR 4(2), 1985. J (6, n) is the Jacobian of the tool, or
    of the camera if there is no tool: velocity above angular velocity, in m and rad without scaling. So the unit of μ
    depends on the robot, and ``half`` must be chosen for each robot; 0.05 suits arms of about a metre with six joints.
    With fewer than six joints, μ = sqrt(det(Jᵀ J)), which tells how well the joints move the tool in the directions in
    which they can move it.
    """

    half: float = 0.05

    def __post_init__(self) -> None:
        set_reals(self, "half", least=LEAST, most=MOST, kind="a manipulability", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the weighted time (M,), s, near singular states."""
        return m.integrate(lambda s: 1.0 / (1.0 + manipulability(m.model, s.state) / self.half))


def manipulability(model: Model, states: States) -> Column:
    """Return the manipulability (N,), sqrt(det(J Jᵀ)), of the tool, or of the camera if the model has no tool.

    With fewer than six joints it is sqrt(det(Jᵀ J)).
    """
    body = "tool" if "tool" in model.provides else "camera"
    rows = []  # rows of Jᵀ: velocity and angular velocity when one joint moves at unit speed
    for joint in model.joints:
        rates = States(**{name: np.full(states.size, float(name == joint)) for name in model.space.names})
        twist = model.twist(body, states, rates)
        rows.append([*twist.velocity, *twist.rotation])
    if len(rows) > 6:
        rows = [list(column) for column in zip(*rows, strict=True)]
    gram = [[dot(a, b) for b in rows] for a in rows]
    square = _determinant(gram)
    positive = square > 0.0
    return np.where(positive, np.sqrt(np.where(positive, square, 1.0)), 0.0)


def _determinant(gram: list[list[Column]]) -> Column:
    """Return the determinants (N,) of positive semidefinite matrices by elimination without pivoting.

    If a pivot is zero, so is the determinant, and what would be divided by the pivot does not matter.
    """
    rows = [list(row) for row in gram]
    product: Column = 1.0
    for k, top in enumerate(rows):
        pivot = top[k]
        regular = pivot > FLAT * (gram[k][k] + FLAT)
        product = product * np.where(regular, pivot, 0.0)
        inverse = np.where(regular, 1.0 / np.where(regular, pivot, 1.0), 0.0)
        for row in rows[k + 1 :]:
            factor = row[k] * inverse
            for j in range(k + 1, len(rows)):
                row[j] = row[j] - factor * top[j]
    return product
