"""The best point of a front for a person, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.frontier.choosing import least
from hpop.preference.draws import Draws

NEAR = 0.02
"""Expected regret up to which a point is as good as the best, a share of the range of what the points cost a person."""
BLOCK = 4_000_000
"""Costs of points by draws that are held at once."""


@checked_arguments
@dataclass(frozen=True, eq=False)
class Best:
    """The best point for a person.

    row          of the front: the least expected cost
    point        of that row
    probability  (n,)  of each row, that it is the best one
    regrets      (n,)  what each row is expected to cost more than the best one, as a share of the range of what the
                       rows cost this person
    near         rows with an expected regret of at most 2 % more than the best one's, the least first
    """

    row: int
    point: Any
    probability: FloatArray
    regrets: FloatArray
    near: tuple[int, ...]

    @property
    def regret(self) -> float:
        """Expected regret of the best row, a share."""
        return float(self.regrets[self.row])

    def __repr__(self) -> str:
        return (
            f"<Best: row {self.row}, the best one with probability {self.probability[self.row]:.2f}, expected regret "
            f"{100 * self.regret:.1f} %>"
        )


def row_of(rows: FloatArray, shares: FloatArray) -> int:
    """The row of (n, f) of least expected cost, for the mean shares (f,); of equal ones never a dominated one."""
    return least(rows @ shares, rows.sum(axis=1))


def judged(rows: FloatArray, draws: Draws) -> tuple[FloatArray, FloatArray]:
    """Return the probability of each of the rows (n, f) to be the best, and its expected regret, by equal draws.

    Of rows that cost a person the same who cares for some of the costs only, one counts: that of the least sum.
    """
    order = np.argsort(rows.sum(axis=1), kind="stable")
    rows = rows[order]
    counts, regrets = np.zeros(len(rows)), np.zeros(len(rows))
    size = max(1, BLOCK // len(rows))
    for begin in range(0, len(draws), size):
        costs = draws.shares[begin : begin + size] @ rows.T  # (draws, n)
        low = costs.min(axis=1, keepdims=True)
        span = costs.max(axis=1, keepdims=True) - low
        np.subtract(costs, low, out=costs)
        np.divide(costs, span, out=costs, where=span > 0)
        regrets += costs.sum(axis=0)
        counts += np.bincount(costs.argmin(axis=1), minlength=len(rows))
    places = np.argsort(order)
    return counts[places] / len(draws), regrets[places] / len(draws)


def judged_alone(rows: FloatArray, draws: Draws, row: int) -> tuple[float, float]:
    """Return the same of one row, in less than half the time."""
    order = np.argsort(rows.sum(axis=1), kind="stable")
    rows, row = rows[order], int(np.flatnonzero(order == row)[0])
    costs = draws.shares @ rows.T  # (draws, n)
    first = costs.argmin(axis=1)
    low = costs[np.arange(len(costs)), first]
    span = costs.max(axis=1) - low
    regrets = (costs[:, row] - low) / np.where(span > 0, span, 1.0)
    return float((first == row).mean()), float(regrets.mean())
