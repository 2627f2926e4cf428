"""Claims: answers are stored as given, are refused where they are not of this design, and name no participant."""

from __future__ import annotations

import csv
import math
import sqlite3
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop import study
from hpop.errors import StudyError
from hpop.study import Answers, Design
from tests.study.conftest import CONSENT
from tests.study.sessions import answered, events_of, put, session

NAME = "Käthe Müller"


@pytest.fixture
def folder(design: Design, tmp_path: Path) -> Path:
    """Return the folder of a study without answers."""
    design.save(tmp_path)
    return tmp_path


def rule(participant: str, place: int, form: str, item: str) -> float:
    """Values that differ by who, where and what, within the scales."""
    number = int(participant[1:]) + 3 * place + 7 * len(item)
    return float(number % (11 if form == "comfort" else 4))


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_answers_come_out_as_they_were_given(design: Design, folder: Path) -> None:
    answered(design, folder, ["p02", "p10", "p01"], rule)
    answers = Answers.load(folder)
    assert answers.people == ("p01", "p02", "p10")
    assert len(answers.table) == 3 * (16 * 4 + 3)
    for row in answers.table:
        assert row.value == rule(row.participant, row.place, row.form, row.item)
        order = design.participant(row.participant).order
        assert row.condition == (order[row.place - 1] if row.place else None)
        assert row.seconds == 1.0
    assert answers.faults == ()
    assert answers.notes[0] == "3 of 12 sessions are complete"


def test_a_matrix_has_people_by_stimuli_and_says_at_which_place(design: Design, folder: Path) -> None:
    people = [f"p{i:02d}" for i in range(1, 13)]
    answered(design, folder, people, rule)
    answers = Answers.load(folder, design)
    matrix = answers.matrix("comfort", "comfort")
    assert matrix.people == tuple(people)
    assert matrix.conditions == ("A", "B", "C")
    for i, person in enumerate(people):
        for j, letter in enumerate("ABC"):
            place = design.participant(person).order.index(letter) + 1
            assert matrix.places[i, j] == place
            assert matrix.values[i, j] == rule(person, place, "comfort", "comfort")
    assert Counter(matrix.places[:, 0].tolist()) == {1: 4, 2: 4, 3: 4}
    nausea = answers.before("ssq", "nausea")
    assert nausea.tolist() == [rule(person, 0, "ssq", "nausea") for person in people]
    assert answers.notes == ("12 of 12 sessions are complete",)


def test_the_total_of_the_ssq_is_made_of_what_was_answered(design: Design, folder: Path) -> None:
    """Nausea 1, general discomfort 1, fatigue 2: Kennedy's weights give 19.08, 22.74, 13.92 and 22.44 (FACTS 9)."""
    given = {"nausea": 1.0, "general_discomfort": 1.0, "fatigue": 2.0}
    answered(design, folder, ["p01"], lambda who, place, form, item: given.get(item, 0.0) if place == 2 else 0.0)
    answers = Answers.load(folder)
    second = design.participant("p01").order[1]
    for name, value in {"N": 19.08, "O": 22.74, "D": 13.92, "total": 22.44}.items():
        matrix = answers.matrix("ssq", name)
        assert dict(zip(matrix.conditions, matrix.values[0].round(6), strict=True)) == {
            letter: value if letter == second else 0.0 for letter in "ABC"
        }
        assert answers.before("ssq", name).tolist() == [0.0]


def test_a_later_answer_takes_the_place_of_an_earlier_one_and_may_take_it_back(design: Design, folder: Path) -> None:
    events = events_of(design, "p01")
    first, second = [event for event in events if event["kind"] == "answer"][:2]
    t = events[-1]["t"]
    events[-1:-1] = [{**first, "t": t, "value": 3}, {**second, "t": t, "value": 2}, {**second, "t": t, "value": None}]
    put(folder, session(design, "p01", events))
    answers = Answers.load(folder)
    found = {row.item: row.value for row in answers.table if row.place == 0}
    assert found[first["item"]] == 3
    assert second["item"] not in found
    assert answers.faults == (f"p01: ssq at place 0 lacks 1 answer: {second['item']}",)
    assert math.isnan(answers.before("ssq", "total")[0])
    assert answers.matrix("ssq", "total").values.tolist() == [[0.0, 0.0, 0.0]]


