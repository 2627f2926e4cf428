"""Test of whether a weighted sum of costs describes a person, by a few more questions and a second model.

A preference assumes that a person feels a weighted sum of the costs. Other tastes exist: a person may want a middle
value, or care only above a threshold. Then the preferred row can be far from the person's best row, although the
preference is sure of it. The second model is a large sample of people with other tastes (:mod:`.tastes`). Only
people remain in it whose loss by the best row is over a tenth of their range.

Each question of the test compares the best row with a challenger: the row whose probability to win by the second model
is the most above that by the weighted sum. The *doubt* is the logarithm of the ratio of the probabilities of all
answers, by the second model to the weighted sum (a likelihood ratio of mixtures). Above :data:`MOST_DOUBT` the weighted
sum does not fit. A test with a clear doubt ends early; a test without one asks more questions.

On a convex front every row is best for some weights, so that answers also move the weights; therefore both models are
compared by all answers, those before the test as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import counted
from hpop.errors import StudyError
from hpop.preference.answers import LAPSE, LOG, CostScale, Feature, PairAnswer, answer_of, evidence
from hpop.preference.posterior import NOTICEABLE, Draws
from hpop.preference.preference import ASKING, Preference
from hpop.preference.tastes import Tastes, some_rows

CHECKS = 24
"""Largest number of questions of a test."""
LEAST_CHECKS = 3
"""Number of questions after which a test may end early."""
SETTLED = -3.0, 3.0
"""Doubts below and above which a test ends early."""
MOST_DOUBT = 0.0
"""Doubt above which a weighted sum does not fit; at most some 5 % of people with a weighted sum have more."""
LARGE_LOSS = 0.1
"""Share of a person's range of losses that the best row must cost people of the second model."""
HELPFUL = 1.0
"""Least gain of the logarithm of the evidence by a feature that is worth suggesting."""
THRESHOLDS = (0.25, 0.5, 0.75)
"""Thresholds that are tried as features, as shares of the range of a cost."""
DRAWN = 40_000
"""Draws of people, of each model."""
LIKELY = 1_500
"""Most probable people of the second model who choose the next question."""


class ModelEvidence(NamedTuple):
    """Evidence of both models: their people, with the probability of the answers so far by each.

    others     people of the second model
    of_others  (N,)  logarithms of the probability of all decided answers, by each of them
    draws      people with a weighted sum
    of_sum     (M,)  logarithms of the probability of these answers, by each of them
    """

    others: Others
    of_others: FloatArray
    draws: Draws
    of_sum: FloatArray

    def after(self, answers: Sequence[PairAnswer], scale: CostScale) -> ModelEvidence:
        """Return the evidence after more answers; "no difference" is left out."""
        decided = [answer for answer in answers if answer.chosen is not None]
        if not decided:
            return self
        pairs = np.array([one.costs if one.chosen == one.first else one.costs[::-1] for one in decided])
        chosen, other = (scale.scaled(pairs[:, i]) for i in range(2))
        of_sum = evidence(decided, scale, ties=False).log_probability(self.draws.weights, self.draws.ties)
        return self._replace(
            of_others=self.of_others + self.others.tastes.log_probability(chosen, other), of_sum=self.of_sum + of_sum
        )


class Others(NamedTuple):
    """People of the second model.

    tastes  N people
    rows    (m,)    rows of the front that may be challengers, or the best row
    losses  (N, m)  losses of the people by these rows
    """

    tastes: Tastes
    rows: IntArray
    losses: FloatArray


