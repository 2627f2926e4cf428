"""Forms are read strictly: what is wrong with one is said with its key and line."""

from __future__ import annotations

from math import isnan
from pathlib import Path

import pytest
import yaml

from hpop.errors import StudyError
from hpop.study.documents import words
from hpop.study.forms import Form, form_file, score, shipped

LANGUAGES = ("de", "en", "fi")
"""Languages of everything that a participant reads."""
EQUAL = {"end_labels", "video_title", "ride_begin"}
"""Texts of the pages that may equal the English ones."""
MINE = """
id: mine
title: {en: Mine}
source: test
when: [after_each]
ask: {en: "How was it?"}
scale: {low: 0, high: 2, step: 1, labels: {en: [bad, fair, good]}}
items:
  - {id: a, text: {en: A}, subscales: [S]}
  - {id: b, text: {en: B}, subscales: [S], reverse: true}
scores:
  - {name: S, subscale: S}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def test_the_forms_that_hpop_brings():
    assert shipped() == (
        *(
            "comfort",
            "csq_vr",
            "fms",
            "gaming",
            "ipq",
            "mssq",
            "nasa_tlx",
            "naturalness",
            "preference",
            "ssq",
            "sus",
            "sus_presence",
            "vrsq",
        ),
    )


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_form_is_sound_has_its_name_and_survives_json(name):
    form = Form.load(name)
    assert form.id == name
    assert form.source
    assert form.rights
    assert form.languages == (("en",) if form.template else LANGUAGES)
    assert Form.from_dict(form.to_dict()) == form


def test_a_form_of_ones_own_is_read_from_its_file(tmp_path):
    form = Form.load(written(tmp_path, MINE))
    assert [item.id for item in form.items] == ["a", "b"]
    assert form.scale_of(form.items[0]).values == (0, 1, 2)


WRONG = {
    "an unknown key": ("reverse: true", "reversed: true", "line 10, items.1.reversed: no such key; did you mean 'rev"),
    "two equal items": ("{id: b", "{id: a", "item of form mine a is given twice"),
    "an id that no file can have": ("{id: b", "{id: B/../c", "items.1.id"),
    "labels that are too few": ("[bad, fair, good]", "[bad]", "expected 3 labels in en, one a value, or 2 for both"),
    "a scale upside down": ("low: 0", "low: 5", "low must be below high, got 5 and 2"),
    "a step that does not fit": ("step: 1", "step: 0.7", "whole number of steps"),
    "endless steps": ("high: 2, step: 1", "high: 1000000, step: 1", "at most 1,000 steps"),
    "a score of nothing": ("{name: S, subscale: S}", "{name: S, subscale: T}", "no item is in the subscale T"),
    "a score of two things": ("subscale: S}\n", "subscale: S, of: [S]}\n", "give exactly one of subscale"),
    "a count of something else": (
        "{name: S, subscale: S}",
        "{name: S, subscale: S}\n  - {name: T, sum_of: [S], at_least: 1}",
        "at_least counts answers of a subscale",
    ),
    "a sum of counts": (
        "{name: S, subscale: S}",
        "{name: S, subscale: S, at_least: 1}\n  - {name: T, of: [S]}",
        "of adds raw sums of subscales, and S is none",
    ),
    "a score of a later one": (
        "  - {name: S,",
        "  - {name: T, of: [S]}\n  - {name: S,",
        "needs S, which must stand be",
    ),
    "a missing language": ("text: {en: A}", "text: {de: A}", "no language has all texts"),
    "another time": ("[after_each]", "[sometimes]", "line 5, when.0: expected 'before', 'after_each' or 'after_all'"),
    "a tag": ("id: mine", "id: !!python/name:os.system x", "tags such as"),
    "a number too many": ("low: 0", "low: .inf", "expected a finite number, got inf"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_a_form_is_said(case, tmp_path):
    there, put, said = WRONG[case]
    assert there in MINE
    with pytest.raises(StudyError) as raised:
        Form.load(written(tmp_path, MINE.replace(there, put, 1)))
    assert said in str(raised.value)


def test_a_form_that_compares_pairs_has_no_scale(tmp_path):
    text = MINE.replace("when: [after_each]", "when: [after_all]\nkind: pairs")
    with pytest.raises(StudyError, match="compares pairs has no scales"):
        Form.load(written(tmp_path, text))


def test_unknown_forms_and_files_that_are_not_there_are_said(tmp_path):
    with pytest.raises(StudyError, match=r"unknown form 'sssq'. Did you mean 'ssq'"):
        Form.load("sssq")
    with pytest.raises(StudyError, match="no such file"):
        Form.load(tmp_path / "absent.yaml")
    with pytest.raises(StudyError, match="expected a valid form, got at title: Field required; at source"):
        Form.from_dict({"id": "x"})


def test_of_a_form_with_many_faults_the_first_ones_are_said():
    values = Form.load("ssq").to_dict()
    values["scale"]["labels"] = {f"language {i}": 7 for i in range(60)}
    with pytest.raises(StudyError, match=r"expected a valid form, got at scale\.labels.*and \d+ more$") as raised:
        Form.from_dict(values)
    assert len(str(raised.value)) < 1000
    assert "pydantic" not in str(raised.value)


def test_languages_are_those_in_which_all_is_written(tmp_path):
    values = yaml.safe_load(MINE)
    for text in (values["title"], values["ask"], *(item["text"] for item in values["items"])):
        text["de"] = "x"
    form = Form.load(written(tmp_path, yaml.safe_dump(values)))
    assert form.languages == ("en",)  # the labels of the scale are English only
    values["scale"]["labels"]["de"] = ["schlecht", "gut"]
    assert Form.load(written(tmp_path, yaml.safe_dump(values))).languages == ("de", "en")


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_text_for_participants_is_missing_or_left_in_english(language):
    english, texts = words("en"), words(language)
    assert texts.keys() == english.keys()
    kept = {name for name, text in texts.items() if text == english[name]} - EQUAL
    assert not kept or language == "en"
    for form in (Form.load(name) for name in shipped() if not Form.load(name).template):
        asked = [form.ask, *(item.text for item in form.items)]
        assert not [text[language] for text in asked if language != "en" and text[language] == text["en"]]


def test_the_presence_questionnaire_counts_answers_of_6_or_7():
    """Usoh et al. 2000 count the answers of 6 or 7; the mean is the other score in use."""
    presence = Form.load("sus_presence")
    ids = [item.id for item in presence.items]
    assert score(presence, dict(zip(ids, [7, 6, 5, 1, 6, 2], strict=True))) == {"mean": 4.5, "high": 3}
    assert score(presence, dict.fromkeys(ids, 5.0)) == {"mean": 5, "high": 0}
    assert all(isnan(value) for value in score(presence, dict.fromkeys(ids[1:], 7.0)).values())


def test_a_template_has_a_structure_and_is_not_asked(tmp_path):
    ipq = Form.load("ipq")
    answers = {item.id: 6.0 for item in ipq.items}
    assert score(ipq, answers) == {"general": 6, "spatial": 4.8, "involvement": 4.5, "realism": 4.5}
    given = form_file("ipq").read_text().replace("template: true\n", "")
    assert not Form.load(written(tmp_path, given)).template
