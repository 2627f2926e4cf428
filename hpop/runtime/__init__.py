"""Running searches: compiled kernels, worker processes, Ctrl-C, limits, progress, and the server of web pages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba and multiprocessing are slow to import
    from hpop.runtime import compiled as compiled
    from hpop.runtime import interrupts as interrupts
    from hpop.runtime import sweep as sweep

__getattr__ = on_first_use(__name__, homes_of(__name__))
