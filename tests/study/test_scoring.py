"""Scores of the questionnaires against printed ones, and what becomes of missing answers."""

from __future__ import annotations

from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import StudyError
from hpop.study.forms import Form, missing, prorated, score

SSQ = Form.load("ssq")
ZEROS = {item.id: 0 for item in SSQ.items}

# FACTS of Kennedy et al. 1993, table 3, written out anew: items of each subscale.
SUBSCALES = {
    "N": "general_discomfort salivation sweating nausea difficulty_concentrating stomach_awareness burping",
    "O": "general_discomfort fatigue headache eyestrain difficulty_focusing difficulty_concentrating blurred_vision",
    "D": "difficulty_focusing nausea fullness_of_head blurred_vision dizziness_eyes_open dizziness_eyes_closed vertigo",
}


def test_the_ssq_has_16_items_and_seven_in_each_subscale():
    assert len(SSQ.items) == 16
    for name, items in SUBSCALES.items():
        assert {item.id for item in SSQ.items if name in item.subscales} == set(items.split())


def test_maxima_of_the_ssq():
    scores = score(SSQ, dict.fromkeys(ZEROS, 3))
    assert scores == pytest.approx({"N": 200.34, "O": 159.18, "D": 292.32, "total": 235.62})


def test_a_worked_example_of_the_ssq():
    scores = score(SSQ, ZEROS | {"nausea": 1, "general_discomfort": 1, "fatigue": 2})
    assert scores == pytest.approx({"N": 19.08, "O": 22.74, "D": 13.92, "total": 22.44})


# VRWalking_Dataset, SSQ_scores_NASA_Reaction_Time.csv: raw sums N, O, D and the total beside them.
@pytest.mark.parametrize(
    ("raw", "total"), [((4, 9, 5), 67.32), ((2, 5, 2), 33.66), ((6, 7, 9), 82.28), ((4, 13, 7), 89.76)]
)
def test_totals_of_a_public_table(raw, total):
    # Items of one subscale only give any raw sums; the greatest single one of O is 9, so 13 takes two shared ones.
    values = dict(ZEROS)
    n, o, d = raw
    if o > 9:
        values["difficulty_focusing"] = 3
        values["general_discomfort"] = 1
        n, o, d = n - 1, o - 4, d - 3
    for items, amount in (
        (("salivation", "sweating", "stomach_awareness", "burping"), n),
        (("fatigue", "headache", "eyestrain"), o),
        (("fullness_of_head", "dizziness_eyes_open", "dizziness_eyes_closed", "vertigo"), d),
    ):
        for item in items:
            values[item] = min(3, amount)
            amount -= values[item]
        assert amount == 0
    scores = score(SSQ, values)
    assert scores["total"] == pytest.approx(total)
    assert (scores["N"] / 9.54, scores["O"] / 7.58, scores["D"] / 13.92) == pytest.approx(raw)
    slip = raw[0] + raw[1] + raw[2] * 3.74  # of a public script: only D is scaled
    assert abs(scores["total"] - slip) > 10


@given(st.lists(st.integers(0, 3), min_size=16, max_size=16))
def test_scores_of_the_ssq_are_its_published_formula(values):
    answers = dict(zip(ZEROS, values, strict=True))
    sums = {name: sum(answers[item] for item in items.split()) for name, items in SUBSCALES.items()}
    expected = {name: sums[name] * times for name, times in (("N", 9.54), ("O", 7.58), ("D", 13.92))}
    expected["total"] = sum(sums.values()) * 3.74
    assert score(SSQ, answers) == pytest.approx(expected)


def test_a_missing_item_makes_the_scores_it_enters_missing():
    answers = dict.fromkeys(ZEROS, 1)
    del answers["nausea"]
    scores = score(SSQ, answers)
    assert isnan(scores["N"])
    assert isnan(scores["D"])
    assert isnan(scores["total"])
    assert scores["O"] == pytest.approx(7 * 7.58)
    assert score(SSQ, answers | {"nausea": None}) == pytest.approx(scores, nan_ok=True)
    assert score(SSQ, answers | {"nausea": nan}) == pytest.approx(scores, nan_ok=True)
    assert missing(SSQ, answers) == ("nausea",)


