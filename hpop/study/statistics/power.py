"""Power of a test, by simulation, and the number of people that a study needs.

Answers are simulated as normal variables with one component per person and one per answer, shifted for each
stimulus. If the scores of a pilot study are given, answers are rounded to such scores. Alternatively, people of a
pilot study are resampled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import stats

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST_SEED, one_of, real, whole
from hpop.base.text import counted, python_value, shown
from hpop.errors import StudyError
from hpop.study.statistics.choices import share
from hpop.study.statistics.ordinal import likelihood_ratio, ordinal_mixed
from hpop.study.statistics.pairs import exact_p, rank_sum_chances
from hpop.study.statistics.scores import checked, complete_rows, friedman_statistics

Test = Literal["friedman", "wilcoxon", "kruskal", "mixed"]
TESTS: tuple[Test, ...] = ("friedman", "wilcoxon", "kruskal", "mixed")
SIMULATIONS, MIXED_SIMULATIONS = 10_000, 500
"""Default numbers of simulated studies; a mixed model takes some 20 ms each."""
LEVELS = 7
"""Number of equally frequent scores for the mixed model, if no pilot has scores."""
MOST_PEOPLE = 2000
MOST_SIMULATED = 200_000
AT_ONCE = 2_000_000
"""Number of scores that are simulated at once."""
FEW_STUDIES = 100
"""Number of studies simulated first, with the largest number of people, to refuse an effect that is far too small."""
SURELY = 0.35
"""Margin by which a share of so few studies may be too low.

A larger error has a probability below 3e-11 (Hoeffding 1963).
"""
FEW = 25
"""Largest number of people for which Wilcoxon's p is exact; with more, the normal approximation decides alike."""
OBSERVED = (
    "the power of a study that was made, for the effect that it found, follows from its p alone and adds nothing: "
    "where p is .05 it is about one half (Hoenig and Heisey 2001, The American Statistician 55, 19-24). Report the "
    "effect with its interval; for a next study give another n, or the least effect that would matter"
)
Draw = Callable[[np.random.Generator, int, int], FloatArray]
"""Function that draws the scores (s, n, k) of s studies with n people and k stimuli."""


@dataclass(frozen=True)
class Power:
    """Power of a study: the share of simulated studies that find a difference.

    power        share of the simulated studies with p below ``alpha``
    low          lower end of its 95 % interval, due to the simulation alone
    high         upper end
    people       in each study
    test         name of the test
    alpha        significance level
    simulations  number of simulated studies
    seed         of their random numbers
    """

    power: float
    low: float
    high: float
    people: int
    test: Test
    alpha: float
    simulations: int
    seed: int

    def text(self) -> str:
        """Return the result as a sentence."""
        return (
            f"With {self.people:,} people the {self.test.title()} test finds the difference (p < {self.alpha:g}) in "
            f"{100 * self.power:.1f} % of studies ({100 * self.low:.1f} to {100 * self.high:.1f} % by the "
            f"{self.simulations:,} simulated ones, seed {self.seed})."
        )


@checked_arguments
def power(
    effect: float | Sequence[float] | None = None,
    *,
    n: int | None = None,
    k: int = 3,
    correlation: float = 0.5,
    test: str | None = None,
    like: Any = None,
    pilot: Any = None,
    target: float = 0.8,
    alpha: float = 0.05,
    simulations: int | None = None,
    seed: int = 0,
) -> Power:
    """Compute the power of a study of n people, or the least n that reaches the power ``target``, by simulation.

    effect       shift of each of the k stimuli, in standard deviations of an answer; a single number is the shift of
                 the last, that of the first is then 0, and the others are evenly between
    n            number of people; None computes the least number
    k            number of stimuli, if ``effect`` is a single number
    correlation  of two answers of one person: with .5 the effect of a pair is its difference in standard deviations of
                 differences, "dz"
    test         "friedman" for three stimuli or more, "wilcoxon" for two; "kruskal", as the paper did; or "mixed", the
                 likelihood-ratio test of an ordinal mixed model, for which ``n`` must be given; without ``like`` or
                 ``pilot`` it has seven equally frequent scores
    like         scores of a pilot, of any shape, for the distribution of simulated scores without an effect
    pilot        scores (people, stimuli), instead of an effect: people are drawn from it, with replacement
    target       power to reach, if ``n`` is None
    alpha        significance level: a study finds a difference if p is below it
    simulations  simulated studies for each n; by default 10,000, or 500 for "mixed"

    Raises StudyError for "observed power": that of a pilot for its own n, or ``effect="observed"``.

    >>> power(0.5, n=35, k=2, simulations=1000, seed=1).power
    0.808
    """
    if isinstance(effect, str) and effect == "observed":
        raise StudyError(f"observed power is not given: {OBSERVED}")
    effect = python_value(effect)
    if test == "mixed" and n is None:
        raise StudyError('test="mixed" needs n, since each study takes some 20 ms: give the number of people')
    several = MIXED_SIMULATIONS if test == "mixed" else SIMULATIONS
    simulations = whole(
        "simulations", several if simulations is None else simulations, 100, MOST_SIMULATED, error=StudyError
    )
    seed = whole("seed", seed, 0, MOST_SEED, error=StudyError)
    draw, k = _from_pilot(pilot, n) if pilot is not None else _from_effect(effect, k, correlation, like, test)
    default = "wilcoxon" if k == 2 else "friedman"
    made = one_of("test", default if test is None else test, TESTS, error=StudyError)
    if made in ("friedman", "wilcoxon") and made != default:
        raise StudyError(f"test must be {default!r}, 'kruskal' or 'mixed' for {k} stimuli, got {made!r}")
    alpha = real("alpha", alpha, 1e-6, 0.5, "a share", error=StudyError)
    target = real("target", target, 0.01, 0.999, "a share", error=StudyError)

    def of(people: int, simulations: int = simulations) -> Power:
        found = _found(draw, people, k, made, alpha, simulations, np.random.default_rng([seed, people]))
        interval = share(found, simulations)
        return Power(interval.share, interval.low, interval.high, people, made, alpha, simulations, seed)

    if n is not None:
        return of(whole("n", n, 2, MOST_PEOPLE, "a number of people", error=StudyError))
    return _least(of, target)


