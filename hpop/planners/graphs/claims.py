"""What is claimed of a search on a graph, in words: how near its points are, and how much it misses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from hpop.runtime.status import Status
from hpop.search import ParetoPaths

if TYPE_CHECKING:
    from hpop.search.timed.paths import TimedPaths

ROUNDED = "edge costs rounded to their quanta"
OFF = "paths off this graph may be better"
SHARE = "this stage's share of the time"


class Ended(Protocol):
    """What a search found, how it ended, and how much it may miss."""

    @property
    def status(self) -> Status: ...

    @property
    def gap(self) -> float: ...

    def __len__(self) -> int: ...


def claimed(
    paths: Ended,
    where: str,
    rounded: str = ROUNDED,
    *,
    eps: float = 0.0,
    tolerance: Mapping[str, float] | None = None,
    optimal: str = "every point is optimal",
    gap: float | None = None,
    stage: bool = False,
) -> str:
    """What is claimed of a search that looks for all optimal vectors, or covers them within ``eps`` and a tolerance.

    where    it was searched, and how costs were ``rounded``, in words
    optimal  what each point is where the search ended early, in words
    gap      what may be missing, where more is known of it than the search tells
    stage    before the last, so that its time is a share and not a limit that anybody has set
    """
    factor = within(eps, tolerance or {})
    if not paths.status.is_final:
        each = f"points are within {factor} of optimal" if factor else optimal
        each = each if len(paths) else "the search itself found none"
        ended = SHARE if stage and paths.status is Status.TIME_LIMIT else paths.status
        missing = how_far(paths.gap if gap is None else gap, tolerance or {})
        return f"incomplete ({ended}): {each} on {where}, others are missing{missing}"
    if factor:
        covered = f"every optimal cost vector on {where} is covered within {factor}"
        return f"{covered}; {OFF}, points need not be optimal themselves; {rounded}"
    return f"exact on {where}; {OFF}; {rounded}"


def claimed_with_known(paths: Ended, where: str, rounded: str = ROUNDED) -> str:
    """What is claimed of a search among ways that were known before, in words."""
    if paths.status.is_final:
        return f"exact on {where}; {OFF}; {rounded}"
    return (
        f"incomplete ({paths.status}): known ways and what was found on {where}, points need not be optimal, others "
        f"are missing{how_far(paths.gap, {})}"
    )


def within(eps: float, tolerance: Mapping[str, float]) -> str:
    """In words, how far a point may be from what it covers; nothing if it may not."""
    return " and ".join([f"a factor {1 + eps:g}"] * bool(eps) + _amounts(tolerance))


def how_far(gap: float, tolerance: Mapping[str, float]) -> str:
    """In words, how much better than the points at hand a missing one may be.

    >>> how_far(0.1, {"turns": 2.0})
    '; for each of them, a point here is at most 10 % worse in every cost, besides 2 in turns'
    """
    if not math.isfinite(gap):
        return "; how much better they may be is not known"
    worse = f"; for each of them, a point here is at most {_percent(gap)} % worse in every cost"
    amounts = " and ".join(_amounts(tolerance))
    return f"{worse}, besides {amounts}" if amounts else worse


def _amounts(tolerance: Mapping[str, float]) -> list[str]:
    return [f"{value:g} in {name}" for name, value in tolerance.items() if value]


def _percent(gap: float) -> str:
    """A share in percent, rounded up to two digits.

    >>> _percent(0.1), _percent(0.1201), _percent(1.0), _percent(12.31), _percent(0.0), _percent(0.00012)
    ('10', '13', '100', '1,300', '0', '0.012')
    """
    if gap == 0.0:
        return "0"
    digit = 10.0 ** (math.floor(math.log10(100 * gap)) - 1)
    percent = math.ceil(100 * gap / digit - 1e-6) * digit
    return f"{percent:,.0f}" if percent >= 10 else f"{percent:.2g}"


def at_memory_limit(paths: ParetoPaths | TimedPaths) -> list[str]:
    """A note on how far a search came that ran out of memory: no user can see how much more it would take."""
    if paths.status is not Status.MEMORY_LIMIT:
        return []
    made, waiting = paths.stats.labels_generated, paths.stats.labels_open
    return [
        f"memory limit: {made:,} labels (partial paths) were generated, {waiting:,} of them still open; raise "
        "max_memory, or give eps, a larger step or fewer criteria"
    ]
