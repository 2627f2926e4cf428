"""Tables that other programs read as they are, their dictionary, and the preregistration of a design."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from hpop import study
from hpop.errors import StudyError
from hpop.study.sharing import variable_names
from tests.study.sessions import answered

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}[A-Za-z0-9]|[A-Za-z]")
"""Name of a variable in R, JASP and SPSS (64 bytes, no _ at its end)."""


@pytest.fixture(scope="module")
def folder(design: study.Design, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a study's folder with the tables of four people; one answer is missing."""
    made = tmp_path_factory.mktemp("study")
    design.save(made)
    answered(design, made, ["p01", "p02", "p03", "p04"], lambda who, place, form, item: float(place == 2))
    path = made / "answers" / "p04.json"
    text = json.loads(path.read_text())
    text["events"] = [event for event in text["events"] if (event.get("item"), event.get("place")) != ("nausea", 1)]
    path.write_text(json.dumps(text))
    study.Answers.load(made).save_tables(made)
    return made


def test_each_column_of_a_table_is_described_and_has_a_name_for_every_program(folder: Path) -> None:
    for path in (folder / f"{stem}.csv" for stem in ("answers", "scores", "choices", "wide")):
        data = path.read_bytes()
        assert not data.startswith(b"\xef\xbb\xbf")
        names = next(csv.reader(data.decode().splitlines()))
        described = json.loads(path.with_suffix(".json").read_text())
        assert list(described)[: len(names)] == names
        assert set(described) - set(names) <= {"MeasurementToolMetadata"}
        assert all(NAME.fullmatch(name) for name in names)
        assert len({name.lower() for name in names}) == len(names)
        assert all(described[name]["Description"] for name in names)


def test_the_wide_table_has_the_scores_of_a_person_in_a_row(folder: Path) -> None:
    answers = study.Answers.load(folder)
    with open(folder / "wide.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["participant"] for row in rows] == ["p01", "p02", "p03", "p04"]
    matrix, before = answers.matrix("ssq", "total"), answers.before("ssq", "total")
    for row, values, places, first in zip(rows, matrix.values, matrix.places, before, strict=True):
        assert [float(row[f"ssq_total_{letter}"] or np.nan) for letter in "ABC"] == pytest.approx(values, nan_ok=True)
        assert [float(row[f"place_{letter}"]) for letter in "ABC"] == places.tolist()
        assert float(row["ssq_total_before"]) == first
        assert row["sex"] in ("f", "m")
    assert sum(row[f"ssq_total_{letter}"] == "" for row in rows for letter in "ABC") == 1


def test_names_of_variables_differ_and_are_no_words_of_spss() -> None:
    assert variable_names(["to", "TO", "a b", "a_b", "p (Cochran's Q)", "95 %", "", "x" * 90]) == [
        *("to_", "TO_2", "a_b", "a_b_2", "p_Cochrans_Q", "v_95", "v", "x" * 60),
    ]


def test_a_preregistration_states_the_plan_and_no_letter(design: study.Design) -> None:
    text = study.preregistration(design, method="mixed", power=study.power(0.5, n=12, simulations=100))
    for said in (
        design.digest,
        "**Participants.** 12.",
        "least turns (row",
        "Kennedy",
        "ordinal mixed model",
        "stimulus before",
        "sex (f, m)",
        "With 12 people",
        "[fill in: ",
        "**Exploratory.** ssq.N, ssq.O, ssq.D, comfort.comfort.",
    ):
        assert said in text
    assert not re.search(r"\b[ABC]: ", text)
    with pytest.raises(StudyError, match="form preference is not asked after each stimulus"):
        study.preregistration(design, score=("preference", "prefer"))
