"""Singularity: how near the arm is to states in which its joints cannot move the tool in some direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import dot
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Model, Motions, States

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
