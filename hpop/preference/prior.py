"""Prior belief about the weights of a person, before any answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import real, whole
from hpop.base.text import set_python_values, shown
from hpop.errors import StudyError
from hpop.preference.answers import LOG, Measure

SELECTIVE = 0.3
"""Share of people who care for only some of the costs."""
SHARPNESS = 15.0
"""Median of the sharpness: a person errs once in 3 million choices across the whole range of the only cost."""

MOST_APART = 1.1
"""Largest ratio of two ranges of a logarithmic cost at which its shares are kept; they cannot be rescaled by units."""
MOST_SPREAD = 10.0
"""Largest spread of a logarithm; beyond, draws would overflow."""
MOST_STRETCH = 1e6
"""Largest ratio of ranges by which a prior is rescaled."""
MOST_COSTS = 1000
"""Largest number of costs."""
MOST_DRAWN = 30_000_000
"""Largest number of shares in one draw."""
LEAST_LOG = -600.0
"""Least logarithm of a share relative to the greatest."""


@checked_arguments
@dataclass(frozen=True)
class Prior:
    """Prior belief about a person's weights: Dirichlet for the shares, log-normal for sharpness and ties, independent.

    Some people answer at random: their sharpness is 0. Without them, the answer to the most informative question would
    always be uncertain, and a person without a preference could not be distinguished from a fastidious person.

    Some people care for some of the costs only: the shares of the other costs are 0. Without them no credible interval
    would include 0 or 1, because a Dirichlet distribution has no probability there (George and McCulloch 1993,
    "Variable selection via Gibbs sampling", Journal of the American Statistical Association 88, 881-889). For f costs,
    each number from 1 to f - 1 of cared-for costs is equally probable, and so is each subset of that size. Their shares
    are Dirichlet with the same concentrations.

    concentration    concentration of each share; empty: 1 for all, so that all shares are equally probable
    sharpness        median of the sharpness
    spread           standard deviation of the logarithm of the sharpness
    random           share of people who answer at random
    ties             median of Davidson's nu
    ties_spread      standard deviation of the logarithm of nu
    selective        share of people who care for some of the costs only
    about            name, unit and range of each cost on the front that earlier people answered about; empty: any
                     front. :meth:`on` rescales the prior to another front
    """

    concentration: tuple[float, ...] = ()
    sharpness: float = SHARPNESS
    spread: float = 0.7
    random: float = 0.2
    ties: float = 0.5
    ties_spread: float = 1.0
    selective: float = SELECTIVE
    about: tuple[Measure, ...] = ()
    _stretch: tuple[float, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        set_python_values(self)
        object.__setattr__(self, "concentration", tuple(map(float, self.concentration)))
        for name, most in (("sharpness", 1e3), ("spread", MOST_SPREAD), ("ties", 1e3), ("ties_spread", MOST_SPREAD)):
            real(f"{name} of the prior", getattr(self, name), 1e-3, most, "a positive number", error=StudyError)
        for name in ("random", "selective"):
            real(f"{name} of the prior", getattr(self, name), 0, 0.9, "a share", error=StudyError)
        for value in self.concentration:
            real("a concentration of the prior", value, 1e-2, 1e4, "a positive number", error=StudyError)

    def on(self, measures: Sequence[Measure]) -> Prior:
        """Return the prior for a front with other ranges of costs; a unit of each cost keeps its weight.

        A cost that is constant on one of the two fronts keeps its share. StudyError if costs or units differ, or if a
        range differs too much to rescale: that of a logarithmic cost by more than a tenth.
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
                f"the prior was learnt from people who were asked about {', '.join(known)}, but here the costs are "
                f"{', '.join(names)}; use one learnt from people who were asked about the same costs"
            )
        stretch = [range_ratio(known[one.name][0], one) for one in measures]
        return replace(
            self,
            concentration=tuple(known[name][1] for name in names),
            about=tuple(known[name][0] for name in names),
            _stretch=() if all(factor == 1.0 for factor in stretch) else tuple(stretch),
        )

    def concentrations(self, f: int) -> FloatArray:
        """Return the Dirichlet concentrations (f,) of the shares; StudyError if the prior is not for f costs."""
        f = whole("f", f, 1, MOST_COSTS, "a number of costs", error=StudyError)
        if not self.concentration:
            return np.ones(f)
        if len(self.concentration) != f:
            raise StudyError(
                f"the prior has concentrations of {len(self.concentration)} costs, but there are {f}: use one learnt "
                "from people who were asked about the same costs"
            )
        return np.array(self.concentration)

    def draw(self, f: int, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw ``count`` random people with f costs: shares (count, f), sharpness (count,) and ties (count,).

        People who answer at random come first. The share of a cost that a person does not care for is 0; other shares
        are above 0.
        """
        # By gamma variables in logarithms, so that small shares do not become 0.
        shape = self.concentrations(f)
        count = whole("count", count, 0, MOST_DRAWN // f, "a number of people", error=StudyError)
        logs = np.log(rng.standard_gamma(shape + 1.0, (count, f))) + np.log(rng.random((count, f))) / shape
        shares = shares_of(logs, self._cared_for(f, count, rng))
        sharpness = np.exp(log(self.sharpness) + self.spread * rng.standard_normal(count))
        sharpness[: round(self.random * count)] = 0.0
        ties = np.exp(log(self.ties) + self.ties_spread * rng.standard_normal(count))
        return *rescale_shares(shares, sharpness, self._range_factors(f)), ties

    def _cared_for(self, f: int, count: int, rng: np.random.Generator) -> BoolArray:
        """Draw ``count`` people, and return a mask (count, f): True where a person cares for a cost."""
        cared_for = np.ones((count, f), dtype=bool)
        if f > 1:
            selective = rng.random(count) < self.selective
            order = rng.random((count, f)).argsort(axis=1).argsort(axis=1)
            cared_for[selective] = (order < rng.integers(1, f, size=(count, 1)))[selective]
        return cared_for

    def log_density(self, shares: FloatArray, sharpness: FloatArray, ties: FloatArray) -> FloatArray:
        """Return the prior's log density (N,) of draws, over logarithms of ratios of shares, of sharpness and of ties.

        The density omits a constant and the probability of the subset of cared-for costs. Ratios are
        between shares above 0.
        """
        of_shares, of_others = self.log_densities(shares, sharpness, ties)
        return np.asarray(of_shares + of_others)

    def log_densities(
        self, shares: FloatArray, sharpness: FloatArray, ties: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the log densities of N draws: (N,) of the shares, and (N,) of sharpness and ties without a constant.

        Densities are over logarithms: of ratios of shares, of sharpness and of ties. So the Dirichlet exponent of each
        share is one larger than over shares (by the Jacobian). StudyError if sharpness or ties are not positive.
        """
        for name, values in (("sharpness", sharpness), ("ties", ties)):
            if not (np.asarray(values) > 0).all():
                raise StudyError(f"{name} must be positive numbers (N,), got {shown(values)}")
        shares, sharpness = rescale_shares(shares, sharpness, 1.0 / self._range_factors(shares.shape[1]))
        of_shares = log_dirichlet(shares, self.concentrations(shares.shape[1]))
        of_sharpness = ((np.log(sharpness) - log(self.sharpness)) / self.spread) ** 2
        of_ties = ((np.log(ties) - log(self.ties)) / self.ties_spread) ** 2
        return np.asarray(of_shares), np.asarray(-0.5 * (of_sharpness + of_ties))

    def _range_factors(self, f: int) -> FloatArray:
        """Return the ratio (f,) of the range of each cost on the front to the range to which the shares refer."""
        return np.array(self._stretch) if self._stretch else np.ones(f)


def shares_of(logs: FloatArray, cared_for: BoolArray) -> FloatArray:
    """Return shares (N, f) that add up to 1 in each row, from their logarithms, each row plus any constant.

    Shares are 0 where ``cared_for`` (N, f) is False.
    """
    logs = np.where(cared_for, logs, -np.inf)
    logs -= logs.max(axis=1, keepdims=True)
    shares = np.where(cared_for, np.exp(np.maximum(logs, LEAST_LOG)), 0.0)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def log_dirichlet(shares: FloatArray, concentrations: FloatArray) -> FloatArray:
    """Return the Dirichlet log density (...) of shares (..., f), over logarithms of their ratios.

    Shares of 0 are ignored.

    concentrations  (..., f)
    """
    from scipy.special import gammaln  # slow to import

    cared_for = shares > 0
    logs = np.log(np.where(cared_for, shares, 1.0))
    each = np.where(cared_for, concentrations, 0.0)
    constants = np.where(cared_for, gammaln(concentrations), 0.0).sum(axis=-1)
    return np.asarray((each * logs).sum(axis=-1) + gammaln(each.sum(axis=-1)) - constants)


def rescale_shares(shares: FloatArray, sharpness: FloatArray, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return shares (N, f) and sharpness (N,) after the ranges of the costs are multiplied by factors, (f,) or (N, f).

    A unit of each cost keeps its weight.
    """
    if (factors == 1.0).all():
        return shares, sharpness
    weights = shares * factors
    total = weights.sum(axis=1)
    return weights / total[:, None], sharpness * total


def range_ratio(known: Measure, other: Measure) -> float:
    """Return the ratio of a cost's range ``other`` to ``known``; 1 if one of them is 0.

    Raises StudyError if the units differ, or if the ratio is too far from 1 to rescale shares.
    """
    if known.unit != other.unit:
        raise StudyError(
            f"people were asked about {shown(known.name)} in {shown(known.unit)}, but here it is in "
            f"{shown(other.unit)}; use people who were asked in the same unit"
        )
    if not (known.size > 0 and other.size > 0):
        return 1.0
    factor = other.size / known.size
    most = MOST_APART if known.unit.startswith(f"{LOG} ") else MOST_STRETCH
    if not 1.0 / most <= factor <= most:
        raise StudyError(
            f"people were asked about a range of {shown(known.name)} of {known.size:g} {known.unit}, but here it is "
            f"{other.size:g}, so their shares say nothing here; use people who were asked about a similar range"
        )
    return factor
