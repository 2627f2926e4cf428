"""When a planner of many programs has to stop: solvers, fields and jobs in other processes all look at one time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from hpop.runtime.limits import LimitPassed

BUILDING = "a program was built"
SOLVING = "a program was solved"
STOPPED = "User_Requested_Stop"  # IPOPT's word
CUT_SHORT = "cut short"  # what jobs count that did not end by themselves


@dataclass(frozen=True)
class Deadline:
    """A moment on the clock of :func:`time.time`, which processes share; None is never.

    It is one of the limits of :mod:`hpop.world.limits`: fields that are made under it end with it.
    """

    at: float | None = None

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """So many seconds from now."""
        return cls(None if seconds is None else time.time() + seconds)

    @property
    def is_past(self) -> bool:
        """Whether it is over."""
        return self.at is not None and time.time() >= self.at

    def check(self, doing: str, memory: int = 0, *, ahead: float = 0.0) -> None:
        """Raise LimitPassed where it is over, or would be ``ahead`` seconds from now: of what nothing interrupts."""
        if self.at is not None and time.time() + ahead >= self.at:
            raise LimitPassed(f"the time was over while {doing}")

    def hold(self, memory: int, doing: str) -> None:
        """Look at the time; memory is not counted."""
        self.check(doing)

    def check_solver(self, status: str) -> None:
        """Raise LimitPassed where a solver ended with a status that says that it was stopped, or the time is over."""
        if status == STOPPED:
            raise LimitPassed(f"the time was over while {SOLVING}")
        self.check(SOLVING)

    def stopping(self, variables: int, constraints: int) -> dict[str, Any]:
        """Options of a CasADi solver of programs of this size, so that IPOPT ends with the iteration at work."""
        if self.at is None:
            return {}
        stop = import_module("hpop.planners.programs._stop")  # on first use: it imports CasADi
        return {"iteration_callback": stop.Stop(self, variables, constraints)}