@checked_arguments
@dataclass(frozen=True, eq=False)
class FitCheck:
    """Test of whether a weighted sum describes a person; :meth:`of` begins it, :meth:`told` adds an answer.

    person   preference of the person when the test began
    answers  answers to the questions of the test
    """

    person: Preference
    answers: tuple[PairAnswer, ...] = ()
    _before: FitCheck | None = field(default=None, repr=False)

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
        """Return the two rows to ask about next, the left one first; None if the test is over.

        It is over after :data:`CHECKS` questions; from :data:`LEAST_CHECKS` questions on, once the doubt is beyond
        :data:`SETTLED`; and if no challenger differs noticeably from :attr:`row`, which is one of the two rows.
        """
        if len(self.answers) >= LEAST_CHECKS and not SETTLED[0] <= self.doubt <= SETTLED[1]:
            return None
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
        told = (*self.answers, answer_of(first, second, chosen, costs))
        return replace(self, answers=told, _before=self)

    # Results

    @cached_property
    def doubt(self) -> float:
        """Return the doubt whether a weighted sum describes the person.

        It is the logarithm of the ratio of the probability of all answers by the second model to that by a weighted
        sum. Answers before the test count as well; "no difference" does not.
        """
        return _log_mean(self._evidence.of_others) - _log_mean(self._evidence.of_sum)

    @property
    def fits(self) -> bool:
        """Return whether a weighted sum fits the answers: the doubt is at most :data:`MOST_DOUBT`."""
        return self.doubt <= MOST_DOUBT

    @property
    def best(self) -> int:
        """Row that is best for the person: by the weighted sum if it fits, otherwise by the second model."""
        if self.fits:
            return self.preference.best().row
        others = self._evidence.others
        return int(others.rows[np.argmin(_probabilities(self._evidence.of_others) @ others.losses)])

    @cached_property
    def preference(self) -> Preference:
        """Preference of the person with the answers of the test.

        "No difference" is left out if it was not a possible answer before the test.
        """
        if not self.answers:
            return self.person
        before, last = self._former.preference, self.answers[-1]
        known = last.chosen is not None or before.ties
        return before.told(last.first, last.second, last.chosen) if known else before

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
            f"{MOST_DOUBT:g} if one fits). Do not rely on the weights or the probability. Other tastes "
            f"expect trajectory {self.best} to be the best."
            + (f" These features describe the answers better: {'; '.join(hints)}." if hints else "")
        )

    # Both models

    @cached_property
    def _rows(self) -> FloatArray:
        """Scaled costs (m, f) of the front."""
        return self.person.scale.rows_on(self.person.points)  # type: ignore[arg-type]

    @cached_property
    def _former(self) -> FitCheck:
        """The test before its last answer."""
        return self._before if self._before is not None else replace(self, answers=self.answers[:-1])

    @cached_property
    def _evidence(self) -> ModelEvidence:
        """Evidence of both models; their people do not depend on the answers of the test."""
        if self.answers:
            return self._former._evidence.after(self.answers[-1:], self.person.scale)
        rng = np.random.default_rng([self.person.seed, 7])
        rows = some_rows(len(self._rows), self.row, rng)
        tastes, losses = Tastes.draw(self._rows[rows], self.person.prior, DRAWN, rng)
        lose = losses[:, np.searchsorted(rows, self.row)] > LARGE_LOSS
        if not lose.any():
            lose[:] = True
        others = Others(tastes.subset(lose), rows, losses[lose])
        draws = self._people_of_sum(self.person.scale)
        first = ModelEvidence(others, np.zeros(int(lose.sum())), draws, np.zeros(len(draws)))
        return first.after(self.person.answers, self.person.scale)

    def _challenge(self) -> FloatArray:
        """Return for each row (m,) how much likelier it beats the best row by the second model than by the sum.

        Rows that the second model does not consider have minus infinity.
        """
        from scipy.special import expit  # slow to import

        others = self._evidence.others
        probability = _probabilities(self._evidence.of_others)
        likely = np.argsort(-probability)[:LIKELY]
        losses, sharpness = others.losses[likely], others.tastes.sharpness[likely]
        gains = sharpness[:, None] * (losses[:, [np.searchsorted(others.rows, self.row)]] - losses)
        by_others = probability[likely] @ expit(gains) / probability[likely].sum()
        rows = self._rows[others.rows]
        by_sum = expit((self._rows[self.row] - rows) @ self.preference.equal_draws(ASKING).weights.T).mean(axis=1)
        value = np.full(len(self._rows), -np.inf)
        value[others.rows] = (1.0 - LAPSE) * (by_others - by_sum)
        return value

    def _people_of_sum(self, scale: CostScale) -> Draws:
        """Draw people with a weighted sum of costs on a scale, from the prior of the weights before any answer."""
        prior = replace(self.person.prior, concentration=(), about=(), _stretch=())
        return Draws.of(prior, len(scale.columns), DRAWN, np.random.default_rng([self.person.seed, 6]))

    def _evidence_of_sum(self, scale: CostScale) -> float:
        """Return the logarithm of the probability of all decided answers by a weighted sum of costs on a scale."""
        decided = [answer for answer in (*self.person.answers, *self.answers) if answer.chosen is not None]
        draws = self._people_of_sum(scale)
        return _log_mean(evidence(decided, scale, ties=False).log_probability(draws.weights, draws.ties))


def _probabilities(logs: FloatArray) -> FloatArray:
    """Return probabilities (N,), which add up to 1, from their logarithms plus any constant."""
    found = np.exp(logs - logs.max())
    return np.asarray(found / found.sum())


def _log_mean(logs: FloatArray) -> float:
    """Return the logarithm of the mean of numbers that are given by their logarithms."""
    most = float(logs.max())
    return most + float(np.log(np.mean(np.exp(logs - most))))