def _from_effect(effect: Any, k: int, correlation: float, like: Any, test: str | None = None) -> tuple[Draw, int]:
    """Return a function that draws normal scores, shifted by the effect of each stimulus, and the number of stimuli.

    With ``like``, a pilot's scores, and for the test "mixed", each draw is mapped to a score (:func:`_pieces`).
    """
    if effect is None:
        raise StudyError("give the least effect that would matter, in standard deviations, or a pilot's scores")
    effect = effect.tolist() if isinstance(effect, np.ndarray) else effect
    if isinstance(effect, Sequence) and not isinstance(effect, str):
        shifts = np.array([real("effect", one, -100, 100, "a shift", error=StudyError) for one in effect])
    else:
        k = whole("k", k, 2, 26, "a number of stimuli", error=StudyError)
        shifts = np.linspace(0.0, real("effect", effect, -100, 100, "a shift", error=StudyError), k)
    if len(shifts) < 2:
        raise StudyError(
            "effect, as a list, must have a shift (in standard deviations) for each of two stimuli or more, got "
            f"{shown(effect)}; add the missing shifts"
        )
    pieces = _pieces(like, test)
    own = np.sqrt(real("correlation", correlation, 0.0, 0.999, "a correlation", error=StudyError))

    def draw(rng: np.random.Generator, studies: int, people: int) -> FloatArray:
        person = own * rng.standard_normal((studies, people, 1))
        answer = np.sqrt(1 - own**2) * rng.standard_normal((studies, people, len(shifts)))
        values: FloatArray = person + answer + shifts
        return values if pieces is None else pieces.scores[np.searchsorted(pieces.cuts, values)]

    return draw, len(shifts)


class _Pieces(NamedTuple):
    """Step function from a normal variable to scores, which makes each score as frequent as in a pilot study.

    scores  (m,)      rising
    cuts    (m - 1,)  values of the normal variable between two scores
    """

    scores: FloatArray
    cuts: FloatArray


def _pieces(like: Any, test: str | None) -> _Pieces | None:
    """Return a step function from a standard normal variable to scores; None if scores are to be normal.

    like  scores of a pilot, whose frequencies the function keeps; None for none: then the test "mixed" has equally
          frequent scores, and other tests have normal ones
    """
    if like is None and test == "mixed":
        return _Pieces(np.arange(float(LEVELS)), stats.norm.ppf(np.arange(1, LEVELS) / LEVELS))
    if like is None:
        return None
    scores = np.asarray(like, dtype=float).ravel()
    steps, counts = np.unique(scores[~np.isnan(scores)], return_counts=True)
    if len(steps) < 2:
        raise StudyError("like must have at least two different scores of a pilot, NaN where one is missing")
    return _Pieces(steps, stats.norm.ppf(np.cumsum(counts)[:-1] / counts.sum()))


def _from_pilot(pilot: Any, n: int | None) -> tuple[Draw, int]:
    """Return a function that draws people of a pilot study with replacement, and the number of stimuli."""
    scores = checked(pilot)
    scores = scores[complete_rows(scores)]
    if len(scores) < 2 or scores.shape[1] < 2:
        raise StudyError(
            f"expected a pilot of two people or more who have scores for all of two stimuli or more, got "
            f"{counted(len(scores), 'such session')}; ask more people, or give an effect instead"
        )
    if n == len(scores):
        raise StudyError(f"n must differ from the pilot's number of people, {n}: {OBSERVED}")

    def draw(rng: np.random.Generator, studies: int, people: int) -> FloatArray:
        drawn: FloatArray = scores[rng.integers(len(scores), size=(studies, people))]
        return drawn

    return draw, scores.shape[1]