def test_choices_are_rows_of_the_front_in_the_order_shown(design: Design, folder: Path) -> None:
    events = events_of(design, "p04")
    compared = [event for event in events if event["kind"] == "compare"]
    compared[0]["value"]["chosen"] = "none"
    put(folder, session(design, "p04", events))
    put(folder, session(design, "p05"))
    answers = Answers.load(folder)
    rows = {condition.id: condition.row for condition in design.conditions}
    question = compared[0]["value"]["question"]
    choices = answers.choices("p04", question)
    assert [(rows[first], rows[second]) for first, second in design.pairs("p04")] == [one[1:3] for one in choices]
    assert choices[0].chosen_row is None
    assert all(one.chosen_row == rows[min(design.pairs("p04")[i])] for i, one in enumerate(choices) if i)
    assert len(answers.choices(question="prefer")) == 6
    with pytest.raises(StudyError, match="no answers of 'p06'; participants with answers: p04, p05"):
        answers.choices("p06")
    with pytest.raises(StudyError, match="question must be one of comfort, prefer"):
        answers.choices(question="liked")


def test_half_a_session_is_used_as_far_as_it_goes_and_told(design: Design, folder: Path) -> None:
    events = events_of(design, "p01")
    second = next(i for i, one in enumerate(events) if one["kind"] == "stimulus" and one["place"] == 2)
    put(folder, session(design, "p01", events[: second + 1]))
    answers = Answers.load(folder)
    matrix = answers.matrix("ssq", "total")
    assert np.isnan(matrix.values).sum() == 2
    assert answers.faults == (
        f"the session of p01 is incomplete: stimulus {design.participant('p01').order[1]}, 2 of 3, had begun, and it "
        "has no end",
    )
    assert answers.notes[0] == "0 of 12 sessions are complete"


def test_who_stopped_is_asked_how_they_feel_and_is_told(design: Design, folder: Path) -> None:
    events = events_of(design, "p01")
    third = next(i for i, one in enumerate(events) if one["kind"] == "stimulus" and one["place"] == 3)
    stop = {**events[third], "kind": "stop"} | {"value": None}
    del stop["place"], stop["condition"]
    after = {**events[third + 3], "place": 4, "condition": None, "value": 3}
    assert after["kind"] == "answer"
    put(folder, session(design, "p01", [*events[:third], stop, after, {**events[-1], "t": 1e4}]))
    answers = Answers.load(folder)
    assert answers.faults == ()  # anybody may
    letter = design.participant("p01").order[1]
    assert answers.noted["Stopped sessions"] == (
        f"1 participant stopped, as anybody may: p01: stimulus {letter}, 2 of 3, had begun"
    )
    assert answers.table[-1].place == 4
    put(folder, session(design, "p01", [*events[:third], after]))
    with pytest.raises(StudyError, match="form ssq is not asked at place 4"):
        Answers.load(folder)


def test_orders_that_are_short_rides_that_jerk_and_devices_that_differ_are_told(design: Design, folder: Path) -> None:
    answered(design, folder, [f"p{i:02d}" for i in range(1, 12)])
    screen = session(design, "p11")
    screen["device"]["headset"] = False
    for event in screen["events"]:
        if event["kind"] == "frames" and event["condition"] == "B":
            event["value"]["slow"] = 0.25
    put(folder, screen)
    answers = Answers.load(folder)
    assert answers.faults == ("p11 saw fewer than 60 frames per second for a share of some rides: B (25%)",)
    short = " ".join(design.participant("p12").order)
    assert answers.notes == (
        "11 of 12 sessions are complete",
        f"some orders have fewer complete sessions than others: order {short}: 1 of 2",
        "10 of 11 participants used a headset, the others a screen: analyse them separately",
    )


def changed(number: int, **values: Any) -> Any:
    def change(contents: dict[str, Any]) -> None:
        contents["events"][number].update(values)

    return change


