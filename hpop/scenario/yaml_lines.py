"""YAML reader that keeps line numbers: plain values, and the line of each key for error messages."""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import yaml

from hpop.base.arrays import copied
from hpop.base.files import read_regular
from hpop.base.text import argument, printable, shown
from hpop.errors import ScenarioError, meant_file

MAX_BYTES = 4_000_000
MAX_DEPTH = 20
MAX_EXPANDED = 10_000
"""Most values in a file with its aliases written out: aliases of aliases could double them with every line."""
LONGEST = 200  # most characters of a dotted key in a message
TAG = "tag:yaml.org,2002:"
DECIMAL = re.compile(r"[-+]?(0|[1-9]\d*|\d*\.\d*(e[-+]\d+)?|\.inf|\.nan)", re.IGNORECASE)
Place = tuple[str | int, ...]


class Document:
    """YAML file as plain values, with the line of every key.

    Keys are words, each given once; numbers are decimal; dates and tags are refused. An alias is a copy of its anchor's
    value, and a file with aliases holds at most `MAX_EXPANDED` values, copies included.

    values  dict
    path    path of the file

    Raises ScenarioError, with the line if there is one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        text = _read(path)
        self._lines: dict[Place, int] = {(): 1}
        try:
            self._check_events(text)
            node = yaml.compose(text, Loader=yaml.CSafeLoader)
            self._walk(node, ())
            self.values: Any = None if node is None else yaml.CSafeLoader("").construct_document(node)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            hint = "; indent with spaces, not tabs" if "\t" in text else ""
            if not hint and ("expected" in str(error.problem) or "mapping values" in str(error.problem)):
                hint = "; check that each key ends in a colon, and that keys of one list are indented alike"
            self._refuse(mark.line + 1 if mark else None, f"not plain YAML: {error.problem}{hint}")
        except yaml.YAMLError as error:
            self._refuse(None, f"not plain YAML: {' '.join(str(error).split())}")
        if not isinstance(self.values, dict):
            got = "an empty file" if self.values is None else shown(self.values)
            self._refuse(None, f"expected keys with values, such as `goal: [9, 2]`, got {got}")

    def with_values(self, values: dict[str, Any], sources: Mapping[Place, Place] | None = None) -> Document:
        """Return the document with other values.

        sources  for the position of a new value, the position in the file whose line is reported for it
        """
        lines = dict(self._lines)
        for place, source in (sources or {}).items():
            lines = {key: line for key, line in lines.items() if key[: len(place)] != place}
            for depth in range(1, len(place)):
                lines.setdefault(place[:depth], self.line(source))
            lines[place] = self.line(source)
        return copied(self, values=values, _lines=lines)

    def where(self, place: Place) -> str:
        """Return file, line and dotted key of a position, for an error message.

        For a position that is missing in the file, the line is that of its nearest parent.
        """
        dotted = printable(".".join(str(key) for key in place))
        if len(dotted) > LONGEST:
            dotted = f"{dotted[:LONGEST]}..."
        return f"{self.path}, line {self.line(place)}" + (f", {dotted}" if dotted else "")

    def line(self, place: Place) -> int:
        """Return the line of a position; or the line of its nearest parent in the file."""
        while place not in self._lines:
            place = place[:-1]
        return self._lines[place]

    def __contains__(self, place: object) -> bool:
        return place in self._lines

    def _refuse(self, line: int | None, text: str) -> NoReturn:
        """Raise ScenarioError with the file, the line if it is known (not None), and a text."""
        raise ScenarioError(f"{self.path}{f', line {line}' if line else ''}: {text}") from None

    def _check_events(self, text: str) -> None:
        """Refuse tags, deep nesting and too many aliases before parsing, because the C loader recurses."""
        expanded = _Expanded()
        event: Any
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            line = event.start_mark.line + 1
            if getattr(event, "tag", None):
                self._refuse(line, f"tags such as {event.tag} are not read; write a plain value")
            if isinstance(event, yaml.NodeEvent | yaml.CollectionEndEvent) and (wrong := expanded.add(event)):
                self._refuse(line, wrong)

    def _walk(self, node: Any, place: Place) -> None:
        """Check the keys and scalars below a YAML node, and store their lines."""
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                line = key.start_mark.line + 1
                if key.tag == TAG + "bool":  # YAML 1.1 reads the words on, off, yes and no as true and false
                    key.tag = TAG + "str"
                if key.tag != TAG + "str":
                    got = shown(key.value) if isinstance(key, yaml.ScalarNode) else "a list or keys"
                    self._refuse(line, f"a key must be a word, got {got}; put it in quotes if it is one")
                here = (*place, key.value)
                if here in self._lines:
                    self._refuse(line, f"{shown(key.value)} is given twice; keep one")
                self._lines[here] = line
                self._walk(value, here)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self._lines[(*place, index)] = value.start_mark.line + 1
                self._walk(value, (*place, index))
        elif isinstance(node, yaml.ScalarNode):
            kind, got, line = node.tag.removeprefix(TAG), node.value[:40], node.start_mark.line + 1
            # YAML 1.1 reads 010 as 8, 1:30 as 90 and 1_0 as 10, which is never meant here.
            if kind in ("int", "float") and (len(node.value) > 400 or not DECIMAL.fullmatch(node.value)):
                self._refuse(line, f"{got!r} is not a plain decimal number; write one")
            if kind not in ("str", "int", "float", "bool", "null"):
                self._refuse(line, f"YAML reads {got!r} as a {kind}; put it in quotes")


class _Expanded:
    """Counter of the size and depth that a YAML file has with its aliases expanded."""

    def __init__(self) -> None:
        self._open: list[tuple[str | None, int, int]] = []  # anchor, values before, deepest level within
        self._named: dict[str | None, tuple[int, int]] = {}  # values and levels of each anchor
        self._values = 0
        self._aliases = False

    def add(self, event: Any) -> str:
        """Count a YAML event; return the fault if a limit is passed, else ""."""
        if isinstance(event, yaml.CollectionStartEvent):
            self._named.pop(event.anchor, None)
            self._values += 1
            self._open.append((event.anchor, self._values - 1, 1))
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before, levels = self._open.pop()
            self._close(anchor, self._values - before, levels)
        elif isinstance(event, yaml.ScalarEvent):
            self._values += 1
            self._close(event.anchor, 1, 0)
        elif event.anchor in self._named:
            self._aliases = True
            values, levels = self._named[event.anchor]
            self._values += values
            self._close(None, values, levels)
        else:  # an alias inside its own anchor, or without an anchor
            return f"the alias *{event.anchor} names nothing that ends before it; write the value out"
        depth = max((level + levels for level, (_, _, levels) in enumerate(self._open)), default=0)
        if depth > MAX_DEPTH:
            return f"values are nested more than {MAX_DEPTH} deep; a scenario needs fewer"
        if self._aliases and self._values > MAX_EXPANDED:
            return f"with its aliases written out, the file has more than {MAX_EXPANDED:,} values; write fewer"
        return ""

    def _close(self, anchor: str | None, values: int, levels: int) -> None:
        """Note the depth of a finished value at its parent; if it has an anchor, store its size (values, levels)."""
        if anchor is not None:
            self._named[anchor] = (values, levels)
        if self._open:
            outer, before, deepest = self._open[-1]
            self._open[-1] = (outer, before, max(deepest, levels + 1))


def _read(path: Path) -> str:
    """Return the text of a YAML file; raise ScenarioError if it cannot be read."""
    try:
        return read_regular(path, MAX_BYTES).decode("utf-8-sig")
    except FileNotFoundError:
        raise ScenarioError(
            f"{path}: no such file; give the path of a YAML file: a scenario, a ROS map, or the events of a drive."
            f"{meant_file(path)}"
        ) from None
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"{path}: not a text file in UTF-8 (byte {error.start}); save it as UTF-8. If it is a map, write a "
            f"scenario, a YAML file that names it: hpop new {argument(path)}"
        ) from None
    except OSError as error:
        reason = error.strerror or error
        raise ScenarioError(
            f"{path}: cannot be read: {reason}; give the path of a YAML file: a scenario, or the events of a drive"
        ) from None


def note_on_yaml(got: Any) -> str:
    """Return a hint if YAML read a value differently than it looks (1e3 as text), or it has a unit (5 cm); else ""."""
    if isinstance(got, list | dict):
        got = got.values() if isinstance(got, dict) else got
        return next(filter(None, map(note_on_yaml, got)), "")
    if isinstance(got, str) and re.fullmatch(r"[-+]?\d+(\.\d*)?e[-+]?\d+", got, re.IGNORECASE):
        return f" (YAML reads {got} as text; write it with a point and a sign, such as 1.0e-3)"
    if isinstance(got, str) and (unit := re.fullmatch(r"([-+]?\d+(?:\.\d*)?) ?(mm|cm|km|m|ms|s|deg|rad)", got)):
        in_base = {"mm": (1e-3, "m"), "cm": (1e-2, "m"), "km": (1e3, "m"), "ms": (1e-3, "s")}
        factor, base = in_base.get(unit[2], (math.pi / 180 if unit[2] == "deg" else 1.0, unit[2].replace("deg", "rad")))
        return f" (write a number without its unit: {got} is {float(unit[1]) * factor:.6g}, in {base})"
    if isinstance(got, bool):
        return " (YAML reads no, off, yes and on as truth values; put words in quotes)"
    return ""


def note_on_path(text: str, path: Path) -> str:
    """Return a sentence on the folder of paths if the text of a fault says that a file is missing; else "".

    path  path of the scenario
    """
    if os.strerror(errno.ENOENT) not in text:
        return ""
    stop = "" if text.endswith((".", "?")) else "."
    return f"{stop} Paths are relative to the scenario's folder, {path.absolute().parent}."


def entries(value: Any) -> list[Any]:
    """Return a value if it is a list, else an empty list; the schema reports the fault."""
    return value if isinstance(value, list) else []
