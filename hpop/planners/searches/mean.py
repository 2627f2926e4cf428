"""A time-mean optimised itself, not its integral, under a cap: for planners on graphs of states.

A mean is a ratio S/T, so it does not add up, and loops through good places lower it for ever. Under a cap on T, or on
the length and the number of turns, its front is finite, and :func:`hpop.search.capped_mean_paths` finds it
exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeAlias, cast

import numpy as np

from hpop.base.options import real
from hpop.criteria import Duration
from hpop.criteria.base import Criterion, Role, index_of_role
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import OFF, ROUNDED, assemble
from hpop.planners.graphs.query import MAX_COSTS, Query
from hpop.planners.objectives import Objectives, edge_objectives, integral_of
from hpop.planners.spending import Exhausted, Spending
from hpop.runtime.status import Status
from hpop.search import Graph, capped_mean_paths, pareto_paths

DetourSpec: TypeAlias = float | Mapping[str, float]
LARGEST_DETOUR = 1000
CAPPED: tuple[Role, ...] = ("duration", "length")
INTEGRAL, DURATION, OTHERS = range(3)  # columns of the graph; the other costs follow


@dataclass(frozen=True)
class Detour:
    """The longest way over the least of any path, in the duration or in the length.

    cost    the role of the criterion
    factor  from 1 to 1000
    """

    cost: Role
    factor: float

    @classmethod
    def of(cls, max_detour: Any, max_turns: int | None) -> Self:
        """From a planner's options: a factor on the duration, or ``{cost: factor}``.

        Raises OptionError unless it makes the duration finite. Turns in place have no length, so a cap on the length
        alone does not; with a bound on the turns it does, as each lasts a finite time.
        """
        spec: Mapping[Any, Any] = max_detour if isinstance(max_detour, Mapping) else {"duration": max_detour}
        cost, factor = next(iter(spec.items()), ("", 0))
        kind = "the longest duration over the least of any path, or {'length': the same of the length},"
        hint = "take one such as 1.3, or leave it out: then the mean's integral is minimised"
        known = len(spec) == 1 and cost in CAPPED
        factor = real("max_detour", factor if known else max_detour, 1, LARGEST_DETOUR, kind, hint=hint)
        if cost == "length" and max_turns is None:
            raise OptionError(
                "max_detour caps the length, but turning in place has none: a path could turn for ever where the mean "
                "is low. Give max_turns as well, such as max_turns=8, or cap the duration, such as max_detour=1.3"
            )
        return cls(cast(Role, cost), float(factor))

    @property
    def option(self) -> DetourSpec:
        """The planner's option, JSON-able."""
        return self.factor if self.cost == "duration" else {self.cost: self.factor}


def mean_objectives(criteria: Sequence[Criterion], planner_name: str) -> Objectives:
    """What the graph must add up: the integral of the one time-mean, the duration, then the other costs.

    Raises OptionError where no criterion is a time-mean, or too many are asked for, UnsupportedCriterion for a second
    time-mean.
    """
    means = [c for c in criteria if c.aggregate == "time-mean"]
    if not means:
        raise OptionError(
            "max_detour is a cap under which a time-mean can be optimised itself, but none of "
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


def mean_criteria(criteria: Sequence[Criterion], objectives: Objectives) -> Objectives:
    """Objectives as they are reported: the mean itself in the place of what its graph adds up."""
    return replace(objectives, optimised=tuple(c for c in criteria if c.aggregate != "trajectory"))


def exact_mean(
    query: Query,
    criteria: Sequence[Criterion],
    detour: Detour,
    name: str,
    spending: Spending,
) -> Candidates:
    """All paths that are non-dominated in the mean itself and the other costs, as the candidates of planner ``name``.

    query   with the columns of :func:`mean_objectives`; its bound on the turns holds as well
    detour  no path may exceed this

    Raises OptionError where a cost that is bounded is not among the criteria, Exhausted where a limit is passed before
    the search.
    """
    graph, quanta, at_most = query.graph, query.quanta, query.at_most()
    column = _column(query, detour)
    progress = spending.limits.progress
    alone = Graph.from_csr(graph.indptr, graph.heads, graph.costs[:, [column]])
    shortest = pareto_paths(
        alone, query.start, query.goals, budget=replace(spending.left(), max_labels=None), progress=progress
    )
    if shortest.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if not shortest.status.is_final:
        raise Exhausted(shortest.status, f"the least {detour.cost} was looked for")
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
    where = f"{query.space.words} for ({', '.join(c.name for c in optimised)})"
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
    found = assemble(
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
        reason=_too_tight(query, column, least) if paths.status is Status.NO_PATH else "",
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


def _column(query: Query, detour: Detour) -> int:
    """The graph's column of the cost that is capped."""
    column = index_of_role(detour.cost, query.objectives.optimised)
    if column is None:
        names = [criterion.name for criterion in query.objectives.optimised]
        raise OptionError(
            f"max_detour caps the cost {detour.cost!r}, but beside the mean only {', '.join(names[OTHERS:])} are "
            f"searched for; list it among the criteria, or cap the duration: max_detour={detour.factor:g}"
        )
    return column


def _refuse_endless(query: Query, bounded: Sequence[int]) -> None:
    """Raise OptionError where motions take time and nothing that is bounded: a head that tilts, or turns back."""
    costs = query.graph.costs
    if ((costs[:, DURATION] > 0) & (costs[:, bounded] == 0).all(axis=1)).any():
        names = " and ".join(query.objectives.optimised[j].name for j in bounded)
        raise OptionError(
            f"motions that take time but cost no {names} could go on for ever where the mean is low; cap the duration "
            "in the place of the length, such as max_detour=1.3"
        )


def _too_tight(query: Query, column: int, least: int) -> str:
    """Why no path keeps the cap and the bound on the turns, in words; "" where one of them alone is not kept."""
    cost, turns = query.objectives.optimised[column], index_of_role("turns", query.objectives.optimised)
    if query.max_turns is None or turns is None or not least:
        return ""
    bounded = Graph.from_csr(query.graph.indptr, query.graph.heads, query.graph.costs[:, [column, turns]])
    shortest = pareto_paths(bounded, query.start, query.goals, at_most=[None, query.max_turns])
    if not len(shortest):
        return ""
    factor = math.ceil(1000 * int(shortest.costs[0, 0]) / least) / 1000
    return (
        f"no path of at most {query.max_turns} turns keeps the cap: their least {cost.name} is {factor:g} times the "
        "least of all paths. Raise max_detour or max_turns"
    )
