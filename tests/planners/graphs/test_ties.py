"""Claims: the copy of the costs that breaks ties by turns counts as memory, and next to nothing is taken beside it."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs.arcs import COPIED, TIE_TURNS, graph_with_tie_break
from hpop.planners.graphs.query import Query
from hpop.planners.spending import Exhausted, Spending
from hpop.runtime.limits import Budget

WORLD = hpop.World.from_polygons([shapely.box(3, 0, 3.5, 3)], extent=shapely.box(0, 0, 8, 6))
ROUND = hpop.DifferentialDrive(radius=0.3)


def asked(*names: str, goal: tuple[float, float, float | None] = (7.0, 1.0, None)) -> hpop.Problem:
    return hpop.Problem(WORLD, ROUND, (1.0, 1.0, 0.0), goal, names)


def query(problem: hpop.Problem, step: float = 0.125) -> Query:
    return Lattice(step=step).query(problem)


def test_a_tie_costs_as_many_units_more_as_there_are_turns():
    for goal in ((7.0, 1.0, None), (6.93, 1.07, 0.3)):  # on the lattice, and joined to it
        found = query(asked("length", goal=goal), 0.5)
        graph, space = found.graph, found.space
        places = space.places(np.arange(graph.nodes))
        tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
        expected = (places[tails] == places[graph.heads]).astype(int)
        if goal[2] is not None:
            joins = np.isin(tails, [found.start, *found.goals]) | np.isin(graph.heads, found.goals)
            assert space.turned[joins].max() == 2
            expected[joins] = space.turned[joins]
        assert (found.graph_with_tie_break.costs[:, 0] == graph.costs[:, 0] * TIE_TURNS + expected).all()


def test_where_a_cost_charges_for_every_turn_nothing_is_copied():
    assert query(asked("length", "turns"), 0.5).graph_with_tie_break is None


def test_a_copy_for_which_there_is_no_room_is_a_memory_limit():
    problem, planner = asked("length"), Lattice(step=0.25)
    found = problem.solve(planner)
    room = found.runs[-1]["edges"] * (24 + 7)  # bytes: of an arc with one cost, and less than that cost again
    front = problem.solve(replace(planner, max_memory=room))
    assert (found.status, front.status, len(front)) == ("complete", "memory limit", 0)
    assert any("costs were copied, to prefer paths with fewer turns, which takes" in note for note in front.notes)


def test_the_search_is_given_what_the_copy_leaves():
    problem, spending = asked("length"), Spending(Budget(max_memory=10**9))
    planner = Lattice(step=0.25)
    found = planner.query(problem, spending=spending)
    found.break_ties()
    assert spending.memory >= found.graph.costs.nbytes + found.graph_with_tie_break.costs.nbytes
    assert spending.left().max_memory == 10**9 - spending.memory


def test_no_more_is_taken_than_is_counted():
    found = query(asked("length", "exposure"))
    graph, turned = found.graph, found.space.turned
    tracemalloc.start()
    assert graph_with_tie_break(graph, turned, Spending()) is not None
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.2 * graph.costs.nbytes + 2_000_000  # blocks
    with pytest.raises(Exhausted, match="memory limit while costs were copied"):
        graph_with_tie_break(graph, turned, Spending(Budget(max_memory=graph.costs.nbytes - 1)))


def test_the_copy_of_a_first_stage_is_freed_and_given_back(monkeypatch):
    copies = []

    class Watched(Spending):
        def hold(self, memory, doing):
            super().hold(memory, doing)
            copies.extend([memory] * (doing == COPIED))

        def release(self, memory):
            super().release(memory)
            copies.remove(memory)

    monkeypatch.setattr("hpop.planners.graphs.lattice.MOST_FIRST", 40)
    monkeypatch.setattr(Lattice, "spending", lambda planner, problem, progress: Watched())
    *_, front = asked("length").fronts([Lattice(step=0.25)], stage=lambda _: None)
    assert front.status == "complete"
    assert copies == [8 * front.runs[-1]["edges"]]  # that of the whole lattice, whose one cost has 8 bytes an edge
