"""The documentation site, without building it: `make docs` does, and finds links that lead nowhere.

What is tested here is what Sphinx does not ask: whether something has no page at all.
"""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from hpop.base.lazy import MOVED
from tests.test_public_names import PUBLIC

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
EXAMPLES = [*(ROOT / "examples").glob("*.py"), *(ROOT / "examples/notebooks").glob("*.ipynb")]


@pytest.fixture(scope="module")
def docs() -> dict[str, ModuleType]:
    """Import the site's own modules."""
    sys.path.insert(0, str(DOCS))
    names = ["check_site", "make_pictures", "extensions.docstrings", "extensions.references", "extensions.repository"]
    names += ["extensions.commands", "extensions.signatures"]
    yield {name: importlib.import_module(name) for name in names}
    sys.path.remove(str(DOCS))
    for name in [*names, "extensions"]:
        del sys.modules[name]


def shown() -> list[object]:
    """Return the objects that the pages of the API document, and the members of modules among them."""
    text = "".join(path.read_text() for path in (DOCS / "api").glob("*.md"))
    names = re.findall(r"^\.\. auto(?:class|function|data|module):: ([\w.]+)$", text, re.MULTILINE)
    found = [pkgutil.resolve_name(name) for name in names]
    for module in [one for one in found if isinstance(one, ModuleType)]:
        found += [getattr(module, name) for name in vars(module).get("__all__", vars(module)) if name[0] != "_"]
    return found


def is_former(name: str) -> bool:
    return any(f"{name}.".startswith(f"{former}.") for former in MOVED)


def test_every_public_name_is_on_a_page_of_the_api() -> None:
    """Under this name, or under another one that is the same."""
    there = shown()
    names = [name for name in PUBLIC if not is_former(name)]
    named = {name: getattr(pkgutil.resolve_name(name.rpartition(".")[0]), name.rpartition(".")[2]) for name in names}
    assert [name for name, public in named.items() if not any(public is one for one in there)] == []


def test_every_page_is_in_one_table_of_contents() -> None:
    listed: list[str] = []
    for page in DOCS.rglob("*.md"):
        for block in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(), re.DOTALL):
            for line in block.splitlines():
                if line.strip() and not line.startswith(":"):
                    name = re.sub(r"^.*<(.*)>$", r"\1", line.strip())
                    listed.append(str((page.parent / name).relative_to(DOCS)))
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in DOCS.rglob("*.md")}
    assert sorted(listed) == sorted(pages - {"index"})


def test_every_example_and_notebook_has_a_tutorial(docs: dict[str, ModuleType]) -> None:
    for path in EXAMPLES:
        page = docs["extensions.repository"].page_of(str(path.relative_to(ROOT)))
        assert (DOCS / page).is_file(), path.name


def test_every_picture_has_a_page_that_says_how_it_is_made(docs: dict[str, ModuleType]) -> None:
    for recipe in docs["make_pictures"].RECIPES:
        page, _, place = recipe.page.partition("#")
        text = (DOCS / f"{page}.md").read_text()
        assert re.search(rf"\{{(example|ran|notebook|live|drawn)\}} {recipe.name}\b", text), recipe.name
        assert not place or place in [re.sub(r"\W+", "-", line.lower()) for line in re.findall("^## (.*)$", text, re.M)]


@pytest.mark.parametrize("name", ["docstrings", "references", "repository", "signatures"])
def test_examples_in_the_sites_modules_are_true(docs: dict[str, ModuleType], name: str) -> None:
    result = doctest.testmod(docs[f"extensions.{name}"])
    assert result.failed == 0
    assert result.attempted or name == "references"


def test_a_docstring_of_the_house_becomes_definitions(docs: dict[str, ModuleType]) -> None:
    written = docs["extensions.docstrings"].rewritten(
        [
            "What |x| is.",
            "",
            "start, end  (M,)  m  where it",
            "                     begins and ends",
            "",
            "    Parameters".strip(),
            "----------",
            "scale : float",
            "    Metres per unit.",
            "",
            "As shown::",
            "",
            "    a  b | c",
        ]
    )
    assert written[0] == r"What \|x\| is."
    assert written[2:4] == ["``start``, ``end`` : (M,), m", "    where it begins and ends"]
    assert written[5:9] == [".. rubric:: Parameters", "", "``scale`` : float", "    Metres per unit."]
    assert written[-1] == "    a  b | c"


def test_a_name_that_nobody_defines_is_known_for_one(docs: dict[str, ModuleType], tmp_path: Path) -> None:
    package = tmp_path / "shop"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "till.py").write_text("class Till:\n    def open(self):\n        self.coins = 0\n    size: int = 3\n")
    known = docs["extensions.references"].defined(package)
    assert known["Till"] == known["till.Till"] == {"shop.till.Till"}
    assert {"Till.open", "Till.coins", "size"} <= set(known)
    assert "Till.close" not in known
    elsewhere = docs["extensions.references"].is_elsewhere
    assert elsewhere("np.ndarray")
    assert elsewhere("Callable")
    assert not elsewhere("the runs")


def test_links_that_lead_nowhere_are_found(docs: dict[str, ModuleType], tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<h1 id="top"></h1><a href="b.html#there">x</a><a href="https://x.org/y">y</a>')
    (tmp_path / "b.html").write_text(
        '<p id="there"></p><a href="a.html#top"></a><a href="a.html#bottom"></a><a href="c.html"></a>'
        '<img src="d.png"><script src="https://x.org/s.js"></script>'
    )
    assert list(docs["check_site"].faults(tmp_path)) == [
        "b.html loads https://x.org/s.js",
        "b.html leads to a.html#bottom, and there is no such place on that page",
        "b.html leads to c.html, which is not there",
        "b.html leads to d.png, which is not there",
    ]
