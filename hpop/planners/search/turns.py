"""The groups that turns make of nodes, and what they save the search.

Call the arcs with a positive cost in one chosen column (the index) turns. They make groups where every
ordered pair of nodes joined by turns is joined by exactly one, and no turn costs more, in any cost, than two
turns on the same way. Both are checked, arc by arc, so nothing is assumed of the graph. Then

- a path never needs two turns in a row. So a label is made only where a plain arc arrives (or a turn reaches
  a target); its successors are "an arc" and "a turn, then an arc".
- if no turn costs anything in the first cost of the search, a label g at a node of a group is also dominated
  if some closed label of any node of the group is nowhere larger after the dearest turn of the group: that
  one could turn to this node. First costs compare, because their bound is the same at all nodes of a group.
  On a lattice of 1.3 million arcs that left a quarter of the expansions.

Becerra et al. 2020 (arXiv 2002.10696) have such turns between the headings of a cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.planners.search.kernels import kernel


@kernel
def find_groups(
    start: IntArray, split: IntArray, arcs: NDArray[Any], is_max: NDArray[np.bool_], group: IntArray
) -> IntArray:
    """Number the groups (n,), -1 for nodes without turns.

    Returns the dearest turn of each group (groups, k); no rows where turns do not make groups.
    """
    n, k = len(split), len(is_max)
    nothing = np.zeros((0, k), np.int64)
    seen = np.full(n, -1, np.int64)
    by = np.zeros(n, np.int64)
    groups = 0
    group[:] = -1
    for u in range(n):
        size = start[u + 1] - split[u]
        for a in range(split[u], start[u + 1]):
            v = arcs[a, 0]
            if seen[v] == u or start[v + 1] - split[v] != size:
                return nothing
            seen[v] = u
            by[v] = a
        for a in range(split[u], start[u + 1]):
            for b in range(split[arcs[a, 0]], start[arcs[a, 0] + 1]):
                w = arcs[b, 0]
                if w == u:
                    continue
                if seen[w] != u:
                    return nothing
                for j in range(1, k + 1):
                    two = max(arcs[a, j], arcs[b, j]) if is_max[j - 1] else arcs[a, j] + arcs[b, j]
                    if arcs[by[w], j] > two:
                        return nothing
        if size > 0 and group[u] < 0:
            group[u] = groups
            for a in range(split[u], start[u + 1]):
                group[arcs[a, 0]] = groups
            groups += 1
    dearest = np.zeros((groups, k), np.int64)
    for u in range(n):
        for a in range(split[u], start[u + 1]):
            for j in range(k):
                dearest[group[u], j] = max(dearest[group[u], j], arcs[a, j + 1])
    return dearest


@kernel
def most_successors(start: IntArray, split: IntArray, arcs: NDArray[Any]) -> int:
    """Count the labels that one expansion can make at most."""
    most = 0
    for u in range(len(split)):
        count = split[u] - start[u]
        for a in range(split[u], start[u + 1]):
            w = arcs[a, 0]
            count += 1 + split[w] - start[w]
        most = max(most, count)
    return most
