"""Test of whether a weighted sum of costs describes a person, by a few more questions and a second model.

A preference assumes that a person feels a weighted sum of the costs. Other tastes exist: a person may want a middle
value, or care only above a threshold. Then the preferred row can be far from the person's best row, although the
preference is sure of it. The second model lets the value of a row be any smooth function of its costs: a Gaussian
process (Chu and Ghahramani 2005, "Preference learning with Gaussian processes", ICML; Laplace's approximation), plus a
weighted sum. Each question of the test compares the best row with a challenger: a row that the Gaussian process
expects to be better, and the weighted sum expects to be worse.

The *doubt* is the number of questions that the best row lost beyond the number that the weighted sum expects, plus half
the logarithm of the ratio of the evidence of the Gaussian process to that of the weighted sum. Above
:data:`MOST_DOUBT` the weighted sum does not fit.

What can be found: on a front that is not convex, some rows are best for no weighted sum, and a person who prefers one
is found. On a convex front every row is best for some weights, so a few answers rarely rule out all weights; the
answers of the test then move the weights instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from scipy.special import expit, log_ndtr

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.text import counted
from hpop.errors import StudyError
from hpop.preference.answers import LAPSE, LOG, CostScale, Feature, PairAnswer, answer_of, evidence
from hpop.preference.posterior import NOTICEABLE, Draws
from hpop.preference.preference import Preference

CHECKS = 8
"""Number of questions of a test."""
MOST_DOUBT = 2.2
"""Doubt above which a weighted sum does not fit; some 5 % of people whom it fits have more."""
SPREADS = tuple((plain, bent, length) for plain in (5.0, 15.0) for bent in (4.0, 10.0) for length in (0.2, 0.5))
"""Settings of the Gaussian process, equally probable before any answer: standard deviations of the weights and of the
smooth function, and the length over which it changes, as a share of the costs' ranges."""
HELPFUL = 1.0
"""Least gain of the logarithm of the evidence by a feature that is worth suggesting."""
THRESHOLDS = (0.25, 0.5, 0.75)
"""Thresholds that are tried as features, as shares of the range of a cost."""
DRAWN = 20_000
"""Draws of the prior for the evidence of a weighted sum."""
STEPS = 60
"""Most iterations of Laplace's approximation."""


class Process(NamedTuple):
    """Gaussian process given answers: each chosen point has a value above that of the other point.

    slopes    (n,)    times the covariances of a value with the answers' differences, they give its mean
    scale     (n,)    roots of the curvatures of the answers' log probabilities
    root      (n, n)  Cholesky root of 1 + scale K scale
    evidence          logarithm of the probability of all answers
    """

    slopes: FloatArray
    scale: FloatArray
    root: FloatArray
    evidence: float


