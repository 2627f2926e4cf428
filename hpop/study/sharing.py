"""Data of a study for other programs: names of variables, a wide table, and a data dictionary.

Tables are read by R, JASP and SPSS as they are: UTF-8, commas, decimal points, empty cells for missing values, and
names of variables that all three accept. A JSON file beside each table describes its columns, with the keys of sidecars
in BIDS (Gorgolewski et al. 2016, Scientific Data 3, 160044): LongName, Description, Units, Levels.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.study.design import Design
from hpop.study.documents import Contents, TableColumn
from hpop.study.forms import Form
from hpop.study.protocol import MEASURED
from hpop.study.tasks import MEASURES, measures, task_scores

if TYPE_CHECKING:
    from hpop.study.answers import Answers

MOST_NAME = 60
"""Longest name of a variable; SPSS allows 64 bytes."""
RESERVED = frozenset(["all", "and", "by", "eq", "ge", "gt", "le", "lt", "ne", "not", "or", "to", "with"])
"""Words that SPSS does not allow as names."""
Sidecar = dict[str, Any]


def variable_names(headings: Iterable[str]) -> list[str]:
    """Return names of variables for headings of columns: letters, digits and _, and different also without case.

    >>> variable_names(["length (m)", "Kendall's W", "95 %", "to", "To"])
    ['length_m', 'Kendalls_W', 'v_95', 'to_', 'To_2']
    """
    names: list[str] = []
    for heading in headings:
        name = re.sub(r"[^A-Za-z0-9_]+", "_", heading.replace("'", "")).strip("_")[:MOST_NAME].rstrip("_")
        name = name if name[:1].isalpha() else f"v_{name}".rstrip("_")
        name += "_" if name.lower() in RESERVED else ""
        taken = {other.lower() for other in names}
        unique = (f"{name.rstrip('_')}_{i}" for i in range(2, len(names) + 3))
        names.append(name if name.lower() not in taken else next(one for one in unique if one.lower() not in taken))
    return names


def wide_table(answers: Answers) -> tuple[Contents, Sidecar]:
    """Return scores and measures of tasks, a row for each person as JASP and SPSS need it, and its dictionary."""
    design = answers.design
    strata = list(design.enrolled[0].strata)
    known = {(row.participant, row.place, row.form, row.score): row.value for row in answers.scores}
    last = len(design.letters) + 1
    measured = [
        (form, name, when, letter)
        for form in design.questionnaires
        for name in form.score_names
        for when in form.when
        for letter in (design.letters if when == "after_each" else ("",))
    ]
    described: list[tuple[str, Sidecar]] = [
        ("participant", {"Description": "Id of the participant"}),
        ("order", {"Description": "Letters of the stimuli in the order in which the participant saw them"}),
        *((level, {"Description": f"Stratum {level}", "Levels": _levels(design, level)}) for level in strata),
        *(
            (f"place_{letter}", _described(f"Place of stimulus {letter} in the order", "1"))
            for letter in design.letters
        ),
    ]
    for form, name, when, letter in measured:
        moment = f"after stimulus {letter}" if letter else when.replace("_", " ").replace("before", "before the first")
        suffix = letter or {"before": "before", "after_all": "after"}[when]
        described.append((f"{form.id}_{name}_{suffix}", _described(f"Score {name} of {form.id}, {moment}", "1", form)))
    measured_tasks = [(name, letter) for name in task_scores(design) for letter in design.letters]
    for name, letter in measured_tasks:
        described.append(
            (f"{MEASURED}_{name}_{letter}", _described(f"{MEASURES[name]}, during stimulus {letter}", "1"))
        )
    rows = []
    for session in answers.sessions:
        person = session.person
        of_tasks = {(one.measure, one.condition): one.value for one in measures(session)} if measured_tasks else {}
        at = {letter: place for place, letter in enumerate(person.order, 1)}
        places = {"before": 0, "after_all": last}
        rows.append(
            [person.id, "".join(person.order), *(person.strata[level] for level in strata)]
            + [at[letter] for letter in design.letters]
            + [
                known.get((person.id, at[letter] if letter else places[when], form.id, name), np.nan)
                for form, name, when, letter in measured
            ]
            + [of_tasks.get(measure, np.nan) for measure in measured_tasks]
        )
    names = variable_names(name for name, _ in described)
    columns = [TableColumn(name, "TEXT" if i < 2 + len(strata) else "REAL") for i, name in enumerate(names)]
    return Contents(columns, rows), dict(zip(names, (one for _, one in described), strict=True))


def sidecars(design: Design) -> dict[str, Sidecar]:
    """Return the descriptions of the columns of answers.csv, scores.csv and choices.csv, by the name of the table."""
    rated = [form for form in design.questionnaires if form.kind == "ratings"]
    k = len(design.letters)
    who = {
        "participant": {"Description": "Id of the participant"},
        "place": _described(f"0 before the first stimulus, 1 to {k} after each of them, {k + 1} after all", "1"),
        "condition": {
            "Description": "Letter of the stimulus; empty before the first and after the last. design.json says which "
            "row of the front it is",
            "Levels": {letter: f"stimulus {letter}" for letter in design.letters},
        },
        "form": {"Description": "Questionnaire", "Levels": {form.id: _text(design, form.title) for form in rated}},
    }
    items: dict[str, str] = {}
    for form in rated:
        for item in form.items:
            said = f"{form.id}: {_text(design, item.text)}"
            items[item.id] = f"{items[item.id]}; {said}" if item.id in items else said
    times = {
        "seconds": _described("Time since the event before", "s"),
        "t": _described("Time since the start of the session", "s"),
    }
    tools = {form.id: _tool(form) for form in design.questionnaires}
    pair = {letter: f"stimulus {letter}" for letter in design.letters}
    asked = {
        item.id: _text(design, item.text)
        for form in design.questionnaires
        if form.kind == "pairs"
        for item in form.items
    }
    return {
        "answers": {
            **who,
            "item": {"Description": "Question", "Levels": items},
            "value": _described("Last answer to the question, on the scale of the form", "1"),
            **times,
            "MeasurementToolMetadata": tools,
        },
        "scores": {
            **who,
            "score": {"Description": "Score of the form"},
            "value": _described("Score; empty if an answer is missing", "1"),
            "MeasurementToolMetadata": tools,
        },
        "choices": {
            "participant": who["participant"],
            "question": {"Description": "Question about two stimuli", "Levels": asked},
            "first": {"Description": "Stimulus on the left", "Levels": pair},
            "second": {"Description": "Stimulus on the right", "Levels": pair},
            "chosen": {"Description": "Chosen stimulus; empty for neither", "Levels": pair},
            **times,
        },
    }


def _described(description: str, units: str, form: Form | None = None) -> Sidecar:
    """Return the description of a column of numbers; of a score, with its better end and source."""
    found = {"Description": description, "Units": units}
    return found if form is None else {**found, "Better": form.better, "Source": " ".join(form.source.split())}


def _levels(design: Design, stratum: str) -> Mapping[str, str]:
    """Return the levels of a stratum, as the keys and the values of BIDS."""
    return {level: level for level in sorted({person.strata[stratum] for person in design.enrolled})}


def _tool(form: Form) -> Sidecar:
    """Return source, rights and scale of a questionnaire."""
    found = {"Description": " ".join(form.source.split()), "Rights": " ".join(form.rights.split())}
    return found if form.scale is None else {**found, "Scale": str(form.scale)}


def _text(design: Design, text: Mapping[str, str]) -> str:
    """Return a text of a form in English, or else in the language of the study."""
    return text.get("en", text[design.language])
