"""The search and the frontier beside pymoo and moocore, on the same data: what each finds, and processor seconds.

    python benchmarks/optimisers.py [--out FILE]     needs pymoo: pip install pymoo

Vectors are drawn here, and so is the street network, a networkx graph with three costs. On it pymoo's NSGA-II (Deb et
al. 2002) optimises a key an edge, as random keys do (Bean 1994): a path is the shortest by these keys, so any path can
come.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import moocore
import networkx as nx
import numpy as np

from hpop import frontier
from hpop.search import pareto_paths

COSTS = ["length", "risk", "turns"]
SETS = [("in a cube", 20_000, 3), ("on a sphere", 2_000, 3), ("in a cube", 5_000, 5)]  # (where, n, k)
RUNS = 3


def main() -> None:
    """Measure, print a line each, write a JSON file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/optimisers.json"))
    out = parser.parse_args().out
    try:
        import pymoo  # noqa: F401
    except ImportError:
        print("optimisers skipped: pymoo is not installed; pip install pymoo")
        return
    rows = [compared(where, n, k) for where, n, k in SETS]
    rows.append(paths_compared(side=16, population=100, generations=100))
    for row in rows:
        print(json.dumps(row))
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


def vectors(where: str, n: int, k: int, seed: int = 0) -> np.ndarray:
    """Cost vectors (n, k): anywhere in a cube, or on a part of a sphere, where none dominates another."""
    rng = np.random.default_rng(seed)
    if where == "in a cube":
        return rng.random((n, k))
    directions = np.abs(rng.standard_normal((n, k)))
    return 1.0 - directions / np.linalg.norm(directions, axis=1, keepdims=True)


def compared(where: str, n: int, k: int, seed: int = 0) -> dict[str, Any]:
    """Non-dominated sets and hypervolumes of the same vectors by three libraries."""
    Y = vectors(where, n, k, seed)
    sets = {"hpop": frontier.filter, "moocore": moocore.filter_dominated, "pymoo": pymoo_filter}
    kept, seconds = {}, {}
    for name, ask in sets.items():
        kept[name], seconds[name] = measured(ask, Y)
    front = kept["hpop"]
    reference = frontier.default_reference(front)
    volumes = {
        "hpop": frontier.hypervolume(front, reference),
        "moocore": float(moocore.hypervolume(front, ref=reference)),
        "pymoo": pymoo_hypervolume(front, reference),
    }
    return {
        "data": f"{n:,} vectors {where}, {k} costs",
        "nondominated": {name: len(found) for name, found in kept.items()},
        "same": all(same_rows(front, found) for found in kept.values()),
        "seconds": {name: round(value, 4) for name, value in seconds.items()},
        "hypervolume": volumes,
    }


def streets(side: int, seed: int = 0) -> nx.DiGraph:
    """Return a street network of side x side crossings: length in m, risk, and the turns of crooked streets."""
    rng = np.random.default_rng(seed)
    g = nx.DiGraph(nx.grid_2d_graph(side, side))
    for _, _, data in g.edges(data=True):
        data.update(length=rng.uniform(80, 160), risk=rng.exponential(0.01), turns=int(rng.integers(0, 3)))
    return g


def paths_compared(side: int, population: int, generations: int, seed: int = 0) -> dict[str, Any]:
    """Compare the exact front of a street network with the result of an evolutionary algorithm."""
    g, source, target = streets(side, seed), (0, 0), (side - 1, side - 1)
    exact, seconds = measured(lambda g: pareto_paths(g, source, target, costs=COSTS).values, g)
    began = process_time()
    found = evolved(g, source, target, population, generations, seed)
    evolving = process_time() - began
    ideal, span = exact.min(axis=0), np.ptp(exact, axis=0)
    scaled = [(Y - ideal) / span for Y in (exact, found)]
    volumes = [frontier.hypervolume(Y, [1.1] * 3) for Y in scaled]
    hit = sum((np.abs(exact - row) < 1e-9 * span).all(axis=1).any() for row in found)
    return {
        "data": f"streets of {side} x {side} crossings, {g.number_of_edges():,} arcs",
        "exact": len(exact),
        "found by NSGA-II": len(found),
        "of them on the front": int(hit),
        "hypervolume of its own to the front's": round(volumes[1] / volumes[0], 4),
        "evaluations": population * generations,
        "seconds": {"hpop": round(seconds, 3), "pymoo": round(evolving, 1)},
    }


def evolved(g: nx.DiGraph, source: Any, target: Any, population: int, generations: int, seed: int) -> np.ndarray:
    """Costs (n, k) of the non-dominated paths that NSGA-II ends with."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    place = {node: i for i, node in enumerate(g.nodes)}
    tails, heads = np.array([(place[u], place[v]) for u, v in g.edges]).T
    table = np.array([[data[name] for name in COSTS] for _, _, data in g.edges(data=True)])
    row_of = {pair: row for row, pair in enumerate(zip(tails.tolist(), heads.tolist(), strict=True))}

    class Keys(ElementwiseProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=len(tails), n_obj=len(COSTS), xl=1e-3, xu=1.0)

        def _evaluate(self, x: np.ndarray, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
            keys = csr_array((x, (tails, heads)), shape=(len(place),) * 2)
            _, before = dijkstra(keys, indices=place[source], return_predecessors=True)
            at, rows = place[target], []
            while at != place[source]:
                rows.append(row_of[int(before[at]), at])
                at = int(before[at])
            out["F"] = table[rows].sum(axis=0)

    result = minimize(Keys(), NSGA2(pop_size=population), ("n_gen", generations), seed=seed + 1)
    return frontier.filter(np.atleast_2d(result.F))


def pymoo_filter(Y: np.ndarray) -> np.ndarray:
    """Return the first front of pymoo's non-dominated sorting."""
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    return Y[NonDominatedSorting().do(Y, only_non_dominated_front=True)]


def pymoo_hypervolume(Y: np.ndarray, reference: np.ndarray) -> float:
    """Hypervolume by pymoo."""
    from pymoo.indicators.hv import HV

    return float(HV(ref_point=reference)(Y))


def same_rows(one: np.ndarray, other: np.ndarray) -> bool:
    """Return True if two sets of vectors have equal members; pymoo keeps all equal rows, the others one."""
    return np.array_equal(np.unique(one, axis=0), np.unique(other, axis=0))


def measured(ask: Callable[[Any], Any], data: Any) -> tuple[Any, float]:
    """Return the result of a call and the least processor seconds of several runs."""
    seconds = []
    for _ in range(RUNS):
        began = process_time()
        found = ask(data)
        seconds.append(process_time() - began)
    return found, min(seconds)


if __name__ == "__main__":
    main()
