"""Batches: many problems, solved by several planners on several workers, with all results in one Parquet data set."""

from __future__ import annotations

from hpop.batches.results import Results
from hpop.batches.running import batch
from hpop.batches.summary import PlannerSummary, summaries, summary_lines

__all__ = ["PlannerSummary", "Results", "batch", "summaries", "summary_lines"]
