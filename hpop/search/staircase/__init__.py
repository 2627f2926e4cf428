"""The search "staircase": exact and fast if one of two or three costs is a small integer (:mod:`.staircase.search`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.staircase import kernel as kernel
    from hpop.search.staircase import search as search
    from hpop.search.staircase import tables as tables

__getattr__ = on_first_use(__name__, homes_of(__name__))
