"""An oracle: all vectors of all walks, state by state and tick by tick, with no dominance at all. Plain Python."""

from __future__ import annotations

import math

from tests.search.timed.instances import TimedQuery
from tests.search.timed.semantics import Semantics, Vector

Reached = list[list[set[Vector]]]  # by tick and node


class TooMany(Exception):
    """More vectors than memory and time are there for; ask :mod:`.expansion` about the query."""


def all_vectors(query: TimedQuery, most: float = math.inf) -> Reached:
    """Costs of all walks that arrive at a node at a tick by an arc, or begin there; TooMany where these are."""
    of = Semantics(query.graph)
    nodes, ticks = range(of.nodes), range(of.last + 1)
    arrived: Reached = [[set() for _ in nodes] for _ in ticks]
    held: Reached = [[set() for _ in nodes] for _ in ticks]
    arrived[0][query.source].add((0,) * len(of.aggregates))
    count = 0
    for t in ticks:
        for v in nodes:
            count += len(arrived[t][v]) + len(held[t][v])
            if count > most:
                raise TooMany
            for end in range(t + of.hold, of.last + 1) if of.hold is not None and arrived[t][v] else ():
                if of.may_stand(of.place[v], t, end):
                    costs = of.hold_costs(of.place[v], t, end)
                    held[end][v] |= {of.add(g, costs) for g in arrived[t][v]}
            leaving = arrived[t][v] | held[t][v]
            for arc in of.arcs_of[v] if leaving else ():
                end = t + of.durations[arc]
                if end <= of.last and of.may_leave(arc, v, t):
                    costs = of.arc_costs(arc, v, t)
                    arrived[end][of.heads[arc]] |= {of.add(g, costs) for g in leaving}
    return arrived


def nondominated(vectors: set[Vector]) -> list[Vector]:
    """Those that no other one is at most as large as in every component, in order."""
    kept: list[Vector] = []
    for v in sorted(vectors):  # what dominates a vector comes before it
        if not any(all(a <= b for a, b in zip(w, v, strict=True)) for w in kept):
            kept.append(v)
    return kept


def front_by_enumeration(query: TimedQuery, most: float = math.inf) -> list[Vector]:
    """All non-dominated vectors of walks that end at a target in time; TooMany where walks have more than `most`."""
    return nondominated({g for reached in all_vectors(query, most) for node in query.targets for g in reached[node]})
