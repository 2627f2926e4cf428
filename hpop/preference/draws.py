"""The posterior of a person's weights as weighted draws.

Draws of the prior are weighted by how probable they make the answers. That is exact but for the number of draws: no
normal approximation, which fails where a share may be nothing. As answers come, fewer and fewer draws carry the
weight. Once they count for less than ``LEAST_EFFECTIVE`` equal ones, they are drawn anew and each is moved by a random
walk that keeps the posterior (Metropolis; Chopin 2002, "A sequential particle filter method for static models").
A share of 0 stays 0 in that walk: how probable it is to care for some costs only is in how many draws have such shares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.preference.model import Evidence
from hpop.preference.prior import Prior, shares_of

COUNT = 20_000
"""Draws of the posterior."""
LEAST_EFFECTIVE = 500
"""Of equal draws, as how many the weighted ones count at least."""
RENEWED = 5_000
"""Draws of equal weight that take their place: ten times as many as they counted for."""
LEAST_ALIKE = 40
"""Of equal draws, as how many those that care for the same costs count at least where their covariance is used."""
STEPS = 12
"""Of the random walk each time, by which duplicates part."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted draws of shares (N, f), sharpness (N,) and ties (N,), the logarithms (N,) of their weights beside."""

    shares: FloatArray
    sharpness: FloatArray
    ties: FloatArray
    logs: FloatArray

    @classmethod
    def of(cls, prior: Prior, f: int, count: int, rng: np.random.Generator) -> Draws:
        """Draws of the prior, all alike."""
        return cls(*prior.draw(f, count, rng), np.zeros(count))

    def __len__(self) -> int:
        return len(self.logs)

    @property
    def weights(self) -> FloatArray:
        """Weights (N, f) of the costs: sharpness times shares."""
        return np.asarray(self.sharpness[:, None] * self.shares)

    def probability(self) -> FloatArray:
        """Of each draw (N,); they add up to 1."""
        size = np.exp(self.logs - self.logs.max())
        return np.asarray(size / size.sum())

    @property
    def effective(self) -> float:
        """As how many equal draws they count: 1 / sum of the squared probabilities (Kong 1992)."""
        return float(1.0 / (self.probability() ** 2).sum())

    def told(self, new: Evidence, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """The draws after further answers; ``known`` has all answers, these among them."""
        draws = replace(self, logs=self.logs + new.log_probability(self.weights, self.ties))
        return draws.renewed(known, prior, rng) if draws.effective < LEAST_EFFECTIVE else draws

    def renewed(self, known: Evidence, prior: Prior, rng: np.random.Generator) -> Draws:
        """Draws of equal weight, not as many, each moved by the random walk.

        Where sharpness is 0 answers say nothing of shares, which are drawn from the prior itself.
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
        """Move each draw by a random walk that keeps the posterior; its steps are as long as weighted draws differ."""
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
        """So many draws of equal weight, one for each equal part of the probability (systematic resampling)."""
        rows = self._rows(count, rng)
        return Draws(self.shares[rows], self.sharpness[rows], self.ties[rows], np.zeros(count))

    def _rows(self, count: int, rng: np.random.Generator) -> IntArray:
        ends = np.cumsum(self.probability())
        parts = (np.arange(count) + rng.random()) / count * ends[-1]
        return np.asarray(np.minimum(np.searchsorted(ends, parts, side="right"), len(self) - 1))


def _groups(before: Draws, cared_for: BoolArray) -> list[tuple[IntArray, FloatArray]]:
    """Rows of draws (N, f) that care for the same costs, and a root of the covariance of the weighted draws that do.

    Where these are too few for a covariance, the root is diagonal, of the deviations among all draws.
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
    """Return as how many deviations a step is best (Roberts and Rosenthal 2001, Statistical Science 16, 351-367)."""
    return float(2.38 / np.sqrt(dimensions))


def _place(draws: Draws) -> FloatArray:
    """Return draws where they have no bounds (N, f + 2): logarithms of shares, less their mean, sharpness and ties.

    The logarithm of a share of 0 is 0, which counts for nothing.
    """
    cared_for = draws.shares > 0
    logs = np.log(np.where(cared_for, draws.shares, 1.0))
    logs -= np.where(cared_for, logs.sum(axis=1, keepdims=True) / cared_for.sum(axis=1, keepdims=True), 0.0)
    return np.column_stack([logs, np.log(draws.sharpness), np.log(draws.ties)])


def _from_place(place: FloatArray, cared_for: BoolArray) -> Draws:
    shares = shares_of(place[:, :-2], cared_for)
    return Draws(shares, np.exp(place[:, -2]), np.exp(place[:, -1]), np.zeros(len(place)))


def _density(draws: Draws, known: Evidence, prior: Prior) -> FloatArray:
    """Logarithm (N,) of the posterior's density where there are no bounds, but for a constant."""
    of_prior = prior.log_density(draws.shares, draws.sharpness, draws.ties)
    return np.asarray(of_prior + known.log_probability(draws.weights, draws.ties))
