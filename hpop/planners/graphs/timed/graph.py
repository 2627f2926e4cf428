"""A graph of states on a clock: what a search takes, and what of it is known before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hpop.base.arrays import BoolArray, FloatArray
from hpop.models.execution import Ramps
from hpop.planners.graphs.timed.clock import Clock
from hpop.planners.graphs.timed.company import Company
from hpop.planners.graphs.timed.legs import TimedArcs
from hpop.planners.graphs.timed.notice import Attention
from hpop.planners.graphs.timed.safety import Safety
from hpop.search import Graph
from hpop.search.timed.graph import TimedGraph


@dataclass(frozen=True, eq=False)
class Timed:
    """A graph of states on a clock.

    graph       what a search takes
    quanta      (k,)  what one count of each cost is, in the criteria's units
    lasting     the column of the duration, which is counted in ticks; None if it is no cost
    start       node of the start, at which plans begin
    arcs        the same arcs as motions
    clock
    company     who moves
    ramps       by how much executions are off; None where that is not known
    hold        s  that the robot stands at least when it waits, or None
    overlooked  (k,)  by how much costs may differ in what is not noticed: a second, or at the worst moment
    pairs       how many costs of an arc or a place at a tick were reckoned
    seconds     s that making it took
    safety      what keeps the robot clear of people
    attention   what criteria said of them
    people_stop whether people who would walk up to the robot where it starts are taken to stop before it
    """

    graph: TimedGraph
    quanta: FloatArray
    lasting: int | None
    start: int
    arcs: TimedArcs
    clock: Clock
    company: Company
    ramps: Ramps | None
    hold: float | None
    overlooked: FloatArray
    pairs: int
    seconds: float
    safety: Safety
    attention: Attention
    people_stop: bool = False

    @property
    def counts(self) -> dict[str, Any]:
        """How large it is, for the stats of a planner."""
        return {
            "ticks": self.graph.horizon,
            "timed_edges": int(self.graph.timed.size),
            "costs_by_time": self.pairs,
            "table_seconds": self.seconds,
        }


@dataclass(frozen=True, eq=False)
class LaidOut:
    """What is there of a graph already that is put on a clock again and again, while people change.

    plain   its arcs, and what they cost by those criteria that do not read the time (:func:`.reading.reading_time`)
    closed  (m,)  arcs that nobody takes
    begin   tick from which on the robot may be at the start
    near    nodes where plans may begin within somebody's margin, and when, s on the clock: the robot may leave there
    arcs    as they were timed before; None if never
    """

    plain: Graph
    closed: BoolArray
    begin: int = 0
    near: tuple[tuple[int, float], ...] = ()
    arcs: TimedArcs | None = None