def top(**values: Any) -> Any:
    def change(contents: dict[str, Any]) -> None:
        contents.update(values)

    return change


def device(**values: Any) -> Any:
    def change(contents: dict[str, Any]) -> None:
        contents["device"].update(values)

    return change


def without_consent(contents: dict[str, Any]) -> None:
    del contents["events"][0]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (top(design="0" * 64), r"answers to another design \(its SHA-256 begins with 000000000000"),
        (top(design="x"), "at design"),
        (top(participant=NAME), "names and initials are refused"),
        (top(participant="p13"), "no participant p13; it has p01 to p12"),
        (top(version=2), "at version"),
        (top(name=NAME), "at name: Extra inputs are not permitted"),
        (top(events={}), "at events"),
        (device(browser="x\x1b[2J"), "plain characters"),
        (device(browser="x" * 401), "at most 400"),
        (device(**{"Owner Name": "x"}), "at device"),
        (device(position=[1, 2]), "at device.position"),
        (without_consent, r"events\[1\]: answer before consent was given"),
        (changed(0, value=False), r"events\[2\]: answer before consent was given"),
        (changed(2, value=4), "item general_discomfort of form ssq: expected 0 to 3 in steps of 1, got 4"),
        (changed(2, value=-1), "expected 0 to 3"),
        (changed(2, value=10**400), "expected 0 to 3"),
        (changed(2, value=0.5), "expected 0 to 3"),
        (changed(2, value=True), "expected 0 to 3"),
        (changed(2, value=NAME), "expected 0 to 3"),
        (changed(2, item="nauseous"), "no item 'nauseous'. Did you mean 'nausea'"),
        (changed(2, form="fms"), "has no form 'fms'; it has ssq, comfort, preference"),
        (changed(2, form="comfort", item="comfort"), "form comfort is not asked at place 0"),
        (changed(2, form="preference", item="prefer"), "not asked at place 0"),
        (changed(2, place=5), "place must be from 0 to 4, got 5"),
        (changed(2, place=1, condition=None), "at place 1 of the session, but the answers say none; use"),
        (changed(2, condition="A"), "p01 sees no stimulus at place 0 of the session, but the answers say A; use"),
        (changed(2, place=None, condition="A"), "expected the place of stimulus A"),
        (changed(2, t=0.5), r"events\[2\]: events must be in order of time, got 0.5 s after 1 s"),
        (changed(2, t=-1), r"at events\[2\].t"),
        (changed(2, at="yesterday"), r"at events\[2\].at"),
        (changed(2, kind="anser"), r"at events\[2\].kind"),
        (changed(2, note=NAME), r"at events\[2\].note: Extra inputs"),
        (changed(1, value=NAME), "the value of start must be a number, a word or nothing"),
        (changed(-1, value={"name": NAME}), "the value of end must be a number, a word or nothing"),
        (changed(-2, value=3), "a remark must be plain text"),
        (changed(-2, value="x" * 2001), "at most 2,000 characters"),
        (changed(-2, value="x\x1b[2J"), "a remark must be plain text"),
        (
            changed(-3, value={"question": "liked", "pair": ["A", "B"], "chosen": "A"}),
            "question must be one of comfort, prefer",
        ),
        (changed(-3, value={"question": "prefer", "pair": ["A", "D"], "chosen": "A"}), "no stimulus 'D'"),
        (changed(-3, value={"question": "prefer", "pair": ["A", "A"], "chosen": "A"}), "two different rides"),
        (changed(-3, value={"question": "prefer", "pair": ["A", "B"], "chosen": "C"}), "chosen must be A, B or 'none'"),
        (changed(-3, value={"question": "prefer", "pair": ["A"], "chosen": "A"}), "an object of question, pair"),
        (changed(-3, value="A"), "an object of question, pair"),
    ],
)
def test_what_the_design_does_not_ask_is_refused(design: Design, folder: Path, change: Any, match: str) -> None:
    contents = session(design, "p01")
    change(contents)
    path = put(folder, contents, "p01")
    with pytest.raises(StudyError, match=match) as told:
        Answers.load(folder)
    assert str(path) in str(told.value)
    assert "\x1b" not in str(told.value)


