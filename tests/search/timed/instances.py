"""Small random questions of the timed search: ties, self-loops, parallel arcs, blockings, cuts and holds abound."""

from __future__ import annotations

from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.search import Graph
from hpop.search.timed.graph import TimedGraph

MOST_WALKS = 2_000_000
LATEST = 40
COSTS = (2, 2, 2, 3, 3, 3, 3, 4, 4, 1, 5, 6)  # how many, as often as each stands here


class TimedQuery(NamedTuple):
    """A timed graph, whence and whither."""

    graph: TimedGraph
    source: int
    targets: tuple[int, ...]


def timed_query(seed: int, *, costs: tuple[int, ...] = COSTS) -> TimedQuery:
    """Return a query with 1 to 6 costs on 2 to 6 nodes, whose walks last some 10 to 20 ticks."""
    rng = np.random.default_rng([17, seed])
    k = int(rng.choice(costs))
    n, h = int(rng.integers(2, 7)), int(rng.integers(0, 11 if k < 4 else 7))
    most = int(rng.integers(2, 9)) if k < 4 else int(rng.integers(1, 5))  # the largest cost: small ones make ties
    aggregates = [str(rng.choice(["sum", "sum", "max"])) for _ in range(k)]
    place = np.sort(rng.integers(0, rng.integers(1, n + 1), n)).astype(np.int32)
    place = np.unique(place, return_inverse=True)[1].astype(np.int32)  # places without gaps
    tails, heads = np.concatenate([rng.integers(0, n, (2, int(rng.integers(n, 2 * n + 3)))), _chain(rng, n)], axis=1)
    m = tails.size
    graph = Graph.from_arcs(n, tails, heads, rng.integers(0, most + 1, (m, k)), aggregates=aggregates)
    tails = np.repeat(np.arange(n), np.diff(graph.indptr))
    in_place = place[tails] == place[graph.heads]
    timed = np.flatnonzero(rng.random(m) < rng.choice([0.3, 0.7])).astype(np.int32)
    stays: BoolArray = in_place & (rng.random(m) < 0.8)
    stays[timed] = False
    places = int(place.max()) + 1
    durations = rng.integers(1, rng.integers(3, 6), m).astype(np.int32)
    hold = None if rng.random() < 0.35 else int(rng.integers(1, 5))
    latest, last = _latest(graph, durations, hold), h + max(hold or 0, int(durations.max())) + n * int(durations.max())
    arrive_by = min(int(rng.integers(4, h + 8)), latest) if rng.random() < 0.5 or latest < last else None
    return TimedQuery(
        TimedGraph(
            graph=graph,
            durations=durations,
            horizon=h,
            timed=timed,
            costs=_costs(rng, k, (timed.size, h + 1), most),
            blocked=_spells(rng, timed.size, h, 0.3),
            place=place,
            stays=stays,
            standing=_standing(rng, aggregates, (places, h + 1), most),
            rate=_rates(rng, aggregates, places, most),
            cut=_spells(rng, places, h, 0.35),
            hold=hold,
            arrive_by=arrive_by,
        ),
        0,
        tuple(
            sorted({n - 1, int(rng.integers(0 if rng.random() < 0.05 else 1, n))} if rng.random() < 0.2 else {n - 1})
        ),
    )


def _chain(rng: np.random.Generator, n: int) -> IntArray:
    """Tails and heads (2, c) of arcs, each twice, that lead from node 0 to the last one over some of the others."""
    through = np.concatenate([[0], rng.permutation(np.arange(1, n - 1))[: rng.integers(0, n)], [n - 1]])
    return np.stack([through[:-1], through[1:]]).repeat(2, axis=1)


def _latest(graph: Graph, durations: IntArray, hold: int | None) -> int:
    """Return the last tick with few enough walks to enumerate, were all arcs open and all holds allowed."""
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)).tolist()
    arcs = list(zip(tails, graph.heads.tolist(), durations.tolist(), strict=True))
    arrived = [[int(node == 0) for node in range(graph.nodes)]]  # walks by tick and node
    left: list[list[int]] = []
    while sum(map(sum, arrived + left)) < MOST_WALKS and len(arrived) < LATEST:
        t = len(arrived)
        waited = [0] * graph.nodes if hold is None else [sum(c) for c in zip(*arrived[: t - hold], strict=True)]
        left.append([a + b for a, b in zip(arrived[-1], waited or [0] * graph.nodes, strict=True)])
        arrived.append([sum(left[t - d][u] for u, v, d in arcs if v == node and d <= t) for node in range(graph.nodes)])
    return len(arrived) - 1


def _costs(rng: np.random.Generator, k: int, shape: tuple[int, int], most: int) -> dict[int, Any]:
    """Tables of some columns, in either width."""
    width = rng.choice([np.int32, np.int64])
    return {j: rng.integers(0, most + 2, shape).astype(width) for j in range(k) if rng.random() < 0.6}


def _spells(rng: np.random.Generator, rows: int, h: int, often: float) -> BoolArray:
    """In some rows a spell (rows, h + 1) of several ticks; now and then it has no end."""
    marked = np.zeros((rows, h + 1), bool)
    for row in range(rows):
        if rng.random() < 2 * often:
            begin = int(rng.integers(0, h + 1))
            marked[row, begin : begin + int(rng.integers(1, 4))] = True
            if rng.random() < 0.8:
                marked[row, h] = False
    return marked


