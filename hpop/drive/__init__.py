"""Driving a plan: options to change the plan on the way, changes of the world, and the event log of a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:
    from hpop.drive.execution import Execution as Execution
    from hpop.drive.moment import Moment as Moment
    from hpop.drive.options import Commit as Commit
    from hpop.drive.options import Option as Option
    from hpop.drive.options import Options as Options
    from hpop.drive.script import Event as Event
    from hpop.drive.script import Happening as Happening
    from hpop.drive.script import follow as follow
    from hpop.drive.script import load as load
    from hpop.drive.script import performed as performed
    from hpop.drive.storage import Change as Change
    from hpop.drive.wishes import Wish as Wish

_HOMES = homes_of(__name__)
__all__ = [*_HOMES]
__getattr__ = on_first_use(__name__, _HOMES)
