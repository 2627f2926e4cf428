"""Instances of the open benchmark: graphs made by seed, as text, beside the reference of their exact fronts.

    python benchmarks/open/make.py OUT [NAME ...]                  write graphs (small ones unless named) into a folder
    python benchmarks/open/make.py OUT [NAME ...] --write-reference  solve them by all methods, and write reference.json

Recipes: museum-like lattices (benchmarks/museums.py: exposure, turns and length); an arm's roadmap; grids of four
neighbours with costs 1 to 10 and targets on the diagonal (Mandow and Perez de la Cruz, JACM 57, 2010; Pulido, Mandow
and Perez de la Cruz, EJOR 239, 2014); NetMaker-like graphs (Skriver and Andersen, Computers & Operations Research 27,
2000; with three costs as Maristany de las Casas, Sedeno-Noda and Borndorfer, arXiv 2110.10978). Fronts are found by the
two exact methods of hpop, and on small graphs by a plain label setting below, which shares no code with hpop.
"""

from __future__ import annotations

import argparse
import heapq
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arrays import IntArray
from hpop.benchmark import file_hash, read_graph, write_graph
from hpop.benchmark.running import (
    REFERENCE,
    DifferentFronts,
    described_graph,
    described_query,
    exact_front,
    read_reference,
    write_reference,
)
from hpop.search import Graph

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # museums.py is beside this folder
SMALL = 1_500  # nodes up to which the plain label setting checks a graph
Made = tuple[Graph, list[tuple[int, int]]]


@dataclass(frozen=True)
class Recipe:
    """Recipe of an instance: its words, and the function that makes the graph and its queries, nodes from 0."""

    words: str
    make: Callable[[], Made]
    is_large: bool = False


