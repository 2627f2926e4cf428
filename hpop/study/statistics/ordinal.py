"""Ordinal mixed model: cumulative logits of ordered scores, with a random intercept for each person.

P(score <= level j) = logistic(threshold_j - effects - person), where the intercepts of people are normal. Each distinct
score is a level; no distance between levels is assumed. The likelihood is integrated over the intercepts by adaptive
Gauss-Hermite quadrature (Liu and Pierce 1994, Biometrika 81, 624-629), as ``clmm`` of R's package *ordinal* does.
No well-maintained Python library has such models: statsmodels' OrderedModel has no random effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from scipy import optimize, stats
from scipy.special import expit, logit

from hpop.base.arrays import FloatArray, IntArray
from hpop.errors import StudyError

NODES = 15
"""Nodes of the quadrature; 1 is Laplace's approximation."""
NEWTON = 30
"""Most steps to the mode of a person's intercept."""
LEAST_SPREAD, MOST_SPREAD = -6.0, 3.0
"""Bounds of the logarithm of the standard deviation of people."""
UNBOUNDED = 15.0
"""Size of a logarithm of odds from which an effect counts as infinite."""
STEP = 1e-4
"""Step of the differences of gradients that give the information."""


class Ordered(NamedTuple):
    """Ordered scores of people, sorted by person.

    level    (N,)    index of each score's level, from 0
    begins   (n,)    first row of each person
    effects  (N, p)  values of the effects
    levels           number of levels
    """

    level: IntArray
    begins: IntArray
    effects: FloatArray
    levels: int


