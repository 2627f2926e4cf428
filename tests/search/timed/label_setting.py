"""Label setting in plain Python under any rule of dominance, to see which rules lose vectors."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tests.search.timed.enumeration import nondominated
from tests.search.timed.instances import TimedQuery
from tests.search.timed.semantics import Semantics, Vector

Label = tuple[int, Vector]  # its tick and its costs
Rule = Callable[[Semantics, int, Label, Label], bool]  # at a node: does the first make the second superfluous?


def front_by_labels(query: TimedQuery, rule: Rule, *, at_once: bool = False) -> list[Vector]:
    """Return the front if labels are dropped by a rule; ``at_once``: each arc is left for as soon as it opens."""
    of = Semantics(query.graph)
    kept: list[list[Label]] = [[] for _ in range(of.nodes)]
    buckets: list[list[tuple[int, Vector]]] = [[] for _ in range(of.last + 1)]
    buckets[0].append((query.source, (0,) * len(of.aggregates)))
    for t, bucket in enumerate(buckets):
        for v, g in sorted(bucket):
            if any(rule(of, v, a, (t, g)) for a in kept[v]):
                continue
            kept[v].append((t, g))
            for arc in of.arcs_of[v]:
                for begin, costs in _departures(of, v, t, g):
                    end = begin + of.durations[arc]
                    if of.may_leave(arc, v, begin):
                        if end <= of.last:
                            buckets[end].append((of.heads[arc], of.add(costs, of.arc_costs(arc, v, begin))))
                        if at_once:
                            break
    return nondominated({g for node in query.targets for _, g in kept[node]})


def _departures(of: Semantics, v: int, t: int, g: Vector) -> Iterator[tuple[int, Vector]]:
    """Ticks at which one may leave, and what it has cost by then."""
    yield t, g
    for end in range(t + of.hold, of.last) if of.hold is not None else ():
        if not of.may_stand(of.place[v], t, end):
            return
        yield end, of.add(g, of.hold_costs(of.place[v], t, end))


def at_most(a: Vector, b: Vector) -> bool:
    """Return True if no component of a is larger."""
    return all(x <= y for x, y in zip(a, b, strict=True))


def equal_ticks(of: Semantics, v: int, a: Label, b: Label) -> bool:
    """Sound, whatever is known."""
    return a[0] == b[0] and at_most(a[1], b[1])


def by_waiting(of: Semantics, v: int, a: Label, b: Label) -> bool:
    """Sound: who came earlier waits, and is then no worse."""
    if a[0] == b[0]:
        return at_most(a[1], b[1])
    if of.hold is None or b[0] - a[0] < of.hold or not of.may_stand(of.place[v], a[0], b[0]):
        return False
    return at_most(of.add(a[1], of.hold_costs(of.place[v], a[0], b[0])), b[1])


def time_as_a_cost(of: Semantics, v: int, a: Label, b: Label) -> bool:
    """Not sound: the arrival as one more cost."""
    return a[0] <= b[0] and at_most(a[1], b[1])


def across_cuts(of: Semantics, v: int, a: Label, b: Label) -> bool:
    """Not sound: waiting also where one may not stand meanwhile."""
    if of.hold is None or 0 < b[0] - a[0] < of.hold:
        return False
    waited = of.add(a[1], of.hold_costs(of.place[v], a[0], b[0])) if a[0] < b[0] else a[1]
    return at_most(waited, b[1])


def short_holds(of: Semantics, v: int, a: Label, b: Label) -> bool:
    """Not sound: waiting also for less than a hold lasts."""
    if of.hold is None or not of.may_stand(of.place[v], a[0], b[0]):
        return False
    waited = of.add(a[1], of.hold_costs(of.place[v], a[0], b[0])) if a[0] < b[0] else a[1]
    return at_most(waited, b[1])
