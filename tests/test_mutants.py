"""The tool that plants faults: each changes the code, is found again, and leads to the tests that may notice it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.mutants.faults import applied, draw, sites
from tests.mutants.reach import Code

TEXT = '''\
"""Doc."""
LIMIT = 3


def f(a, b, *, most=2.0):
    """Doc."""
    if not a < b:
        raise ValueError(f"expected {a} < {b + 1}")
    total = 0
    for i in range(1, most):
        total += min(a * i, b)
        continue
    return g(a, b) and (
        total
        > LIMIT
    )
'''
PACKAGE = {
    "kernels.py": "@kernel\ndef inner(x):\n    return x + 1\n\n\n@lean\ndef middle(x):\n    return inner(x)\n",
    "search.py": "from hpop.kernels import middle as run\n\nSTEP = 3\n\n\ndef go(x):\n    y = run(x)\n    return y\n",
    "other.py": "from hpop import search\n\n\ndef inner():\n    return search.STEP\n",
}


@pytest.fixture
def code(tmp_path: Path) -> Code:
    (tmp_path / "hpop").mkdir()
    for name, text in PACKAGE.items():
        (tmp_path / "hpop" / name).write_text(text)
    return Code(tmp_path)


def test_each_fault_changes_what_the_code_means_and_no_number_of_a_line() -> None:
    found = sites(TEXT, "f.py")
    assert len(found) > 15
    for site in found:
        changed = applied(TEXT, site)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(TEXT))
        assert changed.count("\n") == TEXT.count("\n")


def test_each_kind_of_fault_is_there_and_messages_are_left_alone() -> None:
    changes = {(site.fault.before, site.fault.after) for site in sites(TEXT, "f.py")}
    assert {
        ("a < b", "a <= b"),
        ("a < b", "a >= b"),
        ("not a < b", "a < b"),
        ("not a < b", "False"),
        ("total += min(a * i, b)", "pass"),
        ("total += min(a * i, b)", "total -= min(a * i, b)"),
        ("min(a * i, b)", "max(a * i, b)"),
        ("a * i", "a + i"),
        ("continue", "pass"),
        ("g(a, b)", "g(b, a)"),
        ("3", "4"),
        ("2.0", "3.0"),
    } <= changes
    assert not any("expected" in before or before == "b + 1" for before, _ in changes)


def test_the_same_seed_draws_the_same_faults_in_equal_shares() -> None:
    files, read = {"one": ["f.py"], "two": ["g.py"]}, {"f.py": TEXT, "g.py": TEXT}
    drawn = draw(files, read, 8, seed=1)
    assert drawn == draw(files, read, 8, seed=1) != draw(files, read, 8, seed=2)
    assert [fault.file for fault in drawn] == ["f.py"] * 4 + ["g.py"] * 4


def test_a_fault_is_found_again_where_other_code_has_changed() -> None:
    fault = draw({"one": ["f.py"]}, {"f.py": TEXT}, 1, seed=3)[0]
    moved = '"""Doc."""\nimport os\n' + TEXT.replace('"""Doc."""\nLIMIT', "LIMIT")
    assert [site.fault for site in sites(moved, "f.py")].count(fault) == 1


def test_a_kernel_is_reached_by_the_lines_that_name_it_through_other_kernels(code: Code) -> None:
    assert code.unseen("hpop/kernels.py", 3) == "inner"
    assert code.seen_lines("hpop/kernels.py", "inner") == {("hpop/search.py", 7)}  # not by another of that name


def test_what_an_import_computes_is_reached_by_the_lines_that_name_it(code: Code) -> None:
    assert code.unseen("hpop/search.py", 3) == "STEP"
    assert code.unseen("hpop/search.py", 7) is None
    assert code.seen_lines("hpop/search.py", "STEP") == {("hpop/other.py", 5)}


def test_kernels_that_call_a_changed_one_are_compiled_again(code: Code) -> None:
    assert code.importers("hpop/kernels.py") == {f"hpop/{name}" for name in PACKAGE}
