"""Tests that may notice a change of a line: coverage saw them there, or in a line that calls its kernel.

Coverage cannot see into kernels, nor what an import computes once for all tests. A line of either is reached by the
tests that reach a line of Python which names the kernel (or the name that the import computed), through any number of
kernels between.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from coverage import CoverageData

KERNEL = {"kernel", "lean", "njit"}


class Name(NamedTuple):
    """A name at the top of a file."""

    file: str
    name: str


class Use(NamedTuple):
    """A line that names something, and what it belongs to at the top of its file where coverage cannot see it."""

    file: str
    line: int
    inside: str | None


class Code:
    """The package's files, and who names what."""

    def __init__(self, root: Path, package: str = "hpop") -> None:
        self.trees = {
            str(p.relative_to(root)): ast.parse(p.read_text()) for p in sorted((root / package).rglob("*.py"))
        }

    def unseen(self, file: str, line: int) -> str | None:
        """Return the top-level statement of a line that coverage cannot see run in a test; None otherwise."""
        for statement in self.trees[file].body:
            if statement.lineno <= line <= (statement.end_lineno or statement.lineno) or any(
                decorator.lineno <= line < statement.lineno for decorator in getattr(statement, "decorator_list", [])
            ):
                return _unseen(statement, line)
        return None

    @cached_property
    def uses(self) -> dict[Name, list[Use]]:
        """Return the uses of each top-level name in all files."""
        uses: dict[Name, list[Use]] = defaultdict(list)
        for file, tree in self.trees.items():
            local = self._names(file, tree)
            modules = self._modules(file, tree)
            for statement in tree.body:
                for node in ast.walk(statement):
                    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in local:
                        name = local[node.id]
                    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                        if (module := modules.get(node.value.id)) is None:
                            continue
                        name = Name(module, node.attr)
                    else:
                        continue
                    uses[name].append(Use(file, node.lineno, _unseen(statement, node.lineno)))
        return uses

    def seen_lines(self, file: str, name: str) -> set[tuple[str, int]]:
        """Lines that coverage sees and that name this, or something that names it, and so on."""
        lines: set[tuple[str, int]] = set()
        met, todo = set(), [Name(file, name)]
        while todo:
            if (current := todo.pop()) not in met:
                met.add(current)
                lines |= {(current.file, line) for line in self._methods(current)}
                for use in self.uses[current]:
                    if use.inside is None:
                        lines.add((use.file, use.line))
                    else:
                        todo.append(Name(use.file, use.inside))
        return lines

    def _methods(self, name: Name) -> Iterable[int]:
        """Lines of the methods of a class, whose defaults and names an import computes."""
        for statement in self.trees[name.file].body:
            if isinstance(statement, ast.ClassDef) and statement.name == name.name:
                yield from range(statement.lineno, (statement.end_lineno or statement.lineno) + 1)

    def importers(self, file: str) -> set[str]:
        """Files that import this one, or one that imports it, and the file."""
        imports = {
            other: {name.file for name in self._names(other, tree).values()} | set(self._modules(other, tree).values())
            for other, tree in self.trees.items()
        }
        found, todo = set(), [file]
        while todo:
            if (current := todo.pop()) not in found:
                found.add(current)
                todo += [other for other, imported in imports.items() if current in imported]
        return found

    def _file(self, module: str) -> str | None:
        path = module.replace(".", "/")
        return next((file for file in (f"{path}.py", f"{path}/__init__.py") if file in self.trees), None)

    def _names(self, file: str, tree: ast.Module) -> dict[str, Name]:
        """Return the meaning of a file's names: its own, and those imported from the package."""
        names = {}
        for statement in tree.body:
            if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
                names[statement.name] = Name(file, statement.name)
            for target in _targets(statement):
                names[target] = Name(file, target)
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and (source := self._file(node.module)):
                names |= {alias.asname or alias.name: Name(source, alias.name) for alias in node.names}
        return names

    def _modules(self, file: str, tree: ast.Module) -> dict[str, str]:
        modules = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                found = {alias.asname or alias.name: self._file(f"{node.module}.{alias.name}") for alias in node.names}
                modules |= {name: source for name, source in found.items() if source}
            elif isinstance(node, ast.Import):
                found = {alias.asname or "": self._file(alias.name) for alias in node.names}
                modules |= {name: source for name, source in found.items() if name and source}
        return modules


def _targets(statement: ast.stmt) -> Iterator[str]:
    targets = getattr(statement, "targets", [getattr(statement, "target", None)])
    for target in targets:
        for node in ast.walk(target) if target is not None else ():
            if isinstance(node, ast.Name):
                yield node.id


def _unseen(statement: ast.stmt, line: int) -> str | None:
    """Name of a statement at the top of a file whose line runs at import or in a kernel."""
    if isinstance(statement, ast.FunctionDef):
        return None if line >= statement.body[0].lineno and not is_kernel(statement) else statement.name
    if isinstance(statement, ast.ClassDef):
        for method in statement.body:
            if isinstance(method, ast.FunctionDef) and method.body[0].lineno <= line <= (method.end_lineno or 0):
                return None
        return statement.name
    return next(_targets(statement), "")


def is_kernel(function: ast.FunctionDef) -> bool:
    """Say whether a function is compiled."""
    decorators = (d.func if isinstance(d, ast.Call) else d for d in function.decorator_list)
    return any(getattr(d, "id", getattr(d, "attr", "")) in KERNEL for d in decorators)


class Seen:
    """Tests by line, from coverage; the fixtures before a test count as that test."""

    def __init__(self, data: Path) -> None:
        self._data = CoverageData(str(data))
        self._data.read()
        files = self._data.measured_files()
        self._files = {file[file.rindex("/hpop/") + 1 :]: file for file in files if "/hpop/" in file}
        self._contexts: dict[str, dict[int, list[str]]] = {}

    def tests(self, lines: Iterable[tuple[str, int]]) -> set[str]:
        """Tests that reach any of these lines."""
        found: set[str] = set()
        for file, line in lines:
            if file in self._files:
                if file not in self._contexts:
                    self._contexts[file] = self._data.contexts_by_lineno(self._files[file])
                found |= {context.rpartition("|")[0] for context in self._contexts[file].get(line, []) if context}
        return found
