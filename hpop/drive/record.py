"""The record of a drive as a file: what was asked, the plans that were known, what was told. Told again it is the same.

A search that a deadline cut short would not be: what it found is in the record, and is told again as well.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from shapely.errors import ShapelyError
from shapely.geometry import shape

from hpop.drive.execution import Execution
from hpop.errors import DriveError, HpopError
from hpop.front import found_from_file, seen_from_file
from hpop.frontier.atomic import replacing
from hpop.frontier.storage import checked_path
from hpop.frontier.strict_json import parse, pieces, plain
from hpop.motion_table import MotionTable
from hpop.planners.base import Planner, make_planner
from hpop.problem import Problem
from hpop.regular_file import read_regular
from hpop.text import shown
from hpop.trajectory import Trajectory
from hpop.world.people import person_from

SCHEMA, VERSION = "hpop-drive", 1
SIZE_LIMIT = 512 * 1024**2  # bytes
LEFT_OUT = ("checkpoint",)  # of a planner's options: a file of another search
KEYS = {"schema", "version", "problem", "planner", "begin", "patience", "notice", "ways", "choice", "events"}


def save(drive: Execution, path: str | os.PathLike[str]) -> None:
    """Write a drive to a JSON file, whole or not at all, from which :func:`load` makes the same drive.

    Raises OSError where it cannot be written.
    """
    ways = [drive.choice, *drive.ways]
    stored = {
        "schema": SCHEMA,
        "version": VERSION,
        "problem": seen_from_file(path, plain(drive.problem.describe())),
        "planner": _described(drive.planner),
        "begin": drive.begin,
        "patience": drive.patience,
        "notice": drive.notice,
        "ways": MotionTable.of(ways).describe(),
        "choice": 0,
        "events": plain(drive.record),
    }
    with replacing(checked_path(path)) as file:
        for piece in pieces(stored):
            file.write(piece.encode(errors="backslashreplace"))


def load(path: str | os.PathLike[str]) -> Execution:
    """The drive that :func:`save` wrote, told again all that it was told.

    Raises DriveError for a file that is none of a drive, OSError for one that cannot be read.
    """
    source = checked_path(path)
    try:
        stored = parse(read_regular(source, SIZE_LIMIT))
    except (ValueError, RecursionError) as error:
        raise DriveError(
            f"{source}: expected the JSON of a drive, found {error!s:.200}; save the drive again"
        ) from None
    if not isinstance(stored, dict) or stored.get("schema") != SCHEMA or set(stored) != KEYS:
        raise DriveError(f"{source}: expected a drive, as drive.save writes it, found something else")
    if stored["version"] != VERSION:
        raise DriveError(f"{source}: expected version {VERSION} of a drive, found {shown(stored['version'])}")
    try:
        problem = Problem.from_description(found_from_file(source, stored["problem"]))
        choice, *ways = MotionTable.from_description(problem.model, stored["ways"]).trajectories()
        drive = Execution(
            problem,
            ways,
            choice,
            make_planner(stored["planner"]),
            begin=stored["begin"],
            patience=stored["patience"],
            notice=stored["notice"],
        )
        for event in stored["events"]:
            tell(drive, event)
    except HpopError as error:
        raise DriveError(f"{source}: {error!s:.600}") from error
    except (TypeError, ValueError, LookupError, AttributeError, ShapelyError) as error:
        raise DriveError(f"{source}: not the record of a drive: {shown(error)}; save the drive again") from None
    return drive


def tell(drive: Execution, event: Mapping[str, Any]) -> None:
    """Tell a drive one event of a record; raises DriveError for one that makes no sense."""
    kind, now = event["event"], event["now"]
    if kind == "seen":
        drive.at(now, event["state"])
    elif kind == "options":
        drive.options_again(now, event["deadline"], event["answer"])
    elif kind == "wish":
        drive.wish(event["wish"], **event["shares"])
    elif kind == "take":
        rest = event["rest"]
        way = None if rest is None else Trajectory.from_description(drive.problem.model, rest)
        drive.take_again(event, way)
    elif kind in ("close", "open"):
        area = event["area"]
        told: dict[str, Any] = {kind: area if isinstance(area, str) else shape(area)}
        drive.world(now, **told, name=event["name"])
    elif kind == "people":
        drive.world(now, people=[person_from(person) for person in event["people"]])
    elif kind == "stop":
        drive.world(now, stop=event["person"])
    else:
        raise DriveError(f"a drive has no event {shown(kind)}")


def _described(planner: Planner) -> dict[str, dict[str, Any]]:
    """A planner as JSON, from which :func:`hpop.planners.base.make_planner` makes it again."""
    known = [field for field in fields(planner) if field.name not in LEFT_OUT]  # type: ignore[arg-type]
    given = {field.name: getattr(planner, field.name) for field in known}
    changed = {field.name: given[field.name] for field in known if given[field.name] != field.default}
    return {planner.name: plain(changed)}
