"""Analysis of a study, and simulated answers."""

from __future__ import annotations

import csv
import json
import runpy
from dataclasses import replace

import numpy as np
import pytest

from hpop import study
from hpop.errors import StudyError
from hpop.study import report, statistics
from tests.study.sessions import events_of, put, session

Q = {"comfort": 12, "prefer": 11}
FELT = {"A": -0.5, "B": 1.5, "C": 4.0}


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Draw the figures with fewer pixels."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hpop.study.report.DPI", 30)
        yield


@pytest.fixture(scope="module")
def answers(design):
    return study.simulate(design, {"before": -1.0, **FELT}, liking={"A": 0.5, "B": 0.0, "C": -0.5}, seed=3)


@pytest.fixture(scope="module")
def result(design, answers):
    return study.analyse(design, answers)


@pytest.fixture(scope="module")
def saved(result, tmp_path_factory):
    """Return a study's folder with its answers and its report."""
    folder = tmp_path_factory.mktemp("study")
    result.design.save(folder)
    for one in result.answers.sessions:
        events = [event.model_dump(exclude_none=True) for event in one.events]
        put(folder, session(result.design, one.person.id, events, device=dict(one.device)))
    result.save(folder / "first")
    return folder


def real(design, rule):
    """Answers that are not marked, by a rule of participant, place, form and item."""
    sessions = []
    made = study.simulate(design, dict.fromkeys("ABC", 0.0)).sessions[0]
    for person in design.participants:
        events = tuple(type(made.events[0]).model_validate(event) for event in events_of(design, person.id, rule))
        sessions.append(replace(made, person=person, device={"browser": "Firefox"}, events=events))
    return study.Answers(design, tuple(sessions))


