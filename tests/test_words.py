"""Words of docstrings and names of classes: a verb or a noun first, no pronoun puzzles, one meaning for each name."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HOME = sorted(f"hpop/{path.name}" for path in (ROOT / "hpop").iterdir() if path.suffix == ".py" or path.is_dir())
ROOMS = [*(room for room in HOME if "__pycache__" not in room), "tests", "benchmarks", "examples", "docs", "tools"]
#: Rooms whose docstrings are not rewritten yet; they only shrink.
EXEMPT: set[str] = set()
FIRST = re.compile(r"(What|That|Whether|How|Who|Whom|Whose|Where|Which|When|The same|Of|So many|By how much)\b")
PRONOUN = re.compile(r"\b(somebody|nobody|whom)\b", re.IGNORECASE)
#: Text of a file that may have a docstring with a fault; only such files are parsed.
SUSPECT = re.compile(rf"\"\s*{FIRST.pattern}|(?i:{PRONOUN.pattern})")


def files(room: str) -> list[Path]:
    """Return the Python files of a room."""
    return [ROOT / room] if room.endswith(".py") else sorted((ROOT / room).rglob("*.py"))


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all statements in it; most nodes of a module are expressions, which define nothing."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr):
            yield from statements(child)


@cache
def definitions(path: Path) -> list[tuple[str, str, str, str]]:
    """Return kind, name, place and docstring of a module, its classes and its functions."""
    return [
        (
            type(node).__name__,
            getattr(node, "name", "module"),
            f"{path.relative_to(ROOT)}:{node.body[0].lineno if node.body else 1}",
            ast.get_docstring(node) or "",
        )
        for node in statements(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    ]


def faults(text: str) -> list[str]:
    """Return the words of a docstring that are refused."""
    first = [f'begins with "{match[1]}"'] if (match := FIRST.match(text)) else []
    return first + [f'says "{word}"' for word in PRONOUN.findall(text)]


@pytest.mark.parametrize("room", [room for room in ROOMS if room not in EXEMPT])
def test_docstrings_begin_with_a_verb_or_a_noun_and_are_no_puzzles(room: str) -> None:
    """Ruff's D401 asks for the imperative; here are the words that it lets pass."""
    found = [
        f"{place} {name}: {fault}"
        for path in files(room)
        if SUSPECT.search(path.read_text(encoding="utf-8"))
        for _, name, place, text in definitions(path)
        for fault in faults(text)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Return the remaining cost.", []),
        ("Offer a seat.", []),
        ("What remains.", ['begins with "What"']),
        ("The same as before.", ['begins with "The same"']),
        ("A person whom nobody knows.", ['says "whom"', 'says "nobody"']),
    ],
)
def test_puzzles_are_found(text: str, words: list[str]) -> None:
    assert faults(text) == words


def test_a_class_name_has_one_meaning() -> None:
    """A reader who has met a name once knows it everywhere in hpop."""
    candidates = defaultdict(list)
    for path in files("hpop"):
        for match in re.finditer(r"^ *class (\w+)\b.*:$", path.read_text(encoding="utf-8"), re.MULTILINE):
            candidates[match[1]].append(path)
    places = defaultdict(list)
    for path in {path for found in candidates.values() if len(found) > 1 for path in found}:  # or words of a docstring
        for kind, name, place, _ in definitions(path):
            if kind == "ClassDef":
                places[name].append(place)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
