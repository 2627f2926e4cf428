"""A time-mean optimised itself, not its integral, under a cap on the duration: for planners on graphs of states.

A mean is a ratio S/T, so it does not add up, and loops through good places lower it for ever. Under a cap on T its
front is finite, and :func:`hpop.planners.search.capped_mean_paths` finds it exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from hpop.criteria import Duration
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.planners.base import Candidates, Objectives, edge_objectives, integral_of
from hpop.planners.search import Graph, capped_mean_paths, pareto_paths
from hpop.planners.search.checkpoint import CheckpointSpec
from hpop.planners.state_graph import MAX_COSTS, GraphQuery
from hpop.status import Budget, ProgressCallback, Status

LARGEST_DETOUR = 1000
INTEGRAL, DURATION, OTHERS = range(3)  # columns of the graph; the other costs follow


def check_detour(max_detour: Any) -> None:
    """Raise OptionError unless it can be a cap over the least duration."""
    number = isinstance(max_detour, int | float) and not isinstance(max_detour, bool)
    if not (number and 1 <= max_detour <= LARGEST_DETOUR):
        raise OptionError(
            f"max_detour must be a number from 1 to {LARGEST_DETOUR}, the longest duration over the least of any path, "
            f"got {max_detour!r}; take one such as 1.3, or leave it out: then the mean's integral is minimised"
        )


def mean_objectives(criteria: Sequence[Criterion], planner_name: str) -> Objectives:
    """What the graph must add up: the integral of the one time-mean, the duration, then the other costs.

    Raises OptionError where no criterion is a time-mean, or too many are asked for, UnsupportedCriterion for a second
    time-mean.
    """
    means = [c for c in criteria if c.aggregate == "time-mean"]
    if not means:
        raise OptionError(
            "max_detour caps the duration so that a time-mean can be optimised itself, but none of "
            f"{', '.join(c.name for c in criteria)} is one; leave max_detour out, or add one such as 'obstruction'"
        )
    if len(means) > 1:
        raise UnsupportedCriterion(
            f"{planner_name} optimises one time-mean under max_detour, got {', '.join(c.name for c in means)}. Ask for "
            f"{integral_of(means[1]).name} in the place of {means[1].name}, leave one out, or leave max_detour out: "
            "then the integrals are minimised."
        )
    summed = [c for c in criteria if c is not means[0] and c.aggregate != "trajectory"]
    if len(summed) > MAX_COSTS - OTHERS:
        raise OptionError(
            f"with max_detour the exact search takes at most {MAX_COSTS - OTHERS} costs beside the mean, got "
            f"{len(summed)}"
        )
    memory = edge_objectives(
        [cast(Criterion, Duration()), *(c for c in criteria if c.aggregate == "trajectory")], planner_name
    )
    return replace(memory, optimised=(integral_of(means[0]), *memory.optimised, *summed))


def exact_mean(
    query: GraphQuery,
    criteria: Sequence[Criterion],
    max_detour: float,
    name: str,
    budget: Budget,
    progress: ProgressCallback | None = None,
    checkpoint: CheckpointSpec | None = None,
) -> Candidates:
    """All paths that are non-dominated in the mean itself and the other costs, as the candidates of planner ``name``.

    query       with the columns of :func:`mean_objectives`
    max_detour  no path may last longer than this many times the shortest
    """
    graph, quanta = query.graph, query.quanta
    durations = Graph.from_csr(graph.indptr, graph.heads, graph.costs[:, [DURATION]])
    shortest = pareto_paths(durations, query.start, query.goals, progress=progress)
    if shortest.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    least = int(shortest.costs[0, 0]) if len(shortest) else 0
    paths = capped_mean_paths(
        graph,
        query.start,
        query.goals,
        integral=INTEGRAL,
        duration=DURATION,
        cap=int(max_detour * least),
        budget=budget,
        progress=progress,
        checkpoint=checkpoint,
    )
    optimised = tuple(c for c in criteria if c.aggregate != "trajectory")
    where = f"{query.space.words} for ({', '.join(c.name for c in optimised)})"
    cap = f"duration <= {paths.cap * quanta[DURATION]:.6g} s ({max_detour:g} times the least)"
    if paths.status is Status.NO_PATH:
        claim = f"exact on {where}"
    elif paths.status.is_final:
        claim = f"exact under {cap} on {where}, edge costs rounded to their quanta; nothing is claimed beyond the cap"
    else:
        claim = f"incomplete ({paths.status}): paths of {cap} on {where}; others are missing, and may be better"
    found = query.candidates(
        name,
        paths,
        claim,
        provenance=[{"max_detour": max_detour}] * len(paths),
        stats={
            "method": paths.stats.method,
            "labels_generated": paths.stats.labels_generated,
            "labels_expanded": paths.stats.labels_expanded,
            "peak_memory": paths.stats.peak_memory,
            "least_duration": least * quanta[DURATION],
            "duration_cap": paths.cap * quanta[DURATION],
        },
    )
    # In the place of S and T their ratio. Both are rounded up by less than a quantum an edge.
    unit, time = quanta[INTEGRAL] / quanta[DURATION], np.maximum(found.planned[:, DURATION], quanta[DURATION])
    mean = paths.means * unit
    rounding = (found.tolerance[:, INTEGRAL] + mean * found.tolerance[:, DURATION]) / time
    place = next(j for j, c in enumerate(optimised) if c.aggregate == "time-mean")
    return replace(
        found,
        objectives=optimised,
        planned=np.insert(found.planned[:, OTHERS:], place, mean, axis=1),
        tolerance=np.insert(found.tolerance[:, OTHERS:], place, rounding, axis=1),
    )