def _found(
    draw: Draw, people: int, k: int, test: Test, alpha: float, simulations: int, rng: np.random.Generator
) -> int:
    """Simulate studies of ``people`` people with k scores each, and count those with a p value below ``alpha``."""
    most, found = max(1, AT_ONCE // (people * k)), 0
    for begin in range(0, simulations, most):
        values = draw(rng, min(most, simulations - begin), people)
        found += int((_p_values(values, test) < alpha).sum())
    return found


def _p_values(values: FloatArray, test: Test) -> FloatArray:
    """Return the p value of each simulated study (s,) from its scores (s, n, k)."""
    if test == "friedman":
        p = stats.chi2.sf(friedman_statistics(values), values.shape[2] - 1)
    elif test == "kruskal":
        p = stats.chi2.sf(_kruskal_statistics(values), values.shape[2] - 1)
    elif test == "mixed":
        p = [_mixed_p(study) for study in values]
    else:
        differences = np.round(values[:, :, 1] - values[:, :, 0], 9)
        ranks = np.asarray(stats.rankdata(np.abs(differences), axis=1)) * np.sign(differences)
        size = np.sqrt((ranks**2).sum(axis=1))
        p = 2 * stats.norm.sf(np.abs(ranks.sum(axis=1)) / np.where(size > 0, size, 1.0))
        if values.shape[1] <= FEW:
            return _exact(ranks)
    return np.asarray(p)


def _mixed_p(values: FloatArray) -> float:
    """Return p of the mixed model's test of scores (n, k); 1 if the model cannot be fitted."""
    n, k = values.shape
    people, effects = np.repeat(np.arange(n), k), np.tile(np.eye(k)[:, 1:], (n, 1))
    try:
        full = ordinal_mixed(values.ravel(), people, effects, [f"stimulus {i}" for i in range(1, k)])
        return likelihood_ratio(full, ordinal_mixed(values.ravel(), people, effects[:, :0], ())).p
    except StudyError:
        return 1.0


def _exact(ranks: FloatArray) -> FloatArray:
    """Return exact p values (s,) of Wilcoxon's test from signed ranks (s, n).

    All studies without ties and zeros share one distribution, which makes this fast.
    """
    people = ranks.shape[1]
    plain = (np.sort(np.abs(ranks), axis=1) == np.arange(1, people + 1)).all(axis=1)
    tail = np.cumsum(rank_sum_chances(range(1, people + 1)))
    above = np.where(ranks > 0, ranks, 0.0).sum(axis=1)
    least = np.minimum(above, people * (people + 1) / 2 - above).astype(int)
    p = np.minimum(1.0, 2 * tail[np.where(plain, least, 0)])
    p[~plain] = [exact_p(one[one != 0]) for one in ranks[~plain]]
    return np.asarray(p)


def _kruskal_statistics(values: FloatArray) -> FloatArray:
    """Return Kruskal and Wallis' statistic, with ties, of each of many studies (s, n, k) at once."""
    studies, people, stimuli = values.shape
    total = people * stimuli
    ranks = stats.rankdata(values.reshape(studies, total), axis=1) - (total + 1) / 2
    between = people * (ranks.reshape(values.shape).mean(axis=1) ** 2).sum(axis=1)
    variance = (ranks**2).sum(axis=1) / (total - 1)
    statistics: FloatArray = between / np.where(variance > 0, variance, 1.0)
    return statistics


def _too_small(most: Power, target: float) -> StudyError:
    """Return the error for an effect that even the largest number of people does not find."""
    return StudyError(
        f"{most.people:,} people have a power of {most.power:.2f}, below {target:g}: the effect is too small for any "
        "study; give a larger one, or a lower target"
    )


def _least(of: Callable[..., Power], target: float) -> Power:
    """Find the least number of people that reaches the power ``target``, by doubling, then bisection."""
    few = of(MOST_PEOPLE, FEW_STUDIES)
    if few.power + SURELY < target:
        raise _too_small(few, target)
    low, high = 1, 6
    while (reached := of(high)).power < target:
        if high == MOST_PEOPLE:
            raise _too_small(reached, target)
        low, high = high, min(2 * high, MOST_PEOPLE)
    while high - low > 1:
        middle = of((low + high) // 2)
        if middle.power >= target:
            high, reached = middle.people, middle
        else:
            low = middle.people
    return reached
