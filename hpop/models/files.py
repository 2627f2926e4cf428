"""Files of a robot, identified in a description by path and SHA-256, and found again after both have moved.

In a description a file is a record, ``{"path": ..., "sha256": [...]}``; a folder is a record without hashes. In a saved
front the path is relative to the front's folder, marked by ``"relative"``.
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
    """Return the record of a file in a description, or of a folder, without hashes."""
    return {"path": os.path.abspath(path), "sha256": list(hashes)}


def is_record(value: Any) -> TypeGuard[Mapping[str, Any]]:
    """Return whether a value is such a record."""
    return isinstance(value, Mapping) and {"path", "sha256"} <= value.keys() <= {"path", "sha256", "relative"}


def seen_from(folder: str, description: Any) -> Any:
    """Return a description with paths of files that are also relative to a folder."""

    def seen(one: Mapping[str, Any]) -> Record:
        path = one["path"]
        if not isinstance(path, str):  # malformed
            return dict(one)
        place = place_seen_from(folder, path)
        return {**one, "path": place, "relative": place}

    return _each_record(seen, description)


def found_from(folder: str, description: Any) -> Any:
    """Return the description with whole paths of files found from a folder, without marks of :func:`seen_from`.

    If a relative path leads nowhere, a file of the same name in the folder is taken. Records of earlier versions have
    whole paths as well: if the relative file has changed, and that at the whole path has not, the latter is taken. The
    record of a file that is nowhere keeps its relative path.
    """

    def found(one: Mapping[str, Any]) -> Record:
        plain = {key: value for key, value in one.items() if key != "relative"}
        relative, path = one.get("relative"), str(one["path"])
        if not isinstance(relative, str):
            return plain
        there, beside = places_found_from(folder, relative)
        first = path if os.path.isabs(path) else there
        if os.path.exists(there):
            changed = not _is(there, one) and _is(first, one)
            return plain | {"path": first if changed else there}
        near = next(filter(os.path.exists, (first, beside)), None)
        return plain | ({"path": first, "relative": there} if near is None else {"path": near})

    return _each_record(found, description)


def path_of(given: Mapping[str, Any], what: str) -> Any:
    """Return the path of a record; ModelError with both places of a file that cannot be found."""
    path, there = given["path"], given.get("relative")
    if there is not None and not os.path.exists(str(path)):
        once = f"neither at {shown(path, 400)}, where it was, nor" if path != there else "not"
        raise ModelError(
            f"the {what} is {once} at {shown(there, 400)}, where the saved front sees it; put it there, or beside the "
            "front under the same name, or plan again"
        )
    return path


def _is(path: str, one: Mapping[str, Any]) -> bool:
    """Return whether a file has the first of a record's hashes."""
    try:
        return not one["sha256"] or sha256(read_regular(path, MOST_BYTES)) == one["sha256"][0]
    except (OSError, TypeError, LookupError):
        return False


def without_places(description: Any) -> Any:
    """Return a description without paths of files that have hashes."""
    return _each_record(lambda one: {"sha256": one["sha256"]}, description)


def _each_record(change: Callable[[Mapping[str, Any]], Record], value: Any) -> Any:
    if is_record(value):
        return change(value)
    if isinstance(value, Mapping):
        return {key: _each_record(change, inner) for key, inner in value.items()}
    return [_each_record(change, inner) for inner in value] if isinstance(value, list) else value
