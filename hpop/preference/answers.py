"""Answers of a person (choices between two trajectories, or ratings), the scale of their costs, and their probability.

A person feels a trajectory's total cost ``w . z``. Here z holds its costs as shares of the front's range, and w >= 0
the person's weights, so a trajectory that costs more of everything is never preferred. Of two trajectories the person
chooses the cheaper one by a Bradley-Terry model; with a small probability, a lapse of attention, the choice is random::

    P(a over b) = lapse / 2 + (1 - lapse) logistic(w . (z_b - z_a)),    w = sharpness x shares,   shares add up to 1

If "no difference" is a possible answer, ties follow Davidson (1970, "On extending the Bradley-Terry model to
accommodate ties in paired comparison experiments"), with ``nu`` the weight of a tie.

The scale has an extra column for each threshold. It is that of the front about which a person was asked, and is kept by
units: on another front a metre has the weight that it had there, however wide the other front is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import MOST, real, whole
from hpop.base.text import HARMFUL, counted, python_value, shown
from hpop.errors import StudyError, did_you_mean
from hpop.frontier import ItemFront
from hpop.frontier.choosing import ROUNDING

LOG = "log"
BENT = 9.0
"""Curvature of a logarithmic cost: at the ideal a unit counts 1 + BENT times as much as at the nadir."""
Feature = str | float
"""Nonlinearity of a cost: "log", or a threshold in the cost's unit, above which the cost counts more."""


class Measure(NamedTuple):
    """Column of a scale: the name of a cost, its unit, and its range on the front in that unit (0 if constant)."""

    name: str
    unit: str
    size: float


