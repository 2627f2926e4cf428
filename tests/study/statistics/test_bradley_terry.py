"""Strengths from choices: baseball of 1987, closed forms, and the likelihood itself by another optimiser."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import optimize

from hpop.errors import StudyError
from hpop.study.statistics import bradley_terry

# Agresti 2002, Categorical Data Analysis, table 10.10 and section 10.6: wins at home and away of the Eastern Division
# of the American League in 1987, by home team (rows) against visitors, as the R package BradleyTerry2 has them.
TEAMS = ["Baltimore", "Milwaukee", "Detroit", "Toronto", "New York", "Boston", "Cleveland"]
GAMES = {
    "Milwaukee": {"Detroit": (4, 3), "Toronto": (4, 2), "New York": (4, 3), "Boston": (6, 1), "Cleveland": (4, 2)},
    "Detroit": {"Milwaukee": (3, 3), "Toronto": (4, 2), "New York": (4, 3), "Boston": (6, 0), "Cleveland": (6, 1)},
    "Toronto": {"Milwaukee": (2, 5), "Detroit": (4, 3), "New York": (2, 4), "Boston": (4, 3), "Cleveland": (4, 2)},
    "New York": {"Milwaukee": (3, 3), "Detroit": (5, 1), "Toronto": (2, 5), "Boston": (4, 3), "Cleveland": (4, 2)},
    "Boston": {"Milwaukee": (5, 1), "Detroit": (2, 5), "Toronto": (3, 3), "New York": (4, 2), "Cleveland": (5, 2)},
    "Cleveland": {"Milwaukee": (2, 5), "Detroit": (3, 3), "Toronto": (3, 4), "New York": (4, 3), "Boston": (4, 2)},
    "Baltimore": {"Milwaukee": (2, 5), "Detroit": (1, 5), "Toronto": (1, 6), "New York": (2, 4), "Boston": (1, 6)},
}
GAMES["Baltimore"]["Cleveland"] = (3, 4)
for team, games in {
    "Milwaukee": (6, 0),
    "Detroit": (4, 3),
    "Toronto": (6, 0),
    "New York": (6, 1),
    "Boston": (6, 0),
    "Cleveland": (2, 4),
}.items():
    GAMES[team]["Baltimore"] = games


def season():
    first, second, chosen = [], [], []
    for home, others in GAMES.items():
        for away, (won, lost) in others.items():
            i, j = TEAMS.index(home), TEAMS.index(away)
            first += [i] * (won + lost)
            second += [j] * (won + lost)
            chosen += [i] * won + [j] * lost
    return first, second, chosen


def test_agrestis_baseball():
    first, second, chosen = season()
    fit = bradley_terry(first, second, chosen, stimuli=7, reference=0)
    assert fit.choices == 273
    assert fit.strengths.round(2).tolist() == [0, 1.58, 1.44, 1.29, 1.25, 1.11, 0.68]
    assert fit.errors.round(4).tolist() == [0, 0.3433, 0.3396, 0.3367, 0.3359, 0.3339, 0.3319]


def test_agrestis_home_advantage():
    fit = bradley_terry(*season(), stimuli=7, reference=0, side=True)
    assert round(fit.side, 3) == 0.302
    assert round(fit.side_error, 3) == 0.131
    assert fit.strengths.round(3).tolist() == [0, 1.620, 1.475, 1.327, 1.281, 1.144, 0.705]


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 9))
def test_of_two_stimuli_the_odds_are_those_of_the_counts(wins, losses, ties):
    """Davidson: strengths differ by log(wins / losses), nu is ties / sqrt(wins losses)."""
    count = wins + losses + ties
    fit = bradley_terry([0] * count, [1] * count, [0] * wins + [1] * losses + [None] * ties, stimuli=2)
    assert fit.strengths[0] - fit.strengths[1] == pytest.approx(np.log(wins / losses), abs=1e-6)
    assert fit.ties == pytest.approx(ties / np.sqrt(wins * losses), abs=1e-6)
    assert fit.chance(0, 1) == pytest.approx(wins / (wins + losses), abs=1e-6)
    if not ties:  # the log odds of a binomial
        assert 2 * fit.errors[0] == pytest.approx(np.sqrt(1 / wins + 1 / losses), rel=1e-6)


@given(st.integers(0, 10**6))
def test_no_other_strengths_are_likelier(seed):
    rng = np.random.default_rng(seed)
    pairs = np.array([rng.permutation(3)[:2] for _ in range(40)])
    chosen = [None if tie else int(one) for tie, one in zip(rng.random(40) < 0.3, rng.choice([0, 1], 40), strict=True)]
    chosen = [None if one is None else int(pair[one]) for pair, one in zip(pairs, chosen, strict=True)]

    def unlikely(x):
        s, nu, total = np.array([x[0], x[1], -x[0] - x[1]]), np.exp(x[2]), 0.0
        for (i, j), one in zip(pairs, chosen, strict=True):
            a, b = np.exp(s[i]), np.exp(s[j])
            total -= np.log((nu * np.sqrt(a * b) if one is None else np.exp(s[one])) / (a + b + nu * np.sqrt(a * b)))
        return total

    try:
        fit = bradley_terry(*pairs.T, chosen, stimuli=3)
    except StudyError:
        assume(False)
    x = [*fit.strengths[:2], np.log(fit.ties)]
    best = optimize.minimize(unlikely, x)
    assert unlikely(x) == pytest.approx(best.fun, abs=1e-6)


@given(st.lists(st.sampled_from([(0, 1, 0), (1, 2, 1), (2, 0, 2), (0, 1, None), (2, 1, 2)]), max_size=9))
def test_naming_the_other_first_changes_nothing(more):
    choices = [(0, 1, 0), (1, 2, 1), (2, 0, 2), *more]
    there = bradley_terry(*zip(*choices, strict=True), stimuli=3)
    back = bradley_terry(*zip(*((j, i, one) for i, j, one in choices), strict=True), stimuli=3)
    assert there.strengths == pytest.approx(back.strengths, abs=1e-6)
    assert there.errors == pytest.approx(back.errors, abs=1e-6)


def test_choices_that_a_person_repeats_tell_no_more_than_once():
    """Each of 30 people, as often as he likes: the error of groups stays, that of single choices shrinks."""
    rng = np.random.default_rng(3)
    chosen = (rng.random(30) < 0.6).astype(int)
    people = np.arange(30)
    once = bradley_terry([0] * 30, [1] * 30, chosen, stimuli=2, people=people)
    single = bradley_terry([0] * 120, [1] * 120, np.repeat(chosen, 4), stimuli=2)
    often = bradley_terry([0] * 120, [1] * 120, np.repeat(chosen, 4), stimuli=2, people=np.repeat(people, 4))
    assert often.errors == pytest.approx(once.errors)
    assert single.errors == pytest.approx(once.errors / 2 * np.sqrt(29 / 30))


def test_intervals_are_wider_the_surer_they_are():
    fit = bradley_terry(*season(), stimuli=7)
    assert fit.strengths.sum() == pytest.approx(0)
    assert (fit.interval(0.99)[:, 0] < fit.interval(0.9)[:, 0]).all()
    assert np.diff(fit.interval(0.95), axis=1).ravel() == pytest.approx(2 * 1.959964 * fit.errors)


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ([(0, 1, 0), (0, 2, 0), (1, 2, 1), (2, 1, 2)], "always preferred to others, or never compared"),
        ([(0, 1, 0), (1, 0, 1)], "0, 1; 2|2; 0, 1"),
        ([(0, 1, None), (1, 2, None), (2, 0, None)], "all answers are neither"),
        ([(0, 1, 2)], "chosen must be one of the stimuli 0 and 1, or None, got 2"),
        ([(1, 1, 1)], "two different stimuli, by numbers from 0 to 2"),
        ([(0, 3, 0)], "two different stimuli, by numbers from 0 to 2"),
    ],
)
def test_choices_without_finite_strengths_are_refused(choices, said):
    with pytest.raises(StudyError, match=said):
        bradley_terry(*zip(*choices, strict=True), stimuli=3)


@pytest.mark.parametrize(
    "choices",
    [
        [(0, 1, 0), (1, 0, 1), (1, 2, 1), (2, 1, 2), (2, 0, 2), (0, 2, 0)],
        [(0, 1, 1), (1, 0, 1), (1, 0, 0)],  # whoever is named first loses, or is 1: both without end
        [(0, 1, 0), (0, 1, 0), (0, 1, 1)],  # 0 always first: its strength and its place are one
    ],
)
def test_whoever_is_named_first_cannot_decide_all(choices):
    with pytest.raises(StudyError, match="the order within pairs explains all choices, or cannot be separated"):
        bradley_terry(*zip(*choices, strict=True), stimuli=1 + max(max(pair[:2]) for pair in choices), side=True)


def test_ties_alone_give_no_finite_strengths_to_who_never_lost():
    """With two rows, the likelihood grows with the strength of 1, and nu with it: 0 was never chosen."""
    with pytest.raises(StudyError, match="one was always chosen, or tied"):
        bradley_terry([0] * 10, [1] * 10, [1] * 6 + [None] * 4, stimuli=2)


def test_errors_of_people_need_two():
    with pytest.raises(StudyError, match="two or more different people; got 2 names of 1 people"):
        bradley_terry([0, 0], [1, 1], [0, 1], stimuli=2, people=["p01", "p01"])


CIRCLE = [(0, 1, 0), (1, 2, 1), (2, 0, 2)]


def test_people_who_all_answer_alike_tell_nothing_of_how_people_differ():
    """Ten who choose in the same circle: no error is told, for none is 0; two who differ suffice."""
    circles = CIRCLE * 10
    people = np.repeat(np.arange(10), 3)
    alike = bradley_terry(*zip(*circles, strict=True), stimuli=3, people=people)
    assert alike.strengths == pytest.approx([0, 0, 0])
    assert np.isnan(alike.errors).all()
    assert np.isnan(alike.interval()).all()
    assert (bradley_terry(*zip(*circles, strict=True), stimuli=3).errors > 0).all()
    others = [(0, 1, 0), (1, 2, 1), (2, 0, 0), (0, 1, 1), (1, 2, 1), (2, 0, 2)]
    other = bradley_terry(*zip(*circles[:-6], *others, strict=True), stimuli=3, people=people)
    assert (other.errors > 0).all()
    fixed = bradley_terry(*zip(*circles, strict=True), stimuli=3, people=people, reference=0)
    assert fixed.errors[0] == 0  # by definition
    assert np.isnan(fixed.errors[1:]).all()