@dataclass(frozen=True, eq=False)
class OrdinalFit:
    """Maximum-likelihood fit of an ordinal mixed model, made by :func:`ordinal_mixed`.

    names           (p,) names of the effects
    parameters      first threshold, logarithms of the distances to the next ones, effects, logarithm of ``deviation``
    log_likelihood  at its maximum
    data            scores and effects
    """

    names: tuple[str, ...]
    parameters: FloatArray
    log_likelihood: float
    data: Ordered

    @property
    def effects(self) -> FloatArray:
        """Return the effects (p,): logarithms of ratios of odds; positive means higher scores."""
        return self.parameters[self.data.levels - 1 : -1]

    @property
    def thresholds(self) -> FloatArray:
        """Return the thresholds (levels - 1,) in rising order."""
        return thresholds_of(self.parameters, self.data.levels)

    @property
    def deviation(self) -> float:
        """Return the standard deviation of people's intercepts, on the scale of the effects."""
        return float(np.exp(self.parameters[-1]))

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (p, p) of the effects, from the observed information."""
        size = len(self.parameters)
        rows = [
            (_negative(self.parameters + step, self.data)[1] - _negative(self.parameters - step, self.data)[1])
            / (2 * STEP)
            for step in STEP * np.eye(size)
        ]
        information = (np.array(rows) + np.array(rows).T) / 2
        if self.parameters[-1] <= LEAST_SPREAD + STEP:  # people do not differ: the deviation is at its bound
            information = information[:-1, :-1]
        first = self.data.levels - 1
        inverse = np.linalg.pinv(information)
        return np.asarray(inverse[first : first + len(self.names), first : first + len(self.names)])


def ordinal_mixed(
    scores: FloatArray, people: IntArray, effects: FloatArray, names: Sequence[str], nodes: int = NODES
) -> OrdinalFit:
    """Fit an ordinal mixed model to scores, by maximum likelihood.

    scores   (N,)    numbers, of which only the order counts
    people   (N,)    number of the person who gave each score, from 0
    effects  (N, p)  values that the effects multiply, such as 1 for scores of a stimulus and 0 for others
    names    (p,)    of the effects, for messages
    nodes            number of nodes of the quadrature

    Raises StudyError for fewer than two people or levels, for effects that cannot be told apart, and for infinite ones.
    """
    order = np.argsort(people, kind="stable")
    levels, level = np.unique(scores[order], return_inverse=True)
    begins = np.flatnonzero(np.diff(people[order], prepend=-1))
    if len(levels) < 2 or len(begins) < 2:
        raise StudyError(
            f"a mixed model needs two people and two different scores or more, got {len(begins)} and {len(levels)}"
        )
    known = np.column_stack([np.ones(len(scores)), effects])
    if np.linalg.matrix_rank(known) < known.shape[1]:
        raise StudyError(
            f"the effects {', '.join(names)} cannot be told apart in these orders of stimuli, as some always occur "
            "together: ask more people in other orders, or leave out one of these effects; in a new study, take "
            "balanced orders (williams or permutations)"
        )
    data = Ordered(level.astype(np.int64), begins, effects[order], len(levels))
    below = np.cumsum(np.bincount(level))[:-1] / len(level)
    start = np.concatenate([_distances(logit(below)), np.zeros(len(names)), [0.0]])
    bounds = [(-40.0, 40.0), *[(-15.0, 5.0)] * (len(below) - 1), *[(-20.0, 20.0)] * len(names)]
    bounds.append((LEAST_SPREAD, MOST_SPREAD))
    options: Any = {"maxiter": 2000, "ftol": 1e-13, "gtol": 1e-7}
    found = optimize.minimize(
        _negative, start, args=(data, nodes), jac=True, method="L-BFGS-B", bounds=bounds, options=options
    )
    fit = OrdinalFit(tuple(names), np.asarray(found.x), -float(found.fun), data)
    if endless := [name for name, size in zip(names, np.abs(fit.effects), strict=True) if size > UNBOUNDED]:
        raise StudyError(
            f"the effect of {', '.join(endless)} has no finite estimate, since its scores are all higher or all lower "
            "than the others; ask more people, or use the default method"
        )
    return fit


class Ratio(NamedTuple):
    """Likelihood-ratio test of a fit against a fit with fewer effects: statistic, degrees of freedom and p."""

    statistic: float
    freedom: int
    p: float


def likelihood_ratio(full: OrdinalFit, fewer: OrdinalFit) -> Ratio:
    """Test whether the effects that ``fewer`` lacks are all 0, by chi-square."""
    statistic = max(0.0, 2.0 * (full.log_likelihood - fewer.log_likelihood))
    freedom = len(full.names) - len(fewer.names)
    return Ratio(statistic, freedom, float(stats.chi2.sf(statistic, freedom)))


def log_likelihood(parameters: FloatArray, data: Ordered, nodes: int = NODES) -> float:
    """Return the logarithm of the likelihood of parameters in the order of :attr:`OrdinalFit.parameters`."""
    return -_negative(parameters, data, nodes)[0]


def thresholds_of(parameters: FloatArray, count: int) -> FloatArray:
    """Return the thresholds (count - 1,) in parameters of a model with ``count`` levels."""
    return np.asarray(np.cumsum(np.concatenate([parameters[:1], np.exp(parameters[1 : count - 1])])))


def _distances(thresholds: FloatArray) -> FloatArray:
    """Return the first threshold, and the logarithms of the distances to the next ones."""
    return np.concatenate([thresholds[:1], np.log(np.diff(thresholds))])


def _negative(parameters: FloatArray, data: Ordered, nodes: int = NODES) -> tuple[float, FloatArray]:
    """Return the negative logarithm of the likelihood, and its gradient."""
    thresholds = thresholds_of(parameters, data.levels)
    ends = np.concatenate([[-np.inf], thresholds, [np.inf]])
    low, high = ends[data.level], ends[data.level + 1]  # (N,)
    fixed = data.effects @ parameters[data.levels - 1 : -1]
    deviation = float(np.exp(parameters[-1]))
    sizes = np.diff(data.begins, append=len(data.level))

    def total(values: FloatArray) -> FloatArray:
        return cast(FloatArray, np.add.reduceat(values, data.begins, axis=0))

    mode, curvature = np.zeros(len(data.begins)), np.ones(len(data.begins))
    for _ in range(NEWTON):
        shift = fixed + deviation * np.repeat(mode, sizes)
        above, under = expit(high - shift), expit(low - shift)
        slope = deviation * total(above + under - 1.0) - mode
        curvature = 1.0 + deviation**2 * total(above * (1 - above) + under * (1 - under))
        step = np.clip(slope / curvature, -2.0, 2.0)
        mode = mode + step
        if np.abs(step).max() < 1e-9:
            break
    at, weight = np.polynomial.hermite.hermgauss(nodes)
    width = 1.0 / np.sqrt(curvature)
    points = mode[:, None] + np.sqrt(2.0) * width[:, None] * at  # (n, nodes)
    rows = np.repeat(points, sizes, axis=0)
    shift = fixed[:, None] + deviation * rows
    above, under = expit(high[:, None] - shift), expit(low[:, None] - shift)
    chance = np.maximum(above - under, 1e-300)
    logs = total(np.log(chance)) + at**2 - points**2 / 2 + np.log(weight)
    most = logs.max(axis=1, keepdims=True)
    sums = np.exp(logs - most)
    each = most[:, 0] + np.log(sums.sum(axis=1)) + np.log(width) - np.log(np.pi) / 2

    # Fisher's identity: the gradient is the mean, over the intercepts given the scores, of that with known intercepts.
    share = np.repeat(sums / sums.sum(axis=1, keepdims=True), sizes, axis=0)
    of_shift = share * (above + under - 1.0)
    of_high = (share * above * (1 - above) / chance).sum(axis=1)
    of_low = (share * under * (1 - under) / chance).sum(axis=1)
    of_ends = np.bincount(data.level + 1, of_high, data.levels + 1) - np.bincount(data.level, of_low, data.levels + 1)
    later = np.cumsum(of_ends[1:-1][::-1])[::-1]  # a distance moves all later thresholds
    of_distances = np.concatenate([later[:1], later[1:] * np.exp(parameters[1 : data.levels - 1])])
    gradient = np.concatenate(
        [of_distances, of_shift.sum(axis=1) @ data.effects, [deviation * float((of_shift * rows).sum())]]
    )
    return -float(each.sum()), -gradient


class Crossover(NamedTuple):
    """Ordinal mixed model of stimuli that each person rated in an order of their own.

    fit      k - 1 stimuli against the first, then k - 1 places against the first, then effects of the stimulus before;
             of :func:`factorial`, levels of each factor against its first, then places
    without  likelihood-ratio tests by what is left out: "stimulus", "place" and, if included, "before"; or factors
    """

    fit: OrdinalFit
    without: dict[str, Ratio]

    def contrast(self, weights: FloatArray) -> tuple[float, float]:
        """Return a weighted sum of the effects, with weights (p,), and its standard error."""
        return float(weights @ self.fit.effects), float(np.sqrt(weights @ self.fit.covariance @ weights))


def crossover(values: FloatArray, places: IntArray, *, before: bool = False) -> Crossover:
    """Fit and test an ordinal mixed model of scores (n, k), which k stimuli got at places (n, k) of the order, from 1.

    With ``before``, the effects of the stimulus at the place before (first-order carry-over) are included. The
    effects of the k stimuli add up to 0, so that k - 1 are fitted; the first place has none. Missing scores (NaN) are
    left out, and the person's other scores are kept.

    Raises StudyError as :func:`ordinal_mixed` does.
    """
    n, k = values.shape
    earlier = np.argsort(places, axis=1)[np.arange(n)[:, None], places - 2]  # of first places: any
    last = np.eye(k)[:, :-1] - np.eye(k)[:, -1:]  # (k, k - 1): contrasts against the last stimulus
    blocks = {
        "stimulus": np.broadcast_to(np.eye(k)[:, 1:], (n, k, k - 1)),
        "place": np.eye(k)[places - 1][..., 1:],
    }
    if before:
        blocks["before"] = np.where(places[..., None] > 1, last[earlier], 0.0)
    return _left_out(values, blocks)


def factorial(values: FloatArray, places: IntArray, labels: Mapping[str, Sequence[str]]) -> Crossover:
    """Fit and test an ordinal mixed model of scores (n, k) by the factors of the k conditions, and by places (n, k).

    ``labels`` has the level of each condition (k,) by factor. Factors have no interactions in the model;
    those of one level are left out.

    Raises StudyError as :func:`ordinal_mixed` does.
    """
    n, k = values.shape
    levels = {name: np.unique(of, return_inverse=True) for name, of in labels.items()}
    blocks = {
        name: np.broadcast_to(np.eye(len(found))[index][:, 1:], (n, k, len(found) - 1))
        for name, (found, index) in levels.items()
        if len(found) > 1
    }
    return _left_out(values, blocks | {"place": np.eye(k)[places - 1][..., 1:]})


def _left_out(values: FloatArray, blocks: Mapping[str, FloatArray]) -> Crossover:
    """Fit scores (n, k) by all blocks of effects (n, k, p), and test it against each fit without one of the blocks."""
    known = ~np.isnan(values)
    people = np.broadcast_to(np.arange(len(values))[:, None], values.shape)[known]

    def fitted(names: Sequence[str]) -> OrdinalFit:
        effects = np.column_stack([np.empty((int(known.sum()), 0)), *(blocks[name][known] for name in names)])
        labels = [f"{name} {i}" for name in names for i in range(1, blocks[name].shape[2] + 1)]
        return ordinal_mixed(values[known], people, effects, labels)

    full = fitted(list(blocks))
    rest = {name: [other for other in blocks if other != name] for name in blocks}
    return Crossover(full, {name: likelihood_ratio(full, fitted(others)) for name, others in rest.items()})
