"""CasADi callback that stops the solver IPOPT at a deadline."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import casadi

from hpop.runtime.interrupts import interrupts_held

if TYPE_CHECKING:
    from hpop.planners.programs import Deadline


class Stop(casadi.Callback):
    """Callback that runs after each solver iteration, and stops the solver in time for a deadline.

    It stops the solver when another iteration as long as the last one would pass the deadline. CasADi holds no
    reference to the callback, so the owner of the solver must hold one.
    """

    def __init__(self, deadline: Deadline, variables: int, constraints: int) -> None:
        casadi.Callback.__init__(self)
        self._deadline, self.last = deadline, time.monotonic()
        self._sizes = {"f": 1, "x": variables, "lam_x": variables, "g": constraints, "lam_g": constraints}
        with interrupts_held():
            self.construct("stop", {})

    def begin(self) -> None:
        """Start timing the first iteration."""
        self.last = time.monotonic()

    def get_n_in(self) -> int:
        return int(casadi.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        return casadi.Sparsity.dense(self._sizes.get(casadi.nlpsol_out(i), 0), 1)

    def eval(self, arguments: Any) -> list[int]:
        now = time.monotonic()
        lasts, self.last = now - self.last, now
        return [int(self._deadline.left <= lasts)]
