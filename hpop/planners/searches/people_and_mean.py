"""Variants of the exact search: among moving people, and for a mean over time itself, not its integral.

The search among moving people is on a clock: it counts time in ticks (:mod:`hpop.planners.graphs.timed`).

The search for a mean needs a limit, called the cap. A time-mean is S / T, an integral divided by the duration, so it
does not add up along a path. Without a cap, a path could lower it for ever by loops where the cost is low. With an
upper limit on T, or on the length and the number of turns, the front is finite, and
:func:`hpop.search.capped_mean_paths` finds it exactly.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, TypeAlias, cast

import numpy as np

from hpop.base.options import real
from hpop.criteria import Duration
from hpop.criteria.base import Criterion, Role, index_of_role
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import OFF, ROUNDED, assemble
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.query import MAX_COSTS, Query
from hpop.planners.graphs.timed import timed_query
from hpop.planners.objectives import Objectives, edge_objectives, integral_of
from hpop.planners.spending import Exhausted, Spending
from hpop.runtime.limits import Status
from hpop.search import Graph, capped_mean_paths, pareto_paths

if TYPE_CHECKING:
    from hpop.planners.searches import ExactSearch
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


DetourSpec: TypeAlias = float | Mapping[str, float]
LARGEST_DETOUR = 1000
CAPPED: tuple[Role, ...] = ("duration", "length")
INTEGRAL, DURATION, OTHERS = range(3)  # columns of the graph; the other costs follow


@dataclass(frozen=True)
class Detour:
    """Upper limit (cap) on the duration or the length of a path, as a multiple of the least value of any path.

    cost    role of the limited criterion: "duration" or "length"
    factor  multiple of the least value, from 1 to 1000
    """

    cost: Role
    factor: float

    @classmethod
    def of(cls, max_detour: Any, max_turns: int | None) -> Self:
        """Return the cap that the planner options ``max_detour`` and ``max_turns`` describe.

        ``max_detour`` is a factor on the duration, or ``{cost: factor}``. Raises OptionError for an invalid value, and
        for a cap on the length without ``max_turns``: turning in place adds no length, so a path could turn for ever.
        """
        spec: Mapping[Any, Any] = max_detour if isinstance(max_detour, Mapping) else {"duration": max_detour}
        cost, factor = next(iter(spec.items()), ("", 0))
        kind = "the longest allowed duration divided by the least one, or {'length': the same for lengths},"
        hint = "give a number such as 1.3, or leave max_detour out: then the integral of the mean is minimised"
        is_valid = len(spec) == 1 and cost in CAPPED
        factor = real("max_detour", factor if is_valid else max_detour, 1, LARGEST_DETOUR, kind, hint=hint)
        if cost == "length" and max_turns is None:
            raise OptionError(
                "max_detour with 'length' needs max_turns as well, since turning in place adds no length: a path could "
                "turn for ever where the mean is low. Give max_turns, such as max_turns=8, or limit the duration "
                "instead, such as max_detour=1.3"
            )
        return cls(cast(Role, cost), float(factor))

    @property
    def option(self) -> DetourSpec:
        """Value of the planner option ``max_detour`` for this cap, JSON-able."""
        return self.factor if self.cost == "duration" else {self.cost: self.factor}


def mean_objectives(criteria: Sequence[Criterion], planner_name: str) -> Objectives:
    """Return the objectives of the graph that is searched: integral of the time-mean, duration, then the other costs.

    The search divides the first by the second to get the mean. Raises OptionError if no criterion is a time-mean or if
    there are too many criteria, and UnsupportedCriterion if there is more than one time-mean.
    """
    means = [c for c in criteria if c.aggregate == "time-mean"]
    if not means:
        raise OptionError(
            "max_detour needs a criterion that is a mean over time, but none of "
            f"{', '.join(c.name for c in criteria)} is one; leave max_detour out, or add one such as 'obstruction'"
        )
    if len(means) > 1:
        raise UnsupportedCriterion(
            f"{planner_name} with max_detour can minimise one mean over time, got {', '.join(c.name for c in means)}. "
            f"Replace {means[1].name} by {integral_of(means[1]).name}, leave one out, or leave max_detour out: then "
            "the integrals are minimised."
        )
    summed = [c for c in criteria if c is not means[0] and c.aggregate != "trajectory"]
    if len(summed) > MAX_COSTS - OTHERS:
        raise OptionError(
            f"with max_detour the exact search takes at most {MAX_COSTS - OTHERS} costs beside the mean, got "
            f"{len(summed)}; leave some criteria out"
        )
    memory = edge_objectives(
        [cast(Criterion, Duration()), *(c for c in criteria if c.aggregate == "trajectory")], planner_name
    )
    return replace(memory, optimised=(integral_of(means[0]), *memory.optimised, *summed))


def mean_criteria(criteria: Sequence[Criterion], objectives: Objectives) -> Objectives:
    """Return the objectives as the user sees them: with the mean itself, not its integral and an added duration."""
    return replace(objectives, optimised=tuple(c for c in criteria if c.aggregate != "trajectory"))


def exact_mean(
    query: Query,
    criteria: Sequence[Criterion],
    detour: Detour,
    name: str,
    spending: Spending,
) -> Candidates:
    """Find all paths within the cap that are non-dominated in the mean and the other costs.

    First the least duration (or length) of any path is computed, from which the cap follows; then the capped search
    runs. The paths are returned as candidates of the planner ``name``.

    query   query on a graph with the costs of :func:`mean_objectives`, and with max_turns
    detour  upper limit on the duration or the length

    Raises OptionError if the limited cost is not among the criteria or a path could last for ever within the limits,
    and Exhausted if a limit of ``spending`` is passed before the capped search begins.
    """
    graph, quanta, at_most = query.graph, query.quanta, query.at_most()
    column = _capped_column(query, detour)
    query.hold_copies()
    progress = spending.limits.progress
    alone = Graph.from_csr(graph.indptr, graph.heads, graph.costs[:, [column]])
    shortest = pareto_paths(
        alone, query.start, query.goals, budget=replace(spending.left(), max_labels=None), progress=progress
    )
    if shortest.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if not shortest.status.is_final:
        raise Exhausted(shortest.status, f"the least {detour.cost} of any path was computed")
    least = int(shortest.costs[0, 0]) if len(shortest) else 0
    most = int(detour.factor * least)
    if column != DURATION:
        at_most[column] = most
        _refuse_endless(query, [j for j, bound in enumerate(at_most) if bound is not None])
    paths = capped_mean_paths(
        graph,
        query.start,
        query.goals,
        integral=INTEGRAL,
        duration=DURATION,
        cap=most if column == DURATION else None,
        at_most=at_most,
        budget=spending.left(),
        progress=progress,
        checkpoint=spending.limits.checkpoint,
    )
    optimised = tuple(c for c in criteria if c.aggregate != "trajectory")
    where = f"{query.space.words}, for ({', '.join(c.name for c in optimised)})"
    size = f"{most * quanta[column]:.6g} {query.objectives.optimised[column].unit}"
    cap = f"{detour.cost} <= {size} ({detour.factor:g} times the least)"
    if query.max_turns is not None:
        cap += f" and at most {query.max_turns} turns"
    if not len(shortest):
        claim = f"exact on {where}; {OFF}"
    elif paths.status.is_final:
        claim = f"exact under {cap} on {where}; {OFF}, and nothing is claimed beyond the cap; {ROUNDED}"
    else:
        claim = f"incomplete ({paths.status}): paths of {cap} on {where}; others are missing, and may be better"
    candidates = assemble(
        name,
        query,
        paths,
        claim,
        provenance=[{"max_detour": detour.option}] * len(paths),
        stats={
            "method": paths.stats.method,
            "labels_generated": paths.stats.labels_generated,
            "labels_expanded": paths.stats.labels_expanded,
            "peak_memory": paths.stats.peak_memory,
            f"least_{detour.cost}": least * quanta[column],
            f"{detour.cost}_cap": most * quanta[column],
        },
        reason=_reason_without_path(query, column, least) if paths.status is Status.NO_PATH else "",
    )
    # The ratio replaces S and T. Both are rounded up by less than a quantum per edge.
    unit, time = quanta[INTEGRAL] / quanta[DURATION], np.maximum(candidates.planned[:, DURATION], quanta[DURATION])
    mean = paths.means * unit
    rounding = (candidates.tolerance[:, INTEGRAL] + mean * candidates.tolerance[:, DURATION]) / time
    index = next(j for j, c in enumerate(optimised) if c.aggregate == "time-mean")
    return replace(
        candidates,
        objectives=optimised,
        planned=np.insert(candidates.planned[:, OTHERS:], index, mean, axis=1),
        tolerance=np.insert(candidates.tolerance[:, OTHERS:], index, rounding, axis=1),
    )


def _capped_column(query: Query, detour: Detour) -> int:
    """Return the column, among the costs of the graph, of the cost that the cap ``detour`` limits.

    Raises OptionError if the cost is not among them.
    """
    column = index_of_role(detour.cost, query.objectives.optimised)
    if column is None:
        names = [criterion.name for criterion in query.objectives.optimised]
        raise OptionError(
            f"max_detour with {detour.cost!r} needs the criterion {detour.cost!r}, but the criteria beside the mean "
            f"are only {', '.join(names[OTHERS:]) or 'none'}; add {detour.cost!r}, or limit the duration instead: "
            f"max_detour={detour.factor:g}"
        )
    return column


def _refuse_endless(query: Query, bounded: Sequence[int]) -> None:
    """Raise OptionError if a path could last for ever without exceeding the limits on its costs.

    This is so if some motion takes time but adds nothing to any limited cost, such as tilting a head.

    bounded  columns of the costs that are limited
    """
    costs = query.graph.costs
    if ((costs[:, DURATION] > 0) & (costs[:, bounded] == 0).all(axis=1)).any():
        names = " and ".join(query.objectives.optimised[j].name for j in bounded)
        raise OptionError(
            f"max_detour must limit the duration of every path, but some motions take time and add nothing to {names}, "
            "so that a path could last for ever where the mean is low; give max_detour as a number, such as 1.3, which "
            "limits the duration itself"
        )


def _reason_without_path(query: Query, column: int, least: int) -> str:
    """Return, as text, why no path satisfies both max_turns and the cap of max_detour.

    The text is "" without max_turns, if ``least`` is 0, or if no path satisfies max_turns alone.

    column  column of the limited cost
    least   smallest value of this cost of any path
    """
    cost, turns = query.objectives.optimised[column], index_of_role("turns", query.objectives.optimised)
    if query.max_turns is None or turns is None or not least:
        return ""
    bounded = Graph.from_csr(query.graph.indptr, query.graph.heads, query.graph.costs[:, [column, turns]])
    shortest = pareto_paths(bounded, query.start, query.goals, at_most=[None, query.max_turns])
    if not len(shortest):
        return ""
    factor = math.ceil(1000 * int(shortest.costs[0, 0]) / least) / 1000
    return (
        f"no path with at most {query.max_turns} turns satisfies max_detour: the least {cost.name} of such a path is "
        f"{factor:g} times the least of all paths. Raise max_detour or max_turns"
    )
