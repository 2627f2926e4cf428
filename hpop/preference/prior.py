"""What is thought of a person before any answer."""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import numpy as np

from hpop.arrays import FloatArray
from hpop.errors import StudyError
from hpop.options import real

SHARPNESS = 15.0
"""Median of the sharpness: over the whole range of its one cost a person errs once in 3 million times."""

LEAST_LOG = -600.0
"""Of a share beside the greatest: its logarithm is taken again."""


@dataclass(frozen=True)
class Prior:
    """Shares of a Dirichlet distribution, sharpness and ties of logarithmic normal ones, all independent.

    Some people answer just anything: their sharpness is 0. Without them the question that tells most is never one whose
    answer is known beforehand, so nothing would tell a person without a preference from a fastidious one.

    concentration    of the shares, one for each cost; none: 1 for all, so that all shares are alike probable
    sharpness        median
    spread           standard deviation of the sharpness's logarithm
    random           share of people who answer just anything
    ties             median of Davidson's nu
    ties_spread      standard deviation of its logarithm
    """

    concentration: tuple[float, ...] = ()
    sharpness: float = SHARPNESS
    spread: float = 0.7
    random: float = 0.2
    ties: float = 0.5
    ties_spread: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "concentration", tuple(map(float, self.concentration)))
        for name in ("sharpness", "spread", "ties", "ties_spread"):
            real(f"{name} of the prior", getattr(self, name), 1e-3, 1e3, "a positive number", error=StudyError)
        real("random of the prior", self.random, 0, 0.9, "a share", error=StudyError)
        for value in self.concentration:
            real("a concentration of the prior", value, 1e-2, 1e4, "a positive number", error=StudyError)

    def concentrations(self, f: int) -> FloatArray:
        """The concentration (f,) of each share."""
        if not self.concentration:
            return np.ones(f)
        if len(self.concentration) != f:
            raise StudyError(
                f"the prior has concentrations of {len(self.concentration)} costs, and there are {f}: take one learnt "
                "from people who were asked about the same costs"
            )
        return np.array(self.concentration)

    def draw(self, f: int, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shares (N, f), sharpness (N,) and ties (N,); the first ones are of people who answer just anything."""
        # By gamma variables in logarithms: no share is 0 that was merely small.
        shape = self.concentrations(f)
        logs = np.log(rng.standard_gamma(shape + 1.0, (count, f))) + np.log(rng.random((count, f))) / shape
        logs -= logs.max(axis=1, keepdims=True)
        shares = np.exp(np.maximum(logs, LEAST_LOG))
        shares /= shares.sum(axis=1, keepdims=True)
        sharpness = np.exp(log(self.sharpness) + self.spread * rng.standard_normal(count))
        sharpness[: round(self.random * count)] = 0.0
        ties = np.exp(log(self.ties) + self.ties_spread * rng.standard_normal(count))
        return shares, sharpness, ties

    def log_density(self, shares: FloatArray, sharpness: FloatArray, ties: FloatArray) -> FloatArray:
        """Logarithm (N,) of the density, but for a constant, over the logarithms of ratios of shares, sharpness, ties.

        Over ratios the Dirichlet density has one more of each share, which is its Jacobian.
        """
        of_shares = np.log(shares) @ self.concentrations(shares.shape[1])
        of_sharpness = ((np.log(sharpness) - log(self.sharpness)) / self.spread) ** 2
        of_ties = ((np.log(ties) - log(self.ties)) / self.ties_spread) ** 2
        return np.asarray(of_shares - 0.5 * (of_sharpness + of_ties))
