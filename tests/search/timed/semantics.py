"""Meaning of a timed graph, read from its tables one number at a time, in plain Python; and walks replayed by it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from hpop.base.arrays import IntArray
from hpop.search.timed.graph import TimedGraph

Vector = tuple[int, ...]
HOLD = -1
PART = 20  # bits: rates of sums are in 2**-20 counts


class Semantics:
    """May one leave, may one stand, and what does it cost."""

    def __init__(self, graph: TimedGraph) -> None:
        static = graph.graph
        self.nodes, self.horizon, self.hold = static.nodes, graph.horizon, graph.hold
        self.aggregates, self.heads = static.aggregates, static.heads.tolist()
        self.static, self.durations = static.costs.tolist(), graph.durations.tolist()
        self.arcs_of = [range(static.indptr[u], static.indptr[u + 1]) for u in range(self.nodes)]
        self.row = dict(zip(graph.timed.tolist(), graph.rows.tolist(), strict=True))
        self.tables = {j: table.tolist() for j, table in graph.costs.items()}
        self.blocked, self.cut = graph.blocked.tolist(), graph.cut.tolist()
        self.place, self.stays = graph.place.tolist(), graph.stays.tolist()
        self.standing = {j: table.tolist() for j, table in graph.standing.items()}
        self.rate = graph.rate.tolist()
        self.last = graph.arrive_by if graph.arrive_by is not None else self._late()

    def _late(self) -> int:
        """Whoever arrives later arrives as cheaply without the loops and holds after the horizon."""
        longest = max(self.durations, default=0)
        return self.horizon + max(self.hold or 0, longest) + self.nodes * longest

    def add(self, costs: Vector, more: Iterable[int]) -> Vector:
        """Costs of a walk that goes on."""
        columns = zip(costs, more, self.aggregates, strict=True)
        return tuple(max(a, b) if how == "max" else a + b for a, b, how in columns)

    def may_stand(self, place: int, begin: int, end: int) -> bool:
        """Return True if no person comes too near from one tick to another."""
        return not any(self.cut[place][min(t, self.horizon)] for t in range(begin, end))

    def may_leave(self, arc: int, tail: int, t: int) -> bool:
        """Return True if an arc is open at a tick."""
        t = min(t, self.horizon)
        if arc in self.row:
            return not self.blocked[self.row[arc]][t]
        return not self.stays[arc] or self.may_stand(self.place[tail], t, t + self.durations[arc])

    def arc_costs(self, arc: int, tail: int, t: int) -> list[int]:
        """Costs of an arc that is left for at a tick; the last column stands for every later one."""
        t = min(t, self.horizon)
        costs = list(self.static[arc])
        if arc in self.row:
            for j, table in self.tables.items():
                costs[j] = table[self.row[arc]][t]
        elif self.stays[arc]:
            for j in self.standing:
                while_there = self._standing_cost(j, self.place[tail], t, t + self.durations[arc])
                costs[j] = max(costs[j], while_there) if self.aggregates[j] == "max" else costs[j] + while_there
        return costs

    def hold_costs(self, place: int, begin: int, end: int) -> list[int]:
        """Costs of a hold."""
        return [self._standing_cost(j, place, begin, end) for j in range(len(self.aggregates))]

    def _standing_cost(self, j: int, place: int, begin: int, end: int) -> int:
        if self.aggregates[j] == "max":
            if j not in self.standing:
                return int(self.rate[place][j])
            return max(int(self.standing[j][place][min(t, self.horizon)]) for t in range(begin, end))
        return self._omega(j, place, end) - self._omega(j, place, begin)

    def _omega(self, j: int, place: int, t: int) -> int:
        if j not in self.standing:
            return int(self.rate[place][j] * t >> PART)
        after = max(0, t - self.horizon)
        return int(self.standing[j][place][min(t, self.horizon)] + (self.rate[place][j] * after >> PART))


class TimedWalks(Protocol):
    """Costs (n, k); of each walk nodes (s + 1,), arcs (s,) as they were given or -1 of a hold, ticks (s + 1,)."""

    @property
    def costs(self) -> IntArray: ...
    def __len__(self) -> int: ...
    def steps(self, i: int) -> tuple[IntArray, IntArray, IntArray]: ...


def check_timed_walks(graph: TimedGraph, walks: TimedWalks, source: int, targets: Iterable[int]) -> None:
    """Each is a walk that the graph allows, from the source at tick 0 to a target in time, and costs what is told."""
    of, place_of = Semantics(graph), {int(arc): place for place, arc in enumerate(graph.graph.arc)}
    for i, claimed in enumerate(walks.costs.tolist()):
        nodes, arcs, ticks = (column.tolist() for column in walks.steps(i))
        assert len(nodes) == len(ticks) == len(arcs) + 1
        assert (nodes[0], ticks[0]) == (source, 0)
        assert nodes[-1] in set(targets)
        assert graph.arrive_by is None or ticks[-1] <= graph.arrive_by
        costs: Vector = (0,) * len(of.aggregates)
        held = False
        for tail, head, given, begin, end in zip(nodes[:-1], nodes[1:], arcs, ticks[:-1], ticks[1:], strict=True):
            if given == HOLD:
                assert of.hold is not None
                assert head == tail
                assert not held, "two holds follow each other"
                assert end - begin >= of.hold
                assert of.may_stand(of.place[tail], begin, end)
                costs = of.add(costs, of.hold_costs(of.place[tail], begin, end))
            else:
                arc = place_of[given]
                assert arc in of.arcs_of[tail]
                assert head == of.heads[arc]
                assert end - begin == of.durations[arc]
                assert of.may_leave(arc, tail, begin)
                costs = of.add(costs, of.arc_costs(arc, tail, begin))
            held = given == HOLD
        assert not held, "nobody holds at the goal"
        assert list(costs) == claimed
