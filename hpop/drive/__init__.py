"""Execution: a plan that is driven, options on the way, and the record of a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.drive.execution import Change, Execution
    from hpop.drive.moment import Moment
    from hpop.drive.options import Commit, Option, Options
    from hpop.drive.record import load
    from hpop.drive.start import follow
    from hpop.drive.wishes import Wish

__all__ = ["Change", "Commit", "Execution", "Moment", "Option", "Options", "Wish", "follow", "load"]

_HOMES = {
    "Change": "hpop.drive.execution",
    "Commit": "hpop.drive.options",
    "Execution": "hpop.drive.execution",
    "Moment": "hpop.drive.moment",
    "Option": "hpop.drive.options",
    "Options": "hpop.drive.options",
    "Wish": "hpop.drive.wishes",
    "follow": "hpop.drive.start",
    "load": "hpop.drive.record",
}

__getattr__ = on_first_use(__name__, _HOMES)
