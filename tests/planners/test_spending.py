"""A planner's limits hold while its graph is built, and building is the same whatever the number of cores."""

import os
import threading
import time
from dataclasses import dataclass

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import criteria
from hpop.planners import spending
from hpop.planners.graph_planners import Lattice, Roadmap, WeightedSum
from hpop.planners.graphs import arcs
from hpop.planners.spending import Exhausted, Spending
from hpop.runtime import compiled
from hpop.runtime.limits import Budget
from tests.interrupted import interrupted_locks
from tests.watched import watched

WORLD = hpop.World.from_polygons([shapely.box(3, 0, 3.5, 3)], extent=shapely.box(0, 0, 8, 6))
ROUND = hpop.DifferentialDrive(radius=0.3)


@pytest.fixture(autouse=True)
def costed():
    with watched() as asked_for:
        yield asked_for


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(arcs, "BLOCK", 1000)


def asked(*names, world=WORLD):
    return hpop.Problem(world, ROUND, (1.0, 1.0, 0.0), (7.0, 1.0, 0.0), names or ("watched", "turns"))


@pytest.mark.parametrize("planner", [Lattice, WeightedSum, Roadmap])
def test_a_limit_that_ends_while_the_graph_is_built_is_a_result(planner, costed):
    front = asked().solve(planner(time_limit=1e-9))
    assert (front.status, len(front), costed) == ("time limit", 0, [])
    (note,) = (note for note in front.runs[-1]["notes"] if note.startswith("time limit"))
    assert "take a larger step" in note
    assert "raise time_limit" in note
    assert "incomplete (time limit): its graph was not built, so nothing was searched" in front.certificate


@pytest.mark.parametrize("planner", [Lattice, Roadmap])
def test_a_graph_too_large_for_the_memory_is_refused_before_it_is_costed(planner, costed):
    front = asked().solve(planner(max_memory=300_000))
    assert (front.status, len(front), costed) == ("memory limit", 0, [])
    assert any("MB" in note and "raise max_memory" in note for note in front.runs[-1]["notes"])


def test_little_memory_is_told_as_what_it_is():
    (note,) = (note for note in asked().solve(Lattice(max_memory=1000)).notes if note.startswith("memory limit"))
    taken = float(note.split("which takes ")[1].split(" MB")[0])
    assert 0.001 < taken < 10


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="the system does not tell the size of a process")
def test_memory_that_nobody_counts_shows_in_the_size_of_the_process(monkeypatch):
    monkeypatch.setattr(spending, "BESIDE", 50_000_000)
    monkeypatch.setattr(spending, "EVERY", 0.0)
    hoard = []

    @hpop.criterion("hoarding", group="C", unit="m", aggregate="sum")
    @dataclass(frozen=True)
    class Hoarding:
        """A criterion of one's own that keeps 40 MB each time that it is asked."""

        def cost(self, m):
            hoard.append(np.ones(5_000_000))
            return m.base.length

    try:
        front = asked("hoarding", "turns").solve(Lattice(step=0.25, max_memory=100_000_000))
    finally:
        del criteria._types["hoarding"]
    assert (front.status, len(front)) == ("memory limit", 0)
    assert any("the process had grown by" in note and "raise max_memory" in note for note in front.notes)
    assert 3 < len(hoard) < 20  # 175 MB, and what was begun on every core; the whole graph takes 100 of them


def test_what_a_stage_found_is_kept_when_the_whole_is_not_built_in_time(monkeypatch):
    monkeypatch.setattr("hpop.planners.graphs.lattice.MOST_FIRST", 40)
    problem, planner = asked("length", "turns"), Lattice(step=0.25)
    lattice = planner.lattice(problem)
    room = lattice.size * lattice.headings.count * 20  # bytes: it can be laid out, but not costed
    *_, front = problem.fronts([Lattice(step=0.25, max_memory=room)], stage=lambda _: None)
    assert front.status == "memory limit"
    assert len(front) > 0


def test_an_interruption_ends_building_at_the_next_block(costed):
    with pytest.raises(KeyboardInterrupt):
        asked({"watched": {"interrupted": 3}}).solve(Lattice(step=0.25))
    assert len(costed) <= 3 + 2 * 2 * (spending.CORES + 1)  # of some 40 blocks, of turns and moves each


@pytest.mark.parametrize("number", range(1, 40, 3))
def test_ctrl_c_that_comes_as_a_lock_is_taken_leaves_none_taken(number, monkeypatch):
    """The threads that work on blocks ask for it next, and are waited for."""
    with interrupted_locks(number, monkeypatch), pytest.raises(KeyboardInterrupt):
        list(Spending(Budget()).each(abs, range(60), "a sum was made"))


def test_the_graph_is_the_same_whatever_the_number_of_cores(monkeypatch):
    graphs = []
    for cores in (1, 5):
        monkeypatch.setattr(spending, "CORES", cores)
        problem = asked("length", "exposure", "rotation", "worst_obstruction")
        graphs.append(Lattice(step=0.5).lattice(problem).graph(problem.criteria))
    for name in ("indptr", "heads", "costs"):
        assert (getattr(graphs[0], name) == getattr(graphs[1], name)).all()


def test_on_one_core_no_two_blocks_are_worked_on_at_once():
    """So work beside something else leaves it a core; on two, the second block begins while the third is waited for."""
    began, together = [], []
    lock = threading.Lock()

    def work(block):
        with lock:
            began.append(block)
            together.append(len(began))
        time.sleep(0.002)
        with lock:
            began.remove(block)
        return block

    assert list(Spending(cores=1).each(work, range(6), "blocks were counted")) == list(range(6))
    assert max(together) == 1


def test_what_is_spent_is_taken_from_what_the_search_may_spend():
    spent = Spending(Budget(time_limit=100.0, max_memory=1000, max_labels=7), spent=40.0)
    spent.hold(300, "a graph was built")
    left = spent.left()
    assert (left.max_memory, left.max_labels) == (700, 7)
    assert left.time_limit == pytest.approx(50.0, abs=5.0)  # a tenth is for the evaluation of what is found
    with pytest.raises(Exhausted, match="memory limit"):
        spent.hold(701, "a graph was built")


def test_time_that_others_take_is_not_charged(monkeypatch):
    clock, compiling = [10.0], [0.0]
    monkeypatch.setattr(spending, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(spending, "_compiling_seconds", lambda: compiling[0])
    spent = Spending(Budget(time_limit=1.0))
    clock[0] = 12.0
    with spent.paused():
        clock[0], compiling[0] = 112.0, 90.0  # what compiles meanwhile is not given back twice
    clock[0] = 115.0
    assert spent.seconds() == 5.0


def test_time_that_kernels_take_to_compile_is_not_charged(monkeypatch):
    ticks = iter([10.0, 115.0])
    monkeypatch.setattr(spending, "perf_counter", lambda: next(ticks))
    spent = Spending(Budget(time_limit=1.0))
    before = compiled.compiling_seconds()

    @compiled.numba.njit
    def inner(x):
        return x + 1

    @compiled.numba.njit
    def outer(x):
        return inner(x) + inner(x + 0.5)

    outer(1)
    took = compiled.compiling_seconds() - before
    assert took > 0
    assert spent.seconds() == pytest.approx(105.0 - took)


def test_costs_in_small_integers_are_the_costs():
    column = arcs.Quanta(4)
    for part, counts in ((slice(0, 2), [3, 70_000]), (slice(2, 4), [2**40, 5])):
        column.write(part, np.array(counts))
    assert arcs.table([column.counts], 4)[:, 0].tolist() == [3, 70_000, 2**40, 5]
