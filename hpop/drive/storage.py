"""A drive as a file: what was asked, the plans that were known, and what was told."""

from __future__ import annotations

import os
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from hpop.base.files import read_regular, replacing
from hpop.base.text import shown
from hpop.errors import DriveError
from hpop.frontier.storage import checked_path
from hpop.frontier.strict_json import parse, pieces, plain
from hpop.planners.base import Planner
from hpop.problems.front import found_from_file, seen_from_file
from hpop.trajectories.motion_table import MotionTable

if TYPE_CHECKING:
    from hpop.drive.execution import Execution

SCHEMA, VERSION = "hpop-drive", 1
SIZE_LIMIT = 512 * 1024**2  # bytes
LEFT_OUT = ("checkpoint",)  # of a planner's options: a file of another search
KEYS = {"schema", "version", "problem", "planner", "begin", "patience", "notice", "ways", "events"}


def write(drive: Execution, path: str | os.PathLike[str]) -> None:
    """Write a drive to a JSON file, whole or not at all; raises OSError where it cannot be written."""
    stored = {
        "schema": SCHEMA,
        "version": VERSION,
        "problem": seen_from_file(path, plain(drive.problem.describe())),
        "planner": _described(drive.planner),
        "begin": drive.begin,
        "patience": drive.patience,
        "notice": drive.notice,
        "ways": MotionTable.of([drive.choice, *drive.ways]).describe(),  # the plan that was chosen is the first
        "events": drive.record,
    }
    with replacing(checked_path(path)) as file:
        for piece in pieces(stored):
            file.write(piece.encode(errors="backslashreplace"))


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What :func:`write` wrote, with the problem's files as they are found from the folder of this one.

    Raises DriveError for a file that is none of a drive, OSError for one that cannot be read.
    """
    source = checked_path(path)
    try:
        stored = parse(read_regular(source, SIZE_LIMIT))
    except (ValueError, RecursionError) as error:
        raise DriveError(f"{source}: expected the JSON of a drive, found {error!s:.200}; save it again") from None
    if not isinstance(stored, dict) or stored.get("schema") != SCHEMA or set(stored) != KEYS:
        raise DriveError(f"{source}: expected a drive, as drive.save writes it, found something else")
    if stored["version"] != VERSION:
        raise DriveError(f"{source}: expected version {VERSION} of a drive, found {shown(stored['version'])}")
    if not isinstance(stored["problem"], dict):
        raise DriveError(f"{source}: expected the problem of a drive, found {shown(stored['problem'])}")
    return {**stored, "problem": found_from_file(source, stored["problem"])}


def _described(planner: Planner) -> dict[str, dict[str, Any]]:
    """A planner as JSON, from which :func:`hpop.planners.base.make_planner` makes it again."""
    known = [field for field in fields(planner) if field.name not in LEFT_OUT]  # type: ignore[arg-type]
    given = {field.name: getattr(planner, field.name) for field in known}
    changed = {field.name: given[field.name] for field in known if given[field.name] != field.default}
    return {planner.name: plain(changed)}
