"""Smaller roadmaps before the one asked for: what a time limit leaves is then more than nothing.

To link and cost a roadmap of many samples may take longer than the limit. Under a limit the search is therefore first
run on a sixteenth of the samples, then on a quarter, each in a share of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from hpop.planners.base import Candidates
from hpop.planners.spending import Exhausted, Spending

if TYPE_CHECKING:
    from hpop.planners.roadmap.headings import StateRoadmap

SMALLEST = 250  # samples of the smallest roadmap
GROWTH = 4  # times as many samples has the next one


def smaller(samples: int, spending: Spending) -> list[int]:
    """Return the samples of the roadmaps to search first, the smallest first; none without a time limit."""
    sizes: list[int] = []
    if spending.budget.time_limit is not None:
        while (samples := samples // GROWTH) >= SMALLEST:
            sizes.insert(0, samples)
    return sizes


def growing(
    sizes: list[int],
    make: Callable[[int], StateRoadmap],
    search: Callable[[StateRoadmap], Candidates],
    spending: Spending,
) -> Iterator[Candidates]:
    """Yield what is found on each smaller roadmap, up to the first that a limit ends; memory is given back.

    Parameters
    ----------
    make : the roadmap of so many samples
    search : what is found on it, in a share of the time that is left
    """
    for size in sizes:
        held = spending.memory
        try:
            found = search(make(size))
        except Exhausted:
            return
        finally:
            spending.release(spending.memory - held)
        if len(found.trajectories):
            stage = {"stage": f"roadmap of {size:,} samples"}
            yield replace(found, provenance=tuple(origin | stage for origin in found.provenance)).unfinished()
