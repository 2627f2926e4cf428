"""What docstrings and comments say of each parameter: its unit and meaning, for editors."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import cache
from typing import Any

TABLE = re.compile(r"^(\w+(?:, \w+)*) {2,}(\S.*)$")
NUMPY = re.compile(r"^(\w+(?:, \w+)*) : (.+)$")


def parameter_docs(item: type | Callable[..., Any]) -> dict[str, str]:
    r"""Texts by name: of a class its own and those of its bases, of a function those of its docstring.

    Three ways to write them are known: aligned lines in the docstring (``radius  m  of a round footprint``), comments
    behind the fields (``radius: float = 2.0  # m``), and NumPy's sections (``scale : float`` and indented lines).

    >>> def read(path, scale):
    ...     "path : path of the file\n    scale : float\n        Metres a unit."
    >>> parameter_docs(read)
    {'path': 'path of the file', 'scale': 'Metres a unit.'}
    """
    found: dict[str, str] = {}
    for one in reversed(item.__mro__) if isinstance(item, type) else (item,):
        if one.__module__.partition(".")[0] == "builtins":
            continue
        found |= _comments(one) if isinstance(one, type) else {}
        found |= _lines(inspect.cleandoc(one.__doc__ or ""))
    return found


def _lines(text: str) -> dict[str, str]:
    """Texts by name of the lines of a docstring, each with the indented lines that follow."""
    found: dict[str, list[str]] = {}
    names: list[str] = []
    for line in text.split("\n"):
        table, numpy = TABLE.match(line), NUMPY.match(line)
        if table or numpy:
            names = (table or numpy).group(1).split(", ")  # type: ignore[union-attr]
            found |= {name: [table.group(2) if table else numpy.group(2)] for name in names}  # type: ignore[union-attr]
        elif names and line.startswith("    "):
            for name in names:
                found[name].append(line.strip())
        else:
            names = []
    return {name: _plain(lines) for name, lines in found.items()}


def _plain(lines: list[str]) -> str:
    """One line of text, without markup; of NumPy's form what follows the type, if anything does."""
    first, *rest = lines
    is_type = rest and re.fullmatch(r"[\w\[\]|,. ]+|\(.*\)|\".*", first)
    text = " ".join(" ".join(rest if is_type else lines).split())
    return re.sub(r":\w+:`~?([^`]+)`|``([^`]+)``", r"\1\2", text)


@cache
def _comments(cls: type) -> dict[str, str]:
    """What stands behind the fields of a class in its source; nothing where there is none."""
    try:
        source = inspect.getsource(cls)
    except (OSError, TypeError):
        return {}
    found = re.findall(r"^ +(\w+): [^#\n]*  # (.+)$", source, re.MULTILINE)
    return {name: text for name, text in found if not text.startswith(("type:", "noqa"))}
