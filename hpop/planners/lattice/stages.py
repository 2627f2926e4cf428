"""The stages of the lattice planner: a first answer within a second or two, the exact front in the end.

Most of the time before an answer goes into costing millions of edges. So on a large lattice the first stage takes a
part alone: a bounded number of positions, on the shortest ways. Its edges are edges of the whole lattice, hence its
paths are paths there. On the part, then on the whole, it looks for supported points (:mod:`.supported_paths`), the
best path in each cost first, for a fraction of a second or of the time that building took. Where a cost takes the worst
edge, weighted sums say nothing, and the first points of an exact search stand in. On a large lattice a front within a
tenth of the exact one follows, if it takes no longer than building did. On a small one the exact search is first given
as long as a first answer would take: where it ends, nothing else is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hpop.criteria.base import place_of
from hpop.planners.base import Candidates, Planner
from hpop.planners.graphs.query import GraphQuery
from hpop.planners.lattice.graph import StateLattice
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.spending import Exhausted, Spending, stopped
from hpop.planners.timed.asked import needless
from hpop.search import Graph, ParetoPaths, pareto_paths, supported_paths
from hpop.search.machinery.beside import Onset, begin, compiling_beside, first_is_awaited, is_compiling
from hpop.search.pareto_paths import main_kernels
from hpop.search.supported.first_paths import first_paths
from hpop.status import Budget, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.planners.lattice import Lattice
    from hpop.problem import Problem

MOST = 5_000  # positions of the first stage: their edges are built in a fifth of a second
LARGE = 2  # times as many: a smaller lattice is built as a whole almost as soon as a part of it, and then a second time
MOST_IN_TIME = 400  # positions of the first stage among people who move: what they cost by the tick is soon known
QUICK = 0.1  # s, of a search before the exact one, at least
SHARE = 0.4  # of the time that building took, if that is more: it also tells how busy the machine is
COARSE = 0.1  # relative precision of the last stage before the exact one


def stages(planner: Lattice, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
    """Candidates of each stage; after Ctrl-C what was found, and no more."""
    objectives = edge_objectives(problem.criteria, "lattice").noted(needless(problem, planner.time_options))
    spending = planner.spending(problem)
    try:
        yield from _stages(planner, problem, objectives, spending, progress)
    except Exhausted as stop:
        yield stopped("lattice", objectives, stop, spending)


def _stages(
    planner: Lattice, problem: Problem, objectives: Objectives, spending: Spending, progress: ProgressCallback | None
) -> Iterator[Candidates]:
    lattice = planner.lattice(problem, spending)
    part = None if lattice.costed(objectives.optimised) else part_of(planner, lattice, problem, MOST)
    large = lattice.cells[0].size > LARGE * MOST
    for space in [lattice] if part is None else [part, lattice]:
        query = planner.query(problem, objectives, progress, space)
        query.break_ties()
        budget = spending.share(max(QUICK, SHARE * query.build_seconds))
        exact = None if large or is_compiling() else _at_once(planner, query, budget, progress)
        if exact is not None:
            yield exact
            return
        if first_is_awaited() and space is (part or lattice):
            first = _quick_answer(query, budget, progress)
        else:
            first = _first_answer(query, budget, progress)
        with spending.paused():
            yield first
        if first.status is Status.INTERRUPTED:
            return
        if space is part:
            query.drop_ties()
        begin()
    covered = math.inf
    if large and planner.eps < COARSE:
        coarse = query.exact("lattice", spending.share(query.build_seconds), progress, eps=COARSE, stage=True)
        covered = math.inf if coarse.stats["gap"] is None else coarse.stats["gap"]
        stage = {"stage": f"within a factor {1 + COARSE:g}"}
        with spending.paused():
            yield replace(coarse, provenance=tuple(origin | stage for origin in coarse.provenance)).unfinished()
        if coarse.status is Status.INTERRUPTED:
            return
    yield query.exact(
        "lattice",
        spending.left(),
        progress,
        eps=planner.eps,
        tolerance=planner.tolerance,
        checkpoint=planner.checkpoint,
        covered=covered,
    )


def kernels_beside(planners: Sequence[Planner], problem: Problem) -> AbstractContextManager[Onset | None]:
    """Have other processes compile what the search of a lattice among some planners takes, if nothing of it is kept.

    Where the lattice comes first and in stages, after its first answer, else at once; tells when, None for not at all.
    """
    if not any(p.name == "lattice" and getattr(p, "max_detour", None) is None for p in planners):
        return nullcontext()
    criteria = edge_objectives(problem.criteria, "lattice").optimised
    turns = place_of("turns", criteria)
    onset = Onset.AFTER_FIRST if getattr(planners[0], "answers_in_stages", False) else Onset.AT_ONCE
    return compiling_beside(
        ["max" if c.aggregate == "max" else "sum" for c in criteria],
        -1 if turns is None else turns,
        onset,
        main_kernels,
    )


def part_of(planner: Lattice, lattice: StateLattice, problem: Problem, most: int) -> StateLattice | None:
    """So many positions of a large lattice, on the shortest ways; None of a small one, or where there is no way."""
    if lattice.cells[0].size <= LARGE * most:
        return None
    from hpop.planners.lattice.nearby import nearby  # numba: on first use

    starts, goals = planner.ends(lattice, problem).inside
    if not (starts and goals):
        return None
    at = lattice.places(np.array([starts[0], goals[0]]))
    begin, end = zip(*(axis[at].tolist() for axis in lattice.cells), strict=True)
    kept = nearby(lattice.number >= 0, begin, end, most, corner_cutting=lattice.corner_cutting)
    return None if kept is None else replace(lattice, kept=kept)


def _at_once(
    planner: Lattice, query: GraphQuery, budget: Budget, progress: ProgressCallback | None
) -> Candidates | None:
    """The last answer, where it takes no longer than a first one would; None where it does."""
    exact = query.exact("lattice", budget, progress, eps=planner.eps, tolerance=planner.tolerance)
    return exact if exact.status.is_final or exact.status is Status.INTERRUPTED else None


def first_answer(
    name: str,
    planner: Lattice,
    problem: Problem,
    objectives: Objectives,
    spending: Spending,
    progress: ProgressCallback | None,
) -> Candidates | None:
    """Points on the part of a large lattice round a shortest way, of the planner ``name``; None of a small one."""
    lattice = planner.lattice(problem, spending)
    part = None if lattice.costed(objectives.optimised) else part_of(planner, lattice, problem, MOST)
    if part is None:
        return None
    query = planner.query(problem, objectives, progress, part)
    query.break_ties()
    budget = spending.share(max(QUICK, SHARE * query.build_seconds))
    found = _first_answer(query, budget, progress, name)
    query.drop_ties()
    return found


def _first_answer(
    query: GraphQuery, budget: Budget, progress: ProgressCallback | None, name: str = "lattice"
) -> Candidates:
    """Points found within the budget, and what they are."""

    def search(graph: Graph) -> ParetoPaths:
        find = pareto_paths if "max" in graph.aggregates else supported_paths
        return find(graph, query.start, query.goals, budget=budget, progress=progress)

    kind = "non-dominated" if "max" in query.graph.aggregates else "supported"
    return _stage(name, query, query.with_fewest_turns(search), f"{kind} points")


def _quick_answer(query: GraphQuery, budget: Budget, progress: ProgressCallback | None) -> Candidates:
    """Points found while the kernels of a search are compiled."""

    def search(graph: Graph) -> ParetoPaths:
        return first_paths(graph, query.start, query.goals, budget, progress)

    return _stage("lattice", query, query.with_fewest_turns(search), "points of weighted costs")


def _stage(name: str, query: GraphQuery, paths: ParetoPaths, what: str) -> Candidates:
    """Paths of a first stage of the planner ``name``, and what they are."""
    found = query.candidates(
        name,
        replace(paths, status=Status.UNFINISHED)
        if paths.status is Status.NO_PATH
        else paths,  # the last stage says why
        f"{what} of {query.space.words} for ({query.names})",
        provenance=[{"stage": what}] * len(paths),
        stats={"method": paths.stats.method, "peak_memory": paths.stats.peak_memory},
    )
    return found.unfinished()
