"""docs/study.md: its Python runs from top to bottom, in a study that people have answered meanwhile."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import hpop
from hpop.study import Design
from tests.study.sessions import answered

PAGE = Path(__file__).parents[2] / "docs" / "study.md"


def test_the_python_of_the_page_runs(front: hpop.Front, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hpop.study.report.DPI", 30)
    names: dict[str, object] = {"hpop": hpop, "front": front}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(compile(block, str(PAGE), "exec"), names)
        if "study.prepare(" in block:
            design = Design.load("study")
            answered(design, Path("study"), ["p07", "p08", "p09"], lambda who, *_: float(who == "p07"))
    assert Design.load("study").withdrawn == {"p07"}
