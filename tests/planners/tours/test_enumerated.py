"""Fronts of tours are those of all orders and states of the stops, by a label setting that shares no code with hpop.

Arcs and their costs are those of the lattice without a tour, with the states of stops that are joined to it. Sets of
stops, costs of dwells, orders and dominance are computed here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, permutations
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.motions import States
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Limits
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.search import Graph, pareto_paths
from hpop.trajectories.trajectory import Trajectory

Costs = tuple[int, ...]
Labels = dict[int, set[Costs]]
"""Non-dominated costs at each node."""
STEP = 1.0
SIZE = (4.0, 3.0)
PLANNER = Lattice(step=STEP, headings=4)
CRITERIA = [{"exposure": {"radius": 0.8}}, "turns", "duration"]


def kept(costs: set[Costs]) -> set[Costs]:
    """Return the non-dominated ones of some costs."""
    return {c for c in costs if not any(o != c and all(a <= b for a, b in zip(o, c, strict=True)) for o in costs)}


def label_setting(graph: Graph, begin: Labels) -> Labels:
    """Return the non-dominated costs at each node of paths that begin at nodes with some costs."""
    labels: Labels = defaultdict(set)
    open_ = {(cost, node) for node, costs in begin.items() for cost in costs}
    while open_:
        cost, node = min(open_)
        open_.remove((cost, node))
        if any(all(a <= b for a, b in zip(other, cost, strict=True)) for other in labels[node]):
            continue
        labels[node].add(cost)
        for arc in range(graph.indptr[node], graph.indptr[node + 1]):
            total = tuple(a + b for a, b in zip(cost, graph.costs[arc].tolist(), strict=True))
            open_.add((total, int(graph.heads[arc])))
    return labels


def of_hold(problem: Problem, state: Sequence[float], seconds: float) -> Costs:
    """Return the costs of standing in a state, in quanta, rounded up."""
    columns = {name: np.full(2, value) for name, value in zip(["x", "y", "yaw"], state, strict=True)}
    hold = Trajectory(problem.model, States(**columns, clock=np.array([0.0, seconds])), ("hold",))
    values = problem.evaluate(hold)
    return tuple(int(np.ceil(values[c.name] / c.quantum - 1e-6)) for c in problem.criteria)


def orders(count: int, optional: Sequence[int], order: Any) -> Iterator[tuple[int, ...]]:
    """Yield all sequences of stops that visit each stop, or miss optional ones, and keep an order."""
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count)] if order == "given" else order
    pairs = [] if order == "any" else pairs
    for size in range(count + 1):
        for sequence in permutations(range(count), size):
            if set(range(count)) - set(sequence) - set(optional):
                continue
            rank = {stop: place for place, stop in enumerate(sequence)}
            # A pair holds also over a missed stop between its two.
            if all(rank[i] < rank[j] for i, j in closure(pairs) if i in rank and j in rank):
                yield sequence


def closure(pairs: Sequence[tuple[int, int]]) -> set[tuple[int, int]]:
    found = set(map(tuple, pairs))
    while more := {(i, m) for i, j in found for k, m in found if j == k} - found:
        found |= more
    return found  # type: ignore[return-value]


def enumerated(plain: Problem, ends: Ends, stops: Sequence[Mapping[str, Any]], order: Any) -> set[Costs]:
    """Return the front of a tour over all orders and all states of its stops, on a graph without a tour."""
    objectives = edge_objectives(plain.criteria, "lattice")
    space, start, goals = ends
    graph, states = space.graph(objectives.optimised), space.states(np.arange(space.size))
    rows = np.stack([states.x, states.y, states.yaw], axis=1).tolist()
    optional = [i for i, stop in enumerate(stops) if stop.get("optional")]
    dwells = []
    for stop in stops:
        (x, y), within, dwell = stop["at"], stop["within"], stop.get("dwell", 0.0)
        inside = [v for v, row in enumerate(rows) if (row[0] - x) ** 2 + (row[1] - y) ** 2 <= within**2]
        inside = [v for v in inside if not (dwell and np.isnan(rows[v]).any())]  # no hold at an unknown heading
        nothing = (0,) * len(plain.criteria)
        dwells.append({v: of_hold(plain, rows[v], dwell) if dwell else nothing for v in inside})
    found: set[Costs] = set()
    for sequence in orders(len(stops), optional, order):
        labels = label_setting(graph, {start: {(0,) * len(plain.criteria)}})
        for stop in sequence:
            at = {
                v: {tuple(a + b for a, b in zip(cost, dwell, strict=True)) for cost in labels.get(v, ())}
                for v, dwell in dwells[stop].items()
            }
            labels = label_setting(graph, at)
        missed = (len(stops) - len(sequence),) if optional else ()
        found |= {cost + missed for goal in goals for cost in labels.get(goal, ())}
    return kept(found)


def drawn(seed: int) -> tuple[hpop.World, tuple[Any, Any], list[dict[str, Any]], Any]:
    """Return a small world, the ends, the stops and the order of a tour."""
    rng = np.random.default_rng(seed)
    boxes = [shapely.box(x, y, x + 0.5, y + 0.5) for x, y in rng.uniform(0, 3, (rng.integers(0, 3), 2))]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-0.5, -0.5, SIZE[0] - 0.5, SIZE[1] - 0.5))
    start, goal = ((float(x), float(y)) for x, y in rng.integers(0, (4, 3), (2, 2)))
    aside = rng.random() < 0.3  # a goal off the lattice
    goal = (goal[0] + 0.2, goal[1]) if aside and goal[0] < 3 else goal
    stops: list[dict[str, Any]] = []
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(0, (3, 2))
        stops.append({"at": (x, y), "within": float(rng.uniform(0.75, 1.1)), "dwell": float(rng.choice([0.0, 1.5]))})
        stops[-1]["optional"] = bool(rng.random() < 0.3)
    pair = rng.permutation(len(stops))[:2].tolist()
    some = [(pair[0], pair[1])] if len(pair) > 1 else []
    return world, ((*start, 0.0), (*goal, None)), stops, ["given", "any", some][int(rng.integers(3))]


@pytest.mark.seeds(6, of=130)
def test_the_front_is_that_of_all_orders_and_all_states_of_the_stops(seed: int) -> None:
    world, (start, goal), stops, order = drawn(seed)
    robot = hpop.DifferentialDrive(radius=0.3)
    criteria = [*CRITERIA, *(["stops_missed"] if any(stop["optional"] for stop in stops) else [])]
    try:
        plain = Problem(world, robot, start, goal, CRITERIA)
        problem = Problem(world, robot, start, goal, criteria, tour=hpop.Tour(stops, order))
        query = PLANNER.query(problem)
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    layered = query.space
    assert isinstance(layered, TourGraph)
    wanted = enumerated(plain, Ends(layered.inner, query.start, list(layered.goals)), stops, order)
    paths = query.paths(Limits())
    assert set(map(tuple, paths.costs.tolist())) == wanted
    front = problem.solve(PLANNER)
    assert len(wanted) >= len(front) >= (1 if wanted else 0)
    assert verify(problem, front) == []


@pytest.mark.seeds(4, of=70)
def test_a_given_order_is_the_filtered_sum_of_the_fronts_between_stops_of_one_state(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    boxes = [shapely.box(x, y, x + 0.5, y + 0.5) for x, y in rng.uniform(0, 3, (rng.integers(0, 3), 2))]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-0.5, -0.5, SIZE[0] - 0.5, SIZE[1] - 0.5))
    places = [[float(x), float(y), float(k) * np.pi / 2] for x, y, k in rng.integers(0, (4, 3, 4), (4, 3))]
    start, *between, goal = places
    robot, dwell = hpop.DifferentialDrive(radius=0.3), 2.0
    try:
        plain = Problem(world, robot, start, goal, CRITERIA)
        tour = hpop.Tour([{"goal": place, "dwell": dwell} for place in between])
        query = PLANNER.query(Problem(world, robot, start, goal, CRITERIA, tour=tour))
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    layered = query.space
    assert isinstance(layered, TourGraph)
    graph = layered.inner.graph(edge_objectives(plain.criteria, "lattice").optimised)
    nodes = [query.start, *(int(members[0]) for members in layered.members), *layered.goals]
    total: set[Costs] = {(0, 0, 0)}
    for begin, end in pairwise(nodes):
        stage = set(map(tuple, pareto_paths(graph, begin, [end]).costs.tolist()))
        total = kept({add(a, b) for a in total for b in stage})
    holds = [of_hold(plain, place, dwell) for place in between]
    wanted = {add(add(cost, holds[0]), holds[1]) for cost in total}
    assert set(map(tuple, query.paths(Limits()).costs.tolist())) == wanted


def add(a: Costs, b: Costs) -> Costs:
    return tuple(x + y for x, y in zip(a, b, strict=True))
