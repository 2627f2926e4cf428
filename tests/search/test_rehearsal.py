"""Kernels compiled beside are those that the search takes: a rehearsal gives them the same types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import shapely

import hpop
import hpop.runtime.compiled
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs.query import Query
from hpop.search import pareto_paths, supported_paths
from hpop.search.machinery import beside
from hpop.search.machinery.beside import ORDER, PARTS, Onset, description, is_first_kernel_missing
from hpop.search.machinery.kernels import signature
from hpop.search.machinery.slices import Clock
from hpop.search.pareto_paths import main_kernels
from hpop.search.rehearsal import _Rehearsal, rehearse

CRITERIA = {"turns": ["exposure", "turns", "length"], "general": ["exposure", "rotation", "turns", "length"]}


def taken(query: Query, monkeypatch: pytest.MonkeyPatch) -> dict[str, set[Any]]:
    """Kernels of a first answer and of an exact search, each with the types that it is called with."""
    seen: dict[str, set[Any]] = {}
    prepare = Clock.prepare

    def noted(self: Clock, compiled: Any, *arguments: Any) -> None:
        seen.setdefault(compiled.py_func.__qualname__, set()).add(signature(arguments))
        prepare(self, compiled, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Clock, "prepare", noted)
        pareto_paths(query.graph, query.start, query.goals)
        supported_paths(query.graph, query.start, query.goals)
    return seen


def rehearsed(aggregates: list[str], turns: int, monkeypatch: pytest.MonkeyPatch) -> dict[str, set[Any]]:
    """Return the signatures that a rehearsal compiles."""
    seen: dict[str, set[Any]] = {}

    def noted(self: _Rehearsal, compiled: Any, *arguments: Any) -> None:
        if self.compiles:
            seen.setdefault(compiled.py_func.__qualname__, set()).add(signature(arguments))

    with monkeypatch.context() as patch:
        patch.setattr(_Rehearsal, "prepare", noted)
        for part in PARTS:
            rehearse(part, aggregates, turns)
    return seen


@pytest.mark.parametrize("kind", CRITERIA)
def test_a_rehearsal_compiles_what_the_search_of_a_lattice_takes(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 4, 4))
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.2), (0.5, 0.5, 0), (3.5, 3.5, None), CRITERIA[kind])
    planner = Lattice(step=0.5)
    query = planner.query(problem)
    search = taken(query, monkeypatch)
    ahead = rehearsed(list(query.graph.aggregates), CRITERIA[kind].index("turns"), monkeypatch)
    assert {
        "advance",
        "trace_paths",
        "settle_groups",
        "pack_arcs",
        "costs_of_least_path",
        "weighted_path",
    } <= ahead.keys()
    for name, types in ahead.items():
        assert types & search[name], name
    assert set(search) <= {
        *ORDER,
        "build_tables",
        "fill_layers",
        "order_chains",
        "arcs_onward",
        "reduce_costs",
        "weighted_path",
    }


def test_what_is_compiled_is_told_with_how_far_it_is() -> None:
    from hpop.search.staircase.kernel import advance

    assert description(advance) == f"advance, {ORDER.index('advance') + 1} of {len(ORDER)} parts of the search (once)"


def test_nothing_is_compiled_beside_unless_asked_for() -> None:
    beside.start_compilers()
    assert not is_first_kernel_missing()
    assert not beside._processes


def test_what_is_compiled_beside_begins_after_a_first_answer_and_ends_with_the_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compiling: list[str] = []

    class Process:
        def __init__(self, parts: Sequence[str], *costs: object) -> None:
            self.parts = list(parts)
            compiling.extend(self.parts)

        def stop(self) -> None:
            compiling.clear()

    monkeypatch.setattr(beside, "_Compiler", Process)
    monkeypatch.setattr(hpop.runtime.compiled, "is_cached", lambda made: False)
    with beside.compiling_beside(["sum", "sum", "sum"], 1, Onset.AFTER_FIRST, main_kernels) as onset:
        assert (onset, is_first_kernel_missing(), compiling) == (Onset.AFTER_FIRST, True, [])
        beside.start_compilers()
        beside.start_compilers()
        assert sorted(compiling) == sorted(PARTS)
    assert (is_first_kernel_missing(), compiling) == (False, [])
