"""The file format of a saved front: strict JSON, read without running anything.

A file holds the schema's name and version, the criteria, and the points one by one, so that a person can read
it. Numbers are written in the shortest decimal form that reads back as the same float64. Writing is atomic:
the file appears whole or not at all. Reading checks every key, type and shape, and refuses what it does not
know.
"""

from __future__ import annotations

import errno
import json
import math
import os
from pathlib import Path
from typing import Any, NoReturn, TypedDict

from hpop.frontier.atomic import replacing
from hpop.frontier.errors import FrontFileError

SCHEMA = "hpop-front"
VERSION = 1
SIZE_LIMIT = 512 * 1024**2  # bytes

_TOP = {
    "schema": str,
    "version": int,
    "status": str,
    "certificate": str,
    "criteria": list,
    "reported": list,
    "problem": (dict, type(None)),
    "runs": list,
    "points": list,
}
_CRITERION = {"name": str, "unit": str, "group": str, "quantum": (int, float)}
_REPORTED = {"name": str, "unit": str}
_POINT = {"costs": list, "reported": list, "provenance": dict, "item": object}


class StoredFront(TypedDict):
    """The contents of a file, named as the fields of a front; items are still encoded."""

    costs: list[list[float]]
    items: list[Any]
    names: list[str]
    units: list[str]
    quanta: list[float]
    groups: list[str]
    reported: list[list[float]]
    reported_names: list[str]
    reported_units: list[str]
    status: str
    certificate: str
    provenance: list[dict[str, Any]]
    problem: dict[str, Any] | None
    runs: list[dict[str, Any]]


def write(path: str | os.PathLike[str], stored: StoredFront) -> None:
    """Write a front to ``path``, replacing a file that is there only once the new one is complete.

    Raises
    ------
    FrontFileError
        If an encoded item or the problem is not JSON, or the file would be larger than :func:`read` accepts.
    OSError
        If the folder cannot be written.
    """
    target = checked_path(path)
    try:
        document = json.dumps(_document(stored), allow_nan=False, ensure_ascii=False, indent=1)
        data = document.encode(errors="backslashreplace")  # half a surrogate, as in a name of a file that is no UTF-8
        _parse(data)
    except (TypeError, ValueError, RecursionError) as error:
        raise FrontFileError(
            f"{target}: the front cannot be written as JSON ({error}); "
            "pass encode= to turn each item into lists, dicts, strings and finite numbers"
        ) from error
    if len(data) > SIZE_LIMIT:
        raise FrontFileError(
            f"{target}: the file would be {len(data)} bytes, above the limit of {SIZE_LIMIT}; "
            "let encode= write less of each item, or save fewer points"
        )
    if not target.parent.exists():
        raise FileNotFoundError(
            errno.ENOENT, "the folder for the front is not there; make it first", str(target.parent)
        )
    with replacing(target) as file:
        file.write(data)


def read(path: str | os.PathLike[str]) -> StoredFront:
    """Read what :func:`write` wrote, and check it key by key.

    Raises
    ------
    FrontFileError
        If the file is larger than 512 MB, is not strict JSON (duplicate keys and NaN are refused), or is not
        a front of this version. The message names the file, what was expected, and what was found.
    OSError
        If the file cannot be opened.
    """
    source = checked_path(path)
    with source.open("rb") as file:
        data = file.read(SIZE_LIMIT + 1)
    if len(data) > SIZE_LIMIT:
        _refuse(source, f"a file of at most {SIZE_LIMIT} bytes", "a larger one", "save fewer points")
    try:
        top = _parse(data)
    except RecursionError:
        _refuse(source, "JSON", "brackets nested too deeply", "save the front again")
    except ValueError as error:
        _refuse(source, "JSON", str(error), "save the front again")
    if not isinstance(top, dict) or top.get("schema") != SCHEMA:
        found = f"schema {top.get('schema')!r}" if isinstance(top, dict) else f"a JSON {type(top).__name__}"
        _refuse(source, f'an object with "schema": "{SCHEMA}"', found, "name a file that Front.save wrote")
    version = top.get("version")
    if version != VERSION:
        newer = type(version) is int and version > VERSION
        advice = "update the library that reads it" if newer else "save the front again"
        _refuse(source, f"version {VERSION}", f"version {version!r}", advice)
    _check_keys(source, "the file", top, _TOP)
    for number, run in enumerate(top["runs"]):
        if not isinstance(run, dict):
            _refuse(source, f"runs[{number}] to be an object", type(run).__name__, "save the front again")
    for part, keys in (("criteria", _CRITERION), ("reported", _REPORTED), ("points", _POINT)):
        for number, entry in enumerate(top[part]):
            _check_keys(source, f"{part}[{number}]", entry, keys)
    criteria, reported, points = top["criteria"], top["reported"], top["points"]
    return StoredFront(
        costs=[_numbers(source, f"points[{i}].costs", p["costs"], len(criteria)) for i, p in enumerate(points)],
        items=[p["item"] for p in points],
        names=[c["name"] for c in criteria],
        units=[c["unit"] for c in criteria],
        quanta=_numbers(source, "quantum", [c["quantum"] for c in criteria], len(criteria)),
        groups=[c["group"] for c in criteria],
        reported=[
            _numbers(source, f"points[{i}].reported", p["reported"], len(reported)) for i, p in enumerate(points)
        ],
        reported_names=[r["name"] for r in reported],
        reported_units=[r["unit"] for r in reported],
        status=top["status"],
        certificate=top["certificate"],
        provenance=[p["provenance"] for p in points],
        problem=top["problem"],
        runs=top["runs"],
    )


