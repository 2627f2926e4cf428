"""Simulated people, fronts to ask them about, and answers as the model says them, each by a seed."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.frontier import ItemFront
from hpop.preference import Preference, Prior


def front(n: int = 60, k: int = 3, seed: int = 0) -> ItemFront[int]:
    """Points on a convex front of about n rows, in metres, counts and seconds."""
    rng = np.random.default_rng(seed)
    away = np.abs(rng.normal(size=(n, k)))
    costs = 1.0 - away / np.linalg.norm(away, axis=1)[:, None]
    scales = np.array([40.0, 12.0, 3.0, 0.5, 700.0])[:k]
    units = ["m", "1", "s", "rad", "J"][:k]
    names = ["length", "turns", "exposure", "rotation", "energy"][:k]
    return ItemFront.of(5.0 + costs * scales, names=names, units=units, quanta=[1e-6] * k)


def drawn(prior: Prior, f: int, seed: int) -> tuple[FloatArray, float, float]:
    """One person as a prior has them: shares (f,), sharpness, Davidson's nu."""
    rng = np.random.default_rng([seed, 77])
    shares, sharpness, ties = prior.draw(f, 1_000, rng)
    i = rng.integers(1_000)
    return shares[i], float(sharpness[i]), float(ties[i])


def answered(
    rng: np.random.Generator, a: int, b: int, rows: FloatArray, weights: FloatArray, nu: float | None = None
) -> int | None:
    """Return the answer of a person with weights (f,) about rows a and b, written down from the definition."""
    if rng.random() < 0.02:
        return [a, b, None][rng.integers(2 if nu is None else 3)]
    worth = np.exp(-(rows[[a, b]] @ weights) + (rows[[a, b]] @ weights).min())
    tie = 0.0 if nu is None else nu * np.sqrt(worth.prod())
    return [a, b, None][rng.choice(3, p=np.array([*worth, tie]) / (worth.sum() + tie))]


def asked(
    person: Preference, questions: int, weights: FloatArray, rng: np.random.Generator, *, telling: bool = True
) -> Preference:
    """Return the preference after questions, the most telling ones or random ones."""
    rows = person.scale.rows_on(person.points)
    for _ in range(questions):
        pair = person.next_pair() if telling else tuple(rng.choice(len(rows), 2, replace=False).tolist())
        if pair is None:
            break
        person = person.told(*pair, answered(rng, *pair, rows, weights))
    return person


def held(person: Preference, shares: FloatArray) -> list[bool]:
    """Return, for each cost, True if its interval of 90 % holds the person's share."""
    ends = person.interval(0.9).values()
    return [low - 1e-12 <= share <= high + 1e-12 for share, (low, high) in zip(shares, ends, strict=True)]
