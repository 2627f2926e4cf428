"""Saved fronts and tables: strict JSON files, pandas tables, and xarray datasets.

A file has the name and version of its schema, the criteria, and tables with named columns, so that people and programs
in any language can read it. The tables have costs, reported values, the origin of each point, and the encoded items,
one by one or all together. Writing is atomic: the file is complete or absent. Reading runs no code, checks every key,
type and shape, and raises an error for unknown keys.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypedDict, cast

import numpy as np

from hpop.base.files import read_regular, replacing
from hpop.base.lazy import library
from hpop.base.text import shown
from hpop.frontier.dominance import FloatArray
from hpop.frontier.points import FrontFileError
from hpop.frontier.strict_json import Kinds, numbers, parse, parts, pieces, row_numbers

if TYPE_CHECKING:
    import pandas
    import xarray

    from hpop.frontier.front import ItemFront

SCHEMA = "hpop-front"
VERSION = 2
SIZE_LIMIT = 512 * 1024**2  # bytes

_AGAIN = "save the front again"
_TOP: Kinds = {
    "schema": str,
    "version": int,
    "status": str,
    "certificate": str,
    "criteria": list,
    "reported": list,
    "problem": (dict, type(None)),
    "runs": list,
    "points": dict,
    "items": (list, dict),
}
_CRITERION: Kinds = {"name": str, "unit": str, "group": str, "quantum": (float, int)}
_REPORTED: Kinds = {"name": str, "unit": str}
_POINTS: Kinds = {"count": int, "costs": dict, "reported": dict, "origins": list, "origin": list}
ORIGIN = "provenance."


class StoredFront(TypedDict):
    """Contents of a front's file, named as the fields of a front; items are encoded in a list, or all in a dict."""

    costs: FloatArray
    items: list[Any] | dict[str, Any]
    names: Sequence[str]
    units: Sequence[str]
    quanta: FloatArray
    groups: Sequence[str]
    reported: FloatArray
    reported_names: Sequence[str]
    reported_units: Sequence[str]
    status: str
    certificate: str
    provenance: Sequence[dict[str, Any]]
    problem: dict[str, Any] | None
    runs: Sequence[dict[str, Any]]


def write(path: str | os.PathLike[str], stored: StoredFront) -> None:
    """Write a front to ``path``; an existing file is replaced only once the new one is complete.

    Raises
    ------
    FrontFileError
        If an encoded item or the problem is not JSON, or the file would be larger than :func:`read` accepts.
    OSError
        If the folder cannot be written.
    """
    target = checked_path(path)
    if not target.parent.exists():
        raise FileNotFoundError(
            errno.ENOENT, "the folder for the front's file does not exist; make it first", str(target.parent)
        )
    size = 0
    try:
        with replacing(target) as file:
            for piece in pieces(_document(stored)):
                # Half of a surrogate pair, as in the name of a file that is not UTF-8, is escaped.
                size += file.write(piece.encode(errors="backslashreplace"))
                if size > SIZE_LIMIT:
                    raise FrontFileError(
                        f"{target}: the file must be at most {SIZE_LIMIT} bytes, but would be larger; let encode= "
                        "write less of each item, or save fewer points"
                    )
    except FrontFileError:
        raise
    except (TypeError, ValueError, RecursionError) as error:
        raise FrontFileError(
            f"{target}: the front cannot be written as JSON ({error}); "
            "pass encode= to turn the item of each point into lists, dicts, strings and finite numbers"
        ) from error


def read(path: str | os.PathLike[str]) -> StoredFront:
    """Read a front's file that :func:`write` wrote, and check all its keys.

    Raises
    ------
    FrontFileError
        If the file is larger than 512 MB, is not strict JSON (duplicate keys and NaN are refused), or is not
        a front of a known version. The message names the file, what was expected, and what was found.
    OSError
        If the file cannot be opened, or is no regular file.
    """
    source = checked_path(path)
    try:
        data = read_regular(source, SIZE_LIMIT)
    except OSError as error:
        if error.errno != errno.EFBIG:
            raise
        _refuse(source, f"a file of at most {SIZE_LIMIT} bytes", "a larger one", "save fewer points")
    try:
        top = parse(data)
    except RecursionError:
        _refuse(source, "JSON", "brackets nested too deeply", _AGAIN)
    except ValueError as error:
        _refuse(source, "JSON", str(error), _AGAIN)
    if not isinstance(top, dict) or top.get("schema") != SCHEMA:
        found = f"schema {top.get('schema')!r:.40}" if isinstance(top, dict) else f"a JSON {type(top).__name__}"
        _refuse(source, f'an object with "schema": "{SCHEMA}"', found, "name a file that Front.save wrote")
    version = top.get("version")
    if type(version) is not int or version != VERSION:
        newer = type(version) is int and version > VERSION
        advice = "update the library that reads it" if newer else _AGAIN
        _refuse(source, f"version {VERSION}", f"version {version!r:.40}", advice)
    try:
        return _stored(top)
    except ValueError as error:
        raise FrontFileError(f"{source}: {error!s:.600}; {_AGAIN}") from None  # names in a file may be long


def checked_path(path: object) -> Path:
    """Check that a value is a path and return it as a Path; FrontFileError for anything else."""
    if not isinstance(path, str | os.PathLike):
        raise FrontFileError(
            f"path must be a string or a path object that names a file, such as 'front.json', got {shown(path)}"
        )
    return Path(path)


