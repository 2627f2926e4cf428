"""References from a saved front to the files of a robot model, such as a URDF, which still work after a move.

A model's description (its parameters for JSON) names a file by a record, ``{"path": ..., "sha256": [...]}``. The hash
identifies the file wherever it lies. The record of a folder has no hashes. In a saved front, records also have
``"relative"``: the path relative to the front's folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any, TypeGuard

from hpop.base.files import read_regular
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.world.files import place_seen_from, places_found_from, sha256

Record = dict[str, Any]
MOST_BYTES = 100_000_000  # largest file that is hashed


def record(path: str | os.PathLike[str], *hashes: str) -> Record:
    """Return the record of a file, with its absolute path and SHA-256 hashes; a folder's record has no hashes."""
    return {"path": os.path.abspath(path), "sha256": list(hashes)}


def is_record(value: Any) -> TypeGuard[Mapping[str, Any]]:
    """Return whether a value of a description is a record of a file or folder."""
    return isinstance(value, Mapping) and {"path", "sha256"} <= value.keys() <= {"path", "sha256", "relative"}


def with_relative_paths(folder: str, description: Any) -> Any:
    """Return a copy of a description in which all records of files have paths relative to ``folder``."""

    def seen(one: Mapping[str, Any]) -> Record:
        path = one["path"]
        if not isinstance(path, str):  # malformed
            return dict(one)
        place = place_seen_from(folder, path)
        return {**one, "path": place, "relative": place}

    return _map_records(seen, description)


def with_absolute_paths(folder: str, description: Any) -> Any:
    """Return a copy of a description with absolute paths of files, the inverse of :func:`with_relative_paths`.

    Relative paths start at ``folder``. If there is no file at a relative path, a file of the same name in the folder is
    used. Records of earlier versions also have absolute paths: if the file at the relative path has changed and the one
    at the absolute path has not, the latter is used. The record of a missing file keeps its relative path.
    """

    def found(one: Mapping[str, Any]) -> Record:
        plain = {key: value for key, value in one.items() if key != "relative"}
        relative, path = one.get("relative"), str(one["path"])
        if not isinstance(relative, str):
            return plain
        there, beside = places_found_from(folder, relative)
        first = path if os.path.isabs(path) else there
        if os.path.exists(there):
            changed = not _has_hash(there, one) and _has_hash(first, one)
            return plain | {"path": first if changed else there}
        near = next(filter(os.path.exists, (first, beside)), None)
        return plain | ({"path": first, "relative": there} if near is None else {"path": near})

    return _map_records(found, description)


def path_of(given: Mapping[str, Any], what: str) -> Any:
    """Return the path in a file's record; raise ModelError if the file of a saved front is missing.

    given  the record
    what   name of the file in the message: "URDF"
    """
    path, there = given["path"], given.get("relative")
    if there is not None and not os.path.exists(str(path)):
        once = f"neither at {shown(path, 400)}, where it was, nor" if path != there else "not"
        raise ModelError(
            f"the {what} is {once} at {shown(there, 400)}, where the saved front expects it; put it there, or into the "
            "folder of the front under the same name, or plan again"
        )
    return path


def _has_hash(path: str, one: Mapping[str, Any]) -> bool:
    """Return whether the file at a path has the first of a record's hashes; True for a record without hashes."""
    try:
        return not one["sha256"] or sha256(read_regular(path, MOST_BYTES)) == one["sha256"][0]
    except (OSError, TypeError, LookupError):
        return False


def without_paths(description: Any) -> Any:
    """Return a copy of a description in which records of files have hashes only, to compare descriptions."""
    return _map_records(lambda one: {"sha256": one["sha256"]}, description)


def _map_records(change: Callable[[Mapping[str, Any]], Record], value: Any) -> Any:
    """Return a copy of a description in which ``change`` has been applied to every record of a file or folder."""
    if is_record(value):
        return change(value)
    if isinstance(value, Mapping):
        return {key: _map_records(change, inner) for key, inner in value.items()}
    return [_map_records(change, inner) for inner in value] if isinstance(value, list) else value
