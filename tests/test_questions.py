"""The page of questions names every criterion, in its group, with what a search on a graph makes of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hpop.base.registry import GROUPS, criteria

PAGE = (Path(__file__).parents[1] / "docs" / "questions.md").read_text()
AT_HOME = {name: cls for name, cls in criteria.items() if cls.__module__.startswith("hpop.criteria.")}


MARKS = {"trajectory": "†", "time-mean": "∫"}


def rows(group: str) -> list[tuple[dict[str, str], str]]:
    """Return the names with their marks, and the units, of each row of a group's table."""
    (section,) = re.findall(rf"^## {GROUPS[group].capitalize()}: .*?(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in section.splitlines() if line.startswith("| ")]
    return [(dict(re.findall(r"`(\w+)` ?([†∫]?)", row[1])), row[2]) for row in cells[1:]]


def test_comfort_comes_first() -> None:
    assert re.findall(r"^## (\w+)", PAGE, re.MULTILINE) == ["Comfort", "Performance", "Robot", "Others"]


@pytest.mark.parametrize("group", GROUPS)
def test_every_criterion_of_a_group_answers_one_question(group: str) -> None:
    named = [name for names, _ in rows(group) for name in names]
    assert sorted(named) == sorted(name for name, cls in AT_HOME.items() if cls.group == group)


@pytest.mark.parametrize("group", GROUPS)
def test_a_mark_says_how_a_search_on_a_graph_treats_a_criterion(group: str) -> None:
    assert all(f"marked {mark}" in PAGE.replace("Those marked", "marked") for mark in MARKS.values())
    for names, _ in rows(group):
        for name, mark in names.items():
            assert mark == MARKS.get(AT_HOME[name].aggregate, ""), name


@pytest.mark.parametrize("group", GROUPS)
def test_a_row_has_the_units(group: str) -> None:
    for names, units in rows(group):
        for name in names:
            unit = AT_HOME[name].unit
            assert unit == "1" or unit in units, name