@checked_arguments
@dataclass(frozen=True, eq=False)
class FitCheck:
    """Test of whether a weighted sum describes a person; :meth:`of` begins it, :meth:`told` adds an answer.

    person   preference of the person when the test began
    answers  answers to the questions of the test
    """

    person: Preference
    answers: tuple[PairAnswer, ...] = ()

    @classmethod
    def of(cls, person: Preference) -> Self:
        """Begin the test of a preference; StudyError if it has no front or no answers."""
        if person.points is None or not person.answers:
            raise StudyError(
                "a test of the fit needs a preference with a front and with answers; ask questions first, and attach "
                "a front by preference.on(front)"
            )
        return cls(person)

    @cached_property
    def row(self) -> int:
        """Row of the front that was the best for the person when the test began."""
        return self.person.best().row

    def next_pair(self) -> tuple[int, int] | None:
        """Return the two rows to ask about next, the left one first; None after :data:`CHECKS` questions.

        One of the rows is :attr:`row`. Also None if no challenger differs noticeably from it.
        """
        rows = self._rows
        value = np.where(np.abs(rows - rows[self.row]).max(axis=1) >= NOTICEABLE, self._challenge(), -np.inf)
        value[[row for answer in self.answers for row in (answer.first, answer.second)]] = -np.inf
        other = int(np.argmax(value))
        if len(self.answers) >= CHECKS or value[other] == -np.inf:
            return None
        turned = np.random.default_rng([self.person.seed, 5, len(self.answers)]).random() < 0.5
        return (other, self.row) if turned else (self.row, other)

    def told(self, first: int, second: int, chosen: int | None) -> Self:
        """Return the test after one more answer: two shown rows, and the chosen one; None for no difference.

        Raises StudyError for rows that the front does not have, and if neither is :attr:`row`.
        """
        if self.row not in (first, second):
            raise StudyError(
                f"a question of the test must show row {self.row}, got rows {first} and {second}; ask about next_pair()"
            )
        costs = self.person.scale.costs_on(self.person.points)  # type: ignore[arg-type]
        return replace(self, answers=(*self.answers, answer_of(first, second, chosen, costs)))

    # Results

    @property
    def lost(self) -> float:
        """Number of questions of the test that the best row lost; "no difference" counts as half."""
        return sum(0.5 if a.chosen is None else float(a.chosen != self.row) for a in self.answers)

    @property
    def expected(self) -> float:
        """Number of questions of the test that the weighted sum expects the best row to lose, before their answers."""
        challengers = [a.first + a.second - self.row for a in self.answers]
        return float((1.0 - self._chances_to_win()[challengers]).sum())

    @cached_property
    def evidence_ratio(self) -> float:
        """Logarithm of the ratio of the evidence of the Gaussian process to that of the weighted sum.

        All answers count, those before the test as well; "no difference" does not count.
        """
        logs = np.array([process.evidence for process, _ in self._processes])
        return _log_mean(logs) - self._evidence_of_sum(self.person.scale)

    @property
    def doubt(self) -> float:
        """Return the doubt whether a weighted sum describes the person: `lost` - `expected` + `evidence_ratio` / 2."""
        return self.lost - self.expected + self.evidence_ratio / 2

    @property
    def fits(self) -> bool:
        """Return whether a weighted sum fits the answers: the doubt is at most :data:`MOST_DOUBT`."""
        return self.doubt <= MOST_DOUBT

    @property
    def best(self) -> int:
        """Row that is best for the person: by the weighted sum if it fits, otherwise by the Gaussian process."""
        return self.preference.best().row if self.fits else int(np.argmax(self._means_and_variances()[0]))

    @property
    def preference(self) -> Preference:
        """Preference of the person with the answers of the test."""
        person = self.person
        for answer in self.answers:
            person = person.told(answer.first, answer.second, answer.chosen)
        return person

    def suggestions(self) -> list[tuple[dict[str, Feature], float]]:
        """Return features for ``Preference.fit(..., features=...)`` that describe the answers better, the best first.

        Each is "log", or a threshold at a quarter, a half or three quarters of the range, of one cost, with the gain of
        the logarithm of the evidence. The best feature of each cost is returned, if its gain is at least
        :data:`HELPFUL`.
        """
        scale, front = self.person.scale, self.person.points
        plain = self._evidence_of_sum(CostScale.of(front, {}))  # type: ignore[arg-type]
        found: list[tuple[dict[str, Feature], float]] = []
        for name, low, span in zip(scale.names, scale.ideal.tolist(), scale.span.tolist(), strict=True):
            features: tuple[Feature, ...] = (LOG, *(low + share * span for share in THRESHOLDS)) if span > 0 else ()
            scales = [CostScale.of(front, {name: feature}) for feature in features]  # type: ignore[arg-type]
            gains = [self._evidence_of_sum(bent) - plain for bent in scales]
            if gains and max(gains) >= HELPFUL:
                found.append(({name: features[int(np.argmax(gains))]}, max(gains)))
        return sorted(found, key=lambda one: -one[1])

    def words(self) -> str:
        """Return the result of the test in words."""
        asked = counted(len(self.answers), "question")
        if self.fits:
            return f"A weighted sum of the costs fits the answers ({asked} of the test, doubt {self.doubt:.1f})."
        hints = [f"{name}: {value if isinstance(value, str) else f'{value:.3g}'}" for one, _ in self.suggestions()
                 for name, value in one.items()]  # fmt: skip
        return (
            f"No weighted sum of the costs fits the answers ({asked} of the test, doubt {self.doubt:.1f}, at most "
            f"{MOST_DOUBT:g} if one fits). Do not rely on the weights or the probability. A model without weights "
            f"expects trajectory {self.best} to be the best."
            + (f" These features describe the answers better: {'; '.join(hints)}." if hints else "")
        )

    # Both models

    @cached_property
    def _rows(self) -> FloatArray:
        """Scaled costs (m, f) of the front."""
        return self.person.scale.rows_on(self.person.points)  # type: ignore[arg-type]

    @cached_property
    def _decided(self) -> list[PairAnswer]:
        """All answers that chose a row, before the test and in it."""
        return [answer for answer in (*self.person.answers, *self.answers) if answer.chosen is not None]

    @cached_property
    def _points(self) -> tuple[FloatArray, FloatArray]:
        """Scaled costs (n, f) of the chosen points, and of the points that were not chosen, in :attr:`_decided`."""
        pairs = np.array([a.costs if a.chosen == a.first else a.costs[::-1] for a in self._decided])
        pairs = pairs.reshape(-1, 2, len(self.person.scale.names))
        return self.person.scale.scaled(pairs[:, 0]), self.person.scale.scaled(pairs[:, 1])

    @cached_property
    def _processes(self) -> list[tuple[Process, FloatArray]]:
        """Gaussian process for each setting of :data:`SPREADS`, with covariances (m, n) before the answers.

        Entry (i, j) is that of two differences in value: row i less the best row, and of answer j, chosen less other.
        """
        chosen, other = self._points
        best = self._rows[self.row : self.row + 1]
        found = []
        for setting in SPREADS:
            prior = (
                _covariance(chosen, chosen, setting)
                - _covariance(chosen, other, setting)
                - _covariance(other, chosen, setting)
                + _covariance(other, other, setting)
            )
            ahead, behind = (
                _covariance(self._rows, points, setting) - _covariance(best, points, setting)
                for points in (chosen, other)
            )
            found.append((laplace(prior), ahead - behind))
        return found

    def _means_and_variances(self) -> tuple[FloatArray, FloatArray]:
        """Return how much better each row is than :attr:`row` by the Gaussian process: means and variances (m,).

        They are means over the settings (:data:`SPREADS`), weighted by the probability of the answers in each.
        """
        logs = np.array([process.evidence for process, _ in self._processes])
        shares = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
        means = np.zeros(len(self._rows))
        variances = np.zeros(len(self._rows))
        for share, (process, across), setting in zip(shares, self._processes, SPREADS, strict=True):
            means += share * (across @ process.slopes)
            reduced = np.linalg.solve(process.root, process.scale[:, None] * across.T)
            variances += share * (_difference_variances(self._rows, self.row, setting) - (reduced**2).sum(axis=0))
        return means, np.maximum(variances, 1e-9)

    def _challenge(self) -> FloatArray:
        """Return how much each row (m,) is expected to reveal as a challenger of the best row.

        It is the expected improvement by the Gaussian process, times the probability that the row loses by the
        weighted sum.
        """
        mean, variance = self._means_and_variances()
        deviation = np.sqrt(variance)
        ratio = mean / deviation
        density = np.exp(-0.5 * ratio**2) / np.sqrt(2.0 * np.pi)
        improvement = mean * np.exp(log_ndtr(ratio)) + deviation * density
        return np.asarray(improvement * self._chances_to_win())

    def _chances_to_win(self) -> FloatArray:
        """Return for each row (m,) the probability that the person chooses the best row, if the two are compared.

        It is that of the weighted sum before the test.
        """
        draws = self.person.equal_draws()
        wins = expit((self._rows - self._rows[self.row]) @ draws.weights.T).mean(axis=1)
        return np.asarray(LAPSE / 2 + (1.0 - LAPSE) * wins)

    def _evidence_of_sum(self, scale: CostScale) -> float:
        """Return the logarithm of the probability of all answers by a weighted sum of costs on a scale.

        The probability is a mean over the prior of the weights, before any answer.
        """
        prior = replace(self.person.prior, concentration=(), about=(), _stretch=())
        draws = Draws.of(prior, len(scale.columns), DRAWN, np.random.default_rng([self.person.seed, 6]))
        return _log_mean(evidence(self._decided, scale, ties=False).log_probability(draws.weights, draws.ties))


