"""Graphs of tours, whose layers share their arcs: fronts are those of graphs with a copy of all arcs for each layer."""

from __future__ import annotations

import numpy as np
import pytest

import hpop
from hpop.errors import QueryError
from hpop.planners.graph_planners import Roadmap
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.objectives import edge_objectives
from hpop.search import Graph, pareto_paths
from tests.planners.tours.test_enumerated import CRITERIA, drawn

PLANNERS = {
    "lattice": (hpop.Lattice(step=1.0, headings=4), CRITERIA),
    "lattice with four costs": (hpop.Lattice(step=1.0, headings=8), [*CRITERIA, "length"]),
    "lattice without turns": (hpop.Lattice(step=0.5, headings=4), ["duration", {"exposure": {"radius": 0.8}}]),
    "roadmap": (Roadmap(samples=40), CRITERIA),
}


def copied(space: TourGraph, criteria: hpop.Problem) -> Graph:
    """Return the search graph of a tour with all arcs of all layers, made from one layer and the steps of the tour."""
    optimised = edge_objectives(criteria.criteria, "lattice").optimised
    inner, tour = space.inner.graph(optimised), space.tour
    n, layers = inner.nodes, len(tour.layers)
    tails = np.repeat(np.arange(n), np.diff(inner.indptr))
    parts = [(tails + i * n, inner.heads + i * n, inner.costs) for i in range(layers)]
    for layer, steps in enumerate(tour.steps):
        for step in steps:
            members = space.members[step.stop]
            costs = space.dwell_costs(step.stop, optimised) + space.missed_costs([step.skipped], optimised)
            parts.append((members + layer * n, members + step.layer * n, costs))
    for layer, skipped in tour.endings:
        if skipped:
            goals = np.array(space.goals)
            costs = np.repeat(space.missed_costs([skipped], optimised), goals.size, axis=0)
            parts.append((goals + layer * n, layers * n + np.arange(goals.size), costs))
    return Graph.from_arcs(space.size, *(np.concatenate(column) for column in zip(*parts, strict=True)))


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.seeds(2, of=60)
def test_fronts_are_those_of_copied_layers(name: str, seed: int) -> None:
    world, (start, goal), stops, order = drawn(2000 + seed)
    planner, criteria = PLANNERS[name]
    criteria = [*criteria, *(["stops_missed"] if any(stop["optional"] for stop in stops) else [])]
    robot = hpop.DifferentialDrive(radius=0.3)
    try:
        problem = hpop.Problem(world, robot, start, goal, criteria, tour=hpop.Tour(stops, order))
        query = planner.query(problem)
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    assert isinstance(query.space, TourGraph)
    whole = copied(query.space, problem)
    assert (query.graph.nodes, query.graph.arcs) == (whole.nodes, whole.arcs)
    for eps in (0.0, 0.05):
        wanted = pareto_paths(whole, query.start, query.goals, eps=eps)
        found = pareto_paths(query.graph, query.start, query.goals, eps=eps)
        assert found.costs.tolist() == wanted.costs.tolist()
        assert [found.nodes(i)[-1] for i in range(len(found))] == [wanted.nodes(i)[-1] for i in range(len(wanted))]
