"""Builder of the small wheel ``hpop-search``: the search of hpop without robots, under the name ``hpop_search``.

    python tools/search/build.py OUT        (make wheel-search)

hpop contains the search, and does not depend on the wheel: one package stays whole in one repository, and nothing has
to be released in two steps. The wheel has copies of the modules under a name of its own, so that both can be installed
together. Two distributions with files of one name would overwrite each other, and removing one would break the other.
"""

from __future__ import annotations

import ast
import contextlib
import os
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NAME = "hpop_search"
LEFT_OUT = {"hpop.search.supported.first_paths"}  # needs scipy; for planners
BESIDE = "base|errors|frontier|runtime"  # rooms of hpop from which the search takes modules
PROJECT = """[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "hpop-search"
version = "{version}"
description = "Exact multi-objective shortest paths on plain graphs"
readme = "README.md"
requires-python = "{python}"
license = "MIT"
license-files = ["LICENSE", "NOTICE"]
dependencies = {needs}

[project.optional-dependencies]
networkx = ["{networkx}"]

[tool.setuptools.packages.find]
include = ["{name}*"]
namespaces = false

[tool.setuptools.package-data]
{name} = ["py.typed"]
"""


def module_of(path: Path) -> str:
    """Return the dotted name of a file of hpop."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path) -> Iterator[str]:
    """Yield the names of modules of hpop that a file may import, wherever its imports stand."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("hpop."):
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def needed() -> dict[str, Path]:
    """Return the modules of the wheel by their names in hpop: the search, and all that it imports."""
    paths = {module_of(path): path for path in (ROOT / "hpop").rglob("*.py")}
    waiting = [name for name in paths if name.split(".")[1:2] == ["search"] and name not in LEFT_OUT]
    found: dict[str, Path] = {}
    while waiting:
        name = waiting.pop()
        if name not in found and name in paths and name != "hpop":
            found[name] = paths[name]
            waiting += [*imported(paths[name]), name.rpartition(".")[0]]
    return found


def renamed(text: str) -> str:
    """Return the source or name with the modules of the wheel under their new names.

    >>> renamed("from hpop.search.graph import Graph; from hpop.base.text import shown; hpop.criteria")
    'from hpop_search.graph import Graph; from hpop_search.base.text import shown; hpop.criteria'
    """
    text = re.sub(r"\bhpop\.search\b", NAME, text)
    text = re.sub(rf"\bhpop(?=\.({BESIDE})\b)", NAME, text)
    text = re.sub(r"\bfrom hpop import", f"from {NAME} import", text)
    return re.sub(r'"hpop(\.?)"', rf'"{NAME}\1"', text)


def write_sources(folder: Path) -> None:
    """Write the sources of the wheel: its modules, metadata, README and licence."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (version,) = re.findall(r'^__version__ = "(.+)"', (ROOT / "hpop/__init__.py").read_text(), re.MULTILINE)
    pinned = {re.split(r"[<>=]", text)[0]: text for text in project["dependencies"]}
    for name, path in needed().items():
        parts = renamed(name).split(".")
        target = folder.joinpath(*parts, "__init__.py") if path.name == "__init__.py" else folder.joinpath(*parts)
        target = target if target.suffix else target.with_name(f"{target.name}.py")
        target.parent.mkdir(parents=True, exist_ok=True)
        text = renamed(path.read_text(encoding="utf-8"))
        if name == "hpop.search":
            text = text.replace("\nfrom typing", f'\n__version__ = "{version}"\n\nfrom typing', 1)
        target.write_text(text, encoding="utf-8")
    (folder / NAME / "py.typed").touch()
    needs = [pinned["numpy"], pinned["numba"]]
    values = {"version": version, "python": project["requires-python"], "networkx": pinned["networkx"]}
    (folder / "pyproject.toml").write_text(PROJECT.format(**values, needs=str(needs).replace("'", '"'), name=NAME))
    for path in (Path(__file__).with_name("README.md"), ROOT / "LICENSE", ROOT / "NOTICE"):
        (folder / path.name).write_bytes(path.read_bytes())


def build(out: Path) -> Path:
    """Build the wheel into a folder and return its path."""
    from setuptools import build_meta  # takes a second

    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        write_sources(Path(folder))
        before = Path.cwd()
        os.chdir(folder)  # build_meta builds where it is
        try:
            with contextlib.redirect_stdout(sys.stderr):
                return out / build_meta.build_wheel(str(out))
        finally:
            os.chdir(before)


if __name__ == "__main__":
    print(build(Path(sys.argv[1] if len(sys.argv) > 1 else "out/wheels")))  # noqa: T201
