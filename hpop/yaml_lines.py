"""YAML that remembers lines: plain values, and where each key stands, so that errors can say it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from hpop.errors import ScenarioError

MAX_BYTES = 4_000_000
Place = tuple[str | int, ...]


class Document:
    """A YAML file as plain values, with the line of every key.

    values  dict
    path    of the file
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        text = _read(path)
        self._lines: dict[Place, int] = {(): 1}
        try:
            for event in yaml.parse(text, Loader=yaml.CSafeLoader):
                if isinstance(event, yaml.AliasEvent):
                    line = event.start_mark.line + 1
                    raise ScenarioError(f"{path}, line {line}: anchors and aliases are not read; write the values out")
            root = yaml.compose(text, Loader=yaml.CSafeLoader)
            self._walk(root, ())
            self.values = yaml.load(text, Loader=yaml.CSafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            where = f", line {mark.line + 1}" if mark else ""
            raise ScenarioError(f"{path}{where}: not plain YAML: {error.problem}") from None
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ScenarioError(f"{path}: not plain YAML: {error}") from None
        if not isinstance(self.values, dict):
            raise ScenarioError(f"{path}: expected keys such as world, start and goal, got {_shown(self.values)}")

    def where(self, place: Place) -> str:
        """File, line and dotted key of a place, or of the nearest one above it that stands in the file."""
        known = place
        while known not in self._lines:
            known = known[:-1]
        dotted = ".".join(str(key) for key in place)
        return f"{self.path}, line {self._lines[known]}" + (f", {dotted}" if dotted else "")

    def _walk(self, node: Any, place: Place) -> None:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                here = (*place, key.value)
                if here in self._lines:
                    raise ScenarioError(f"{self.path}, line {key.start_mark.line + 1}: {key.value!r} is given twice")
                self._lines[here] = key.start_mark.line + 1
                self._walk(value, here)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self._lines[(*place, index)] = value.start_mark.line + 1
                self._walk(value, (*place, index))


def _read(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ScenarioError(f"{path}: {size:,} bytes are no scenario; at most {MAX_BYTES:,} are read")
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError(f"{path}: no such file; give the path of a scenario (YAML)") from None
    except IsADirectoryError:
        raise ScenarioError(f"{path} is a folder; give the path of a scenario (YAML) in it") from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: not a text file in UTF-8") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror or error}") from None


def _shown(value: object) -> str:
    return repr(value)[:60] if value is not None else "an empty file"
