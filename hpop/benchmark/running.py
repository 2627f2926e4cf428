"""Queries of the open benchmark with the size and the hash of each exact front, and the runner of a foreign program.

The runner compares the program's fronts with the reference, and measures time and memory.
"""

from __future__ import annotations

import csv
import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arrays import IntArray
from hpop.base.files import replacing
from hpop.benchmark import file_hash, front_hash, read_graph, split_costs, write_graph
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
        raise GraphError(
            f"{REFERENCE} has another graph named {path.stem} (its SHA-256 differs from that of {path}): rename "
            f"{path}, or restore the graph"
        )
    others = [row for row in before["queries"] if (row["source"], row["target"]) != (source, target)]
    instances[path.stem] = described_graph(path, graph, [*others, query], before["recipe"])
    write_reference(path.parent, instances)
    return query


LAUNCHER = Path(__file__).with_name("launch.py")
MARKS = re.compile(r"[\s,;()\[\]]+")


@dataclass(frozen=True)
class ForeignProgram:
    """Command line of a foreign program, and how to read its output.

    command     words with placeholders: {graph}, {graphs} (one file per cost), {source}, {target}, {costs} (number)
    first_node  number of the first node in graphs, sources and targets: 1 or 0
    count       regular expression, its one group the number of vectors, for a program that prints no vectors; or ""
    clock       regular expression, its one group the program's own seconds in the output; or ""
    """

    command: str
    first_node: int = 1
    count: str = ""
    clock: str = ""

    def __post_init__(self) -> None:
        for name in ("count", "clock"):
            try:
                groups = re.compile(getattr(self, name)).groups
            except re.error as error:
                raise OptionError(f"{name} must be a regular expression: {error}") from None
            if getattr(self, name) and groups != 1:
                raise OptionError(f"{name} must have one group, such as 'in (\\S+) s'; got {groups}")

    def words(self, query: BenchmarkQuery, scratch: Path) -> list[str]:
        """Return the words of the command for a query; files that it needs are written to the folder ``scratch``."""
        graph = query.graph
        graphs: list[Path] = []
        if self.first_node != 1:
            graph = scratch / query.graph.name
            if not graph.exists():
                write_graph(read_graph(query.graph), graph, first_node=self.first_node)
        if "{graphs}" in self.command:
            graphs = sorted(scratch.glob(f"{query.graph.stem}.c*.gr")) or split_costs(
                read_graph(query.graph), scratch / query.graph.stem, first_node=self.first_node
            )
        shift = self.first_node - 1
        values = {
            "{graph}": str(graph),
            "{graphs}": " ".join(map(str, graphs)),
            "{source}": str(query.source + shift),
            "{target}": str(query.target + shift),
            "{costs}": str(query.costs),
        }
        words: list[str] = []
        for word in shlex.split(self.command):
            replaced = re.sub(r"\{\w+\}", lambda match: values.get(match[0], match[0]), word)
            words += [str(path) for path in graphs] if word == "{graphs}" else [replaced]
        return words


@dataclass(frozen=True)
class RunResult:
    """Result of a program for one query.

    vectors  number of cost vectors on the exact front
    front    "equal", "equal size", "differs", "time limit" or "failed"
    found    number of cost vectors that the program found; None if it is not known
    seconds, processor_seconds, memory  of the whole process with the reading of the graph: s, s and MB
    clock    seconds by the program's own clock, or None
    """

    instance: str
    source: int
    target: int
    vectors: int
    front: str
    found: int | None
    seconds: float
    processor_seconds: float
    memory: float
    clock: float | None
    message: str = ""


