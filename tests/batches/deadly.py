"""A criterion at which a worker dies, as one that runs out of memory does."""

import os
import signal
from dataclasses import dataclass

import numpy as np

from hpop.criteria import Length, criterion

WHERE = 4.9  # m: a motion that ends farther up kills its process


@criterion("deadly_length", group="R", unit="m", aggregate="sum")
@dataclass(frozen=True)
class DeadlyLength:
    """Length of paths that stay below; evaluating others kills the process."""

    def cost(self, m):
        """Length (M,), m."""
        if np.any(np.asarray(m.end.y) > WHERE):
            os.kill(os.getpid(), signal.SIGKILL)
        return Length().cost(m)
