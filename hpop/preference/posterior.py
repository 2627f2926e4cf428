"""Posterior of a person's weights as weighted draws, the best point for the person, and the next question.

Draws of the prior are weighted by the probability of the answers. That is exact up to the number of draws; a normal
approximation would fail where a share may be 0. With more answers, fewer draws carry the weight. Once they count for
less than ``LEAST_EFFECTIVE`` equal ones, they are resampled, and each is moved by a random walk that keeps the
posterior (Metropolis; Chopin 2002, "A sequential particle filter method for static models"). A share of 0 stays 0 in
that walk: the probability of caring for some costs only is the fraction of draws with such shares.

Questions are chosen by Bayesian active learning by disagreement (Houlsby et al. 2011, arXiv 1112.5745): the best
question has an open answer, although each person with certain weights would be sure of it. Pairs are drawn at random,
and pairs among the present favourites are added.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.frontier.choosing import least
from hpop.preference.answers import BLOCK, Evidence, probabilities
from hpop.preference.prior import Prior, shares_of

COUNT = 20_000
"""Draws of the posterior."""
LEAST_EFFECTIVE = 500
"""Least equivalent number of equal draws; below, draws are renewed."""
RENEWED = 5_000
"""Number of renewed draws: ten times the equivalent number."""
LEAST_ALIKE = 40
"""Least equivalent number of draws that care for the same costs, for using their covariance."""
STEPS = 12
"""Steps of a random walk, which separate duplicates."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted draws of shares (N, f), sharpness (N,) and ties (N,), with the logarithms (N,) of their weights."""

    shares: FloatArray
    sharpness: FloatArray
    ties: FloatArray
    logs: FloatArray

    @classmethod
    def of(cls, prior: Prior, f: int, count: int, rng: np.random.Generator) -> Draws:
        """Return draws of the prior, with equal weights."""
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
        """Equivalent number of equal draws: 1 / sum of the squared probabilities (Kong 1992)."""
        return float(1.0 / (self.probability() ** 2).sum())

    def told(self, new: Evidence, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Return the draws after further answers; ``known`` has all answers, including these."""
        draws = replace(self, logs=self.logs + new.log_probability(self.weights, self.ties))
        return draws.renewed(known, prior, rng) if draws.effective < LEAST_EFFECTIVE else draws

    def renewed(self, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Return fewer draws, of equal weight, each moved by the random walk.

        Where sharpness is 0 answers carry no information on shares, which are drawn from the prior itself.
        """
        draws = self.equal(min(len(self), RENEWED), rng)
        sharp = draws.sharpness > 0
        shares, _, ties = replace(prior, random=0.0).draw(draws.shares.shape[1], int((~sharp).sum()), rng)
        of_random = Draws(shares, np.zeros(len(ties)), ties, np.zeros(len(ties)))
        if not sharp.any():
            return of_random
        moved = draws._part(sharp)._walked(self._part(self.sharpness > 0), known, prior, rng)
        return of_random._with(moved)

    def _walked(self, before: Draws, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Return each draw moved by a random walk that keeps the posterior, with steps scaled to the weighted draws."""
        place, cared_for = _place(self), self.shares > 0
        groups = _groups(before, cared_for)
        density = _density(self, known, prior)
        for step in range(STEPS):
            length = 1.0 if step % 3 else 0.3  # now and then short: the posterior may be bent
            away = length * rng.standard_normal(place.shape)
            for rows, root in groups:
                away[rows] = away[rows] @ root.T
            moved = place + away
            there = _density(_from_place(moved, cared_for), known, prior)
            taken = np.log(rng.random(len(place))) < there - density
            place[taken], density[taken] = moved[taken], there[taken]
        return _from_place(place, cared_for)

    def _part(self, kept: BoolArray) -> Draws:
        return Draws(self.shares[kept], self.sharpness[kept], self.ties[kept], self.logs[kept])

    def _with(self, other: Draws) -> Draws:
        columns = ((mine, its) for mine, its in zip(vars(self).values(), vars(other).values(), strict=True))
        return Draws(*(np.concatenate(pair) for pair in columns))

    def equal(self, count: int, rng: np.random.Generator) -> Draws:
        """Return ``count`` draws of equal weight, one for each equal part of probability (systematic resampling)."""
        rows = self._rows(count, rng)
        return Draws(self.shares[rows], self.sharpness[rows], self.ties[rows], np.zeros(count))

    def _rows(self, count: int, rng: np.random.Generator) -> IntArray:
        ends = np.cumsum(self.probability())
        parts = (np.arange(count) + rng.random()) / count * ends[-1]
        return np.asarray(np.minimum(np.searchsorted(ends, parts, side="right"), len(self) - 1))


def _groups(before: Draws, cared_for: BoolArray) -> list[tuple[IntArray, FloatArray]]:
    """Return rows of draws (N, f) that care for the same costs, with a root of their weighted covariance.

    Where they are too few for a covariance, the root is diagonal, of the deviations among all draws.
    """
    place, probability = _place(before), before.probability()
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
        groups.append((np.flatnonzero(kind == number), vectors * np.sqrt(np.maximum(values, 1e-12)) * _best(free)))
        few &= kind != number
    if few.any():
        groups.append((np.flatnonzero(few), np.diag(deviations) * _best(size - 1)))
    return groups


def _best(dimensions: int) -> float:
    """Return the best length of a step, in deviations (Roberts and Rosenthal 2001, Statistical Science 16, 351-367)."""
    return float(2.38 / np.sqrt(dimensions))


def _place(draws: Draws) -> FloatArray:
    """Return draws in unbounded coordinates (N, f + 2): logarithms of shares, less their mean, sharpness and ties.

    The logarithm of a share of 0 is 0, and is ignored.
    """
    cared_for = draws.shares > 0
    logs = np.log(np.where(cared_for, draws.shares, 1.0))
    logs -= np.where(cared_for, logs.sum(axis=1, keepdims=True) / cared_for.sum(axis=1, keepdims=True), 0.0)
    return np.column_stack([logs, np.log(draws.sharpness), np.log(draws.ties)])


def _from_place(place: FloatArray, cared_for: BoolArray) -> Draws:
    shares = shares_of(place[:, :-2], cared_for)
    return Draws(shares, np.exp(place[:, -2]), np.exp(place[:, -1]), np.zeros(len(place)))


def _density(draws: Draws, known: Evidence, prior: Prior) -> FloatArray:
    """Return the logarithm (N,) of the posterior's density in unbounded coordinates, up to a constant."""
    of_prior = prior.log_density(draws.shares, draws.sharpness, draws.ties)
    return np.asarray(of_prior + known.log_probability(draws.weights, draws.ties))


NEAR = 0.02
"""Expected regret up to which a point is as good as the best, a share of the range of the person's costs."""
CELLS = 4_000_000
"""Costs of points by draws in one block."""


@checked_arguments
@dataclass(frozen=True, eq=False)
class Best:
    """Best point of a front for a person.

    row          of the front: the least expected cost
    point        of that row
    probability  (n,)  of each row, that it is the best one
    regrets      (n,)  expected extra cost of each row over the best one, as a share of the range of the person's costs
                       of
                       the rows
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
    """Return the row of (n, f) with the least expected cost for mean shares (f,); among equals no dominated one."""
    return least(rows @ shares, rows.sum(axis=1))


def judged(rows: FloatArray, draws: Draws) -> tuple[FloatArray, FloatArray]:
    """Return the probability of each of the rows (n, f) to be the best, and its expected regret, by equal draws.

    Of rows with equal costs to a person who cares for some of the costs only, the one with the least sum counts.
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


def judged_alone(rows: FloatArray, draws: Draws, row: int) -> tuple[float, float]:
    """Return the probability and the expected regret of one row, in less than half the time."""
    order = np.argsort(rows.sum(axis=1), kind="stable")
    rows, row = rows[order], int(np.flatnonzero(order == row)[0])
    costs = draws.shares @ rows.T  # (draws, n)
    first = costs.argmin(axis=1)
    low = costs[np.arange(len(costs)), first]
    span = costs.max(axis=1) - low
    regrets = (costs[:, row] - low) / np.where(span > 0, span, 1.0)
    return float((first == row).mean()), float(regrets.mean())


PAIRS = 400
"""Pairs that are drawn at random."""
FAVOURITES = 8
"""Rows that are most often the best; all their pairs are candidates."""
NOTICEABLE = 0.05
"""Least difference of a pair in some cost, a share of its range."""


def most_telling(
    rows: FloatArray,
    draws: Draws,
    asked: Collection[tuple[int, int]],
    rng: np.random.Generator,
    *,
    ties: bool,
) -> tuple[int, int] | None:
    """Return the pair of rows to ask about, the first shown left; None if none remains that differs.

    Parameters
    ----------
    rows : (n, f) array
        Costs as shares of their ranges.
    draws
        Of the weights, of equal weight.
    asked
        Earlier pairs, in the order in which they were shown: none is repeated, and its reverse only if there is no new
        pair.
    ties
        Whether "no difference" is a possible answer.
    """
    pairs = _candidates(rows, draws, rng)
    numbers = {a * len(rows) + b for a, b in asked}
    known, turned = (np.isin(pairs @ order, list(numbers)) for order in ([len(rows), 1], [1, len(rows)]))
    fresh = bool((~(known | turned)).any())
    other_way = np.where(known[:, None], pairs[:, ::-1], pairs)[~(known & turned)]
    pairs = pairs[~(known | turned)] if fresh else other_way
    if not len(pairs):
        return None
    gains = (rows[pairs[:, 1]] - rows[pairs[:, 0]]) @ draws.weights.T  # (pairs, draws)
    best = int(np.argmax(information(gains, draws.ties if ties else None)))
    a, b = pairs[best].tolist()
    return (b, a) if fresh and rng.random() < 0.5 else (a, b)


def information(gains: FloatArray, ties: FloatArray | None) -> FloatArray:
    """Return the expected information of an answer, nats, for each pair: (pairs, draws) -> (pairs,)."""
    told = np.zeros(len(gains))
    size = max(1, BLOCK // gains.shape[1])
    for begin in range(0, len(gains), size):
        part = slice(begin, begin + size)
        for chances in probabilities(gains[part], ties):
            mean = chances.mean(axis=1)
            told[part] += np.einsum("pd,pd->p", chances, np.log(chances)) / chances.shape[1] - mean * np.log(mean)
    return told


def _candidates(rows: FloatArray, draws: Draws, rng: np.random.Generator) -> IntArray:
    """Return pairs of rows (m, 2) that differ noticeably: all of few rows, else random and favourite ones."""
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
