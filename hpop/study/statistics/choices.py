"""Statistics of choices: shares with intervals, and strengths of stimuli that are compared in pairs.

In the model of Bradley and Terry, stimulus i is chosen over j with odds exp(s_i - s_j). If people may answer "neither",
it is a third outcome, with weight nu exp((s_i + s_j) / 2). Bradley and Terry 1952, Biometrika 39, 324-345; Davidson
1970, Journal of the American Statistical Association 65, 317-328.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from scipy import optimize, special, stats
from scipy.sparse import coo_array, csgraph

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray, frozen
from hpop.base.options import whole
from hpop.errors import StudyError

ALIKE = 1e-9
"""Ratio of the variance between people to that between choices below which all people count as answering alike."""
MOST_STIMULI = 1000
"""Largest number of stimuli; the computing time grows with its third power."""
MOST_STEPS = 100
"""Largest number of steps of Newton's method, which needs about ten."""


@checked_arguments
@dataclass(frozen=True, eq=False)
class Strengths:
    """Strength of preference for each stimulus, as fitted by `bradley_terry`.

    strengths   (k,)  logarithmic; only differences matter: their mean is 0, or the reference's strength is 0
    errors      (k,)  standard errors; NaN if all people answered alike, so that their variation is unknown
    ties        nu, the weight of the answer "neither"; 0 if it was never given
    side        bonus to the strength of the first of a pair; NaN if not fitted
    side_error  its standard error; NaN as in errors
    choices     number of comparisons, including ties
    """

    strengths: FloatArray
    errors: FloatArray
    ties: float
    side: float
    side_error: float
    choices: int

    def interval(self, level: float = 0.95) -> FloatArray:
        """Return confidence intervals (k, 2) of the strengths, lower and upper ends, from their standard errors."""
        half = stats.norm.isf((1 - level) / 2) * self.errors
        ends: FloatArray = np.column_stack([self.strengths - half, self.strengths + half])
        return ends

    def chance(self, first: int, second: int) -> float:
        """Return the probability that ``first`` is chosen over ``second``, if the answer is not "neither"."""
        return float(special.expit(self.strengths[first] - self.strengths[second]))


@checked_arguments
def bradley_terry(
    first: Sequence[int],
    second: Sequence[int],
    chosen: Sequence[int | None],
    *,
    stimuli: int,
    people: Sequence[Any] | None = None,
    reference: int | None = None,
    side: bool = False,
    names: Sequence[str] | None = None,
) -> Strengths:
    """Fit the strengths of stimuli 0 to k - 1 to comparisons (m,) by maximum likelihood.

    first, second  the two stimuli of each comparison
    chosen     the chosen stimulus of each comparison, None for neither
    people     person of each comparison, for errors that account for similar choices of one person (a "sandwich" by
               groups); by default comparisons are independent
    reference  stimulus of strength 0; by default the mean is 0
    side       whether to fit the bonus of the first stimulus of a pair
    names      of the stimuli, for errors; by default their numbers

    Raises StudyError if no finite strengths exist: some stimuli were never chosen over, nor tied with, the others; or
    ties, or the order within pairs, explain all choices.

    >>> fit = bradley_terry([0, 0, 0], [1, 1, 1], [0, 0, 1], stimuli=2)
    >>> round(fit.chance(0, 1), 6)
    0.666667
    """
    stimuli = whole("stimuli", stimuli, 2, MOST_STIMULI, "a number of stimuli", error=StudyError)
    pairs = np.array([first, second], dtype=np.int64).reshape(2, -1).T  # (m, 2)
    outcome = np.array([_outcome(pair, one) for pair, one in zip(pairs, chosen, strict=True)], dtype=np.int64)
    _check(pairs, outcome, [str(i) for i in range(stimuli)] if names is None else names)
    tied = bool((outcome == 2).any())
    features = _features(pairs, stimuli, tied, side)  # (m, outcomes, parameters)
    _check_bounded(features, outcome, tied, side)
    estimate, chances, information = _maximum_likelihood(features, outcome)
    by_choices: FloatArray = np.asarray(np.linalg.inv(information), dtype=np.float64)
    covariance = by_choices
    if people is not None:
        gradients = features[np.arange(len(outcome)), outcome] - np.einsum("mo,mop->mp", chances, features)
        covariance = covariance @ _spread(gradients, people) @ covariance
    centre = np.eye(stimuli)
    centre -= 1 / stimuli if reference is None else np.eye(stimuli)[reference]
    to_strengths = centre[:, 1:]  # the first stimulus is 0 in the fit
    own = slice(0, stimuli - 1)
    errors = _errors(to_strengths, covariance[own, own], by_choices[own, own])
    return Strengths(
        strengths=frozen(to_strengths @ estimate[own]),
        errors=frozen(errors),
        ties=float(np.exp(estimate[stimuli - 1])) if tied else 0.0,
        side=float(estimate[-1]) if side else np.nan,
        side_error=float(_errors(np.eye(1), covariance[-1:, -1:], by_choices[-1:, -1:])[0]) if side else np.nan,
        choices=len(outcome),
    )


