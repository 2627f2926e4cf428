"""Exact search among moving people: a quick early result, then the exact one.

The search is on a clock: it counts time in ticks (:mod:`hpop.planners.graphs.timed`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from hpop.planners.base import Candidates
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.timed.timing import timed_query
from hpop.planners.objectives import Objectives
from hpop.runtime.limits import Status

if TYPE_CHECKING:
    from hpop.planners.searches.exact import ExactSearch
    from hpop.problems.problem import Problem

QUICK = 0.2  # s: least time for a search before the exact one
COARSE = 0.1  # relative error allowed in a search on a part of the graph
SHARE = 0.4  # of the building time, if that is longer: the building time also reflects the load of the machine


def answers_among_people(
    search: ExactSearch,
    problem: Problem,
    objectives: Objectives,
    graphs: Iterable[BuiltGraph],
    *,
    in_stages: bool,
) -> Iterator[tuple[Candidates, BuiltGraph]]:
    """Search each graph on a clock, and yield the candidates of each stage with their graph.

    The last candidates are those of the exact search, unless Ctrl-C ends the search before. Raises Exhausted when a
    limit is passed.

    Parameters
    ----------
    search : planner whose options apply
    graphs : parts of the graph, then the whole graph, which contains them
    in_stages : whether early results may be yielded before the exact one
    """
    attention, tolerance = None, search.tolerance
    for built in graphs:
        spending = built.ends.space.spending
        before = spending.memory
        query = timed_query(built, objectives, problem, search.time_options, search.max_turns, attention)
        assert query.timing is not None
        attention = query.timing.timed.attention
        if built.part:
            share = spending.share(max(QUICK, query.build_seconds))
            first = query.exact(search.name, share, eps=max(COARSE, search.eps), tolerance=tolerance, stage=True)
            spending.release(spending.memory - before)
            is_stage = len(first.trajectories) or first.status is Status.INTERRUPTED
            if is_stage:  # if no path was found on this part, the whole graph is searched in stages instead
                in_stages = False
                with spending.paused():
                    yield _first_points(first).unfinished(), built
            if first.status is Status.INTERRUPTED:
                return
            continue
        if in_stages:
            share = spending.share(max(QUICK, SHARE * query.build_seconds))
            first = _first_points(query.exact(search.name, share, eps=search.eps, tolerance=tolerance, stage=True))
            if first.status.is_final:
                yield _with_people_who_stop(search, problem, query, first, built), built
                return
            with spending.paused():
                yield first.unfinished(), built
            if first.status is Status.INTERRUPTED:
                return
        candidates = query.exact(search.name, spending.left(), eps=search.eps, tolerance=tolerance)
        yield _with_people_who_stop(search, problem, query, candidates, built), built


def _first_points(candidates: Candidates) -> Candidates:
    """Return candidates whose provenance says that they come from the early stage "first points"."""
    return replace(candidates, provenance=tuple(origin | {"stage": "first points"} for origin in candidates.provenance))


def _with_people_who_stop(
    search: ExactSearch, problem: Problem, query: Query, candidates: Candidates, built: BuiltGraph
) -> Candidates:
    """Plan again, with people who stop in front of the robot, if there is no path because people walk into its start.

    Returns the new candidates if this finds a path or is stopped by a limit; otherwise the given ``candidates``.
    """
    timing = query.timing
    assert timing is not None
    has_none = candidates.status.is_final and not len(candidates.trajectories)
    if not has_none or not any(timing.timed.safety.coming(timing.departure)):
        return candidates
    attention = timing.timed.attention
    stopping = timed_query(
        built, query.objectives, problem, search.time_options, search.max_turns, attention, people_stop=True
    )
    assert stopping.timing is not None
    if not stopping.timing.stopping:
        return candidates
    limits = replace(built.ends.space.spending.left(), checkpoint=None)
    stopping_candidates = stopping.exact(search.name, limits, eps=search.eps, tolerance=search.tolerance)
    is_better = len(stopping_candidates.trajectories) or not stopping_candidates.status.is_final
    return stopping_candidates if is_better else candidates
