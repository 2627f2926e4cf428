"""What is thought of a person before any answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log

import numpy as np

from hpop.arguments import checked_arguments
from hpop.arrays import FloatArray
from hpop.errors import StudyError
from hpop.options import real
from hpop.preference.scale import LOG, Measure
from hpop.scalars import set_python_values
from hpop.text import shown

SHARPNESS = 15.0
"""Median of the sharpness: over the whole range of its one cost a person errs once in 3 million times."""

MOST_APART = 1.1
"""Ratio of ranges up to which shares of a logarithmic cost are about the same: it has no unit to be rescaled by."""
MOST_SPREAD = 10.0
"""Of a logarithm: beyond, what is drawn would overflow."""
MOST_STRETCH = 1e6
"""Ratio of ranges that a prior is rescaled by, at most."""
LEAST_LOG = -600.0
"""Of a share beside the greatest: its logarithm is taken again."""


@checked_arguments
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
    about            what the shares are of, by name, unit and range, of the front that earlier people were asked about;
                     none: of any front that is asked about. On another front it is rescaled by units: see :meth:`on`
    """

    concentration: tuple[float, ...] = ()
    sharpness: float = SHARPNESS
    spread: float = 0.7
    random: float = 0.2
    ties: float = 0.5
    ties_spread: float = 1.0
    about: tuple[Measure, ...] = ()
    _stretch: tuple[float, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        set_python_values(self)
        object.__setattr__(self, "concentration", tuple(map(float, self.concentration)))
        for name, most in (("sharpness", 1e3), ("spread", MOST_SPREAD), ("ties", 1e3), ("ties_spread", MOST_SPREAD)):
            real(f"{name} of the prior", getattr(self, name), 1e-3, most, "a positive number", error=StudyError)
        real("random of the prior", self.random, 0, 0.9, "a share", error=StudyError)
        for value in self.concentration:
            real("a concentration of the prior", value, 1e-2, 1e4, "a positive number", error=StudyError)

    def on(self, measures: Sequence[Measure]) -> Prior:
        """The same, of shares of other ranges: what a unit is thought to count stays.

        A cost that is the same all over one of two fronts keeps its share. StudyError where costs or units differ, and
        for a logarithmic cost of another range.
        """
        if not self.about:
            return self
        known = {
            one.name: (one, value)
            for one, value in zip(self.about, self.concentrations(len(self.about)).tolist(), strict=True)
        }
        names = [one.name for one in measures]
        if {*known} != {*names}:
            raise StudyError(
                f"the prior is of people who were asked about {', '.join(known)}, and here the costs are "
                f"{', '.join(names)}; take one learnt from people who were asked about the same costs"
            )
        stretch = [stretched(known[one.name][0], one) for one in measures]
        return replace(
            self,
            concentration=tuple(known[name][1] for name in names),
            about=tuple(known[name][0] for name in names),
            _stretch=() if all(factor == 1.0 for factor in stretch) else tuple(stretch),
        )

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
        return *rescaled(shares, sharpness, self._factors(f)), ties

    def log_density(self, shares: FloatArray, sharpness: FloatArray, ties: FloatArray) -> FloatArray:
        """Logarithm (N,) of the density, but for a constant: over logarithms of ratios of shares, sharpness, ties."""
        of_shares, of_others = self.log_densities(shares, sharpness, ties)
        return np.asarray(of_shares + of_others)

    def log_densities(
        self, shares: FloatArray, sharpness: FloatArray, ties: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The same of shares (N,), and of sharpness and ties (N,), apart.

        Over ratios the Dirichlet density has one more of each share, which is its Jacobian. That of other ranges is 1.
        """
        shares, sharpness = rescaled(shares, sharpness, 1.0 / self._factors(shares.shape[1]))
        of_shares = np.log(shares) @ self.concentrations(shares.shape[1])
        of_sharpness = ((np.log(sharpness) - log(self.sharpness)) / self.spread) ** 2
        of_ties = ((np.log(ties) - log(self.ties)) / self.ties_spread) ** 2
        return np.asarray(of_shares), np.asarray(-0.5 * (of_sharpness + of_ties))

    def _factors(self, f: int) -> FloatArray:
        """By what a range of the front asked about is greater than that of which the shares are (f,)."""
        return np.array(self._stretch) if self._stretch else np.ones(f)


def rescaled(shares: FloatArray, sharpness: FloatArray, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares (N, f) and sharpness (N,) of ranges so many times as great, (f,) or (N, f): a unit weighs the same."""
    if (factors == 1.0).all():
        return shares, sharpness
    weights = shares * factors
    total = weights.sum(axis=1)
    return weights / total[:, None], sharpness * total


def stretched(known: Measure, other: Measure) -> float:
    """How many times as great the range of the other one is; 1 where one of both says nothing. StudyError by units."""
    if known.unit != other.unit:
        raise StudyError(
            f"people were asked about {shown(known.name)} in {shown(known.unit)}, here it is in {shown(other.unit)}; "
            "take people who were asked in the same unit"
        )
    if not (known.size > 0 and other.size > 0):
        return 1.0
    factor = other.size / known.size
    most = MOST_APART if known.unit.startswith(f"{LOG} ") else MOST_STRETCH
    if not 1.0 / most <= factor <= most:
        raise StudyError(
            f"people were asked about a range of {shown(known.name)} of {known.size:g} {known.unit}, here it is "
            f"{other.size:g}: shares of the one say nothing of the other; take people who were asked about the same"
        )
    return factor
