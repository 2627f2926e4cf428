"""Exact search if one cost is a mean, the ratio of two sums, within limits on the duration (:mod:`.capped_mean`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.mean import kernel as kernel
    from hpop.search.mean import search as search

__getattr__ = on_first_use(__name__, homes_of(__name__))
