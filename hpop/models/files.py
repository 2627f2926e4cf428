"""Files of which a robot is made: named in a description by path and SHA-256, and found again when both have moved.

In a description a file is a record, ``{"path": ..., "sha256": [...]}``, wherever it stands; so is a folder, without
hashes. A front that is saved adds ``"relative"``, the path as seen from its own folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeGuard

from hpop.errors import ModelError
from hpop.regular_file import read_regular
from hpop.text import shown
from hpop.world.files import sha256

Record = dict[str, Any]
MOST_BYTES = 100_000_000  # of a file that is looked at


def record(path: str | os.PathLike[str], *hashes: str) -> Record:
    """How a description names a file, or without hashes a folder."""
    return {"path": os.path.abspath(path), "sha256": list(hashes)}


def is_record(value: Any) -> TypeGuard[Mapping[str, Any]]:
    """Whether a value is such a record."""
    return isinstance(value, Mapping) and {"path", "sha256"} <= value.keys() <= {"path", "sha256", "relative"}


def seen_from(folder: str, description: Any) -> Any:
    """A description whose records also say where the files are as seen from a folder."""

    def seen(one: Mapping[str, Any]) -> Record:
        try:
            return {**one, "relative": Path(os.path.relpath(one["path"], folder)).as_posix()}
        except (ValueError, TypeError):  # on another drive, or no path
            return dict(one)

    return _each_record(seen, description)


def found_from(folder: str, description: Any) -> Any:
    """The description without what :func:`seen_from` added: the files that the folder sees there are the ones meant.

    Where they have changed, and those at the whole paths have not, these are. A record of a file at neither place
    goes on saying where the folder would see it, by its whole path.
    """

    def found(one: Mapping[str, Any]) -> Record:
        plain = {key: value for key, value in one.items() if key != "relative"}
        relative = one.get("relative")
        if not isinstance(relative, str):
            return plain
        there = os.path.abspath(os.path.join(folder, relative))
        if os.path.exists(there):
            changed = not _is(there, one) and _is(str(one["path"]), one)
            return plain if changed else plain | {"path": there}
        return plain if os.path.exists(str(one["path"])) else plain | {"relative": there}

    return _each_record(found, description)


def path_of(given: Mapping[str, Any], what: str) -> Any:
    """The path of a record; ModelError that names both places of a file that a front's folder does not see either."""
    path, there = given["path"], given.get("relative")
    if there is not None and not os.path.exists(str(path)):
        raise ModelError(
            f"the {what} is neither at {shown(path, 400)}, where it was, nor at {shown(there, 400)}, where the saved "
            "front would see it if both had moved; put it back to one of them, or plan again"
        )
    return path


def _is(path: str, one: Mapping[str, Any]) -> bool:
    """Whether a file has the first of a record's hashes."""
    try:
        return not one["sha256"] or sha256(read_regular(path, MOST_BYTES)) == one["sha256"][0]
    except (OSError, TypeError, LookupError):
        return False


def without_places(description: Any) -> Any:
    """A description that does not say where its files are, if it has their hashes."""
    return _each_record(lambda one: {"sha256": one["sha256"]}, description)


def _each_record(change: Callable[[Mapping[str, Any]], Record], value: Any) -> Any:
    if is_record(value):
        return change(value)
    if isinstance(value, Mapping):
        return {key: _each_record(change, inner) for key, inner in value.items()}
    return [_each_record(change, inner) for inner in value] if isinstance(value, list) else value
