"""Singularity: how little the joints can move the tool in some direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import dot
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Model, Motions, States

FLAT = 1e-12  # share of a diagonal entry below which a pivot is a rounding error


@criterion("singularity", group="R", unit="s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class Singularity:
    """Time near singular postures: ∫ 1 / (1 + μ/μ0) dt, μ = sqrt(det(J Jᵀ)) the manipulability.

    half  μ0, the manipulability at which a second costs half a second

    A second costs 1 s in a singular posture, and falls to 0 far from any. Unit s; a sum over motions.

    Source: Yoshikawa, "Manipulability of robotic mechanisms", IJRR 4(2), 1985. J (6, n) is the Jacobian of the tool, or
    of the camera where there is no tool: velocity above rotation, in m and rad without scaling. So μ has a unit that
    depends on the robot, and ``half`` belongs to one robot; 0.05 suits arms of about a metre with six joints. With
    fewer than six joints, μ = sqrt(det(Jᵀ J)): how well the joints move the tool in those directions in which they can
    move it.
    """

    half: float = 0.05

    def __post_init__(self) -> None:
        set_reals(self, "half", least=LEAST, most=MOST, kind="a manipulability", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), s."""
        return m.integrate(lambda s: 1.0 / (1.0 + manipulability(m.model, s.state) / self.half))


def manipulability(model: Model, states: States) -> Column:
    """Return sqrt(det(J Jᵀ)) (N,) of the tool, or else of the camera; of Jᵀ J with fewer than six joints."""
    body = "tool" if "tool" in model.provides else "camera"
    rows = []  # of Jᵀ: the twist caused by each joint at unit speed
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
    """Return the determinant (N,) of positive semidefinite matrices, by elimination without pivoting.

    A zero pivot makes the determinant zero, so divisions by it do not matter.
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
