"""Answers of a person (choices between two trajectories, or ratings), and their probability in a model of the person.

A person feels a trajectory's total cost ``w . z``. Here z holds its costs as shares of the front's range, and w >= 0
the person's weights, so a trajectory that costs more of everything is never preferred. Of two trajectories the person
chooses the cheaper one by a Bradley-Terry model; with a small probability, a lapse of attention, the choice is random::

    P(a over b) = lapse / 2 + (1 - lapse) logistic(w . (z_b - z_a)),    w = sharpness x shares,   shares add up to 1

If "no difference" is a possible answer, ties follow Davidson (1970, "On extending the Bradley-Terry model to
accommodate ties in paired comparison experiments"), with ``nu`` the weight of a tie.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import MOST, real, whole
from hpop.base.text import HARMFUL, python_value, shown
from hpop.errors import StudyError
from hpop.preference.scale import CostScale

LAPSE = 0.02
"""Share of answers that are random, by a lapse of attention."""
BLOCK = 2**14
"""Number of probabilities in a block: they fit the processor's cache, which is three times as fast."""
MOST_GAIN = 700.0
"""Largest extra cost of a chosen point that is put in an exponential, which would overflow beyond it.

An answer with a larger one can only be a lapse.
"""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Answers of a person as arrays, in the form that the model needs.

    The order in which two points were shown does not matter.

    gains    (n, f)  value of each cost at the point that was not chosen, minus its value at the chosen point, as a
             share of the cost's range; for a tie the sign does not matter
    tied     (n,)    True where the answer was "no difference"
    offered  (n,)    True where "no difference" was a possible answer
    weight   (n,)    number of answers that each row counts for
    """

    gains: FloatArray
    tied: BoolArray
    offered: BoolArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.gains)

    def log_probability(self, weights: FloatArray, ties: FloatArray) -> FloatArray:
        """Return the log probability (N,) of all answers together, for each of N draws of a person's weights.

        weights  (N, f)  of the draws
        ties     (N,)    Davidson's nu of the draws
        """
        logs = np.empty(len(weights))
        size = max(1, BLOCK // max(1, len(self)))
        for begin in range(0, len(weights), size):
            part = slice(begin, begin + size)
            gains = weights[part] @ self.gains.T  # (draws, n)
            logs[part] = log_answer_probability(gains, self.tied, self.offered, ties[part, None]) @ self.weight
        return logs

    def __getitem__(self, which: slice) -> Evidence:
        return Evidence(self.gains[which], self.tied[which], self.offered[which], self.weight[which])


def log_answer_probability(gain: FloatArray, tied: BoolArray, offered: BoolArray, ties: FloatArray) -> FloatArray:
    """Return the log probability of single answers; all arguments are arrays that broadcast.

    gain     extra cost of the point that was not chosen, w . (z_other - z_chosen)
    tied     True where the answer was "no difference"
    offered  True where "no difference" was a possible answer
    ties     Davidson's nu
    """
    gain = np.where(tied, np.abs(gain), np.maximum(gain, -MOST_GAIN))  # a tie is symmetric to the last digit
    half = np.exp(-0.5 * gain)  # square root of the odds against the chosen point
    nu = np.where(offered, ties, 0.0)
    share = np.where(tied, nu * half, 1.0) / (1.0 + half * (half + nu))
    lapse = np.where(offered, LAPSE / 3, LAPSE / 2)
    return np.asarray(np.log(lapse + (1.0 - LAPSE) * share))


def answer_probabilities(gain: FloatArray, ties: FloatArray | None) -> tuple[FloatArray, ...]:
    """Return the probabilities of the possible answers: the first point, the second, and "no difference" if possible.

    gain  extra cost of the second point over the first, summed with the person's weights (sharpness times shares)
    ties  Davidson's nu; None if "no difference" is not possible
    """
    size = np.exp(-np.abs(gain))
    nu = 0.0 if ties is None else ties * np.sqrt(size)
    total = 1.0 + size + nu
    ahead = (1.0 - LAPSE) / total
    behind = ahead * size
    lapse = LAPSE / 2 if ties is None else LAPSE / 3
    first = lapse + np.where(gain < 0, behind, ahead)
    second = lapse + np.where(gain < 0, ahead, behind)
    return (first, second) if ties is None else (first, second, lapse + nu * ahead)


MOST_ANSWERS = 10_000
"""Largest number of answers of one person, including pairs that are derived from ratings."""


class PairAnswer(NamedTuple):
    """Answer to a question about two points of a front.

    first, second  rows of the two points in the front, in the order in which they were shown
    chosen         row of the preferred point; None for "no difference"
    costs          costs of both points, in the units of the preference
    weight         number of answers that it counts for: 1, except for pairs that are derived from ratings
    """

    first: int
    second: int
    chosen: int | None
    costs: tuple[tuple[float, ...], tuple[float, ...]]
    weight: float = 1.0


def answer_of(first: Any, second: Any, chosen: Any, costs: FloatArray, weight: float = 1.0) -> PairAnswer:
    """Return an answer about two rows of a front with costs (n, k); StudyError for invalid rows."""
    a, b = (whole(what, row, 0, len(costs) - 1, "a row of the front", error=StudyError)
            for what, row in (("the first", first), ("the second", second)))  # fmt: skip
    chosen = python_value(chosen)
    if a == b:
        raise StudyError(f"a choice must be between two different rows, got {a} twice")
    if chosen is not None and chosen not in (a, b):
        raise StudyError(f"chosen must be row {a} or {b}, or None for no difference, got {shown(chosen)}")
    pair = tuple(costs[a].tolist()), tuple(costs[b].tolist())
    return PairAnswer(a, b, None if chosen is None else int(chosen), pair, weight)


def checked_question(question: Any) -> str:
    """Return a question's name, such as "prefer"; raise StudyError unless it is text of 1 to 100 characters."""
    if not isinstance(question, str) or not question.strip() or len(question) > 100 or HARMFUL.search(question):
        raise StudyError(f"a question must be a word such as 'prefer' or 'comfort', got {shown(question)}")
    return question