def _covariance(one: FloatArray, other: FloatArray, setting: tuple[float, float, float]) -> FloatArray:
    """Return the covariances (n, m) of the values of points (n, f) and (m, f) by a setting of :data:`SPREADS`."""
    plain, bent, length = setting
    apart = ((one[:, None] - other[None]) ** 2).sum(axis=-1)
    return np.asarray(plain**2 * (one - 0.5) @ (other - 0.5).T + bent**2 * np.exp(-apart / (2.0 * length**2)))


def _difference_variances(rows: FloatArray, row: int, setting: tuple[float, float, float]) -> FloatArray:
    """Return the variance (m,) of the difference in value between each row (m, f) and one of them, before answers."""
    plain, bent, length = setting
    apart = ((rows - rows[row]) ** 2).sum(axis=1)
    return np.asarray(plain**2 * apart + 2.0 * bent**2 * (1.0 - np.exp(-apart / (2.0 * length**2))))


def laplace(prior: FloatArray) -> Process:
    """Return the Gaussian process given n answers, from the prior covariance (n, n) of their differences in value.

    The difference of an answer is the value of the chosen point less that of the other point.

    Curvatures are those of Fisher scoring, which are never negative, although lapses make the log probability convex
    in places. Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", algorithm 3.1.
    """
    n = len(prior)
    covariance = prior + 1e-6 * np.eye(n)
    values, slopes = np.zeros(n), np.zeros(n)
    for step in range(STEPS + 1):
        likely = expit(values)
        chance = LAPSE / 2 + (1.0 - LAPSE) * likely
        rise = (1.0 - LAPSE) * likely * (1.0 - likely)
        curvature = np.maximum(rise**2 / (chance * (1.0 - chance)), 1e-9)
        scale = np.sqrt(curvature)
        root = np.linalg.cholesky(np.eye(n) + scale[:, None] * covariance * scale[None])
        if step == STEPS:
            break
        aim = curvature * values + rise / chance
        slopes = aim - scale * np.linalg.solve(root.T, np.linalg.solve(root, scale * (covariance @ aim)))
        moved = covariance @ slopes
        if n == 0 or np.abs(moved - values).max() < 1e-5:
            break
        values = values + (moved - values) * (0.7 if step > 5 else 1.0)
    fit = float(np.log(chance).sum() - 0.5 * slopes @ values - np.log(np.diag(root)).sum())
    return Process(slopes, np.asarray(scale), np.asarray(root, dtype=np.float64), fit)


def _log_mean(logs: FloatArray) -> float:
    """Return the logarithm of the mean of numbers that are given by their logarithms."""
    most = float(logs.max())
    return most + float(np.log(np.mean(np.exp(logs - most))))
