"""Learning of a criterion from ratings: a weighted sum of criteria that explains how people rate trajectories."""

from __future__ import annotations

import errno
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.files import replacing
from hpop.base.options import MOST, one_of, real
from hpop.base.text import is_whole, shown
from hpop.criteria.base import Criterion, CriterionSpec, describe_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.learnt import LEAST_WEIGHT, Learnt, Source, checked_parts, document
from hpop.errors import HpopWarning, StudyError
from hpop.frontier.strict_json import pieces
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory

FOLDS = 10
"""Largest number of folds of the cross-validation."""
ROUNDING = 1e-9
"""Share of a column's largest number below which differences between one person's values are rounding errors."""
BETTER = ("high", "low")


@dataclass(frozen=True, eq=False)
class Fitted:
    """Learnt weights of criteria, with their prediction error; :meth:`save` makes a criterion from them.

    parts    weight and criterion; zero weights are left out
    source   origin of the ratings, with the cross-validated error
    """

    parts: tuple[tuple[float, Criterion], ...]
    source: Source

    @property
    def weights(self) -> dict[str, float]:
        """Return the weights by criterion, in points of the rating per unit of the criterion."""
        return {criterion.name: weight for weight, criterion in self.parts}

    def save(self, path: str | os.PathLike[str]) -> Learnt:
        """Write the learnt criterion to a JSON file, completely or not at all, and return the criterion.

        Raises OSError if it cannot be written.
        """
        target = Path(path)
        if not target.parent.exists():
            raise FileNotFoundError(errno.ENOENT, "the folder for the criterion does not exist; create it", str(path))
        told = document(tuple((weight, describe_criterion(criterion)) for weight, criterion in self.parts), self.source)
        with replacing(target) as file:
            for piece in pieces(told):
                file.write(piece.encode())
        return Learnt(str(target))

    def __str__(self) -> str:
        """Return the weighted sum and the origin of the ratings as text."""
        return f"{' + '.join(f'{weight:.4g} {name}' for name, weight in self.weights.items())}, {self.source}"


@checked_arguments
def fit_criterion(
    ratings: Sequence[float],
    trajectories: Sequence[Trajectory] | Sequence[int],
    problem: Problem,
    criteria: Sequence[CriterionSpec],
    *,
    people: Sequence[Any] | None = None,
    front: Front | None = None,
    better: str = "high",
    question: str = "comfort",
    source: str,
) -> Fitted:
    """Learn a criterion from ratings: the weighted sum of criteria that explains how trajectories were rated.

    The weights minimise the squared error and are not negative. Each person's mean is removed, so only differences
    between ratings of one person count. Costs are those of the planned motion, as planners use them. The error is
    cross-validated: up to ten times some trajectories are left out, and their ratings are predicted. A warning tells if
    this is no better than predicting each person's mean.

    Parameters
    ----------
    ratings : (N,) numbers
    trajectories : (N,) rated trajectories, or with ``front`` its rows
    problem : the world, in which costs are evaluated
    criteria : candidates, all of them sums: "exposure", not its mean "obstruction"
    people : (N,) ids of the raters; one person by default
    front : front of the rows in ``trajectories``
    better : whether a "high" or a "low" rating is the better one
    question : the rated quality
    source : description of the ratings (people, time, place) for users of the criterion

    Raises StudyError for inconsistent ratings, CriterionError for a criterion that is not a sum.
    """
    one_of("better", better, BETTER, error=StudyError)
    if not isinstance(source, str) or not source.strip():
        raise StudyError("source must describe the ratings, such as '12 colleagues, May 2026, simulated ride'")
    rated = [_number(rating) for rating in ratings]
    ways = [_way(one, front) for one in trajectories]
    who = [0] * len(rated) if people is None else list(people)
    if not len(rated) == len(ways) == len(who):
        raise StudyError(
            f"expected as many trajectories and people as ratings, got {len(ways)} and {len(who)} for {len(rated)}"
        )
    made = [criterion for _, criterion in checked_parts([(0.0, spec) for spec in criteria])]
    by_states = {_states(way): way for way in ways}  # equal trajectories are left out together
    distinct, places = list(by_states.values()), {states: i for i, states in enumerate(by_states)}
    of = np.array([places[_states(way)] for way in ways], dtype=np.intp)
    if len(distinct) < len(made) + 2:
        raise StudyError(
            f"to learn {len(made)} weights, expected at least {len(made) + 2} distinct trajectories, got "
            f"{len(distinct)}; rate more of them, or take fewer criteria"
        )
    costs = trajectory_costs(made, distinct, problem.world)[of]  # (N, k)
    ids = {one: i for i, one in enumerate(dict.fromkeys(who))}
    persons = np.array([ids[one] for one in who], dtype=np.intp)
    if np.bincount(persons).max() < 2:
        raise StudyError(
            "each person rated only one trajectory, and ratings are compared within a person; ask for more"
        )
    values = np.array(rated) * (1.0 if better == "low" else -1.0)  # (N,) more is worse
    weights = _least_squares_weights(costs, values, persons)
    if not weights.any():
        raise StudyError(
            "no criterion explains these ratings: each weight is 0, because costs are higher where ratings are better; "
            f"check better={better!r}"
        )
    error, of_mean = _errors(costs, values, persons, of)
    if not LEAST_WEIGHT <= weights.max() <= MOST or max(error, of_mean) > MOST:
        raise StudyError(
            f"expected a weight from {LEAST_WEIGHT:g} to {MOST:g}, and an error up to that, got {weights.max():.3g} "
            f"and {error:.3g}; give the ratings in another unit"
        )
    if error >= of_mean:
        warnings.warn(
            f"the learnt criterion predicts left-out trajectories no better than each person's mean (error {error:.3g} "
            f"against {of_mean:.3g}); take fewer criteria, or more ratings",
            HpopWarning,
            stacklevel=2,
        )
    told = Source(question, source, len(rated), len(ids), len(distinct), error, of_mean)
    return Fitted(tuple((float(w), c) for w, c in zip(weights, made, strict=True) if w > 0), told)


