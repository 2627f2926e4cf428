"""Graphs to search, and an oracle that shares nothing with the searches: closure of sets of vectors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, pareto_paths

Vector = tuple[int, ...]


def nondominated(vectors: set[Vector]) -> set[Vector]:
    return {v for v in vectors if not any(w != v and all(a <= b for a, b in zip(w, v, strict=True)) for w in vectors)}


def front_by_closure(graph: Graph, source: int, targets: set[int]) -> list[Vector]:
    """Bellman and Ford with sets: relax every arc until no node's set of non-dominated vectors changes."""
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)).tolist()
    arcs = list(zip(tails, graph.heads.tolist(), graph.costs.tolist(), strict=True))
    sets: list[set[Vector]] = [set() for _ in range(graph.nodes)]
    sets[source] = {(0,) * graph.criteria}
    changed = True
    while changed:
        changed = False
        for tail, head, cost in arcs:
            longer = {
                tuple(max(a, c) if how == "max" else a + c for a, c, how in zip(v, cost, graph.aggregates, strict=True))
                for v in sets[tail]
            }
            merged = nondominated(sets[head] | longer)
            if merged != sets[head]:
                sets[head], changed = merged, True
    return sorted(nondominated(set().union(*(sets[t] for t in targets))))


def all_walks(graph: Graph, source: int, bounds: Sequence[int | None]) -> set[tuple[int, Vector]]:
    """End and costs of every walk within bounds, by brute force; it ends if every loop raises a bounded sum."""
    seen = {(source, (0,) * graph.criteria)}
    waiting = list(seen)
    while waiting:
        node, g = waiting.pop()
        for a in range(graph.indptr[node], graph.indptr[node + 1]):
            columns = zip(g, graph.costs[a].tolist(), graph.aggregates, strict=True)
            longer = int(graph.heads[a]), tuple(max(x, c) if how == "max" else x + c for x, c, how in columns)
            within = all(b is None or x <= b for x, b in zip(longer[1], bounds, strict=True))
            if within and longer not in seen:
                seen.add(longer)
                waiting.append(longer)
    return seen


@pytest.fixture(scope="session")
def closure() -> Callable[[Graph, int, set[int]], list[Vector]]:
    return front_by_closure


@pytest.fixture(scope="session")
def walks_within() -> Callable[[Graph, int, Sequence[int | None]], set[tuple[int, Vector]]]:
    return all_walks


def random_lattice(seed: int, width: int = 5, turn_rest: int = 1) -> Graph:
    """Cells with four headings on a grid: turns (rest, 1, 0) and moves (rest, 0, length), small costs."""
    rng = np.random.default_rng(seed)
    rest = rng.integers(0, 4, (width, width))
    steps = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    arcs = []
    for x in range(width):
        for y in range(width):
            for t, (dx, dy) in enumerate(steps):
                here = (x * width + y) * 4 + t
                arcs += [(here, here - t + u, int(turn_rest * rest[x, y]), 1, 0) for u in range(4) if u != t]
                if 0 <= x + dx < width and 0 <= y + dy < width and rng.random() < 0.8:
                    there = ((x + dx) * width + y + dy) * 4 + t
                    arcs.append((here, there, int(rest[x + dx, y + dy]), 0, int(rng.integers(1, 4))))
    table = np.array(arcs)
    return Graph.from_arcs(width * width * 4, table[:, 0], table[:, 1], table[:, 2:])


@pytest.fixture(scope="session")
def lattice() -> Callable[..., Graph]:
    return random_lattice


def with_ends(inner: Graph, seed: int) -> tuple[Graph, int, int]:
    """Join a start to two cells of the lattice and a goal to four, heading by heading, by up to two turns."""
    rng = np.random.default_rng(seed)
    start, goal, cells = inner.nodes, inner.nodes + 1, inner.nodes // 4
    near = rng.choice(cells, 6, replace=False)
    heads, tails = (np.add.outer(4 * part, np.arange(4)).ravel() for part in (near[:2], near[2:]))
    ends = np.concatenate([np.full(heads.size, start), tails, [start]]), np.append(heads, np.full(tails.size + 1, goal))
    joins = rng.integers((0, 0, 1), (60, 3, 40), (ends[0].size, 3))
    joins[-1] = 4000, 0, 4000  # straight from start to goal, dear
    arcs = (
        np.append(np.repeat(np.arange(inner.nodes), np.diff(inner.indptr)), ends[0]),
        np.append(inner.heads, ends[1]),
        np.concatenate([inner.costs, joins]),
    )
    made = Graph.from_arcs(inner.nodes + 2, *arcs)
    return Graph.from_csr(made.indptr, made.heads, made.costs), start, goal


@pytest.fixture(scope="session")
def beside() -> Callable[[int, int], tuple[Graph, int, int]]:
    """Return a maker of lattices with a start and a goal beside them."""

    def made(seed: int, width: int) -> tuple[Graph, int, int]:
        graph = random_lattice(seed, width)
        costs = graph.costs.copy()
        costs[costs[:, 1] > 0, 0] = 7
        return with_ends(Graph.from_csr(graph.indptr, graph.heads, costs), seed)

    return made


def random_chain(steps: int, most: tuple[int, ...] = (9, 3, 9), aggregates: list[str] | None = None) -> Graph:
    """Three random choices a step."""
    rng = np.random.default_rng(5)
    tails = np.repeat(np.arange(steps), 3)
    costs = rng.integers(0, most, (3 * steps, len(most)))
    return Graph.from_arcs(steps + 1, tails, tails + 1, costs, aggregates=aggregates)


@pytest.fixture(scope="session")
def chain() -> Callable[..., Graph]:
    return random_chain


@pytest.fixture
def interrupted(tmp_path: Path) -> tuple[Graph, Path]:
    """Return a graph, and the checkpoint of a stopped search in it."""
    graph, file = random_chain(60), tmp_path / "search.ckpt"
    assert pareto_paths(graph, 0, 60, checkpoint=file, budget=Budget(max_labels=2000)).status is Status.LABEL_LIMIT
    return graph, file