def run_program(program: ForeignProgram, queries: Sequence[BenchmarkQuery], time_limit: float) -> Iterator[RunResult]:
    """Yield the result of a program for each query, one process after another."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        for query in queries:
            yield _run(program, query, time_limit, scratch)


def _run(program: ForeignProgram, query: BenchmarkQuery, time_limit: float, scratch: Path) -> RunResult:
    """Run a program for one query, and compare its front with the reference."""
    used, output, errors = scratch / "used.json", scratch / "output", scratch / "errors"
    used.unlink(missing_ok=True)
    launcher = [sys.executable, "-I", "-S", str(LAUNCHER), str(used), str(time_limit)]
    with output.open("wb") as out, errors.open("wb") as err:
        subprocess.run(
            [*launcher, *program.words(query, scratch)], stdin=subprocess.DEVNULL, stdout=out, stderr=err, check=False
        )
    text = output.read_text(errors="replace")
    complaint = (errors.read_text(errors="replace").strip().splitlines() or [""])[-1][:200]
    row: dict[str, Any] = {"instance": query.instance, "source": query.source, "target": query.target}
    row |= {"vectors": query.vectors, "found": None, "clock": None}
    if not used.exists():
        return RunResult(**row, front="failed", seconds=0, processor_seconds=0, memory=0, message=complaint)
    spent = json.loads(used.read_text())
    row |= {"seconds": spent["seconds"], "processor_seconds": spent["processor_seconds"]}
    row |= {"memory": spent["memory"] / 1e6, "clock": _last(program.clock, text)}
    if spent["is_late"]:
        return RunResult(**row, front="time limit")
    front, row["found"] = _compared(program, query, text)
    if front != "equal" and front != "equal size" and spent["exit_status"]:
        return RunResult(**row, front="failed", message=f"exit status {spent['exit_status']} {complaint}".rstrip())
    return RunResult(**row, front=front)


def _compared(program: ForeignProgram, query: BenchmarkQuery, text: str) -> tuple[str, int | None]:
    """Compare the front in a program's output with the reference; return the verdict and the size of the front."""
    if program.count:
        number = _last(program.count, text)
        return ("equal size" if number == query.vectors else "differs"), None if number is None else int(number)
    vectors = read_vectors(text, query.costs)
    return ("equal" if front_hash(vectors) == query.sha256 else "differs"), len(vectors)


def read_vectors(text: str, costs: int) -> list[tuple[int, ...]]:
    r"""Return the distinct cost vectors in a program's output: lines that have one whole number for each cost.

    >>> read_vectors("c 3 labels\n2 10\n(9, 1)\n9 1\n1 2 3", 2)
    [(2, 10), (9, 1)]
    """
    rows = ([word for word in MARKS.split(line) if word] for line in text.splitlines())
    return sorted({tuple(map(int, row)) for row in rows if len(row) == costs and all(map(str.isdecimal, row))})


def _last(pattern: str, text: str) -> float | None:
    """Return the number in the last match of a regular expression; None if there is no match or it is no number."""
    try:
        return float(re.findall(pattern, text)[-1]) if pattern else None
    except (IndexError, ValueError):
        return None


def write_tables(results: Sequence[RunResult], command: str, stem: Path) -> None:
    """Write results as STEM.csv, with all digits, and STEM.md, a row for each instance."""
    names = [field.name for field in fields(RunResult)]
    with stem.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([getattr(result, name) for name in names] for result in results)
    stem.with_suffix(".md").write_text(f"`{command}`\n\n{markdown(results)}", encoding="utf-8")


def markdown(results: Sequence[RunResult]) -> str:
    """Return a Markdown table with a row for each instance: sums of vectors and seconds, the largest memory."""
    lines = [
        "| instance | queries | vectors | front | seconds | processor | own clock | memory, MB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(result.instance for result in results):
        rows = [result for result in results if result.instance == name]
        fronts = [row.front for row in rows]
        verdict = ", ".join(f"{fronts.count(front)} {front}" for front in dict.fromkeys(fronts))
        clocks = [row.clock for row in rows if row.clock is not None]
        cells = [name, str(len(rows)), f"{sum(row.vectors for row in rows):,}", verdict]
        cells += [f"{sum(row.seconds for row in rows):.3g}", f"{sum(row.processor_seconds for row in rows):.3g}"]
        cells += [f"{sum(clocks):.3g}" if len(clocks) == len(rows) else "", f"{max(row.memory for row in rows):.0f}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