def test_prorating_fills_one_of_seven_and_says_so():
    answers = dict.fromkeys(ZEROS, 1)
    del answers["nausea"]
    scores = score(SSQ, answers, prorate=True)
    assert scores == pytest.approx({"N": 7 * 9.54, "O": 7 * 7.58, "D": 7 * 13.92, "total": 21 * 3.74})
    assert prorated(SSQ, answers) == ("N", "D", "total")
    del answers["sweating"]  # two of N's seven
    scores = score(SSQ, answers, prorate=True)
    assert isnan(scores["N"])
    assert scores["D"] == pytest.approx(7 * 13.92)
    assert isnan(scores["total"])
    assert prorated(SSQ, answers) == ("D",)


def test_scores_of_the_vrsq():
    form = Form.load("vrsq")
    assert len(form.items) == 9
    assert score(form, {item.id: 3 for item in form.items}) == pytest.approx(
        {"oculomotor": 100, "disorientation": 100, "total": 100}
    )
    answers = {item.id: 0 for item in form.items} | {"eyestrain": 3, "vertigo": 3}
    assert score(form, answers) == pytest.approx({"oculomotor": 25, "disorientation": 20, "total": 22.5})


def test_the_sus_is_scored_as_its_author_does():
    """Brooke 1996: position - 1 of odd statements, 5 - position of even ones, added up, times 2.5."""
    form = Form.load("sus")
    assert [item.reverse for item in form.items] == [False, True] * 5
    for positions in ([1, 5] * 5, [5, 1] * 5, [3] * 10, [4, 2, 5, 1, 3, 3, 5, 2, 4, 1], [1] * 10):
        brooke = 2.5 * (sum(p - 1 for p in positions[::2]) + sum(5 - p for p in positions[1::2]))
        answers = {item.id: p for item, p in zip(form.items, positions, strict=True)}
        assert score(form, answers) == {"usability": brooke}
    del answers["learn"]
    assert isnan(score(form, answers)["usability"])


def test_transport_that_was_never_used_is_left_out_of_the_mssq():
    form = Form.load("mssq")
    answers = {item.id: 1 for item in form.items} | {"child_ship": -1, "child_boat": -1, "child_swing": -1}
    answers["child_car"] = 3
    assert score(form, answers) == pytest.approx({"child": (3 + 5) * 9 / 6, "adult": 9, "total": 12 + 9})
    none = score(form, dict.fromkeys(answers, -1))
    assert all(map(isnan, none.values()))


def test_reversed_items_count_from_the_other_end():
    form = Form.load("naturalness")
    assert score(form, {"natural": 7, "expected": 7, "abrupt": 1})["naturalness"] == pytest.approx(7)
    assert score(form, {"natural": 4, "expected": 4, "abrupt": 7})["naturalness"] == pytest.approx(3)


@pytest.mark.parametrize("value", [4, -1, 1.5, True, "2", float("inf")])
def test_values_off_the_scale_are_refused_by_name(value):
    with pytest.raises(StudyError, match=r"item 'nausea' of form ssq: expected 0 to 3 in steps of 1, got"):
        score(SSQ, ZEROS | {"nausea": value})


def test_items_that_the_form_does_not_have_are_refused():
    with pytest.raises(StudyError, match=r"form ssq has no item 'nausae'. Did you mean 'nausea'"):
        score(SSQ, {"nausae": 1})


def test_equal_scores_are_equal_numbers():
    """A raw sum of 3 times 9.54 is 28.62 in the tables, and not 28.619999999999997, which other programs take apart."""
    answers = ZEROS | {"sweating": 3, "headache": 3}
    assert score(SSQ, answers) == {"N": 28.62, "O": 22.74, "D": 0.0, "total": 22.44}