def grid(side: int, costs: int, seed: int, depths: tuple[int, ...]) -> Made:
    """Return a square grid of four neighbours, and queries from its centre to nodes on the diagonal at given depths."""
    rng = np.random.default_rng(seed)
    node = np.arange(side * side).reshape(side, side)
    first = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    second = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    table = rng.integers(1, 11, (2 * len(first), costs))
    graph = Graph.from_arcs(side * side, np.append(first, second), np.append(second, first), table)
    centre = side // 2
    return graph, [(int(node[centre, centre]), int(node[centre + d // 2, centre + d // 2])) for d in depths]


def netmaker(nodes: int, costs: int, seed: int, queries: int) -> Made:
    """Return a NetMaker-like graph: a cycle of ten times the costs, and 1 to 9 arcs from each node to near ones.

    Each arc is cheap in one cost, dear in another: with three costs one is drawn from 1 to 33, one from 34 to 66, one
    from 67 to 100, in random order; with two costs one from the first and one from the last. Heads are at most 10 away.
    """
    rng = np.random.default_rng(seed)
    order = rng.permutation(nodes)
    tails, heads = [order], [np.roll(order, -1)]
    for tail in range(nodes):
        near = np.array([node for node in range(max(0, tail - 10), min(nodes, tail + 11)) if node != tail])
        heads.append(rng.choice(near, rng.integers(1, 10), replace=False))
        tails.append(np.full(len(heads[-1]), tail))
    count = sum(map(len, heads))
    lows, highs = (
        (np.array([1, 34, 67]), np.array([33, 66, 100])) if costs == 3 else (np.array([1, 67]), np.array([33, 100]))
    )
    table = rng.permuted(rng.integers(lows, highs + 1, (count, costs)), axis=1)
    table[:nodes] *= 10
    graph = Graph.from_arcs(nodes, np.concatenate(tails), np.concatenate(heads), table)
    pairs = rng.integers(0, nodes, (queries, 2))
    return graph, [(int(a), int(b)) for a, b in pairs]


def museum(name: str) -> Made:
    """Return the lattice of a museum with exposure, turns and length, and its query from corner to corner."""
    import museums

    from hpop.planners.graphs import LatticeGraph

    query = LatticeGraph(step=museums.CELL).query(museums.problem(name))
    (goal,) = query.goals
    return Graph.from_csr(query.graph.indptr, query.graph.heads, query.graph.costs), [(query.start, goal)]


def arm(samples: int) -> Made:
    """Return a roadmap of the arm of the examples, costs in hundredths; a last node joins all its goals at no cost."""
    from hpop.examples import path
    from hpop.planners.graphs import RoadmapGraph
    from hpop.scenario import load_scenario

    query = RoadmapGraph(samples=samples).query(load_scenario(path("arm_shelf.yaml")).problem)
    graph, units = query.graph, np.rint(0.01 / query.quanta).astype(np.int64)
    costs = np.vstack([-(-graph.costs // units), np.zeros((len(query.goals), graph.criteria), np.int64)])
    tails = np.append(np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)), query.goals)
    heads = np.append(graph.heads, np.full(len(query.goals), graph.nodes))
    return Graph.from_arcs(graph.nodes + 1, tails, heads, costs), [(query.start, graph.nodes)]


RECIPES = {
    "grid-20-k3": Recipe("grid, seed 1", lambda: grid(20, 3, 1, (6, 10, 16))),
    "grid-14-k4": Recipe("grid, seed 2", lambda: grid(14, 4, 2, (4, 8, 12))),
    "grid-100-k2": Recipe("grid, seed 3", lambda: grid(100, 2, 3, (20, 60, 98))),
    "grid-100-k3": Recipe("grid, seed 4", lambda: grid(100, 3, 4, (20, 40, 60))),
    "netmaker-300-k3": Recipe("NetMaker, seed 1", lambda: netmaker(300, 3, 1, 5)),
    "netmaker-3000-k2": Recipe("NetMaker, seed 2", lambda: netmaker(3000, 2, 2, 5)),
    "netmaker-3000-k3": Recipe("NetMaker, seed 3", lambda: netmaker(3000, 3, 3, 5)),
    "netmaker-10000-k3": Recipe("NetMaker, seed 4", lambda: netmaker(10000, 3, 4, 5)),
    "arm-1000": Recipe(
        "roadmap of examples/arm_shelf.yaml, duration, rotation, look_at in 0.01 s, rad, rad s", lambda: arm(1000)
    ),
    "m60": Recipe("lattice of museums.py", lambda: museum("m60")),
    "m100": Recipe("lattice of museums.py", lambda: museum("m100")),
    "m160": Recipe("lattice of museums.py", lambda: museum("m160")),
    "m200": Recipe("lattice of museums.py", lambda: museum("m200"), is_large=True),
}


def plain_front(file: Path, source: int, target: int) -> list[tuple[int, ...]]:
    """Return the front of a query, nodes as in the file: labels in lexicographic order, each kept unless dominated."""
    arcs: dict[int, list[tuple[int, tuple[int, ...]]]] = {}
    for line in file.read_text().splitlines():
        if line.startswith("a "):
            tail, head, *costs = map(int, line.split()[1:])
            arcs.setdefault(tail, []).append((head, tuple(costs)))
    width = len(next(iter(arcs.values()))[0][1])
    labels: dict[int, list[tuple[int, ...]]] = {}
    queue = [((0,) * width, source)]
    while queue:
        label, node = heapq.heappop(queue)
        done = labels.setdefault(node, [])
        rivals = done + labels.get(target, [])
        if any(all(a <= b for a, b in zip(rival, label, strict=True)) for rival in rivals):
            continue
        done.append(label)
        if node != target:
            for head, costs in arcs.get(node, []):
                heapq.heappush(queue, (tuple(a + b for a, b in zip(label, costs, strict=True)), head))
    return sorted(labels.get(target, []))


def reference(recipe: Recipe, path: Path, pairs: list[tuple[int, int]]) -> dict[str, Any]:
    """Return the reference of an instance; raises DifferentFronts if two methods disagree."""
    graph, rows = read_graph(path), []
    for source, target in pairs:
        front, methods = exact_front(graph, source, target)
        if graph.nodes <= SMALL:
            plain: IntArray = np.array(plain_front(path, source + 1, target + 1), np.int64)
            if not np.array_equal(front, plain):
                raise DifferentFronts(f"{path}: hpop found {len(front)} vectors, the plain label setting {len(plain)}")
            methods = [*methods, "plain label setting"]
        rows.append(described_query(front, source + 1, target + 1, methods))
        print(f"{path.stem} {source + 1} {target + 1}: {len(front)} vectors by {', '.join(methods)}", flush=True)
    return described_graph(path, graph, rows, recipe.words)


def main() -> None:
    """Write the graphs and their reference into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"instances: {', '.join(RECIPES)}")
    parser.add_argument(
        "--write-reference", action="store_true", help="solve the instances, and write reference.json here"
    )
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.names if name not in RECIPES]:
        parser.error(f"no instance is called {unknown[0]}; there are {', '.join(RECIPES)}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    instances = read_reference(HERE) if (HERE / REFERENCE).exists() else {}
    for name in arguments.names or [name for name, recipe in RECIPES.items() if not recipe.is_large]:
        graph, pairs = RECIPES[name].make()
        path = arguments.out / f"{name}.gr"
        write_graph(graph, path)
        if arguments.write_reference:
            instances[name] = reference(RECIPES[name], path, pairs)
            write_reference(HERE, {known: instances[known] for known in RECIPES if known in instances})
        elif file_hash(path) != instances[name]["sha256"]:
            sys.exit(f"{path} differs from the graph of {REFERENCE}: rounding on this machine differs; leave it out")
        print(f"{path}: {graph.nodes:,} nodes, {graph.arcs:,} arcs, {graph.criteria} costs", flush=True)
    shutil.copy(HERE / REFERENCE, arguments.out / REFERENCE)


if __name__ == "__main__":
    main()
