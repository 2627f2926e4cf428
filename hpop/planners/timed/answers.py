"""The answers of a planner on a graph of states where people move: a first one soon, then the exact one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from hpop import limits
from hpop.errors import QueryError
from hpop.planners.base import Candidates
from hpop.planners.graphs.joined_ends import Ends, JoinedEnds
from hpop.planners.graphs.query import refuse_too_many, tolerance_counts
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.objectives import Objectives
from hpop.planners.timed.asked import Asked
from hpop.planners.timed.assembly import timed_graph
from hpop.planners.timed.notice import Attention
from hpop.planners.timed.query import TimedQuery
from hpop.status import Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.problem import Problem

QUICK = 0.2  # s, of a search before the exact one, at least
COARSE = 0.1  # relative precision on a part of the graph
SHARE = 0.4  # of the time that building took, if that is more: it also tells how busy the machine is


def answers(
    problem: Problem,
    objectives: Objectives,
    ends: Ends,
    asked: Asked,
    progress: ProgressCallback | None,
    sooner: Ends | None = None,
) -> Iterator[Candidates]:
    """Candidates of each stage; after Ctrl-C what was found, and no more. Raises Exhausted where a limit is passed.

    ``sooner`` is a part of the graph: what it takes to put it on a clock is soon done, and its paths are paths of all.
    """
    refuse_too_many(objectives)
    tolerance_counts(objectives, asked.tolerance or {})  # that would only be found wrong by the last stage
    if progress:
        progress(Progress("graph"))
    spending = ends.space.spending
    in_stages, attention = asked.in_stages, None
    if sooner is not None:
        before = spending.memory
        query = _query(problem, objectives, sooner, asked)
        attention = query.timed.attention
        share = spending.share(max(QUICK, query.build_seconds))
        eps = max(COARSE, asked.eps)
        first = query.exact(asked.planner, share, progress, eps=eps, tolerance=asked.tolerance, stage=True)
        spending.release(spending.memory - before)
        if len(first.trajectories) or first.status is Status.INTERRUPTED:  # where nothing is found, all are asked next
            in_stages = False
            with spending.paused():
                yield first.unfinished()
        if first.status is Status.INTERRUPTED:
            return
    query = _query(problem, objectives, ends, asked, attention)
    if in_stages:
        left = spending.share(max(QUICK, SHARE * query.build_seconds))
        first = query.exact(asked.planner, left, progress, eps=asked.eps, tolerance=asked.tolerance, stage=True)
        if first.status.is_final:
            yield first
            return
        with spending.paused():
            yield first.unfinished()
        if first.status is Status.INTERRUPTED:
            return
    yield query.exact(
        asked.planner,
        spending.left(),
        progress,
        eps=asked.eps,
        tolerance=asked.tolerance,
        checkpoint=asked.checkpoint,
    )


def _query(
    problem: Problem, objectives: Objectives, ends: Ends, asked: Asked, attention: Attention | None = None
) -> TimedQuery:
    """The question on a graph, put on a clock."""
    began = time.perf_counter()
    space, start, goals = ends
    if not isinstance(space, StateGraph | JoinedEnds):
        raise QueryError(f"{space.words} has no clock")
    with limits.within(space.spending):
        timed = timed_graph(
            space, objectives.optimised, start, goals, asked.options, problem.quanta, attention=attention
        )
    seconds = time.perf_counter() - began
    return TimedQuery(problem, objectives, timed, asked.options, start, goals, seconds, asked.max_turns)
