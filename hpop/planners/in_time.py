"""How many of the points that a planner found can still be evaluated before its time limit.

To make and evaluate a trajectory takes a tenth of a millisecond, or several where criteria have memory, and a search
may find a hundred thousand. So a few points are evaluated first: they make the fields, and tell what a point takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

from hpop.planners.base import Candidates
from hpop.runtime.status import Status

SHARES = (16, 4)  # of all points, one of so many, in the first sample and in the second
MARGIN = 1.2  # what all points may take, beyond what the samples tell
FEW, FEW_WITH_MEMORY = 60, 6  # points that are evaluated in any case, without memory and where criteria have memory


def evaluable_in_time(
    candidates: Candidates,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float] = perf_counter,
) -> Candidates:
    """Return the candidates that can be evaluated in the seconds left, spread over all, with a note on the others.

    The best point in each cost is always among them, and a few are returned where no time is left. Without a limit, and
    after Ctrl-C, all are returned.

    Parameters
    ----------
    left : seconds until the limit, None without one
    evaluate : what takes the time, for some of the candidates
    clock : s, that the evaluation is timed by
    """
    few = FEW_WITH_MEMORY if any(c.aggregate == "trajectory" for c in candidates.filters) else FEW
    if left() is None or len(candidates.trajectories) <= few:
        return candidates
    try:
        number = _number(candidates, few, left, evaluate, clock)
    except KeyboardInterrupt:
        return replace(candidates, status=Status.INTERRUPTED)
    if number >= len(candidates.trajectories):
        return candidates
    some, count = candidates.spread(number), len(candidates.trajectories)
    only = f"{len(some.trajectories):,} of the {count:,} points found could be evaluated before the time limit"
    return replace(
        some,
        status=Status.TIME_LIMIT if some.status.is_final else some.status,
        certificate=f"{some.certificate}; only {only}, and the others are left out",
        notes=(*some.notes, f"only {only}; they are spread over all points found. Raise time_limit to have the others"),
    )


def _number(
    candidates: Candidates,
    few: int,
    left: Callable[[], float | None],
    evaluate: Callable[[Candidates], object],
    clock: Callable[[], float],
) -> int:
    """Return how many points can be evaluated in the seconds left, judging by some of them."""
    count = len(candidates.trajectories)
    evaluate(candidates.spread(1))  # makes fields, which take their time once
    size, took = 0, 0.0
    for share in SHARES:
        more = min(count, max(few, count // share))
        if more <= size or (took / max(1, size)) * more > (left() or 0.0) / 2:
            break
        began = clock()
        evaluate(candidates.spread(more))
        now = clock() - began
        each = MARGIN * max(0.0, now - took) / (more - size)
        size, took = more, now
        remaining = (left() or 0.0) - MARGIN * took
        if remaining >= each * (count - size):
            return count
    else:
        return max(few, min(count, size + int(remaining / each) if each else count))
    if not size or (left() or 0.0) <= 0.0:
        return few
    return max(few, min(count, int((left() or 0.0) * size / (MARGIN * took))))
