"""Planning problems, their solution by planners, and the resulting fronts of trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: SciPy is slow to import
    from hpop.problems import evaluation as evaluation
    from hpop.problems import named_rows as named_rows
    from hpop.problems import verify as verify

__getattr__ = on_first_use(__name__, homes_of(__name__))
