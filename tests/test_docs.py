"""What the documentation shows runs as it stands there."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def blocks(file: str, language: str = "python") -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / file).read_text(), re.DOTALL)


def test_the_first_block_of_the_readme_plans_and_draws(tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks("README.md")[0], "README.md", "exec"), {})
    written = {path.name for path in tmp_path.iterdir()}
    assert {"front.json", "map.png", "front.png", "trace.png", "where.png"} <= written


def test_the_scenario_in_the_readme_is_the_one_of_the_demo(tmp_path):
    import yaml

    shown = yaml.safe_load(blocks("README.md", "yaml")[0])
    assert shown == yaml.safe_load((ROOT / "examples/museum.yaml").read_text())


@pytest.mark.parametrize("name", ["Glare", "DoorDistance", "Boredom"])
def test_a_criterion_in_the_docs_passes_its_conformance_checks(name, tmp_path, monkeypatch):
    from hpop.testing import check_criterion

    (block,) = (block for block in blocks("docs/criteria.md") if f"class {name}:" in block)
    module = tmp_path / f"docs_{name.lower()}.py"  # pickling needs an importable module
    module.write_text(re.sub(r'criterion\("', r'criterion("docs_', block))
    monkeypatch.syspath_prepend(tmp_path)
    check_criterion(getattr(importlib.import_module(module.stem), name)())


def test_the_search_in_the_docs_finds_what_it_says():
    names: dict = {}
    exec(compile(blocks("docs/planners.md")[0], "docs/planners.md", "exec"), names)
    assert names["paths"].costs.tolist() == [[2, 8], [6, 2]]
    assert names["paths"].nodes(0).tolist() == [0, 1, 3]


@pytest.mark.parametrize("file", ["README.md", *(str(p.relative_to(ROOT)) for p in (ROOT / "docs").glob("*.md"))])
def test_links_between_documents_lead_somewhere(file):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", (ROOT / file).read_text()):
        assert ((ROOT / file).parent / target).exists(), f"{file} links to {target}"
