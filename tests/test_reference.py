"""Generated pages agree with the code: the reference of the criteria, the glossary, the schema."""

from __future__ import annotations

import doctest
import importlib.util
from pathlib import Path

import pytest

from hpop.base.registry import criteria

SCRIPT = Path(__file__).resolve().parents[1] / "docs/make_reference.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("make_reference", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "page",
    ["criteria_reference.md", "formats_reference.md", "glossary.md", "options_reference.md", "scenario.schema.json"],
)
def test_what_is_written_from_the_code_is_up_to_date(script, page):
    assert (script.DOCS / page).read_text(encoding="utf-8") == script.PAGES[page](), "something changed: make reference"


def test_every_criterion_of_hpop_has_an_entry_with_its_parameters(script):
    page = (script.DOCS / "criteria_reference.md").read_text(encoding="utf-8")
    at_home = {name for name, cls in criteria.items() if cls.__module__.startswith("hpop.")}
    assert {line[5:-1] for line in page.splitlines() if line.startswith("### `")} == at_home
    entry = page[page.index("### `energy`") : page.index("### `", page.index("### `energy`") + 1)]
    assert "| J | sum | wheels | yes | 1e-06 |" in entry
    assert "| `c6` | 20 | W s³/m², which is kg |" in entry
    assert "Tokekar" in entry


def test_a_criterion_from_elsewhere_is_not_in_it(script, monkeypatch):
    class Elsewhere:
        __module__ = "somewhere.else"

    before = script.reference()
    monkeypatch.setitem(criteria._types, "elsewhere", Elsewhere)
    assert script.reference() == before
    assert "elsewhere" not in script.schema()


def test_the_examples_in_the_script_hold(script):
    assert doctest.testmod(script).failed == 0