@dataclass(frozen=True, eq=False)
class CostScale:
    """Scale that maps the costs of a front to numbers from 0 to 1; costs of other fronts may lie outside.

    names     of the k costs
    units     of the k costs
    ideal     (k,)   least value of each cost on the front
    span      (k,)   range of each cost on the front; 0 for a constant cost, which has no effect on a preference
    features  nonlinearities by name of a cost: "log" lets a unit near the ideal count more; a number in the cost's unit
              is a threshold, and the excess above it is a further column with a share of its own
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    ideal: FloatArray
    span: FloatArray
    features: Mapping[str, Feature]

    def __post_init__(self) -> None:
        for name, feature in self.features.items():
            self._check_feature(name, feature)

    @classmethod
    def of(cls, front: ItemFront[Any], features: Mapping[str, Feature] | None = None) -> CostScale:
        """Return the scale of a front's costs; StudyError for fewer than two points, or an invalid feature."""
        if not isinstance(front, ItemFront):
            raise StudyError(f"a preference needs a front, such as problem.solve() returns, got {shown(front)}")
        if len(front) < 2:
            raise StudyError(
                f"a preference needs a front of at least two points, got {counted(len(front), 'point')}; plan one with "
                "other criteria or planners"
            )
        low, high = front.ideal(), front.nadir()
        varies = high - low > ROUNDING * np.maximum(np.abs(low), np.abs(high))
        if features is not None and not isinstance(features, Mapping):
            raise StudyError(
                f"features must be a dict by name of a cost, such as {{'turns': 6}}, got {shown(features)}"
            )
        return cls(front.names, front.units, low, np.where(varies, high - low, 0.0), dict(features or {}))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns that have shares of their own: the costs, and their excesses above thresholds."""
        above = [f"{name} above {bound:g}" for name, bound in self._thresholds]
        return (*self.names, *above)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Name, unit and range of each column; the unit of a logarithmic cost is marked as such."""
        found = []
        for name, unit, span in zip(self.names, self.units, self.span.tolist(), strict=True):
            found.append(Measure(name, f"{LOG} {unit}" if self.features.get(name) == LOG else unit, span))
        for column, (name, bound) in zip(self.columns[len(found) :], self._thresholds, strict=True):
            j = self.names.index(name)
            room = float(self.ideal[j] + self.span[j]) - bound
            found.append(Measure(column, self.units[j], max(room, 0.0)))
        return tuple(found)

    def scaled(self, costs: FloatArray) -> FloatArray:
        """Scale costs (n, k), given in their units; return (n, f), one column for each of :attr:`columns`."""
        plain = self._range_shares(costs)
        columns = [
            self._log_scaled(plain[:, j]) if self.features.get(n) == LOG else plain[:, j]
            for j, n in self._column_sources
        ]
        for name, bound in self.features.items():
            if not isinstance(bound, str):
                j = self.names.index(name)
                room = self.ideal[j] + self.span[j] - bound
                columns.append(np.maximum(costs[:, j] - bound, 0.0) / room if room > 0 else np.zeros(len(costs)))
        return np.column_stack(columns)

    def column_indices(self, front: ItemFront[Any]) -> list[int]:
        """Return the indices of this scale's costs among the costs of a front; StudyError that names a missing cost."""
        places = []
        for name, unit in zip(self.names, self.units, strict=True):
            if name not in front.names:
                raise StudyError(
                    f"the preference weighs {shown(name)}, which the front does not have"
                    f"{' but reported' * (name in front.reported_names)}.{did_you_mean(name, front.names)} Its costs "
                    f"are {', '.join(front.names)}; plan with {shown(name)} as a criterion, or answer the questions "
                    "for this front again"
                )
            j = front.names.index(name)
            if front.units[j] != unit:
                raise StudyError(
                    f"the preference has {shown(name)} in {shown(unit)}, the front in {shown(front.units[j])}; "
                    "convert the front's costs to the same unit, or answer the questions for this front again"
                )
            places.append(j)
        return places

    def costs_on(self, front: ItemFront[Any]) -> FloatArray:
        """Return the costs (n, k) of a front in the order of this scale; StudyError that names a missing cost."""
        return np.asarray(front.costs[:, self.column_indices(front)])

    def rows_on(self, front: ItemFront[Any]) -> FloatArray:
        """Return the scaled costs (n, f) of the points of a front."""
        return self.scaled(self.costs_on(front))

    @property
    def _thresholds(self) -> list[tuple[str, float]]:
        """Names of costs that have a threshold, with the threshold."""
        return [(name, bound) for name, bound in self.features.items() if not isinstance(bound, str)]

    @cached_property
    def _column_sources(self) -> list[tuple[int, str]]:
        """Index and name of each cost."""
        return list(enumerate(self.names))

    def _range_shares(self, costs: FloatArray) -> FloatArray:
        """Scale costs (n, k): `ideal` becomes 0, `ideal` + `span` becomes 1, and constant costs become 0."""
        varies = self.span > 0
        shares = (costs - self.ideal) / np.where(varies, self.span, 1.0)
        return np.asarray(np.where(varies, shares, 0.0))

    @staticmethod
    def _log_scaled(share: FloatArray) -> FloatArray:
        """Bend shares of a cost's range logarithmically: 0 at the ideal, 1 at the nadir, linear below the ideal."""
        below = np.minimum(share, 0.0)
        return np.asarray((BENT * below + np.log1p(BENT * np.maximum(share, 0.0))) / np.log1p(BENT))

    def _check_feature(self, name: str, feature: Any) -> None:
        """Raise StudyError for a feature of an unknown cost, or a threshold outside the range of the cost."""
        if name not in self.names:
            raise StudyError(f"no cost is called {shown(name)}.{did_you_mean(name, self.names)} There are: "
                             f"{', '.join(self.names)}")  # fmt: skip
        if feature == LOG:
            return
        bound = real(f"the feature of {name}", feature, -MOST, MOST, "'log' or a number in its unit", error=StudyError)
        j = self.names.index(name)
        if not self.ideal[j] < bound < self.ideal[j] + self.span[j]:
            raise StudyError(
                f"the feature of {name} must be a number between its least and greatest value on the front, "
                f"{self.ideal[j]:g} to {self.ideal[j] + self.span[j]:g} {self.units[j]}, got {bound:g}"
            )


def fingerprint(front: ItemFront[Any]) -> str:
    """Return the SHA-256 of a front's names, units and costs, by which files refer to the front."""
    text = json.dumps([front.names, front.units, front.costs.tolist()], allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


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
    costs          costs (k,) of the first and of the second point, in the order and units of the :class:`CostScale`
    weight         number of answers that it counts for: 1, or 2 / m for a pair that is derived from m ratings
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
    """Return the answers of one person as the arrays from which the preference model is fitted.

    scale  converts costs to shares of their ranges, so that all costs are comparable
    ties   True if "no difference" was a possible answer

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
