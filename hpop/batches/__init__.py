"""Batches: many problems, solved by several planners on several workers, with one Parquet data set of results."""

from __future__ import annotations

from hpop.batches.results import Results
from hpop.batches.running import batch

__all__ = ["Results", "batch"]
