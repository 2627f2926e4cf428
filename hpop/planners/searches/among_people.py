"""Answers of the exact search among moving people: a first one soon, then the exact one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from hpop.planners.base import Candidates
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.timed.timing import timed_query
from hpop.planners.objectives import Objectives
from hpop.runtime.status import Status

if TYPE_CHECKING:
    from hpop.planners.searches.exact import ExactSearch
    from hpop.problems.problem import Problem

QUICK = 0.2  # s: least time of a search before the exact one
COARSE = 0.1  # relative precision on a part of the graph
SHARE = 0.4  # of the building time, if that is longer: it also reflects the load of the machine


def answers_among_people(
    search: ExactSearch,
    problem: Problem,
    objectives: Objectives,
    graphs: Iterable[BuiltGraph],
    *,
    in_stages: bool,
) -> Iterator[tuple[Candidates, BuiltGraph]]:
    """Yield the candidates of each stage and their graph; after Ctrl-C no other stage follows.

    Raises Exhausted where a limit is passed.

    Parameters
    ----------
    search : the planner
    graphs : parts of the graph, then the whole graph, which contains them
    in_stages : whether a first answer comes before the exact one
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
            if is_stage:  # without paths here, the whole graph has stages
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
    """Return candidates with the name of this stage in their provenance."""
    return replace(candidates, provenance=tuple(origin | {"stage": "first points"} for origin in candidates.provenance))


def _with_people_who_stop(
    search: ExactSearch, problem: Problem, query: Query, candidates: Candidates, built: BuiltGraph
) -> Candidates:
    """Return candidates; without a plan because people walk up to the start, those where people stop before it."""
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
