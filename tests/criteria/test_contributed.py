"""A criterion of hpop comes with all files that CONTRIBUTING.md asks for: a failure names the missing one."""

import re
from functools import cache
from pathlib import Path

import pytest

import hpop.criteria
from hpop.base.registry import GROUPS

ROOT = Path(__file__).parents[2]
HOME = ROOT / "hpop" / "criteria"
DECLARED = re.compile(r'@criterion\(\s*"(\w+)".*?^class (\w+)', re.DOTALL | re.MULTILINE)
MODULES = sorted(path for group in GROUPS.values() for path in (HOME / group).glob("[a-z]*.py"))
CRITERIA = [(name, cls, path) for path in MODULES for name, cls in DECLARED.findall(path.read_text(encoding="utf-8"))]


@cache
def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@cache
def other_tests() -> str:
    others = (path for path in sorted((ROOT / "tests").rglob("test_*.py")) if path != Path(__file__))
    return "\n".join(path.read_text(encoding="utf-8") for path in others)


def test_criteria_are_found_where_they_are_declared():
    assert len(CRITERIA) >= 50


def missing_parts(name, cls, path):
    """Return what a criterion still lacks, each with what to do."""
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    missing = []
    if cls not in hpop.criteria.__all__:
        missing.append(
            f"hpop/criteria/__init__.py does not import it: add 'from {module} import {cls} as {cls}' below 'if "
            "TYPE_CHECKING'; it is registered, and public, by that line alone"
        )
    if f'"{module}"' not in text("pyproject.toml") and module.split(".")[-1] not in text("pyproject.toml"):
        missing.append(
            f"pyproject.toml does not name {module.split('.')[-1]} in the import contract of {path.parent.name}"
        )
    if not re.search(rf"\b{cls}\b", other_tests()):  # its name may be an everyday word of other tests
        missing.append(f"no test names {cls}: write tests/criteria/test_{path.stem}.py, with values computed by hand")
    if not re.search(rf"`{name}`", text("docs/questions.md")):
        missing.append(f"docs/questions.md has no row for it: which question does `{name}` answer?")
    if not re.search(rf"`{name}`", text("docs/arm_reference.md")):
        missing.append(
            f"the table of criteria in docs/arm_reference.md does not name `{name}`: add it to the last row if it "
            "requires what an arm lacks (a base, a heading, wheels), else to the third if it has memory "
            f"(aggregate='trajectory'), else to the first if 'hpop check {name}' says that it has a gradient, else to "
            "the second"
        )
    if f"### `{name}`" not in text("docs/criteria_reference.md"):
        missing.append("docs/criteria_reference.md has no section of it: run `make reference`, which writes one")
    return missing


@pytest.mark.parametrize(("name", "cls", "path"), CRITERIA, ids=[name for name, _, _ in CRITERIA])
def test_a_criterion_is_named_documented_and_tested(name, cls, path):
    missing = missing_parts(name, cls, path)
    assert not missing, f"{name!r} ({path.relative_to(ROOT)}): " + "; ".join(missing)


def test_a_name_that_other_tests_use_as_a_word_is_no_test():
    missing = missing_parts("length", "CriterionOf" + "NoTest", HOME / "robot" / "motion.py")
    assert [part.partition(":")[0] for part in missing][1:] == ["no test names CriterionOfNoTest"]
