"""Claims: the parts of `make proof` are together the whole suite, and a part proven is one whose files are the same."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture
def proof(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Load the tool, with records in a folder of this test."""
    spec = importlib.util.spec_from_file_location("proof", Path(__file__).with_name("proof.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "RESULTS", tmp_path)
    return module


def test_the_parts_hold_every_test_file(proof: ModuleType) -> None:
    everywhere = set((proof.ROOT / "tests").rglob("test_*.py"))
    held: set[Path] = set()
    for names in proof.PARTS.values():
        left_out = [proof.ROOT / name.removeprefix("--ignore=") for name in names if name.startswith("--ignore=")]
        for path in (proof.ROOT / name for name in names if not name.startswith("-")):
            files = {path} if path.suffix else set(path.rglob("test_*.py"))
            held |= {file for file in files if not any(folder in file.parents for folder in left_out)}
    assert everywhere <= held


def test_a_part_counts_as_proven_only_for_the_files_it_passed_with(proof: ModuleType, tmp_path: Path) -> None:
    assert proof.passed_before("search", "now") is None
    record = {"part": "search", "state": "now", "exit code": 0, "tests": 3, "failures": 0, "errors": 0}
    (tmp_path / "search.json").write_text(json.dumps(record))
    assert proof.passed_before("search", "now") == record
    assert proof.passed_before("search", "later") is None
    (tmp_path / "search.json").write_text(json.dumps(record | {"exit code": 1}))
    assert proof.passed_before("search", "now") is None


def test_the_table_tells_what_failed_and_what_did_not_run(proof: ModuleType) -> None:
    record = {"exit code": 1, "tests": 7, "failures": 2, "errors": 0, "processor seconds": 5, "wall seconds": 4}
    lines = {line.split()[0]: line for line in proof.table({"world": record}).splitlines()}
    assert lines["world"].endswith("2 failed")
    assert lines["search"].endswith("not run for these files")
    assert proof.main(["nothing"]) == 2
