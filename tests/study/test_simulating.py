"""Simulated answers are whole, marked, and show what they were made with."""

from __future__ import annotations

import numpy as np
import pytest

from hpop import study
from hpop.errors import StudyError

SAME = dict.fromkeys("ABC", 0.0)


def test_everybody_answers_all_and_is_marked_as_simulated(design):
    answers = study.simulate(design, SAME, seed=1)
    assert answers.people == tuple(person.id for person in design.participants)
    assert answers.faults == ()
    assert all(session.ended and session.device["simulated"] is True for session in answers.sessions)
    assert not np.isnan(answers.matrix("ssq", "total").values).any()
    assert len(answers.choices()) == 3 * len(answers.people)


def test_the_seed_says_it_all(design):
    assert study.simulate(design, SAME, seed=1).table == study.simulate(design, SAME, seed=1).table
    assert study.simulate(design, SAME, seed=1).table != study.simulate(design, SAME, seed=2).table


def test_who_feels_worse_answers_so_and_chooses_so(design):
    answers = study.simulate(design, {"A": 0.0, "B": 2.0, "C": 6.0}, liking={"A": 0, "B": 0, "C": 9}, seed=1)
    a, b, c = np.median(answers.matrix("ssq", "total").values, axis=0)
    assert a < b < c
    a, b, c = np.median(answers.matrix("comfort", "comfort").values, axis=0)
    assert a > b > c
    worst, liked = design.condition("C").row, design.condition("C").row
    assert not any(one.chosen_row == worst for one in answers.choices(question="comfort"))
    assert all(one.chosen_row == liked for one in answers.choices() if liked in one[1:3])


def test_tiring_shows_by_place(design):
    matrix = study.simulate(design, SAME, tiring=2.0, seed=1).matrix("ssq", "total")
    first, last = (matrix.values[matrix.places == place] for place in (1, 3))
    assert np.median(last) > np.median(first) + 10


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"discomfort": {"A": 0}}, r"discomfort must have a number for each stimulus \(A, B, C\), but lacks B"),
        ({"discomfort": SAME, "liking": {"A": 0}}, "liking must have a number for each"),
        ({"discomfort": SAME, "correlation": 2}, "correlation must be"),
        ({"discomfort": SAME, "seed": -1}, "seed must be"),
    ],
)
def test_what_cannot_be_simulated_is_refused(design, asked, said):
    with pytest.raises(StudyError, match=said):
        study.simulate(design, **asked)