def _standing(
    rng: np.random.Generator, aggregates: list[str], shape: tuple[int, int], most: int
) -> dict[int, IntArray]:
    """For some columns what standing costs: the running sum from any beginning, or the rate of a maximum."""
    tables = {}
    for j, aggregate in enumerate(aggregates):
        if rng.random() < 0.5:
            rates = rng.integers(0, most + 1, shape) * (rng.random(shape) < 0.6)
            tables[j] = np.cumsum(rates, axis=1) - rates[:, :1] if aggregate == "sum" else rates
    return tables


def _rates(rng: np.random.Generator, aggregates: list[str], places: int, most: int) -> IntArray:
    """Return the cost of a tick of standing (P, k): parts of a quantum for sums, whole quanta for maxima."""
    counts = rng.integers(0, most + 1, (places, len(aggregates))) * (rng.random((places, len(aggregates))) < 0.6)
    sums = np.array([aggregate == "sum" for aggregate in aggregates])
    parts = rng.choice([1 << 20, 1 << 19, 700_001], (places, 1))
    return np.where(sums, counts * parts, counts).astype(np.int64)


def timed_lattice(seed: int, width: int, *, worst: bool = False, duration: bool = False) -> TimedQuery:
    """Cells with four headings, people who cross them; turns, length and exposure to people, from corner to corner.

    worst     the exposure is that of the worst moment
    duration  is a fourth cost
    """
    rng = np.random.default_rng([18, seed])
    cells, h = width * width, 3 * width
    exposure, taken = _people(rng, width, h)
    walls = rng.random(cells) < 0.1
    walls[[0, -1]] = False
    steps = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    turns = [
        (4 * cell + a, 4 * cell + b, 1, 0, 2 + (abs(a - b) == 2))
        for cell in range(cells)
        for a, b in permutations(range(4), 2)
    ]
    moves = [
        (4 * (x + y * width) + a, 4 * (x + dx + (y + dy) * width) + a, 0, 1, 1)
        for x in range(width)
        for y in range(width)
        for a, (dx, dy) in enumerate(steps)
        if 0 <= x + dx < width and 0 <= y + dy < width and not walls[[x + y * width, x + dx + (y + dy) * width]].any()
    ]
    arcs = np.array(turns + moves)
    arcs = arcs[np.argsort(arcs[:, 0], kind="stable")]
    place = (np.arange(4 * cells) // 4).astype(np.int32)
    stays = arcs[:, 2] == 1
    met = exposure[place[arcs[:, 1]]].any(axis=1) | taken[place[arcs[:, 1]]].any(axis=1)
    timed = np.flatnonzero(~stays & met).astype(np.int32)
    later = np.minimum(np.arange(h + 1) + 1, h)
    costs, rate = np.zeros((len(arcs), 3 + duration), np.int64), np.zeros((cells, 3 + duration), np.int64)
    costs[:, :2] = arcs[:, 2:4]
    rate[:, 2] = exposure[:, h] if worst else exposure[:, h] << 20
    if duration:
        costs[:, 3], rate[:, 3] = arcs[:, 4], 1 << 20
    return TimedQuery(
        TimedGraph(
            graph=Graph.from_arcs(
                4 * cells,
                arcs[:, 0],
                arcs[:, 1],
                costs,
                aggregates=["sum", "sum", "max" if worst else "sum", *["sum"] * duration],
            ),
            durations=arcs[:, 4].astype(np.int32),
            horizon=h,
            timed=timed,
            costs={2: exposure[place[arcs[timed, 1]]]},
            blocked=taken[place[arcs[timed, 1]]] | taken[place[arcs[timed, 1]]][:, later],
            place=place,
            stays=stays,
            standing={2: exposure if worst else np.cumsum(exposure, axis=1) - exposure},
            rate=rate,
            cut=taken,
            hold=3,
            arrive_by=6 * width,
        ),
        0,
        (4 * cells - 1, 4 * cells - 2),
    )


def _people(rng: np.random.Generator, width: int, h: int) -> tuple[IntArray, BoolArray]:
    """Exposure (cells, h + 1) to four people who walk straight on, and cells that they take.

    At the end they are gone, but for one somewhere who stands now and then.
    """
    x, y = np.arange(width * width) % width, np.arange(width * width) // width
    exposure = np.zeros((width * width, h + 1), np.int64)
    taken = np.zeros((width * width, h + 1), bool)
    for line, begin, backwards in rng.integers(0, (width, width, 2), (4, 3)).tolist():
        for t in range(h):
            at = t // 2 - begin
            at = width - 1 - at if backwards else at
            away = np.abs(x - line) + np.abs(y - at)
            exposure[:, t] += np.maximum(0, 3 - away)
            taken[:, t] |= away == 0
    if rng.random() < 0.5:
        exposure[:, h] = np.maximum(0, 3 - np.abs(x - width // 2) - np.abs(y - width // 2))
    return exposure, taken