def test_stimuli_that_differ_are_found_and_by_the_tests_that_are_named(result, answers):
    values = answers.matrix("ssq", "total").values
    (test,) = result.tables["test"]
    assert test["p"] == statistics.friedman(values).p < 0.001
    assert [row["p"] for row in result.tables["pairs"]] == [
        statistics.wilcoxon(values[:, i], values[:, j]).p for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    medians = [row["median"] for row in result.tables["scores"][1:4]]
    assert medians == pytest.approx(np.median(values, axis=0)) == sorted(medians)
    assert "Pratt" in result.choices["Differences of zero"]
    assert result.choices["Correction"].startswith("Holm")


def test_stimuli_that_do_not_differ_are_not_found(design):
    result = study.analyse(design, study.simulate(design, dict.fromkeys("ABC", 0.0), seed=5))
    assert result.tables["test"][0]["p"] > 0.05


def test_a_place_that_matters_is_found(design, result):
    tired = study.analyse(design, study.simulate(design, dict.fromkeys("ABC", 0.0), tiring=2.0, seed=3))
    assert tired.tables["carry-over"][0]["p"] < 0.001
    assert result.tables["carry-over"][0]["p"] > 0.05
    assert [row["people"] for row in result.tables["carry-over"]] == [12, 12]


def test_the_papers_method_has_the_papers_tests_and_their_identity(design, answers):
    result = study.analyse(design, answers, method="paper")
    (test,), pairs = result.tables["test"], result.tables["pairs"]
    assert test["chi-square"] == pytest.approx(2 / 3 * sum(row["z"] ** 2 for row in pairs))
    assert pairs[1]["z"] == pytest.approx(pairs[0]["z"] + pairs[2]["z"])
    assert [row["adjusted p"] for row in pairs] == [min(1, 3 * row["p"]) for row in pairs]
    assert {row["p by"] for row in result.tables["against before"]} == {"normal approximation"}
    assert "costs power" in result.choices["Test of all stimuli"]


def test_the_mixed_model_finds_the_stimuli_and_tells_of_the_stimulus_before(design):
    felt = {"A": 0.0, "B": 0.6, "C": 1.2}
    result = study.analyse(design, study.simulate(design, felt, correlation=0.3, seed=1), method="mixed")
    (test,), pairs = result.tables["test"], result.tables["pairs"]
    assert (test["df"], test["people"], test["scores"]) == (2, 12, 36)
    assert test["p"] < 0.05
    assert [row["odds ratio"] > 1 for row in pairs] == [True] * 3  # A feels best, C worst
    assert pairs[1]["odds ratio"] == pytest.approx(pairs[0]["odds ratio"] * pairs[2]["odds ratio"])
    assert [row["df"] for row in result.tables["carry-over"]] == [2, 2, 2]
    after = [row["odds ratio"] for row in result.tables["stimulus before"]]
    assert np.prod(after) == pytest.approx(1.0)
    assert "Ordinal mixed model" in result.text()


def test_choices_are_counted_and_strengths_go_with_them(result):
    rows = [row for row in result.tables["choices"] if row["question"] == "prefer"]
    assert [row["first chosen"] + row["second chosen"] + row["neither"] for row in rows] == [12, 12, 12]
    strengths = [row["strength"] for row in result.tables["strengths"]]
    assert len(strengths) == 3
    assert strengths == sorted(strengths, reverse=True)
    assert "comfort, strengths: some groups of stimuli were always preferred" in result.choices["Not done"]
    assert "A" in result.choices["Not done"].split("them: ")[1]


def test_who_did_not_answer_all_is_left_out_where_it_is_said(design, answers):
    half = replace(answers.sessions[0], events=answers.sessions[0].events[:40])  # up to the first stimulus
    result = study.analyse(design, study.Answers(design, (half, *answers.sessions[1:])))
    assert (result.tables["test"][0]["people"], result.tables["test"][0]["left out"]) == (11, 1)
    assert "12 sessions; 11 with all scores" in result.choices["People"]
    assert "the session of p01 is incomplete" in result.choices["Faults of sessions"]
    assert "11 of 12" in result.choices["Complete sessions"]
    assert "order" in result.choices["Orders of complete sessions"]
    assert sum(row["place 1"] for row in result.tables["balance"]) == 11


def test_who_compared_some_pairs_alone_has_no_favourite_among_all(design, answers):
    """A participant who did not compare one pair has no favourite: counted with the others, no share would reach 1."""
    events = [one for one in answers.sessions[0].events if one.kind != "compare" or one.value["question"] == "comfort"]
    some = replace(answers.sessions[0], events=tuple(events))
    result = study.analyse(design, study.Answers(design, (some, *answers.sessions[1:])))
    rows = {question: [row for row in result.tables["favourites"] if row["question"] == question] for question in Q}
    for question, of in Q.items():
        assert [row["of"] for row in rows[question]] == [of] * 4
        assert sum(row["people"] for row in rows[question]) == of
        assert rows[question][-1]["favourite"] == "none over each other one"


def test_the_page_says_what_stands_behind_each_letter_and_how_long_it_lasts(design, answers):
    first, *others = design.conditions
    design = replace(design, conditions=(replace(first, duration=60.0), *others))
    result = study.analyse(design, study.Answers(design, answers.sessions))
    assert [row["seconds"] for row in result.tables["stimuli"]] == [60.0, *(one.duration for one in others)]
    assert [row["length (m)"] for row in result.tables["stimuli"]] == [one.costs["length"] for one in design.conditions]
    assert "may come from the durations" in result.choices["Durations"]
    assert "--share" not in result.text()
    assert "60.0 s (" in report.page(result, {}).partition("<h2>")[0]


def test_what_has_no_value_is_a_dash_that_the_page_explains_and_a_gap_in_csv(front, tmp_path):
    design = study.Design.of(front, ["knee", "view"], participants=6, consent="Yes", forms=["fms"])
    result = study.analyse(design, study.simulate(design, {"A": 0.0, "B": 0.5}, seed=2), score=("fms", "sickness"))
    still = next(f"{one.id}: {one}" for one in design.conditions if one.row is None)
    result.save(tmp_path)
    page, table = (tmp_path / "report.html").read_text(), (tmp_path / "stimuli.csv").read_text()
    (row,) = [line for line in page.split("<tr>") if line.startswith(f"<td>{still}</td>")][:1]
    assert row.count("<td>-</td>") == max(len(one.costs) for one in design.conditions)
    assert "<td></td>" not in page
    assert "<th>Dashes in tables</th>" in page
    assert ",," in next(line for line in table.splitlines() if line.startswith(still))


def test_a_report_into_the_folder_of_a_study_is_refused_for_it_has_tables_of_the_same_names(result, design, tmp_path):
    design.save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(StudyError, match=r"a report needs a folder of its own, such as .*report"):
        result.save(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("inside", ["pages", "answers/p01", "stimuli", "words"])
def test_a_report_among_a_studys_pages_or_answers_is_refused(result, design, tmp_path, inside):
    design.save(tmp_path)
    with pytest.raises(StudyError, match=r"a report needs a folder of its own, such as .*report"):
        result.save(tmp_path / inside)
    assert not (tmp_path / inside).exists()


def test_of_two_stimuli_the_place_is_tested_as_a_pair_is(front):
    design = study.Design.of(front, ["knee", "least turns"], participants=6, consent="Yes", forms=["fms"])
    result = study.analyse(design, study.simulate(design, {"A": 0.0, "B": 0.5}, seed=2), score=("fms", "sickness"))
    place = result.tables["carry-over"][0]
    assert place["check"] == "the place matters (Wilcoxon, exact p)"
    assert "chi-square" not in place
    assert "once a ride, at its end" in result.choices["Questionnaire"]
    assert "Asked before the first stimulus, once after each" in result.choices["Questionnaire"]


def test_what_one_persons_answers_do_not_suffice_for_is_said(design, answers):
    result = study.analyse(design, study.Answers(design, answers.sessions[:1]))
    assert "test" not in result.tables
    assert "test: Friedman's test needs the scores of two people or more" in result.choices["Not done"]
    assert "test: Friedman" in result.text()


def test_simulated_answers_are_marked_everywhere(result, saved):
    assert result.mark.startswith("SIMULATED: all answers")
    assert result.mark in result.text()
    for name in ("scores", "order", "choices"):
        assert result.mark in [text.get_text() for text in result.draw(name).texts]
    for path in (saved / "first").iterdir():
        if path.suffix == ".csv":
            assert all(line.endswith(",SIMULATED") for line in path.read_text().splitlines()[1:])
        elif path.suffix != ".png":
            assert result.mark in path.read_text()


def test_answers_of_people_are_not_marked(design):
    result = study.analyse(design, real(design, lambda person, place, form, item: float(item == "nausea") * place % 3))
    assert result.mark == ""
    assert "SIMULATED" not in result.text()
    mixed = study.Answers(design, (*study.simulate(design, FELT).sessions[:2], *result.answers.sessions[2:]))
    assert study.analyse(design, mixed).mark.startswith("SIMULATED: 2 of 12 sessions")


def test_the_report_is_written_and_its_code_writes_it_again(saved, monkeypatch):
    monkeypatch.chdir(saved)
    runpy.run_path(str(saved / "first" / "repeat.py"))
    first = {path.name: path.read_bytes() for path in (saved / "first").iterdir()}
    again = {path.name: path.read_bytes() for path in (saved / "report").iterdir()}
    assert first == again
    assert first.keys() >= {"report.html", "repeat.py", "scores.csv", "test.csv", "scores.png", "order.png"}


def test_tables_are_written_to_the_last_digit(saved, result):
    with open(saved / "first" / "pairs.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["p"]) for row in rows] == [row["p"] for row in result.tables["pairs"]]
    assert [row["first"] for row in rows] == [row["first"] for row in result.tables["pairs"]]


def test_the_page_names_every_choice_asks_for_nothing_and_runs_nothing(result, saved):
    page = (saved / "first" / "report.html").read_text()
    for what in result.choices:
        assert f"<th>{what}</th>" in page
    assert "<script" not in page
    assert "default-src 'none'" in page
    assert "http" not in page.replace("http-equiv", "")
    assert result.design.digest in page


def test_names_of_rows_stay_text_on_the_page(design, answers):
    conditions = (replace(design.conditions[0], name="<script>alert(1)</script>"), *design.conditions[1:])
    named = replace(design, conditions=conditions)
    page = report.page(study.analyse(named, study.Answers(named, answers.sessions)), {})
    assert "<script" not in page
    assert "&lt;script&gt;" in page


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"method": "papers"}, "Did you mean 'paper'"),
        ({"correction": "fdr"}, "correction must be one of holm, bonferroni, none"),
        ({"score": ("vrsq", "total")}, "the study has no form 'vrsq'"),
        ({"score": ("ssq", "sum")}, "score must be one of N, O, D, total"),
        ({"score": ("preference", "comfort")}, "is not asked after each stimulus"),
        ({"score": "ssq"}, "score must be a form and a name"),
    ],
)
def test_what_cannot_be_analysed_is_refused(design, answers, asked, said):
    with pytest.raises(StudyError, match=said):
        study.analyse(design, answers, **asked)


def test_answers_of_nobody_and_figures_that_do_not_exist_are_refused(design, result):
    with pytest.raises(StudyError, match="no participant has all answers for the score total"):
        study.analyse(design, study.Answers(design, ()))
    with pytest.raises(StudyError, match="Did you mean 'scores'"):
        result.draw("score")


def test_an_item_is_analysed_as_a_score_is(design, answers):
    result = study.analyse(design, answers, score=("ssq", "nausea"))
    assert result.tables["scores"][1]["median"] in (0, 1, 2, 3)
    assert json.dumps(result.choices)


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
