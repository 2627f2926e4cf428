"""Posterior of a person's weights as weighted random draws; the best point for the person; the next question to ask.

Draws of the prior are weighted by the probability of the answers. This is exact up to the number of draws, whereas
a normal approximation would fail where a share may be 0. With more answers, fewer draws carry the weight. Once the
effective sample size is less than ``LEAST_EFFECTIVE``, draws are resampled, and each is moved by a random walk
that leaves the posterior invariant (Metropolis; Chopin 2002, "A sequential particle filter method for static
models"). The walk keeps shares of 0, so the fraction of draws with such shares is the probability that the person
cares for some costs only.

Questions are chosen by Bayesian active learning by disagreement (Houlsby et al. 2011, arXiv 1112.5745): the answer to
the best question is uncertain overall, although it would be certain if the person's weights were known. Candidates are
random pairs, and pairs among the rows that are currently most often the best.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.frontier.choosing import least
from hpop.preference.answers import BLOCK, Evidence, answer_probabilities
from hpop.preference.prior import Prior, shares_of

COUNT = 20_000
"""Number of draws of the posterior."""
LEAST_EFFECTIVE = 500
"""Least effective sample size; below it, draws are resampled."""
RENEWED = 5_000
"""Number of resampled draws: ten times ``LEAST_EFFECTIVE``."""
LEAST_ALIKE = 40
"""Least effective sample size at which the covariance of draws that care for the same costs is used."""
STEPS = 12
"""Number of steps of the random walk, which separates duplicate draws."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Random draws of one person's weights, each with an importance weight.

    shares     (N, f)  share of each cost, each row adds up to 1
    sharpness  (N,)    factor from shares to weights; 0 for a person who answers at random
    ties       (N,)    tendency to answer "no difference" (Davidson's nu)
    logs       (N,)    logarithms of the importance weights of the draws
    """

    shares: FloatArray
    sharpness: FloatArray
    ties: FloatArray
    logs: FloatArray

    @classmethod
    def of(cls, prior: Prior, f: int, count: int, rng: np.random.Generator) -> Draws:
        """Return draws of the prior for f costs, with equal importance weights."""
        return cls(*prior.draw(f, count, rng), np.zeros(count))

    def __len__(self) -> int:
        return len(self.logs)

    @property
    def weights(self) -> FloatArray:
        """Weights (N, f) of the costs: sharpness times shares."""
        return np.asarray(self.sharpness[:, None] * self.shares)

    def probability(self) -> FloatArray:
        """Return the probability of each draw (N,); they add up to 1."""
        size = np.exp(self.logs - self.logs.max())
        return np.asarray(size / size.sum())

    @property
    def effective(self) -> float:
        """Effective sample size: 1 / sum of the squared probabilities (Kong 1992)."""
        return float(1.0 / (self.probability() ** 2).sum())

    def with_answers(self, new: Evidence, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Return the draws after further answers: reweighted, and resampled if too few of them carry the weight.

        new    the further answers
        known  all answers, including the further ones
        """
        draws = replace(self, logs=self.logs + new.log_probability(self.weights, self.ties))
        return draws.resampled(known, prior, rng) if draws.effective < LEAST_EFFECTIVE else draws

    def resampled(self, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Return at most ``RENEWED`` draws of equal weight; those of sharpness above 0 are moved by the random walk.

        ``known`` are all answers. Where the sharpness is 0, answers carry no information on shares and ties, so these
        are drawn from the prior.
        """
        draws = self.equally_weighted(min(len(self), RENEWED), rng)
        sharp = draws.sharpness > 0
        shares, _, ties = replace(prior, random=0.0).draw(draws.shares.shape[1], int((~sharp).sum()), rng)
        of_random = Draws(shares, np.zeros(len(ties)), ties, np.zeros(len(ties)))
        if not sharp.any():
            return of_random
        moved = draws._subset(sharp)._random_walk(self._subset(self.sharpness > 0), known, prior, rng)
        return of_random._concatenated(moved)

    def _random_walk(self, before: Draws, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Move each draw by a random walk that leaves the posterior invariant; return the moved draws.

        ``before`` are the weighted draws; their spread sets the length of the steps.
        """
        place, cared_for = _unbounded_coordinates(self), self.shares > 0
        groups = _covariance_groups(before, cared_for)
        density = _log_density(self, known, prior)
        for step in range(STEPS):
            length = 1.0 if step % 3 else 0.3  # every third step is short: the posterior may be curved
            away = length * rng.standard_normal(place.shape)
            for rows, root in groups:
                away[rows] = away[rows] @ root.T
            moved = place + away
            there = _log_density(_from_unbounded(moved, cared_for), known, prior)
            taken = np.log(rng.random(len(place))) < there - density
            place[taken], density[taken] = moved[taken], there[taken]
        return _from_unbounded(place, cared_for)

    def _subset(self, kept: BoolArray) -> Draws:
        """Return the draws that a mask keeps."""
        return Draws(self.shares[kept], self.sharpness[kept], self.ties[kept], self.logs[kept])

    def _concatenated(self, other: Draws) -> Draws:
        """Return these draws followed by others."""
        columns = ((mine, its) for mine, its in zip(vars(self).values(), vars(other).values(), strict=True))
        return Draws(*(np.concatenate(pair) for pair in columns))

    def equally_weighted(self, count: int, rng: np.random.Generator) -> Draws:
        """Return ``count`` draws of equal weight that represent the weighted draws (systematic resampling)."""
        rows = self._systematic_rows(count, rng)
        return Draws(self.shares[rows], self.sharpness[rows], self.ties[rows], np.zeros(count))

    def _systematic_rows(self, count: int, rng: np.random.Generator) -> IntArray:
        """Return the rows of the draws that systematic resampling selects."""
        ends = np.cumsum(self.probability())
        parts = (np.arange(count) + rng.random()) / count * ends[-1]
        return np.asarray(np.minimum(np.searchsorted(ends, parts, side="right"), len(self) - 1))


def _covariance_groups(before: Draws, cared_for: BoolArray) -> list[tuple[IntArray, FloatArray]]:
    """Group the draws that care for the same costs, and return how a random step is scaled in each group.

    A group is the rows of its draws in ``cared_for``, and a matrix that turns a standard normal step into a step of the
    random walk: a root of the group's weighted covariance, times the best length of a step. Draws of groups that are
    too small for a covariance are the last group; its root is the diagonal of the standard deviations of all draws.

    before     weighted draws, from which covariances are computed
    cared_for  (N, f)  True where a draw to be moved cares for a cost
    """
    place, probability = _unbounded_coordinates(before), before.probability()
    middle = probability @ place
    deviations = np.sqrt(np.maximum(probability @ (place - middle) ** 2, 1e-12))
    kinds, kind = np.unique(np.concatenate([cared_for, before.shares > 0]), axis=0, return_inverse=True)
    kind, earlier = kind.ravel()[: len(cared_for)], kind.ravel()[len(cared_for) :]
    counts, size = np.bincount(kind, minlength=len(kinds)), place.shape[1]
    groups: list[tuple[IntArray, FloatArray]] = []
    few = np.ones(len(cared_for), dtype=bool)
    for number in np.flatnonzero(counts >= LEAST_ALIKE).tolist():
        same = earlier == number
        weight = probability[same] / probability[same].sum()
        if (weight**2).sum() * LEAST_ALIKE > 1.0:
            continue
        away = place[same] - weight @ place[same]
        values, vectors = np.linalg.eigh((away * weight[:, None]).T @ away)
        free = int(kinds[number].sum()) + 1  # ratios of shares, sharpness and ties
        groups.append(
            (np.flatnonzero(kind == number), vectors * np.sqrt(np.maximum(values, 1e-12)) * _best_step_length(free))
        )
        few &= kind != number
    if few.any():
        groups.append((np.flatnonzero(few), np.diag(deviations) * _best_step_length(size - 1)))
    return groups


def _best_step_length(dimensions: int) -> float:
    """Return the best length of a Metropolis step in several dimensions, in standard deviations.

    Roberts and Rosenthal 2001.
    """
    return float(2.38 / np.sqrt(dimensions))


def _unbounded_coordinates(draws: Draws) -> FloatArray:
    """Return draws in unbounded coordinates (N, f + 2): logarithms of f shares, of the sharpness and of ``ties``.

    The logarithms of the shares are centred: their mean is 0.
    The logarithm of a share of 0 is set to 0 and is ignored.
    """
    cared_for = draws.shares > 0
    logs = np.log(np.where(cared_for, draws.shares, 1.0))
    logs -= np.where(cared_for, logs.sum(axis=1, keepdims=True) / cared_for.sum(axis=1, keepdims=True), 0.0)
    return np.column_stack([logs, np.log(draws.sharpness), np.log(draws.ties)])


def _from_unbounded(place: FloatArray, cared_for: BoolArray) -> Draws:
    """Convert unbounded coordinates (N, f + 2) back to equally weighted draws; shares outside ``cared_for`` are 0."""
    shares = shares_of(place[:, :-2], cared_for)
    return Draws(shares, np.exp(place[:, -2]), np.exp(place[:, -1]), np.zeros(len(place)))


def _log_density(draws: Draws, known: Evidence, prior: Prior) -> FloatArray:
    """Return the logarithm (N,) of the posterior density of draws, in unbounded coordinates, up to a constant."""
    of_prior = prior.log_density(draws.shares, draws.sharpness, draws.ties)
    return np.asarray(of_prior + known.log_probability(draws.weights, draws.ties))


NEAR = 0.02
"""Expected regret below which a point counts as good as the best: a share of the range of total costs."""
CELLS = 4_000_000
"""Largest number of costs (points times draws) that are computed in one block."""


@checked_arguments
@dataclass(frozen=True, eq=False)
class Best:
    """Best point of a front for a person: the point with the least expected total cost.

    row          row of the point in the front
    point        the point itself
    probability  (n,)  probability of each row to be the best
    regrets      (n,)  expected extra total cost of each row over the row that is best for the true weights, as a share
                 of the range of total costs over the front
    near         ``row``, then the rows whose expected regret is at most 0.02 above that of ``row``, in ascending order
    """

    row: int
    point: Any
    probability: FloatArray
    regrets: FloatArray
    near: tuple[int, ...]

    @property
    def regret(self) -> float:
        """Expected regret of the best row: what the person loses on average, as a share of the range of total costs."""
        return float(self.regrets[self.row])

    def __repr__(self) -> str:
        return (
            f"<Best: row {self.row}, the best one with probability {self.probability[self.row]:.2f}, expected regret "
            f"{100 * self.regret:.1f} %>"
        )


def least_cost_row(rows: FloatArray, shares: FloatArray) -> int:
    """Return the row of scaled costs (n, f) whose expected total cost, for mean shares (f,), is least.

    If several are equal, it is a row that no other row dominates.
    """
    return least(rows @ shares, rows.sum(axis=1))


def best_probability_and_regret(rows: FloatArray, draws: Draws) -> tuple[FloatArray, FloatArray]:
    """Return each row's probability (n,) to be the best, and its expected regret (n,), over equally weighted draws.

    The regret of a row for a draw is its total cost minus the least one, as a share of the range of total costs.

    A draw that cares for some costs only may give rows (n, f) an equal cost. Then the row with the least sum of all
    costs is the best.
    """
    order = np.argsort(rows.sum(axis=1), kind="stable")
    rows = rows[order]
    counts, regrets = np.zeros(len(rows)), np.zeros(len(rows))
    size = max(1, CELLS // len(rows))
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


def row_probability_and_regret(rows: FloatArray, draws: Draws, row: int) -> tuple[float, float]:
    """Return the probability to be the best, and the expected regret, of one row, over equally weighted draws.

    It is twice as fast as :func:`best_probability_and_regret`, which does this for all rows.
    """
    order = np.argsort(rows.sum(axis=1), kind="stable")
    rows, row = rows[order], int(np.flatnonzero(order == row)[0])
    costs = draws.shares @ rows.T  # (draws, n)
    first = costs.argmin(axis=1)
    low = costs[np.arange(len(costs)), first]
    span = costs.max(axis=1) - low
    regrets = (costs[:, row] - low) / np.where(span > 0, span, 1.0)
    return float((first == row).mean()), float(regrets.mean())


PAIRS = 400
"""Number of pairs that are drawn at random as candidates for a question."""
FAVOURITES = 8
"""Number of rows that are most often the best; all pairs of these are candidates for a question."""
NOTICEABLE = 0.05
"""Least difference that a pair must have in some cost, as a share of its range."""


def most_informative_pair(
    rows: FloatArray,
    draws: Draws,
    asked: Collection[tuple[int, int]],
    rng: np.random.Generator,
    *,
    ties: bool,
) -> tuple[int, int] | None:
    """Return the pair of rows about which to ask next, the left one first; None if all remaining pairs are too similar.

    Parameters
    ----------
    rows : (n, f) array
        Scaled costs of the front: 0 for the least of each cost, 1 for the greatest.
    draws
        Equally weighted draws of the posterior.
    asked
        Earlier pairs, in the order in which they were shown. No pair is repeated; an earlier pair is asked in reverse
        order only if there is no new pair.
    ties
        True if "no difference" is a possible answer.
    """
    pairs = _candidate_pairs(rows, draws, rng)
    numbers = {a * len(rows) + b for a, b in asked}
    known, turned = (np.isin(pairs @ order, list(numbers)) for order in ([len(rows), 1], [1, len(rows)]))
    fresh = bool((~(known | turned)).any())
    other_way = np.where(known[:, None], pairs[:, ::-1], pairs)[~(known & turned)]
    pairs = pairs[~(known | turned)] if fresh else other_way
    if not len(pairs):
        return None
    gains = (rows[pairs[:, 1]] - rows[pairs[:, 0]]) @ draws.weights.T  # (pairs, draws)
    best = int(np.argmax(expected_information(gains, draws.ties if ties else None)))
    a, b = pairs[best].tolist()
    return (b, a) if fresh and rng.random() < 0.5 else (a, b)


def expected_information(gains: FloatArray, ties: FloatArray | None) -> FloatArray:
    """Return how much information (pairs,), in nats, an answer about each pair is expected to give about the weights.

    gains  (pairs, draws)  extra cost of the second row over the first, with the weights of each draw
    ties   (draws,)  tendency to answer "no difference" (Davidson's nu); None if that is not a possible answer
    """
    told = np.zeros(len(gains))
    size = max(1, BLOCK // gains.shape[1])
    for begin in range(0, len(gains), size):
        part = slice(begin, begin + size)
        for chances in answer_probabilities(gains[part], ties):
            mean = chances.mean(axis=1)
            told[part] += np.einsum("pd,pd->p", chances, np.log(chances)) / chances.shape[1] - mean * np.log(mean)
    return told


def _candidate_pairs(rows: FloatArray, draws: Draws, rng: np.random.Generator) -> IntArray:
    """Return pairs of rows (m, 2) that differ noticeably, as candidates for the next question.

    These are all pairs if there are at most :data:`PAIRS`; otherwise :data:`PAIRS` random pairs, and all pairs of the
    :data:`FAVOURITES` rows that are best for most draws.
    """
    n = len(rows)
    if n * (n - 1) // 2 <= PAIRS:
        pairs = np.column_stack(np.triu_indices(n, 1))
    else:
        found, counts = np.unique((draws.shares @ rows.T).argmin(axis=1), return_counts=True)
        top = found[np.argsort(-counts, kind="stable")[:FAVOURITES]]
        favourites = top[np.column_stack(np.triu_indices(len(top), 1))]
        pairs = np.concatenate([favourites, rng.integers(n, size=(PAIRS, 2))])
    apart = np.abs(rows[pairs[:, 0]] - rows[pairs[:, 1]]).max(axis=1)
    return np.asarray(pairs[apart >= NOTICEABLE])
