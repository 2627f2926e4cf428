"""Smaller roadmaps before the one asked for: what a time limit leaves is then more than nothing.

To link and cost a roadmap of many samples may take longer than the limit. Under a limit the search is therefore first
run on a sixteenth of the samples, then on a quarter, each in a share of the time.
"""

from __future__ import annotations

from hpop.planners.spending import Spending

SMALLEST = 250  # samples of the smallest roadmap
GROWTH = 4  # times as many samples has the next one


def smaller(samples: int, spending: Spending) -> list[int]:
    """Return the samples of the roadmaps to search first, the smallest first; none without a time limit."""
    sizes: list[int] = []
    if spending.limits.time_limit is not None:
        while (samples := samples // GROWTH) >= SMALLEST:
            sizes.insert(0, samples)
    return sizes
