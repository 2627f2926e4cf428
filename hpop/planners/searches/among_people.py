"""Answers of the exact search among people who move: a first one soon, then the exact one."""

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

QUICK = 0.2  # s, of a search before the exact one, at least
COARSE = 0.1  # relative precision on a part of the graph
SHARE = 0.4  # of the time that building took, if that is more: it also tells how busy the machine is


def answers_among_people(
    search: ExactSearch,
    problem: Problem,
    objectives: Objectives,
    graphs: Iterable[BuiltGraph],
    *,
    in_stages: bool,
) -> Iterator[tuple[Candidates, BuiltGraph]]:
    """Yield the candidates of each stage and the graph on which they were found; after Ctrl-C no other stage follows.

    Raises Exhausted where a limit is passed.

    Parameters
    ----------
    search : the planner
    graphs : parts of the graph, whose paths are paths of the whole graph, then the whole graph
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
            if is_stage:  # where nothing is found, the whole graph has stages
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
        found = query.exact(search.name, spending.left(), eps=search.eps, tolerance=tolerance)
        yield _with_people_who_stop(search, problem, query, found, built), built


def _first_points(found: Candidates) -> Candidates:
    """Return candidates whose provenance names the stage."""
    return replace(found, provenance=tuple(origin | {"stage": "first points"} for origin in found.provenance))


def _with_people_who_stop(
    search: ExactSearch, problem: Problem, query: Query, found: Candidates, built: BuiltGraph
) -> Candidates:
    """Return candidates, or, if no path is left as people walk up to the start, those where people stop before it."""
    timing = query.timing
    assert timing is not None
    if found.status is not Status.NO_PATH or not any(timing.timed.safety.coming(timing.departure)):
        return found
    known = timing.timed.attention
    again = timed_query(
        built, query.objectives, problem, search.time_options, search.max_turns, known, people_stop=True
    )
    assert again.timing is not None
    if not again.timing.stopping:
        return found
    limits = replace(built.ends.space.spending.left(), checkpoint=None)
    others = again.exact(search.name, limits, eps=search.eps, tolerance=search.tolerance)
    return found if others.status is Status.NO_PATH else others
