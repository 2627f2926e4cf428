"""Modules that all searches share: labels, time slices, lower bounds, groups of turns, checkpoints, approximation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.machinery import bounds as bounds
    from hpop.search.machinery import changed_turns as changed_turns
    from hpop.search.machinery import kernels as kernels
    from hpop.search.machinery import labels as labels
    from hpop.search.machinery import plain_bounds as plain_bounds
    from hpop.search.machinery import slices as slices
    from hpop.search.machinery import turns as turns

__getattr__ = on_first_use(__name__, homes_of(__name__))