def test_two_files_of_one_participant_are_refused(design: Design, folder: Path) -> None:
    """As a browser calls a second download."""
    put(folder, session(design, "p01"))
    put(folder, session(design, "p01"), "p01 (1)")
    with pytest.raises(StudyError, match=r"p01 \(1\).json: a second file of participant p01, beside p01.json"):
        Answers.load(folder)
    (folder / "answers" / "p01.json").unlink()
    with pytest.raises(StudyError, match=r"these are the answers of p01; rename the file to p01.json"):
        Answers.load(folder)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('{"schema": "hpop-answers", "schema": "hpop-answers"}', "twice in one object"),
        ("[" * 100_000, "as JSON"),
        ('{"t": NaN}', "NaN"),
        ("", "as JSON"),
        ("\xff", "as JSON"),
        (" " * (64 * 2**20 + 1), "expected at most 67,108,864 bytes"),
    ],
)
def test_a_file_that_is_no_json_or_gigantic_is_refused(folder: Path, text: str, match: str) -> None:
    (folder / "answers").mkdir()
    (folder / "answers" / "p01.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(StudyError, match=match):
        Answers.load(folder)


def test_more_events_than_a_session_has_are_refused(design: Design, folder: Path) -> None:
    put(folder, session(design, "p01", [{"t": 0, "at": "2026-11-23T10:00:00Z", "kind": "resume"}] * 20_001))
    with pytest.raises(StudyError, match="at most 20000 items"):
        Answers.load(folder)


def test_tables_hold_what_was_answered_and_the_two_kinds_agree(design: Design, folder: Path) -> None:
    answered(design, folder, ["p01", "p02"], rule)
    answers = Answers.load(folder)
    answers.save_tables(folder)
    of_csv = [tuple(row.values()) for row in rows_of(folder / "answers.csv")]
    with sqlite3.connect(folder / "answers.sqlite") as base:
        of_sqlite = base.execute("SELECT * FROM answers").fetchall()
        scores = base.execute("SELECT participant, condition, value FROM scores WHERE score = 'total' AND place > 0")
        total = {(who, letter): value for who, letter, value in scores.fetchall()}
        chosen = base.execute(
            "SELECT count(*) FROM choices WHERE question = 'prefer' AND chosen IS NOT NULL"
        ).fetchone()
    base.close()
    assert [tuple("" if value is None else str(value) for value in row) for row in of_sqlite] == of_csv
    assert len(of_csv) == len(answers.table) == 134
    matrix = answers.matrix("ssq", "total")
    for i, who in enumerate(matrix.people):
        for j, letter in enumerate(matrix.conditions):
            assert total[who, letter] == matrix.values[i, j]
    assert chosen == (6,)
    assert {row["score"] for row in rows_of(folder / "scores.csv")} == {"N", "O", "D", "total", "comfort"}


def test_a_score_that_lacks_an_answer_is_empty_in_the_tables(design: Design, folder: Path) -> None:
    events = [event for event in events_of(design, "p01") if (event.get("place"), event.get("item")) != (0, "nausea")]
    put(folder, session(design, "p01", events))
    Answers.load(folder).save_tables(folder)
    found = {row["score"]: row["value"] for row in rows_of(folder / "scores.csv") if row["place"] == "0"}
    assert found == {"N": "", "O": "0.0", "D": "", "total": ""}
    with sqlite3.connect(folder / "answers.sqlite") as base:
        (empty,) = base.execute("SELECT count(*) FROM scores WHERE value IS NULL").fetchone()
    base.close()
    assert empty == 3


def test_no_table_can_hold_what_a_participant_wrote(design: Design, folder: Path) -> None:
    """Every text in the tables is an id, a letter, or a word of the design; a remark is in remarks.csv alone."""
    put(folder, session(design, "p01", events_of(design, "p01", rule, remark=f"=I am {NAME},\nborn here")))
    Answers.load(folder).save_tables(folder)
    words = {*design.letters, *design.forms, "p01", ""}
    words |= {name for form in design.questionnaires for name in (*form.score_names, *(item.id for item in form.items))}
    numbers = {"place", "value", "seconds", "t"}
    for name in ("answers.csv", "scores.csv", "choices.csv"):
        for row in rows_of(folder / name):
            assert {value for key, value in row.items() if key not in numbers} <= words, name
            assert all(float(value) >= 0 for key, value in row.items() if key in numbers and value)
    with sqlite3.connect(folder / "answers.sqlite") as base:
        tables = [name for (name,) in base.execute("SELECT name FROM sqlite_master")]
        texts = {value for name in tables for row in base.execute(f"SELECT * FROM {name}") for value in row}
    base.close()
    assert {text for text in texts if isinstance(text, str)} <= words
    assert NAME.encode() not in (folder / "answers.sqlite").read_bytes()
    (remark,) = rows_of(folder / "remarks.csv")
    assert remark == {"participant": "p01", "place": "4", "remark": f"'=I am {NAME},\nborn here"}


def test_matrices_of_what_is_not_asked_are_refused(design: Design, folder: Path) -> None:
    answers = Answers.load(folder)
    assert answers.people == ()
    assert answers.matrix("ssq", "total").values.shape == (0, 3)
    with pytest.raises(StudyError, match="has no form 'vrsq'"):
        answers.matrix("vrsq", "total")
    with pytest.raises(StudyError, match="Did you mean 'total'"):
        answers.matrix("ssq", "totals")


def test_answers_of_whoever_took_a_place_count_and_of_whoever_withdrew_do_not(
    front: hpop.Front, design: Design, folder: Path
) -> None:
    after = design.after("p02", withdrawn=True).after("p03", withdrawn=False)
    after.save(folder)
    answered(after, folder, ["p03", "p13", "p14"])
    answers = Answers.load(folder)
    assert answers.people == ("p03", "p13", "p14")
    assert answers.notes[0] == "2 of 12 sessions are complete"
    put(folder, session(after, "p02"))
    with pytest.raises(StudyError, match="p02 withdrew; `hpop study withdraw` removes these answers"):
        Answers.load(folder)


def test_numbers_stand_in_the_table_as_they_were_given(design: Design, folder: Path) -> None:
    """Whole ones without a point, and times without digits that are but rounding: .3 - .1 is .19999999999999998."""
    events = events_of(design, "p01", lambda who, place, form, item: 2)
    for i, event in enumerate(events):
        event["t"] = round(0.1 + 0.2 * i, 1)
    put(folder, session(design, "p01", events))
    Answers.load(folder).save_tables(folder)
    lines = (folder / "answers.csv").read_text().splitlines()
    assert lines[1].split(",")[5:7] == ["2", "0.2"]
    assert {line.split(",")[5] for line in lines[1:]} == {"2"}


def test_a_video_that_ended_before_it_can_have_is_a_fault_and_one_that_the_page_did_not_play_a_note(
    front: hpop.Front, tmp_path: Path
) -> None:
    videos = study.Design.of(front, [0, 1], participants=2, consent=CONSENT, forms=("comfort",), kind="video")
    videos.save(tmp_path)
    events = events_of(videos, "p01")  # a second apart
    second = videos.participant("p01").order[1]
    end = next(i for i, one in enumerate(events) if one["kind"] == "stimulus" and one["value"] == "end")
    events.insert(end, {**events[end], "value": "played"})
    put(tmp_path, session(videos, "p01", events))
    answers = Answers.load(tmp_path)
    lasts = videos.condition(second).duration
    assert answers.faults == (
        f"p01 did not watch video {second} to its end: it lasts {lasts:.1f} s, but was reported as ended after 2.0 s",
    )
    assert answers.noted["Videos"].endswith(f"in another player: p01 ({second})")
    later = events[:end] + [{**event, "t": event["t"] + lasts} for event in events[end:]]
    last = max(i for i, one in enumerate(later) if one["kind"] == "stimulus")
    later = later[:last] + [{**event, "t": event["t"] + lasts} for event in later[last:]]
    put(tmp_path, session(videos, "p01", later))
    assert Answers.load(tmp_path).faults == ()