def checked_path(path: object) -> Path:
    """Return a path, or refuse what is none."""
    if not isinstance(path, str | os.PathLike):
        raise FrontFileError(f"expected the path of a front's file, such as 'front.json', got {path!r:.80}")
    return Path(path)


def _parse(data: bytes) -> Any:
    """Parse strict JSON: UTF-8, no key twice in an object, no NaN, no infinity."""
    return json.loads(
        data.decode("utf-8"),
        object_pairs_hook=_object_without_duplicates,
        parse_float=_finite_float,
        parse_constant=_no_constant,
    )


def _document(stored: StoredFront) -> dict[str, Any]:
    """Arrange a front as the JSON object that the file holds."""
    criteria = zip(stored["names"], stored["units"], stored["groups"], stored["quanta"], strict=True)
    reported = zip(stored["reported_names"], stored["reported_units"], strict=True)
    points = zip(stored["costs"], stored["reported"], stored["provenance"], stored["items"], strict=True)
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "status": stored["status"],
        "certificate": stored["certificate"],
        "criteria": [dict(zip(_CRITERION, values, strict=True)) for values in criteria],
        "reported": [dict(zip(_REPORTED, values, strict=True)) for values in reported],
        "problem": stored["problem"],
        "runs": stored["runs"],
        "points": [dict(zip(_POINT, values, strict=True)) for values in points],
    }


def _refuse(source: Path, expected: str, found: str, advice: str) -> NoReturn:
    """Raise the error that every refusal to read has the form of."""
    raise FrontFileError(f"{source}: expected {expected}, found {found}; {advice}") from None


def _check_keys(source: Path, place: str, entry: object, keys: dict[str, Any]) -> None:
    """Check that an object has exactly these keys, with values of these types."""
    if not isinstance(entry, dict):
        _refuse(source, f"{place} to be an object", type(entry).__name__, "save the front again")
    if entry.keys() != keys.keys():
        missing, extra = sorted(keys.keys() - entry.keys()), sorted(entry.keys() - keys.keys())
        found = f"missing keys {missing}, unknown keys {extra}"
        _refuse(source, f"{place} to have the keys {list(keys)}", found, "save the front again")
    for key, kind in keys.items():
        if not isinstance(entry[key], kind) or (isinstance(entry[key], bool) and kind is not object):
            names = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
            found = f"{type(entry[key]).__name__} in {place}"
            _refuse(source, f"{key!r} to be of type {names}", found, "save the front again")


def _numbers(source: Path, place: str, values: list[Any], length: int) -> list[float]:
    """Check that a list holds ``length`` finite numbers, and return them as floats."""
    if len(values) != length:
        _refuse(source, f"{length} numbers in {place}", f"{len(values)}", "save the front again")
    for value in values:
        if type(value) is not float and (type(value) is not int or abs(value) > 2**1023):
            _refuse(source, f"float64 numbers in {place}", f"{value!r:.40}", "save the front again")
    return [float(value) for value in values]


def _object_without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Build an object, refusing one that says the same key twice."""
    result = dict(pairs)
    if len(result) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {twice!r} twice in one object")
    return result


def _finite_float(text: str) -> float:
    """Parse a number, refusing one too large for float64."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text:.40}, too large for float64")
    return value


def _no_constant(text: str) -> NoReturn:
    """Refuse NaN and Infinity, which JSON does not have."""
    raise ValueError(f"the constant {text}, which is not JSON")