def _number(rating: Any) -> float:
    """Return a rating as a float; StudyError if it is not a number in range."""
    return float(real("a rating", rating, -MOST, MOST, error=StudyError))


def _way(given: Any, front: Front | None) -> Trajectory:
    """Return the rated trajectory, which is given itself or as a row of the front."""
    if isinstance(given, Trajectory):
        return given
    if front is not None and is_whole(given) and 0 <= given < len(front):
        return front.trajectories[int(given)]
    rows = "its trajectory" if front is None else f"its trajectory, or its row, 0 to {len(front) - 1}"
    raise StudyError(f"each rating needs {rows}; got {shown(given)}")


def _states(way: Trajectory) -> tuple[Any, ...]:
    """Return a key that is equal for equal trajectories: kinds and states of their motions."""
    states = way.states
    return (way.kinds, *((name, np.asarray(getattr(states, name)).tobytes()) for name in states.names))


def _least_squares_weights(costs: FloatArray, values: FloatArray, persons: IntArray) -> FloatArray:
    """Return non-negative least-squares weights (k,), fitted to differences from each person's mean.

    Lawson and Hanson 1974.
    """
    from scipy.optimize import nnls

    away = _within(np.column_stack([costs, values]), persons)
    size = np.sqrt((away**2).mean(axis=0))
    size = np.where(size > 0, size, 1.0)
    weights, _ = nnls(away[:, :-1] / size[:-1], away[:, -1])
    return np.asarray(weights / size[:-1])


def _within(table: FloatArray, persons: IntArray) -> FloatArray:
    """Subtract each person's mean from a table (N, m).

    Mere rounding errors become 0; otherwise they would get weights.
    """
    away = table - _levels(table, persons)[persons]
    return np.where(np.abs(away) > ROUNDING * np.abs(table).max(axis=0), away, 0.0)


def _levels(table: FloatArray, persons: IntArray) -> FloatArray:
    """Return the mean (people, m) of each person's rows in a table (N, m)."""
    counts = np.maximum(np.bincount(persons), 1)
    return np.column_stack([np.bincount(persons, column) / counts for column in table.T])


def _errors(costs: FloatArray, values: FloatArray, persons: IntArray, of: IntArray) -> tuple[float, float]:
    """Return two root mean square errors on left-out trajectories: of the learnt weights, and of each person's mean.

    A person's mean is learnt from the remaining ratings; a person without remaining ratings is not predicted.

    costs    (N, k)  of the rated trajectories
    values   (N,)    ratings; more is worse
    persons  (N,)    number of each rating's person
    of       (N,)    number of each rating's trajectory
    """
    folds = np.random.default_rng(0).permutation(of.max() + 1) % FOLDS
    squares: list[FloatArray] = []
    for fold in range(min(FOLDS, len(folds))):
        out = folds[of] == fold
        kept = ~out
        asked = out & np.isin(persons, persons[kept])
        if not asked.any():
            continue
        weights = _least_squares_weights(costs[kept], values[kept], persons[kept])
        both = np.column_stack([values - costs @ weights, values])
        levels = _levels(both[kept], persons[kept])
        squares.append((both[asked] - levels[persons[asked]]) ** 2)
    if not squares:
        raise StudyError(
            "the error on left-out trajectories cannot be computed, because a person's ratings are always all left out "
            "or all used; ask each person about more trajectories"
        )
    error, of_mean = np.sqrt(np.concatenate(squares).mean(axis=0)).tolist()
    return error, of_mean
