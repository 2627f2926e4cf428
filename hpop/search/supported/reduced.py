"""What a worker does for a weight: one shortest path in the graph with reduced costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import IntArray
from hpop.search.supported.weights import Vector

NONE = np.zeros(0, np.int64)


class Task(NamedTuple):
    """A path of least weighted cost is sought.

    weights  of the reduced costs
    limit    what the least weighted sum is known not to exceed
    blocked  (b,)  arcs of the reduced graph that it must not take
    """

    weights: Vector
    limit: int
    blocked: IntArray = NONE


@dataclass(frozen=True, eq=False)
class Reduced:
    """What a worker needs: the graph without dead ends, costs reduced by the bounds of the cost-to-go.

    The reduced cost of an arc, c(u, v) + h(v) - h(u), is not negative, and along a path from the source to a target
    adds up to its cost minus the ideal.

    indptr, heads  arcs in compressed rows
    costs          (m, k)  reduced, in int32 where they fit
    source         node
    is_target      (n,)
    largest        (k,)    greatest reduced cost of an arc
    """

    indptr: IntArray
    heads: Any
    costs: Any
    source: int
    is_target: Any
    largest: tuple[int, ...]


def solve_weight(data: Reduced, task: Task) -> IntArray:
    """Arcs (in the reduced graph) of a path of least weighted cost."""
    arcs = least_path(data, task, lambda kernel, *arguments: kernel(*arguments))
    if arcs is None:
        raise AssertionError(f"no path within the limit {task}: the graph's bounds are wrong, please report")
    return arcs


def least_path(data: Reduced, task: Task, call: Any) -> IntArray | None:
    """The same, the kernel called by ``call``; None if no path is within the limit."""
    from hpop.search.supported.weighted_path import encoded, weighted_path  # numba: on first use

    weights, limit = encoded(task.weights, task.limit, data.largest)
    heads = data.heads
    if task.blocked.size:  # as loops, which no shortest path takes
        heads = heads.copy()
        heads[task.blocked] = np.searchsorted(data.indptr, task.blocked, side="right") - 1
    arcs: IntArray = call(weighted_path, data.indptr, heads, data.costs, data.source, data.is_target, weights, limit)
    return None if arcs.size and arcs[0] < 0 else arcs
