"""Preference of a person, learnt from choices between trajectories: weights of the costs, with their uncertainty."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST_SEED, real, whole
from hpop.base.text import counted
from hpop.errors import StudyError
from hpop.frontier import ItemFront
from hpop.preference import storage
from hpop.preference.answers import (
    CostScale,
    Feature,
    PairAnswer,
    answer_of,
    answers_of_choices,
    answers_of_ratings,
    checked_question,
    evidence,
    fingerprint,
)
from hpop.preference.posterior import (
    COUNT,
    NEAR,
    Best,
    Draws,
    best_probability_and_regret,
    least_cost_row,
    most_informative_pair,
    row_probability_and_regret,
)
from hpop.preference.prior import Prior

QUESTIONS = 12
"""Default number of questions after which asking stops."""
SURE = 0.8
"""Probability of the best row above which no more questions are needed."""
NOT_RANDOM = 0.1
"""Probability of random answers from which on asking stops only at the number of questions, not by ``SURE``."""
ASKING = 1_000
"""Number of draws for choosing the next question, and for deciding whether to ask one."""
MOST_DRAWS = 1_000_000
JUDGING = 2_000
"""Number of draws for choosing the best row."""
PREFER, COMFORT = "prefer", "comfort"


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Preference:
    """Preference of one person about one question: weights of a front's costs, as a posterior; :meth:`fit` makes one.

    The preferred trajectory need not be the most comfortable one (Becerra et al. 2020), so ask about preference and
    comfort in two questions.

    scale     names and units of the costs, and the values that are 0 and 1 on the scale
    question  "prefer", "comfort", or another name of 1 to 100 characters
    answers   answers of the person
    draws     weighted draws of the posterior
    prior     the belief before any answer
    ties      True if "no difference" was a possible answer
    seed      seed of all random draws: equal answers give an equal preference
    front     SHA-256 of the front's costs
    points    the front itself; None for a preference read from a file (see :meth:`on`)

    Guarantees: no weight is negative, so a dominated point is never best; the order in which two points were shown, and
    a change of units, change nothing. For people who follow the prior, including those who care for some of the costs
    only, intervals contain the true share at least as often as they claim.

    Cost: some 10 ms for each question, 30 to 55 ms if draws are renewed, 2 ms for the best row, of some hundred points.
    """

    scale: CostScale
    question: str
    answers: tuple[PairAnswer, ...]
    draws: Draws
    prior: Prior
    ties: bool
    seed: int
    front: str
    points: ItemFront[Any] | None

    @classmethod
    def fit(
        cls,
        front: ItemFront[Any],
        choices: Iterable[Any] = (),
        *,
        ratings: Mapping[int, float] | None = None,
        question: str = PREFER,
        features: Mapping[str, Feature] | None = None,
        ties: bool | None = None,
        prior: Prior | None = None,
        seed: int = 0,
        count: int = COUNT,
    ) -> Self:
        """Learn a preference from choices between points of a front, or from ratings; with neither it is the prior.

        Parameters
        ----------
        front : front of at least two points
        choices : pairs of rows, (chosen, other), or choices from a study's answers, which may be ties
        ratings : by row, more is better; they count as pairs within the person, see :func:`~answers.answers_of_ratings`
        question : name of the question, such as "prefer" or "comfort"
        features : by cost: "log", or a number above which the cost counts once more; see :class:`CostScale`
        ties : whether "no difference" was a possible answer; by default whether it occurs
        prior : by default that of an unknown person; see :meth:`People.prior`, which is rescaled by units where ranges
            differ
        seed : seed of the random draws
        count : draws of the posterior

        Raises StudyError for rows that the front does not have, and for invalid choices.
        """
        seed = whole("seed", seed, 0, MOST_SEED, error=StudyError)
        scale = CostScale.of(front, features)
        costs = np.asarray(front.costs)
        answers = answers_of_choices(choices, costs) + ([] if ratings is None else answers_of_ratings(ratings, costs))
        # In random order: sorted answers would drive the draws away from the posterior, and back.
        answers = [answers[i] for i in np.random.default_rng([seed, 4]).permutation(len(answers))]
        may_tie = any(answer.chosen is None for answer in answers) if ties is None else bool(ties)
        prior = (Prior() if prior is None else prior).on(scale.measures)
        count = whole("count", count, 1_000, 10**6, error=StudyError)
        drawn = Draws.of(prior, len(scale.columns), count, np.random.default_rng([seed, 0]))
        empty = cls(scale, checked_question(question), (), drawn, prior, may_tie, seed, fingerprint(front), front)
        return empty._with_answers(answers)

    def told(self, first: int, second: int, chosen: int | None) -> Self:
        """Return the preference after one more answer: two shown rows, and the chosen one; None for no difference.

        Raises StudyError for rows that the front does not have.
        """
        return self._with_answers([answer_of(first, second, chosen, self.scale.costs_on(self._points()))])

    def _with_answers(self, more: Iterable[PairAnswer]) -> Self:
        """Return the preference after further answers."""
        answers, draws = list(self.answers), self.draws
        new = list(more)
        if not self.ties and any(answer.chosen is None for answer in new):
            raise StudyError('"no difference" was not a possible answer; give ties=True from the first question on')
        known = evidence([*answers, *new], self.scale, ties=self.ties)
        for i, answer in enumerate(new, len(answers)):
            draws = draws.with_answers(
                known[i : i + 1], known[: i + 1], self.prior, np.random.default_rng([self.seed, 1, i])
            )
            answers.append(answer)
        return replace(self, answers=tuple(answers), draws=draws)

    def on(self, front: ItemFront[Any]) -> Self:
        """Return the preference with another front, on which a unit of each cost keeps its weight.

        Raises StudyError if the front lacks a cost.
        """
        self.scale.costs_on(front)
        return replace(self, points=front)

    # Results

    @property
    def weights(self) -> dict[str, float]:
        """Expected share of each cost, scaled to its range over the front of the questions; the shares add up to 1.

        The shares assume that there is a preference at all. :attr:`random` says how probable it is that there is none,
        and intervals include that.
        """
        return dict(zip(self.scale.columns, self._shares.tolist(), strict=True))

    def interval(self, level: float = 0.9) -> dict[str, tuple[float, float]]:
        """Return, for each cost, an interval that contains its share with probability ``level``, with equal tails.

        The lower end is 0 if the person may well not care for this cost; the upper end is 1 if the person may well care
        for no other cost.
        """
        level = real("level", level, 0.01, 0.999, "a probability", error=StudyError)
        probability, found = self.draws.probability(), {}
        for j, name in enumerate(self.scale.columns):
            order = np.argsort(self.draws.shares[:, j])
            below = np.cumsum(probability[order])
            ends = np.searchsorted(below, [(1 - level) / 2, (1 + level) / 2])
            low, high = self.draws.shares[order, j][np.minimum(ends, len(order) - 1)].tolist()
            found[name] = (low, high)
        return found

    @property
    def random(self) -> float:
        """Probability that the person answers at random."""
        return float(self.draws.probability()[self.draws.sharpness == 0].sum())

    @property
    def can_be_seen(self) -> bool:
        """True if there are answers, and the probability that the person answers at random is below one half."""
        return bool(self.answers) and self.random < 0.5

    def best(self, front: ItemFront[Any] | None = None) -> Best:
        """Return the point with the least expected cost for the person, and each point's probability to be the best.

        front  by default the front of the preference, :attr:`points`

        Raises StudyError for a front without one of the costs.
        """
        front = self._points() if front is None else front
        row = self.row(front)
        probability, regrets = best_probability_and_regret(self.scale.rows_on(front), self.equal_draws(JUDGING))
        near = np.flatnonzero(regrets <= regrets[row] + NEAR)
        order = near[np.argsort(regrets[near], kind="stable")].tolist()
        rest = tuple(other for other in order if other != row)
        return Best(row, front[row], probability, regrets, (row, *rest))

    def row(self, front: ItemFront[Any]) -> int:
        """Return the row of the best point of a front, for ``front.select(preference=...)``."""
        if not len(front):
            raise StudyError("expected a front with at least one point to choose from, got none")
        return least_cost_row(self.scale.rows_on(front), self._shares)

    def expected(self, front: ItemFront[Any], costs: FloatArray) -> FloatArray:
        """Return the expected totals (m,) of costs (m, k) for this person, minus the total of costs that are all 0.

        The k costs are in the order of ``front.names``. A total is the sum of the scaled costs (0 and 1 at the ideal
        and the nadir of the preference's own front), each times the person's mean share.
        Raises StudyError if the front lacks a cost of the preference.
        """
        of = np.asarray(costs)[:, self.scale.column_indices(front)]
        return np.asarray((self.scale.scaled(of) - self.scale.scaled(np.zeros((1, of.shape[1])))) @ self._shares)

    # Questions

    def next_pair(self) -> tuple[int, int] | None:
        """Return the two rows to ask about next, the left one first; None if no remaining rows differ noticeably."""
        front = self._points()
        costs = self.scale.costs_on(front)
        asked = [(a.first, a.second) for a in self.answers if self._is_about(a, costs)]
        rng = np.random.default_rng([self.seed, 2, len(self.answers)])
        return most_informative_pair(self.scale.scaled(costs), self.equal_draws(ASKING), asked, rng, ties=self.ties)

    def why_stop(self, most: int = QUESTIONS) -> str:
        """Return the reason why no more questions are needed, as text; "" if another question is worth asking.

        ``most`` is the number of answers after which asking stops in any case.
        """
        if len(self.answers) >= most:
            return f"{counted(most, 'question')} asked"
        if not self.answers or self.random >= NOT_RANDOM:
            return ""
        front = self._points()
        probability, regret = row_probability_and_regret(
            self.scale.rows_on(front), self.equal_draws(ASKING), self.row(front)
        )
        if probability > SURE:
            return f"the best one is known with a probability of {probability:.2f}"
        if regret < NEAR:
            return f"another one is expected to be better by only {100 * regret:.1f} % of the range"
        return ""

    # Files

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the preference to a JSON file ``hpop-preference``, completely or not at all; OSError if that fails."""
        storage.write(path, self._stored())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file from :meth:`save`; StudyError for another kind of file, OSError if it cannot be read.

        The preference has no front: see :meth:`on`, or give one to :meth:`best`.
        """
        stored = storage.read(path)
        draws = Draws(stored.shares, stored.sharpness, stored.ties_nu, np.zeros(len(stored.ties_nu)))
        return cls(
            stored.scale,
            stored.question,
            stored.answers,
            draws,
            stored.prior,
            stored.ties,
            stored.seed,
            stored.front,
            None,
        )

    def _stored(self) -> storage.Stored:
        """Return the content of the preference's file."""
        draws = self.equal_draws(storage.DRAWS)
        return storage.Stored(
            self.scale, self.question, self.answers, self.prior, self.ties, self.seed, self.front,
            draws.shares, draws.sharpness, draws.ties,
        )  # fmt: skip

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {share:.2f}" for name, share in self.weights.items())
        return f"<Preference ({self.question}) from {len(self.answers)} answers: {shares}>"

    @cached_property
    def _shares(self) -> FloatArray:
        # Only draws with a preference: regret is not defined for random answers.
        probability = self.draws.probability() * (self.draws.sharpness > 0)
        if not probability.any():
            probability = self.draws.probability()
        return np.asarray(probability @ self.draws.shares / probability.sum())

    def equal_draws(self, count: int = JUDGING) -> Draws:
        """Return ``count`` equally weighted draws of the posterior of the person's weights."""
        count = whole("count", count, 1, MOST_DRAWS, "a number of draws", error=StudyError)
        return self.draws.equally_weighted(count, np.random.default_rng([self.seed, 3, len(self.answers), count]))

    def _points(self) -> ItemFront[Any]:
        """Return the front of the preference; StudyError if it was read from a file and has none."""
        if self.points is None:
            raise StudyError("this preference was read from a file and has no front; attach one: preference.on(front)")
        return self.points

    def _is_about(self, answer: PairAnswer, costs: FloatArray) -> bool:
        """Return whether an answer is about rows of these costs (n, k), rather than rows of another front."""
        rows = (answer.first, answer.second)
        return max(rows) < len(costs) and all(
            tuple(costs[row].tolist()) == known for row, known in zip(rows, answer.costs, strict=True)
        )
