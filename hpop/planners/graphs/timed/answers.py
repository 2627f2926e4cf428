"""The answers of a planner on a graph of states where people move: a first one soon, then the exact one."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, cast

from hpop.errors import QueryError
from hpop.planners.base import Candidates
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.asked import Asked
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.notice import Attention
from hpop.planners.graphs.timed.query import TimedQuery
from hpop.planners.objectives import Objectives
from hpop.runtime import limits
from hpop.runtime.status import Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

QUICK = 0.2  # s, of a search before the exact one, at least
COARSE = 0.1  # relative precision on a part of the graph
SHARE = 0.4  # of the time that building took, if that is more: it also tells how busy the machine is


def answers(
    problem: Problem,
    objectives: Objectives,
    graphs: Iterable[BuiltGraph],
    asked: Asked,
    progress: ProgressCallback | None,
) -> Iterator[tuple[Candidates, BuiltGraph]]:
    """Candidates of each stage, with the graph on which they were found; after Ctrl-C what was found, and no more.

    Raises Exhausted where a limit is passed.

    Parameters
    ----------
    graphs : parts of the graph, which are soon put on a clock and whose paths are paths of the whole; then the whole
    """
    if progress:
        progress(Progress("graph"))
    in_stages, attention = asked.in_stages, None
    for built in graphs:
        spending = built.ends.space.spending
        before = spending.memory
        query = _query(problem, objectives, built, asked, attention)
        attention = query.timed.attention
        if built.part:
            share = spending.share(max(QUICK, query.build_seconds))
            eps = max(COARSE, asked.eps)
            first = query.exact(asked.planner, share, progress, eps=eps, tolerance=asked.tolerance, stage=True)
            spending.release(spending.memory - before)
            is_stage = len(first.trajectories) or first.status is Status.INTERRUPTED
            if is_stage:  # where nothing is found, the whole graph has stages
                in_stages = False
                with spending.paused():
                    yield first.unfinished(), built
            if first.status is Status.INTERRUPTED:
                return
            continue
        if in_stages:
            left = spending.share(max(QUICK, SHARE * query.build_seconds))
            first = query.exact(asked.planner, left, progress, eps=asked.eps, tolerance=asked.tolerance, stage=True)
            first = replace(first, notes=(*first.notes, *built.notes))
            if first.status.is_final:
                yield _with_people_who_stop(query, first, built, asked, progress), built
                return
            with spending.paused():
                yield first.unfinished(), built
            if first.status is Status.INTERRUPTED:
                return
        found = query.exact(
            asked.planner,
            spending.left(),
            progress,
            eps=asked.eps,
            tolerance=asked.tolerance,
            checkpoint=asked.checkpoint,
        )
        found = _with_people_who_stop(query, found, built, asked, progress)
        yield replace(found, notes=(*found.notes, *built.notes)), built


def _with_people_who_stop(
    query: TimedQuery, found: Candidates, built: BuiltGraph, asked: Asked, progress: ProgressCallback | None
) -> Candidates:
    """What was found, or, if no path is left as people walk up to the start, what is where they stop before it."""
    if found.status is not Status.NO_PATH or not any(query.timed.safety.coming(query.begins_at)):
        return found
    space = built.ends.space
    again = _query(query.problem, query.objectives, built, asked, query.timed.attention, people_stop=True)
    if not again.stopping:
        return found
    others = again.exact(asked.planner, space.spending.left(), progress, eps=asked.eps, tolerance=asked.tolerance)
    return found if others.status is Status.NO_PATH else others


def _query(
    problem: Problem,
    objectives: Objectives,
    built: BuiltGraph,
    asked: Asked,
    attention: Attention | None = None,
    *,
    people_stop: bool = False,
) -> TimedQuery:
    """The question on a graph, put on a clock."""
    began = time.perf_counter()
    space, start, goals = built.ends
    if not space.has_clock:
        raise QueryError(f"{space.words} has no clock")
    at = cast(StateGraph | JoinedEnds, space)
    with limits.within(space.spending):
        timed = timed_graph(
            at,
            objectives.optimised,
            start,
            goals,
            asked.options,
            problem.quanta,
            attention=attention,
            people_stop=people_stop,
        )
    seconds = time.perf_counter() - began
    return TimedQuery(problem, objectives, timed, asked.options, start, goals, seconds, asked.max_turns)
