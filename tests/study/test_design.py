"""Claims: a design is balanced, blind, the same when read again, and refuses what would not be a study."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop import study
from hpop.errors import StudyError
from hpop.study.conditions import lettered_conditions
from hpop.study.design import Design
from tests.study.conftest import CONSENT


def of(front: hpop.Front, rows: Any = ("knee", "least turns", "least length"), **changes: Any) -> Design:
    return Design.of(front, rows, **{"participants": 6, "consent": CONSENT, **changes})


def test_the_papers_design_has_three_f_and_three_m_in_each_of_six_orders(front: hpop.Front) -> None:
    design = of(front, participants=36, strata={"sex": ("f", "m")})
    both = Counter((person.order, person.strata["sex"]) for person in design.participants)
    assert len(both) == 12
    assert set(both.values()) == {3}
    assert not any("orders" in note for note in design.notes)


def test_letters_are_dealt_by_the_seed_and_not_by_the_rows(front: hpop.Front) -> None:
    rngs = map(np.random.default_rng, range(20))
    dealt = {tuple(one.row for one in lettered_conditions(front, [3, 0, 5], "ride", rng)) for rng in rngs}
    assert len(dealt) == 6
    assert of(front, seed=3).document == of(front, seed=3).document


def test_what_the_page_knows_names_no_row_no_cost_and_nobody_else(front: hpop.Front) -> None:
    """Nothing of the front is in it, by its words or its numbers, but how long a stimulus lasts."""
    design = of(front, rows=["knee", "least length", "view"], seed=4)
    public = design.public("p02")
    text = json.dumps(public)
    for word in ("row", "knee", "least", "exposure", "turns", "front", "sha", "seed", "strata", "p01", "p03"):
        assert word not in text.replace("turns in", ""), word
    for condition in design.conditions:
        assert not any(str(cost) in text for cost in condition.costs.values() if cost != int(cost))
    assert [place["condition"] for place in public["places"]] == list(design.participant("p02").order)
    assert {place["stimulus"] for place in public["places"]} == {"stimuli/A.html", "stimuli/B.html", "stimuli/C.html"}
    assert set(public) == {
        *("schema", "version", "design", "participant", "language", "consent", "protocol", "forms", "places"),
        "comparisons",
    }


def test_each_pair_is_compared_once_left_and_right_alike_often_and_never_the_still_view(front: hpop.Front) -> None:
    design = of(front, rows=[0, 1, 2, "view"], participants=240, order="permutations")
    view = next(one.id for one in design.conditions if one.row is None)
    pairs = [design.pairs(person.id) for person in design.participants]
    for several in pairs:
        assert len({frozenset(pair) for pair in several}) == len(several) == 3
        assert view not in {letter for pair in several for letter in pair}
    left = Counter(first for several in pairs for first, _ in several)
    assert all(190 < count < 290 for count in left.values())  # 240 of each, standard deviation 11
    assert len({tuple(several) for several in pairs}) > 20


def test_a_baseline_lasts_as_long_as_the_others_on_average(front: hpop.Front) -> None:
    design = of(front, rows=[0, 5, "view"])
    lasts = {one.row: one.duration for one in design.conditions}
    assert lasts[None] == pytest.approx((lasts[0] + lasts[5]) / 2)
    assert next(one for one in design.conditions if one.row is None).costs == {}


def test_a_design_is_read_as_it_was_written(design: Design, tmp_path: Path) -> None:
    design.save(tmp_path)
    again = Design.load(tmp_path)
    assert again.digest == design.digest
    assert again.conditions == design.conditions
    assert again.participants == design.participants
    assert again.questionnaires == design.questionnaires
    assert (again.protocol, again.consent, again.seed) == (design.protocol, design.consent, design.seed)
    schedule = (tmp_path / "schedule.csv").read_text().splitlines()
    assert schedule[0] == "participant,sex,place 1,place 2,place 3,left,takes the place of"
    assert len(schedule) == 13


def test_another_design_has_another_digest(front: hpop.Front) -> None:
    several = [of(front), of(front, seed=1), of(front, consent="Else"), of(front, forms=["ssq"]), of(front, [0, 1, 2])]
    assert len({design.digest for design in several}) == len(several)


def test_who_left_is_followed_by_the_next_person_in_the_same_order(design: Design, tmp_path: Path) -> None:
    """Answers of the others stay answers of this design: the digest is the same."""
    before = design.participant("p03")
    after = design.after("p03", withdrawn=False).after("p13", withdrawn=True)
    after.save(tmp_path)
    again = Design.load(tmp_path)
    assert again.digest == design.digest
    assert [person.id for person in again.participants] == [f"p{i:02d}" for i in range(1, 15)]
    assert {person.id for person in again.expected} == {f"p{i:02d}" for i in range(1, 15)} - {"p03", "p13"}
    for successor in ("p13", "p14"):
        assert again.participant(successor).order == before.order
        assert again.participant(successor).strata == before.strata
    assert again.withdrawn == {"p13"}
    counts = Counter((person.order, person.strata["sex"]) for person in again.expected)
    assert set(counts.values()) == {1}
    assert again.after("p03", withdrawn=True).withdrawn == {"p03", "p13"}  # who dropped out may still withdraw
    with pytest.raises(StudyError, match="p13 withdrew already; p14 has the place"):
        again.after("p13", withdrawn=True)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"consent": ""}, "the consent text is empty"),
        ({"consent": " \n\t "}, "the consent text is empty"),
        ({"consent": "Yes \x1b[2J"}, "control character"),
        ({"consent": "x" * 20_001}, "20,001 characters"),
        ({"rows": ["knee"]}, "2 to 26 stimuli"),
        ({"rows": ["view"]}, "2 to 26 stimuli"),
        ({"rows": ["knee", 0, 3]}, r"knee \(row 3\) and row 3 are the same trajectory"),
        ({"participants": 0}, "participants must be"),
        ({"participants": 1001}, "from 1 to 1,000"),
        ({"participants": 40}, "multiple of 6 participants, got 40: take 36 or 42"),
        ({"order": "permutation"}, "Did you mean 'permutations'"),
        ({"forms": ["sqq"]}, "Did you mean 'ssq'"),
        ({"forms": "ssq"}, "forms must be a list of ids"),
        ({"forms": ["ssq", "ssq"]}, "each once, got ssq, ssq"),
        ({"forms": [], "comparisons": False}, "must have one form or more"),
        ({"language": "fr"}, "forms without texts in 'fr': "),
        (
            {"forms": ["ssq", "ipq"]},
            "expected forms with questions, got ipq, whose text is not part of hpop: copy .*ipq",
        ),
        ({"strata": {"sex": ("f", "m"), "age": ("a", "b")}}, "expected at least 8"),
        ({"kind": "film"}, "kind must be one of ride, video"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_what_makes_no_study_is_refused(front: hpop.Front, changes: dict[str, Any], match: str) -> None:
    with pytest.raises(StudyError, match=match):
        of(front, **changes)


@pytest.mark.parametrize(("rest_s", "rule"), [(-1.0, "Stop."), (4000.0, "Stop."), (60.0, ""), (60.0, "Stop\x1b[2J")])
def test_a_protocol_rests_up_to_an_hour_and_says_how_to_stop(rest_s: float, rule: str) -> None:
    with pytest.raises(StudyError, match=r"rest_s must be|the stop rule"):
        study.Protocol(rest_s, rule)


def test_more_conditions_than_letters_are_refused(front: hpop.Front) -> None:
    costs = [[float(i), float(40 - i)] for i in range(40)]
    many = hpop.Front.of(costs, [front.trajectories[0]] * 40, names=("turns", "length"))
    with pytest.raises(StudyError, match=r"2 to 26 stimuli, .* got 27"):
        of(many, rows=list(range(27)), order="latin", comparisons=False)
    assert len(of(many, rows=list(range(26)), order="latin", comparisons=False).letters) == 26
    with pytest.raises(StudyError, match="9 stimuli have 36 pairs"):
        of(many, rows=list(range(9)), order="latin")


def test_orders_that_cannot_be_equally_frequent_are_told(front: hpop.Front) -> None:
    assert "20 participants for 6 orders" in of(front, participants=20, order="williams").notes[0]
    assert "with 18 or 24 each is seen equally often" in of(front, participants=20, order="williams").notes[0]
    assert "with 6 each" in of(front, participants=4, order="williams").notes[0]
    assert not any("orders" in note for note in of(front, participants=20, order="random").notes)


def test_orders_that_are_not_equally_frequent_within_strata_are_told(front: hpop.Front) -> None:
    """Each of 24 orders once: none can be seen by both; each of six twice can."""
    sexes = {"sex": ("f", "m")}
    note = of(front, rows=[0, 1, 2, 3], participants=24, strata=sexes).notes[0]
    assert "not seen equally often within f or m; with a multiple of 48 participants they are, 48 for instance" in note
    for options in ({"rows": [0, 1, 2, 3], "order": "williams", "participants": 24}, {"participants": 12}):
        assert not any("within" in note for note in of(front, strata=sexes, **options).notes)


def test_the_digest_of_a_front_is_that_of_what_it_holds(front: hpop.Front, tmp_path: Path) -> None:
    """Saved elsewhere it is the same; with another cost or another way it is not."""
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    assert study.front_digest(again) == study.front_digest(front)
    assert study.front_digest(again[1:]) != study.front_digest(front)
    swapped = replace(front, items=(front.items[1], front.items[0], *front.items[2:]))
    assert study.front_digest(swapped) != study.front_digest(front)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('"seed": 7', '"seed":  7', "was rewritten by another program"),
        ('"version": 1', '"version": 2', "at version: Input should be 1, got 2"),
        ('"seed": 7', '"seed": 7, "seed": 7', "twice in one object"),
        ('"seed": 7', '"seed": NaN', "the constant NaN"),
        ('"seed": 7', '"seed": 7, "owner": "Anna"', "at owner: Extra inputs are not permitted"),
        ('"seed": 7,', "", "at seed: Field required"),
        ('"id": "p02"', '"id": "Anna"', r"at participants\[1\].id"),
        ('"id": "p02"', '"id": "p07"', "p01, p02, ..., each once"),
        ('"schema": "hpop-study"', '"schema": "hpop-front"', "at schema"),
        ('"kind": "ride"', '"kind": "ri\\u001bde"', r"at conditions\[0\].kind"),
    ],
)
def test_a_design_file_that_is_none_is_refused(design: Design, tmp_path: Path, old: str, new: str, match: str) -> None:
    design.save(tmp_path)
    path = tmp_path / "design.json"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(StudyError, match=match) as told:
        Design.load(tmp_path)
    assert "\x1b" not in str(told.value)
    assert str(path) in str(told.value)


def test_a_file_that_says_who_left_is_read_as_strictly(design: Design, tmp_path: Path) -> None:
    design.after("p03", withdrawn=True).save(tmp_path)
    path = tmp_path / "people.json"
    text = path.read_text()
    for old, new, match in (
        ("p03", "p33", "p33 cannot leave the study: expected a participant of the study who has not left"),
        ("p13", "p14", "the successor of p03 must have the next free id, p13; got p14"),
        ("p13", "Anna", "at left"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(StudyError, match=match):
            Design.load(tmp_path)


def test_a_baseline_is_shown_and_compared_as_a_row_is_and_no_choice_of_a_row(front, tmp_path):
    beside = study.Baseline("common planner", front.trajectories[4], dict(front[4].costs))
    design = study.Design.of(front, [0, 2], participants=6, consent="You may stop.", baselines=[beside], seed=1)
    (shown,) = (one for one in design.conditions if one.row is None)
    assert (shown.kind, shown.name, str(shown)) == ("ride", "common planner", "common planner (baseline)")
    assert shown.duration == front.trajectories[4].execution().duration
    assert len(design.pairs("p01")) == 3
    design.save(tmp_path)
    assert study.Design.load(tmp_path).conditions == design.conditions
    answers = study.simulate(design, dict.fromkeys("ABC", 0.0))
    assert len(answers.sessions[0].comparisons) == 6
    assert {(one.first_row, one.second_row) for one in answers.choices()} <= {(0, 2), (2, 0)}
