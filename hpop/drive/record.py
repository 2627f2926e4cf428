"""A drive told again from its record. Told the same it is the same.

A search that a deadline cut short would not be: what it found is in the record, and is told again as well.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from shapely.errors import ShapelyError
from shapely.geometry import shape

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.drive.execution import Execution
from hpop.drive.storage import read
from hpop.errors import DriveError, HpopError
from hpop.planners.base import make_planner
from hpop.problems.problem import Problem
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.people import person_from


@checked_arguments
def load(path: str | os.PathLike[str]) -> Execution:
    """The drive that :meth:`hpop.drive.Execution.save` wrote, told again all that it was told.

    Raises DriveError for a file that is none of a drive, OSError for one that cannot be read.
    """
    stored = read(path)
    try:
        problem = Problem.from_description(stored["problem"])
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
        raise DriveError(f"{path}: {error!s:.600}") from error
    except (TypeError, ValueError, OverflowError, LookupError, AttributeError, ShapelyError) as error:
        raise DriveError(f"{path}: not the record of a drive: {shown(error)}; save the drive again") from None
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
        drive.world(now, people=[person_from(person) for person in event["people"]], groups=event["groups"])
    elif kind == "stop":
        drive.world(now, stop=event["person"])
    else:
        raise DriveError(f"a drive has no event {shown(kind)}")
