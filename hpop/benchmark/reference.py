"""Reference of the open benchmark: queries on graphs, with the size and the hash of each exact front."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arrays import IntArray
from hpop.base.files import replacing
from hpop.benchmark.graph_files import file_hash, front_hash, read_graph
from hpop.errors import GraphError, OptionError
from hpop.search import Graph, pareto_paths

REFERENCE = "reference.json"
"""Name of the reference file in a folder of instances."""


@dataclass(frozen=True)
class BenchmarkQuery:
    """Query on a benchmark graph, with the size and the hash of its exact front; nodes are numbered from 1.

    ``costs`` is the number of costs of each arc, and ``vectors`` the number of cost vectors on the front.
    """

    instance: str
    graph: Path
    costs: int
    source: int
    target: int
    vectors: int
    sha256: str


class DifferentFronts(Exception):
    """Error if two exact methods found different fronts, so that one of them is wrong."""


def read_reference(folder: Path) -> dict[str, Any]:
    """Return the instances in a folder's reference file, by name; raise OptionError if it cannot be read."""
    try:
        instances: dict[str, Any] = json.loads((folder / REFERENCE).read_text())["instances"]
    except (OSError, ValueError, KeyError):
        raise OptionError(
            f"{folder} must hold {REFERENCE}; make it with benchmarks/open/make.py or python -m hpop.benchmark add"
        ) from None
    return instances


def write_reference(folder: Path, instances: dict[str, Any]) -> None:
    """Write the reference file of a folder, with one query per line."""
    parts = []
    for name, instance in instances.items():
        queries = ",\n   ".join(json.dumps(row) for row in instance["queries"])
        head = json.dumps({key: value for key, value in instance.items() if key != "queries"})
        parts.append(f'  {json.dumps(name)}: {head[:-1]}, "queries": [\n   {queries}]}}')
    with replacing(folder / REFERENCE) as file:
        file.write(('{\n "instances": {\n' + ",\n".join(parts) + "\n }\n}\n").encode())


def read_queries(folder: Path, names: Sequence[str] = ()) -> list[BenchmarkQuery]:
    """Return the queries on the named instances, or on all instances whose graphs are in the folder.

    Raises OptionError for an unknown name or a missing graph, GraphError for a graph that differs from the reference.
    """
    instances = read_reference(folder)
    for name in names:
        if name not in instances:
            raise OptionError(f"no instance is called {name!r}; there are {', '.join(instances)}")
    queries = []
    for name, instance in instances.items():
        graph = folder / f"{name}.gr"
        if (name not in names) if names else not graph.exists():
            continue
        if not graph.exists():
            raise OptionError(f"{graph} is missing; make it with benchmarks/open/make.py")
        if file_hash(graph) != instance["sha256"]:
            raise GraphError(f"{graph} is not the graph of {REFERENCE}: its SHA-256 differs; make it again")
        for row in instance["queries"]:
            known = {key: row[key] for key in ("source", "target", "vectors", "sha256")}
            queries.append(BenchmarkQuery(name, graph, instance["costs"], **known))
    if not queries:
        raise OptionError(f"{folder} holds none of the graphs of {REFERENCE}; make them with benchmarks/open/make.py")
    return queries


def exact_front(graph: Graph, source: int, target: int) -> tuple[IntArray, list[str]]:
    """Solve a query (nodes from 0) by two methods; return the exact front (N, k) and the methods that agree on it.

    The method "staircase" is left out on graphs that it does not support. Raises DifferentFronts if
    the methods disagree.
    """
    front = pareto_paths(graph, source, target, method="general").costs
    try:
        other = pareto_paths(graph, source, target, method="staircase").costs
    except OptionError:
        return front, ["general"]
    if not np.array_equal(front, other):
        raise DifferentFronts(
            f"general found {len(front)} vectors from {source} to {target} (nodes from 0), staircase {len(other)}; one "
            "of the methods is wrong: report it with this graph"
        )
    return front, ["general", "staircase"]


def described_query(front: IntArray, source: int, target: int, methods: Sequence[str]) -> dict[str, Any]:
    """Return the entry of a query (nodes from 1) for the reference file."""
    row = {"source": source, "target": target, "vectors": len(front), "sha256": front_hash(front)}
    return row | {"checked_by": list(methods)}


def described_graph(path: Path, graph: Graph, queries: list[dict[str, Any]], recipe: str) -> dict[str, Any]:
    """Return the entry of a graph, with its queries, for the reference file."""
    sizes = {"nodes": graph.nodes, "arcs": graph.arcs, "costs": graph.criteria}
    return {"recipe": recipe, **sizes, "sha256": file_hash(path), "queries": queries}


def add_query(path: Path, source: int, target: int) -> dict[str, Any]:
    """Solve a query (nodes from 1) on a graph file, add it to the reference in its folder, and return its entry."""
    graph = read_graph(path)
    instances = read_reference(path.parent) if (path.parent / REFERENCE).exists() else {}
    front, methods = exact_front(graph, source - 1, target - 1)
    query = described_query(front, source, target, methods)
    before = instances.get(path.stem, {"queries": [], "recipe": "your own"})
    if before["queries"] and before["sha256"] != file_hash(path):
        raise GraphError(f"{path} is not the graph of {REFERENCE}: its SHA-256 differs; give it another name")
    others = [row for row in before["queries"] if (row["source"], row["target"]) != (source, target)]
    instances[path.stem] = described_graph(path, graph, [*others, query], before["recipe"])
    write_reference(path.parent, instances)
    return query
