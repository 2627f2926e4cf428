"""Imports: inside functions only with a reason, and one way also where a package imports its modules on first use."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


def unexplained(source: str) -> list[int]:
    """Lines of the imports of hpop inside functions that have no reason.

    The reason is a comment on their line, above them or above the first of consecutive ones, or one for the whole file,
    which says "imported inside functions".
    """
    lines = ["", *source.splitlines()]
    if any(line.startswith("#") and "imported inside functions" in line for line in lines):
        return []
    top, of_functions = "", False  # quick: most imports that are indented are those for type checkers
    for line in lines:
        top = top if line[:1] in ("", " ", "#") else line
        is_import = line[:1] == " " and line.lstrip().startswith(("from hpop", "import hpop", "from ."))
        of_functions |= is_import and not top.startswith("if TYPE_CHECKING")
    if not of_functions:
        return []
    functions = [f for f in ast.walk(ast.parse(source)) if isinstance(f, ast.FunctionDef | ast.AsyncFunctionDef)]
    imports = {
        node.lineno: int(node.end_lineno or 0)
        for function in functions
        for node in ast.walk(function)
        if (isinstance(node, ast.ImportFrom) and (node.level or str(node.module).split(".")[0] == "hpop"))
        or (isinstance(node, ast.Import) and any(alias.name.split(".")[0] == "hpop" for alias in node.names))
    }
    found, explained = [], 0  # the last line of an import with a reason
    for begin, end in sorted(imports.items()):
        above = lines[begin - 1].lstrip().startswith("#") or explained == begin - 1
        if above or any("#" in line for line in lines[begin : end + 1]):
            explained = end
        else:
            found.append(begin)
    return found


FUNCTION = "def f():\n"


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("import hpop\n" + FUNCTION + "    import numpy\n", []),
        (FUNCTION + "    import hpop.view\n", [2]),
        (FUNCTION + "    from hpop import view\n    from .a import b\n", [2, 3]),
        (FUNCTION + "    from hpop import view  # slow\n    from hpop.a import b\n\n    from hpop.c import d\n", [5]),
        (FUNCTION + "    # slow\n    from hpop import (\n        a,\n    )\n    from hpop.a import b\n", []),
        ("class A:\n    async def f():\n        if 1:\n            from hpop import a\n", [4]),
        ("# Heavy modules are imported inside functions: slow.\n" + FUNCTION + "    from hpop import a\n", []),
    ],
)
def test_what_has_a_reason_to_be_imported_in_a_function(source: str, lines: list[int]) -> None:
    assert unexplained(source) == lines


def test_hpop_is_imported_at_the_top_of_files_or_with_a_reason_elsewhere() -> None:
    paths = sorted((ROOT / "hpop").rglob("*.py"))
    assert [f"{path.relative_to(ROOT)}:{line}" for path in paths for line in unexplained(path.read_text())] == []


# Packages that import modules on first use: import-linter does not see which file reads which module


def module_of(path: Path) -> str:
    """Return the dotted name of a file of hpop."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in (ROOT / "hpop").rglob("*.py")}
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]


IMPORTED = re.compile(r"^ *from +([\w.]+) +import +(\([^)]*\)|.*)|^ *(import hpop)", re.MULTILINE)


def imports_modules(source: str) -> bool:
    """Return whether a file imports hpop, or a module from a package of it; most files import names alone."""
    return any(
        whole or any(f"{package}.{name}" in MODULES for name in re.findall(r"\w+", names))
        for package, names, whole in IMPORTED.findall(source)
    )


def modules_read(source: str) -> Iterator[str]:
    """Yield the modules of hpop whose names a file reads as attributes, such as ``geometry._kernels.nearest``."""
    if not imports_modules(source):  # quick
        return
    tree, packages = ast.parse(source), dict[str, str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            named = {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
            packages |= {name: module for name, module in named.items() if module in MODULES}
        elif isinstance(node, ast.Import) and any(alias.name == "hpop" for alias in node.names):
            packages["hpop"] = "hpop"
    for node in ast.walk(tree) if packages else ():
        names, value = list[str](), node
        while isinstance(value, ast.Attribute):
            names, value = [value.attr, *names], value.value
        if names and isinstance(value, ast.Name) and value.id in packages:
            module = ".".join([packages[value.id], *names])
            while module not in MODULES:
                module = module.rpartition(".")[0]
            yield module


def wrong_way(contract: dict[str, Any], reader: str, module: str) -> bool:
    """Return whether a contract of layers forbids that a module reads another one."""
    (container,) = contract["containers"]
    if not (reader.startswith(f"{container}.") and module.startswith(f"{container}.")):
        return False
    for ignored in contract.get("ignore_imports", ()):
        one, other = ignored.split(" -> ")
        if reader == one and f"{module}.".startswith(f"{other}."):
            return False
    rooms = [{name.strip() for name in layer.replace(":", "|").split("|")} for layer in contract["layers"]]
    (from_, to) = (name.removeprefix(f"{container}.").partition(".")[0] for name in (reader, module))
    (high, low) = (next(i for i, layer in enumerate(rooms) if name in layer) for name in (from_, to))
    return from_ != to and (low < high or (low == high and ":" not in contract["layers"][low]))


def test_modules_imported_on_first_use_are_of_lower_layers() -> None:
    read = [(name, module) for name, path in MODULES.items() for module in set(modules_read(path.read_text()))]
    layers = [contract for contract in CONTRACTS if contract["type"] == "layers"]
    assert ("hpop.world.geometry.planar", "hpop.world.geometry._kernels") in read
    assert [(*pair, each["name"]) for each in layers for pair in read if wrong_way(each, *pair)] == []


def test_a_module_of_a_higher_layer_is_found() -> None:
    contract = {"containers": ["hpop.search"], "layers": ["mean", "timed | lazy", "graph : queries"]}
    read = set(modules_read("from hpop.search import mean as m, timed\nm.kernel.go()\ntimed.graph\nother.x\n"))
    assert read == {"hpop.search.mean.kernel", "hpop.search.timed.graph"}
    assert wrong_way(contract, "hpop.search.timed.graph", "hpop.search.mean.kernel")
    assert wrong_way(contract, "hpop.search.timed", "hpop.search.lazy")
    assert not wrong_way(contract, "hpop.search.mean.kernel", "hpop.search.timed.graph")
    assert not wrong_way(contract, "hpop.search.graph", "hpop.search.queries")
    assert not wrong_way(contract, "hpop.search.graph", "hpop.world")
    ignoring = {**contract, "ignore_imports": ["hpop.search.timed.graph -> hpop.search.mean"]}
    assert not wrong_way(ignoring, "hpop.search.timed.graph", "hpop.search.mean.kernel")
