"""Execution: a plan that is driven, options on the way, and the record of a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.drive.change import Change
    from hpop.drive.execution import Execution
    from hpop.drive.moment import Moment
    from hpop.drive.options import Commit, Option, Options
    from hpop.drive.record import load
    from hpop.drive.script import Event, Happening, performed
    from hpop.drive.start import follow
    from hpop.drive.wishes import Wish

__all__ = [
    "Change",
    "Commit",
    "Event",
    "Execution",
    "Happening",
    "Moment",
    "Option",
    "Options",
    "Wish",
    "follow",
    "load",
    "performed",
]

_HOMES = {
    "Change": "hpop.drive.change",
    "Commit": "hpop.drive.options",
    "Event": "hpop.drive.script",
    "Execution": "hpop.drive.execution",
    "Happening": "hpop.drive.script",
    "Moment": "hpop.drive.moment",
    "Option": "hpop.drive.options",
    "Options": "hpop.drive.options",
    "Wish": "hpop.drive.wishes",
    "follow": "hpop.drive.start",
    "load": "hpop.drive.record",
    "performed": "hpop.drive.script",
}

__getattr__ = on_first_use(__name__, _HOMES)