def answers_of_choices(choices: Iterable[Any], costs: FloatArray) -> list[PairAnswer]:
    """Convert choices between rows to answers.

    Choices are pairs (chosen row, other row), or objects with ``first_row``, ``second_row`` and ``chosen_row``.
    """
    answers = []
    for choice in choices:
        if hasattr(choice, "chosen_row"):
            answers.append(answer_of(choice.first_row, choice.second_row, choice.chosen_row, costs))
        elif isinstance(choice, Sequence) and not isinstance(choice, str) and len(choice) == 2:
            answers.append(answer_of(choice[0], choice[1], choice[0], costs))
        else:
            raise StudyError(
                "a choice must be the chosen row and the other one, such as (3, 12), or a result of "
                f"answers.choices(...), got {shown(choice)}"
            )
    return answers


def answers_of_ratings(ratings: Mapping[int, float], costs: FloatArray) -> list[PairAnswer]:
    """Convert ratings by row, where a higher rating is better, to answers: in each pair the better row is chosen.

    Rows with equal ratings count as "no difference". m ratings hold no more information than m - 1 comparisons, so each
    of the m (m - 1) / 2 pairs has the weight 2 / m.
    """
    if not isinstance(ratings, Mapping) or len(ratings) < 2:
        raise StudyError(f"ratings must be a dict of at least two, such as {{3: 7, 12: 4.5}}, got {shown(ratings)}")
    if len(ratings) ** 2 > 2 * MOST_ANSWERS:
        raise StudyError(f"expected ratings of at most {int((2 * MOST_ANSWERS) ** 0.5)} rows, got {len(ratings):,}")
    rated = [
        (row, real(f"the rating of row {shown(row)}", rating, -MOST, MOST, error=StudyError))
        for row, rating in ratings.items()
    ]
    answers = []
    for (a, of_a), (b, of_b) in combinations(sorted(rated), 2):
        better = None if of_a == of_b else (a if of_a > of_b else b)
        answers.append(answer_of(a, b, better, costs, 2 / len(ratings)))
    return answers


def evidence(answers: Sequence[PairAnswer], scale: CostScale, *, ties: bool) -> Evidence:
    """Convert answers to the arrays that the model needs.

    ties  True if "no difference" was a possible answer

    Raises StudyError for more than :data:`MOST_ANSWERS` answers.
    """
    n = len(answers)
    if n > MOST_ANSWERS:
        raise StudyError(f"expected at most {MOST_ANSWERS:,} answers of a person, got {n:,}; leave some out")
    pairs = np.array([answer.costs for answer in answers]).reshape(n, 2, len(scale.names))
    gains = scale.scaled(pairs[:, 1]) - scale.scaled(pairs[:, 0])
    turned = np.array([answer.chosen == answer.second for answer in answers], dtype=np.bool_)
    return Evidence(
        np.where(turned[:, None], -gains, gains),
        np.array([answer.chosen is None for answer in answers], dtype=np.bool_),
        np.full(n, ties),
        np.array([answer.weight for answer in answers], dtype=np.float64),
    )