def _outcome(pair: IntArray, chosen: int | None) -> int:
    """Return 0 if the first of a pair was chosen, 1 for the second, 2 for neither; StudyError for another stimulus."""
    if chosen is None:
        return 2
    if chosen not in pair:
        raise StudyError(f"chosen must be one of the stimuli {pair[0]} and {pair[1]}, or None, got {chosen}")
    return int(chosen == pair[1])


def _check(pairs: IntArray, outcome: IntArray, names: Sequence[str]) -> None:
    """Raise StudyError if no finite strengths maximise the likelihood.

    Ford 1957, American Mathematical Monthly 64, 28.
    """
    stimuli = len(names)
    if not len(pairs) or stimuli < 2 or pairs.min() < 0 or pairs.max() >= stimuli or (pairs[:, 0] == pairs[:, 1]).any():
        raise StudyError(f"each comparison must name two different stimuli, by numbers from 0 to {stimuli - 1}")
    if (outcome == 2).all():
        raise StudyError("all answers are neither: strengths cannot be estimated without a choice; ask more people")
    forth, back = outcome != 1, outcome != 0
    over = np.concatenate([pairs[forth], pairs[back][:, ::-1]])  # chosen, or as good, over the other
    graph = coo_array((np.ones(len(over)), (over[:, 0], over[:, 1])), shape=(stimuli, stimuli))
    parts, part = csgraph.connected_components(graph, directed=True, connection="strong")
    if parts > 1:
        groups = "; ".join(", ".join(names[int(i)] for i in np.flatnonzero(part == one)) for one in range(parts))
        raise StudyError(
            f"some groups of stimuli were always preferred to others, or never compared with them: {groups}. Their "
            "strengths are unbounded; give the counts of the choices in your paper, or ask more people"
        )


def _check_bounded(features: FloatArray, outcome: IntArray, tied: bool, side: bool) -> None:
    """Raise StudyError if ties or the order within pairs leave the maximum of the likelihood unbounded or not unique.

    This is so if some direction of the parameters makes no answer less likely (Albert and Anderson 1984,
    Biometrika 71, 1-10).
    """
    answered = features[np.arange(len(outcome)), outcome][:, None]
    ahead = np.unique((answered - features).reshape(-1, features.shape[2]), axis=0)
    change = optimize.linprog(-ahead.sum(axis=0), -ahead, np.zeros(len(ahead)), bounds=(-1, 1))
    if float(change.fun or 0.0) < -1e-6 or np.linalg.matrix_rank(ahead) < ahead.shape[1]:
        why = ["of two groups of stimuli one was always chosen, or tied"] * tied
        why += [
            "the order within pairs explains all choices, or cannot be separated from the stimuli: leave side out"
        ] * side
        raise StudyError(f"no finite strengths fit the choices: {'; or '.join(why)}. Report the counts, or ask more")


def _features(pairs: IntArray, stimuli: int, tied: bool, side: bool) -> FloatArray:
    """Return how much each parameter adds to the log weight of each outcome: (m, 2 or 3 outcomes, parameters).

    Outcomes are the first of a pair (m, 2), the second and, if ``tied``, neither. Parameters are the strengths of all
    stimuli but number 0, then the log weight of "neither" if ``tied``, and that of the first place if ``side``.
    """
    count, last = len(pairs), stimuli - 1
    features = np.zeros((count, 2 + tied, stimuli + tied + side))
    rows = np.arange(count)
    for outcome in (0, 1):
        features[rows, outcome, pairs[:, outcome]] = 1
        if tied:
            features[rows, 2, pairs[:, outcome]] = 0.5
    features = features[:, :, 1:]  # the strength of the first stimulus is 0
    if tied:
        features[:, 2, last] = 1
    if side:
        features[:, 0, -1] = 1
    return features


