"""The supported part of the front, by weighted sums: one exact shortest path for each vector of weights."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.supported import weighted_path as weighted_path

__getattr__ = on_first_use(__name__, homes_of(__name__))
