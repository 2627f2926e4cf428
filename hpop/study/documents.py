"""JSON files of a study: strict, of bounded size, each with its schema and version; StudyError for anything else."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from hpop.base.files import read_regular, replacing
from hpop.base.text import printable, shown
from hpop.errors import StudyError
from hpop.frontier.strict_json import parse, pieces

MOST_FAULTS = 3
"""Faults of a file that are told one by one."""


class Part(BaseModel):
    """An object of a file: its keys and no others, each of its type."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


T = TypeVar("T", bound=Part)


def read(path: str | os.PathLike[str], kind: type[T], what: str, most: int) -> T:
    """The contents of a file of at most ``most`` bytes, checked; ``what`` it is to be, in words."""
    return checked(path, parsed(path, read_bytes(path, most), what), kind, what)


def read_bytes(path: str | os.PathLike[str], most: int) -> bytes:
    """The bytes of a regular file, at most ``most``."""
    try:
        return read_regular(path, most)
    except OSError as error:
        raise StudyError(f"cannot read {path}: {error.strerror or error}") from None


def parsed(place: object, data: bytes, what: str) -> Any:
    """What JSON says, not yet checked; ``place`` is named in the error."""
    try:
        return parse(data)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{place}: expected {what} as JSON, found {printable(error):.200}") from None


def checked(place: object, values: Any, kind: type[T], what: str) -> T:
    """Values as an object of a kind; ``place`` is named in the error: a file, or an event of it."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise StudyError(f"{place}: expected {what}, found {in_words(error)}") from None


def in_words(error: ValidationError) -> str:
    """The first faults that pydantic found, and how many more there are."""
    faults = error.errors(include_url=False, include_context=False)
    said = "; ".join(_said(dict(fault)) for fault in faults[:MOST_FAULTS])
    return said + (f"; and {len(faults) - MOST_FAULTS:,} more" if len(faults) > MOST_FAULTS else "")


def write(path: str | os.PathLike[str], values: Any) -> None:
    """Write a JSON file, whole or not at all."""
    write_bytes(path, ("".join(pieces(values)) + "\n").encode())


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file, whole or not at all; StudyError where that cannot be."""
    try:
        with replacing(Path(path)) as file:
            file.write(data)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror or error}") from None


def _said(fault: dict[str, Any]) -> str:
    """A fault that pydantic found: where, what was expected, what came."""
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{printable(part)}" for part in fault["loc"])
    came = "" if fault["type"] == "missing" else f", got {shown(fault['input'], 40)}"
    return f"at {where.lstrip('.') or 'the top'}: {fault['msg']}{came}"
