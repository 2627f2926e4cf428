"""Claims: joint bounds after closings are true of every path that is open, bind where doors close, and come back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, Prepared, pareto_paths
from hpop.search import prepared as prepared_graph
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import DeadlineClock
from hpop.search.staircase.turn_hull import STEP_BITS
from tests.search.prepared.test_prepared import an_event, any_graph

EVENTS = 4
ROUNDED = 8  # of 2^27, what a whole way weighs


class Layers(DeadlineClock):
    """A deadline that is there after so many layers."""

    def __init__(self, layers: int) -> None:
        super().__init__(1.0, Budget(), None)
        self.layers = layers

    @property
    def remaining(self) -> float:
        """Seconds."""
        self.layers -= 1
        return 1e9 if self.layers >= 0 else 0.0


@pytest.fixture(autouse=True)
def of_any_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prepared_graph, "MANY", 0)


@pytest.mark.seeds(1, of=50)
def test_bounds_after_closings_are_below_what_every_open_path_weighs(seed: int, lattice: Callable[..., Graph]) -> None:
    graph, rng = any_graph(4 * (seed // 2) + seed % 2, lattice), np.random.default_rng(seed)
    prepared, closed = Prepared(graph, graph.nodes - 1), np.zeros(graph.arcs, np.bool_)
    hull, groups = prepared.staircase_bounds.hull, prepared.closed_arcs.whole
    if hull is None and seed:  # costs of a few of these graphs are too wide, or their arcs no chains
        return
    assert hull is not None
    first, index, rest = prepared.plans[0][1]
    whole = hull.layers.copy(), hull.moved.copy()
    raised = 0
    for number in range(EVENTS):
        shut, opened = an_event(graph, closed, rng, number)
        closed[shut], closed[opened] = True, False
        prepared.close(shut)
        prepared.open(opened)
        assert prepared.hull is not None
        if (
            prepared.closed_arcs.groups is not groups
        ):  # some turns of a group are closed: joint bounds are not asked for
            continue
        complete = prepared.hull.close(
            closed, prepared.closed_arcs.turns > 0, Layers(int(rng.integers(2 * len(hull.layers))))
        )
        assert complete == (prepared.outdated_hull is None)
        assert (hull.layers >= whole[0]).all()
        raised += int((hull.layers > whole[0]).sum())
        for node in rng.integers(graph.nodes, size=2).tolist():
            paths = pareto_paths(graph.without(closed), node, graph.nodes - 1)
            if paths.status is Status.NO_PATH:
                continue
            least = prepared.staircase_bounds.h[[first, rest], node]
            assert (least < UNREACHABLE).all()
            steps = hull.layers[:, groups.new_number[node]].astype(np.int64) << STEP_BITS  # (m, LANES)
            for costs in paths.costs:
                bound = least @ hull.weights.T + steps[min(int(costs[index]), len(steps) - 1)]
                assert (bound <= costs[[first, rest]] @ hull.weights.T + ROUNDED).all()
    assert raised > 0 or seed
    prepared.open(np.flatnonzero(closed))
    assert prepared.hull is not None
    assert prepared.hull.close(prepared.closed, prepared.closed_arcs.turns > 0, Layers(0))
    np.testing.assert_array_equal(hull.layers, whole[0])
    np.testing.assert_array_equal(hull.moved, whole[1])


@pytest.mark.seeds(1, of=[6, *range(6), *range(7, 40)])  # in 6 arcs lead to nodes that reach no target
def test_a_closed_door_is_in_the_bounds_of_those_who_went_through_it(seed: int, lattice: Callable[..., Graph]) -> None:
    """As a hull has them that is made without the door, up to what rounding takes; but for ways of ever more turns."""
    graph = lattice(seed)
    prepared = Prepared(graph, graph.nodes - 1)
    hull = prepared.staircase_bounds.hull
    if hull is None and seed != 6:
        return
    assert hull is not None
    few = (hull.layers[-1] == hull.layers[-2]).all(axis=0)  # lanes in which no node has a use for ever more turns
    rng = np.random.default_rng(seed)
    place, tails = int(rng.integers(1, graph.nodes // 4 - 1)), np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    shut = np.flatnonzero((tails // 4 == place) | (graph.heads // 4 == place))
    prepared.close(shut)
    assert prepared.hull is not None
    for _ in range(len(hull.layers)):  # a layer a call: each goes on where the one before had to end
        prepared.hull.close(prepared.closed, prepared.closed_arcs.turns > 0, Layers(1))
    assert prepared.outdated_hull is None
    first, _, rest = prepared.plans[0][1]
    for node in range(0, graph.nodes, 7):
        if node // 4 == place:
            continue
        paths = pareto_paths(graph.without(prepared.closed), node, graph.nodes - 1)
        if paths.status is Status.NO_PATH:
            continue
        least = prepared.staircase_bounds.h[[first, rest], node] @ hull.weights.T
        bound = least + (hull.layers[-1, prepared.closed_arcs.whole.new_number[node]].astype(np.int64) << STEP_BITS)
        weighed = (paths.costs[:, [first, rest]] @ hull.weights.T).min(axis=0)
        capped = hull.layers[-1, prepared.closed_arcs.whole.new_number[node]] == 2**16 - 1
        assert (bound <= weighed + ROUNDED).all()
        assert ((weighed - bound <= 0.02 * weighed) | capped | ~few).all()