def _maximum_likelihood(features: FloatArray, outcome: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the maximum likelihood parameters (p,), probabilities of the outcomes (m, o), and information (p, p).

    The log-likelihood is concave, so Newton's method with step halving converges to its maximum, if it is finite. Check
    this before the call (:func:`_check`, :func:`_check_bounded`). The information is the negative second derivative at
    the maximum; the observed and the expected one are equal here. StudyError if MOST_STEPS steps do not suffice.

    features  (m, o, p)  as returned by :func:`_features`, for m choices
    outcome   (m,)       index of the outcome of each choice
    """
    chosen = features[np.arange(len(outcome)), outcome].sum(axis=0)
    estimate = np.zeros(features.shape[2])
    for _ in range(MOST_STEPS):
        chances = special.softmax(features @ estimate, axis=1)
        mean = np.einsum("mo,mop->mp", chances, features)
        information = np.einsum("mo,mop,moq->pq", chances, features, features) - mean.T @ mean
        gradient = chosen - mean.sum(axis=0)
        if np.abs(gradient).max() < 1e-10 * len(outcome):
            return estimate, chances, information
        step = np.linalg.solve(information, gradient)
        reached = _likelihood(chosen, features, estimate)
        while _likelihood(chosen, features, estimate + step) < reached - 1e-9 * len(outcome):
            step /= 2
        estimate = estimate + step
    raise StudyError(
        f"no strengths were found in {MOST_STEPS} steps; give the counts of the choices in your paper instead"
    )


def _likelihood(chosen: FloatArray, features: FloatArray, estimate: FloatArray) -> float:
    """Return the log-likelihood of the choices."""
    return float(chosen @ estimate - special.logsumexp(features @ estimate, axis=1).sum())


def _spread(gradients: FloatArray, people: Sequence[Any]) -> FloatArray:
    """Return the sum (p, p), over people, of the outer products of each person's summed gradients.

    It makes the standard errors account for similar choices of one person, and has the small-sample factor
    n / (n - 1) for n people.
    """
    different, member = np.unique(np.array(people), return_inverse=True)
    count = len(different)
    if len(member) != len(gradients) or count < 2:
        raise StudyError(
            f"people must name one person for each of {len(gradients)} comparisons, with two or more different people; "
            f"got {len(member)} names of {count} people"
        )
    sums = np.zeros((count, gradients.shape[1]))
    np.add.at(sums, member, gradients)
    spread: FloatArray = sums.T @ sums * count / (count - 1)
    return spread


def _errors(sums: FloatArray, covariance: FloatArray, by_choices: FloatArray) -> FloatArray:
    """Return the standard errors (k,) of k weighted sums of p parameters.

    An error is NaN if the variation between people gives 0 for it, although the single choices vary.

    sums        (k, p)  weights of the parameters in each sum
    covariance  (p, p)  of the parameters, from the variation between people or, without people, as ``by_choices``
    by_choices  (p, p)  of the parameters, if all choices were independent
    """
    variances, apart = (np.einsum("kp,pq,kq->k", sums, one, sums) for one in (covariance, by_choices))
    told = (variances > ALIKE * apart) | (apart == 0.0)
    errors: FloatArray = np.sqrt(np.where(told, variances, np.nan))
    return errors


MOST_OUTCOMES = 200_000
"""Largest number of outcomes that a multinomial test enumerates."""
MOST_PEOPLE = 1_000_000


@dataclass(frozen=True)
class Share:
    """Proportion of a total, with its confidence interval.

    share  count / total
    low    lower end of the interval of shares that the exact test accepts
    high   upper end
    p      two-sided exact p of a share of one half; below 1 - level if the interval does not contain one half
    """

    count: int
    total: int
    share: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class Multinomial:
    """Result of a test whether k options are chosen equally often.

    p      probability of counts at most as likely as these, if all k are equally likely
    exact  whether all counts were enumerated; else p is from the chi-square test
    """

    p: float
    exact: bool


@checked_arguments
def share(count: int, total: int, level: float = 0.95) -> Share:
    """Return a proportion with the interval of Clopper and Pearson (1934, Biometrika 26, 404-413).

    This interval inverts the exact binomial test that gives p. Wilson's interval does not: of 5 out of 5 it leaves out
    one half, which that test does not reject (p = .0625).

    >>> one = share(15, 148)
    >>> round(one.low, 4), round(one.high, 4)
    (0.0578, 0.1617)
    """
    total = whole("total", total, 1, MOST_PEOPLE, error=StudyError)
    count = whole("count", count, 0, total, error=StudyError)
    test = stats.binomtest(count, total)
    interval = test.proportion_ci(level, method="exact")
    return Share(count, total, count / total, float(interval.low), float(interval.high), float(test.pvalue))


@checked_arguments
def multinomial(counts: Sequence[int]) -> Multinomial:
    """Test whether k stimuli are chosen equally often, given how many people chose each.

    The test is exact if there are at most 200,000 outcomes (36 people and three stimuli have 703), else by chi-square.
    Raises StudyError for fewer than two stimuli, or no people.

    >>> round(multinomial([5, 1, 0]).p, 4)
    0.0535
    """
    seen = np.array([whole("count", count, 0, MOST_PEOPLE, error=StudyError) for count in counts])
    people, stimuli = int(seen.sum()), len(seen)
    if stimuli < 2 or people < 1:
        raise StudyError(f"expected choices among two stimuli or more, got {people} among {stimuli}")
    if comb(people + stimuli - 1, stimuli - 1) > MOST_OUTCOMES:
        return Multinomial(float(stats.chisquare(seen).pvalue), exact=False)
    bars = np.array(list(combinations(range(people + stimuli - 1), stimuli - 1)))  # between the people of each
    ends = np.full((len(bars), 1), people + stimuli - 1)
    outcomes = np.diff(np.hstack([np.full_like(ends, -1), bars, ends]), axis=1) - 1  # (outcomes, k)
    weights = -special.gammaln(outcomes + 1).sum(axis=1)
    least = -special.gammaln(seen + 1).sum()
    chances = np.exp(weights + special.gammaln(people + 1) - people * np.log(stimuli))
    return Multinomial(min(1.0, float(chances[weights <= least + 1e-9].sum())), exact=True)
