"""The search "general": exact, for one to six costs on any graph (:mod:`.general.search`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.general import kernel as kernel
    from hpop.search.general import search as search

__getattr__ = on_first_use(__name__, homes_of(__name__))