def _document(stored: StoredFront) -> dict[str, Any]:
    """Return the JSON object to be written to a front's file."""
    rows: dict[str, int] = {}
    origins = [rows.setdefault(text, len(rows)) for text in _texts(stored["provenance"])]
    criteria = zip(stored["names"], stored["units"], stored["groups"], stored["quanta"].tolist(), strict=True)
    reported = zip(stored["reported_names"], stored["reported_units"], strict=True)
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "status": stored["status"],
        "certificate": stored["certificate"],
        "criteria": [dict(zip(_CRITERION, values, strict=True)) for values in criteria],
        "reported": [dict(zip(_REPORTED, values, strict=True)) for values in reported],
        "problem": stored["problem"],
        "runs": list(stored["runs"]),
        "points": {
            "count": len(origins),
            "costs": dict(zip(stored["names"], stored["costs"].T.tolist(), strict=True)),
            "reported": dict(zip(stored["reported_names"], stored["reported"].T.tolist(), strict=True)),
            "origins": list(map(json.loads, rows)),
            "origin": origins,
        },
        "items": stored["items"],
    }


def _texts(provenance: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the JSON text of each provenance entry; an object that occurs several times is encoded once."""
    text_of: dict[int, str] = {}
    for origin in provenance:
        text = text_of.get(id(origin))
        if text is None:
            text = text_of[id(origin)] = json.dumps(origin, sort_keys=True)
        yield text


def _stored(top: dict[str, Any]) -> StoredFront:
    """Return the contents of a front's file from its JSON object; ValueError if they are invalid."""
    parts(top, "the file", _TOP)
    criteria = [parts(entry, f"criteria[{i}]", _CRITERION) for i, entry in enumerate(top["criteria"])]
    reported = [parts(entry, f"reported[{i}]", _REPORTED) for i, entry in enumerate(top["reported"])]
    names, units, groups, quanta = ([entry[i] for entry in criteria] for i in range(4))
    for i, run in enumerate(top["runs"]):
        if type(run) is not dict:
            raise ValueError(f"expected runs[{i}] to be an object, found {type(run).__name__}")
    reported_names = [name for name, _ in reported]
    points = _points(top, names, reported_names)
    stored: dict[str, Any] = {
        "names": names,
        "units": units,
        "groups": groups,
        "quanta": numbers(quanta, "quantum", len(criteria)),
        "reported_names": reported_names,
        "reported_units": [unit for _, unit in reported],
        "status": top["status"],
        "certificate": top["certificate"],
        "problem": top["problem"],
        "runs": top["runs"],
    }
    return cast(StoredFront, stored | points)


def _points(top: dict[str, Any], names: list[str], reported_names: list[str]) -> dict[str, Any]:
    """Return costs, reported values, provenance and items of all points from the JSON object of a front's file."""
    count, *tables, origins, origin = parts(top["points"], "points", _POINTS)
    for key, column in (("origin", origin), ("items", top["items"])):
        if isinstance(column, list) and len(column) != count:
            raise ValueError(f"expected {count} entries in {key}, one for each point, found {len(column)}")
    for i, entry in enumerate(origins):
        if type(entry) is not dict:
            raise ValueError(f"expected origins[{i}] to be an object, found {type(entry).__name__}")
    matrices = []
    for key, table, columns in zip(("costs", "reported"), tables, (names, reported_names), strict=True):
        kinds: Kinds = dict.fromkeys(columns, list)
        lists = dict(zip(kinds, parts(table, key, kinds), strict=True))
        matrix = [numbers(lists[name], f"{key}.{name}", count) for name in columns]
        matrices.append(np.array(matrix, dtype=np.float64).reshape(len(columns), count).T)
    return {
        "costs": matrices[0],
        "reported": matrices[1],
        "provenance": [origins[i] for i in row_numbers(origin, "origin", count, len(origins)).tolist()],
        "items": top["items"],
    }


def _refuse(source: Path, expected: str, found: str, advice: str) -> NoReturn:
    """Raise FrontFileError for the file ``source``: what was expected, what was found, and what to do."""
    raise FrontFileError(f"{source}: expected {expected}, found {found:.200}; {advice}") from None


def dataframe(front: ItemFront[Any]) -> pandas.DataFrame:
    """Return a front as a pandas table with one row for each point.

    Its columns are the costs, the reported values, and the keys of the provenance.
    """
    frame = library("pandas", "to_dataframe()").DataFrame(_columns(front), index=_index(front))
    frame.index.name = "point"
    frame.attrs.update(units=_units(front), **_claims(front))
    return frame


def dataset(front: ItemFront[Any]) -> xarray.Dataset:
    """Return a front as an xarray dataset: a variable for each column, along the dimension "point", with its unit."""
    units = _units(front)
    variables = {
        name: ("point", values, {"units": units[name]} if name in units else {})
        for name, values in _columns(front).items()
    }
    return library("xarray", "to_xarray()").Dataset(variables, {"point": _index(front)}, _claims(front))


def _columns(front: ItemFront[Any]) -> dict[str, Any]:
    """Return the columns (n,) of a front by name: costs, reported values, and one for each key of the provenance."""
    columns: dict[str, Any] = dict(zip(front.names, front.costs.T, strict=True))
    columns |= zip(front.reported_names, front.reported.T, strict=True)
    for key in dict.fromkeys(key for origin in front.provenance for key in origin):
        values = np.empty(len(front), dtype=object)
        for row, origin in enumerate(front.provenance):
            values[row] = origin.get(key)
        columns[ORIGIN + key] = values
    return columns


def _index(front: ItemFront[Any]) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.arange(len(front))


def _units(front: ItemFront[Any]) -> dict[str, str]:
    return dict(zip(front.names + front.reported_names, front.units + front.reported_units, strict=True))


def _claims(front: ItemFront[Any]) -> dict[str, str]:
    return {"status": front.status, "certificate": front.certificate}
