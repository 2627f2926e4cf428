"""Open benchmark of multi-objective shortest paths: graph files, hashes of fronts, and runs of any program.

Here are the graph files: plain text, in the form that most programs of the field read, and converters of other formats.
A file has a line ``p sp NODES ARCS`` and then a line ``a TAIL HEAD COST [COST ...]`` for each arc. Costs are whole
numbers. Nodes are numbered from 1, as in the 9th DIMACS challenge; a line that begins with c is a comment.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arrays import FloatArray, IntArray
from hpop.errors import GraphError
from hpop.search import Graph

MEDIAN = 1000
"""Median to which each cost of a converted TNTP file is scaled."""
TNTP_COLUMNS = {
    "capacity": 2,
    "length": 3,
    "free_flow_time": 4,
    "b": 5,
    "power": 6,
    "speed": 7,
    "toll": 8,
    "link_type": 9,
}
"""Columns of a link in a TNTP file, after its two ends."""
SEMICOLONS = re.compile(r"[;\s]+")


def write_graph(graph: Graph, path: Path, *, first_node: int = 1) -> None:
    """Write a graph to a text file, with its arcs in the order of their tails; ``first_node`` as for `read_graph`."""
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    table = np.column_stack([tails + first_node, graph.heads + first_node, graph.costs])
    with path.open("w", encoding="ascii") as file:
        file.write(f"p sp {graph.nodes} {graph.arcs}\n")
        row = " ".join(["a", *["%d"] * table.shape[1]]) + "\n"
        for part in np.array_split(table, 1 + len(table) // 10_000):
            file.write(row * len(part) % tuple(part.ravel().tolist()))


def read_graph(path: Path, *, first_node: int = 1) -> Graph:
    """Read a graph from a text file; raise GraphError for a file without the line ``p sp``, or with invalid arcs.

    first_node  number of the first node in the file: 1, or 0 as in files of NetMaker
    """
    with path.open(encoding="ascii", errors="replace") as file:
        nodes, arcs = _sizes(file, path)
        table = _table(file, path, skipped=1)
    if len(table) != arcs:
        raise GraphError(
            f"{path} announces {arcs} arcs, but has {len(table)}; correct its line `p sp`, or the lines of its arcs"
        )
    return _graph(nodes, table, first_node)


def split_costs(graph: Graph, stem: Path, *, first_node: int = 1) -> list[Path]:
    """Write a graph as one file for each cost, as the 9th DIMACS challenge does, and return the paths of the files."""
    paths = []
    for j in range(graph.criteria):
        paths.append(stem.with_name(f"{stem.name}.c{j + 1}.gr"))
        part = Graph.from_csr(graph.indptr, graph.heads, graph.costs[:, [j]])
        write_graph(part, paths[-1], first_node=first_node)
    return paths


def _sizes(file: TextIO, path: Path) -> tuple[int, int]:
    """Read a file up to the line ``p sp NODES ARCS``, and return the numbers of nodes and arcs."""
    for line in iter(file.readline, ""):
        words = line.split()
        if words[:1] == ["p"] and len(words) == 4:
            return _whole(words[2], path), _whole(words[3], path)
        if words and words[0] != "c":
            break
    raise GraphError(f"{path} must begin with a line `p sp NODES ARCS`, after comments (c ...)")


def _whole(word: str, path: Path) -> int:
    try:
        return int(word)
    except ValueError:
        raise GraphError(f"{path}: a whole number is expected, got {word!r}") from None


def _table(file: TextIO, path: Path, *, skipped: int) -> IntArray:
    """Return the numbers in the remaining lines as a table; the first ``skipped`` words of each line are left out."""
    begin = file.tell()
    words = next((line.split() for line in iter(file.readline, "") if line.split() and line[0] != "c"), [])
    if not words:
        return np.zeros((0, 3), np.int64)
    file.seek(begin)
    try:
        return np.loadtxt(file, np.int64, comments="c", usecols=range(skipped, len(words)), ndmin=2)
    except (ValueError, OverflowError) as error:
        raise GraphError(f"{path}: each arc must have a tail, a head and whole costs ({error})") from None


def _graph(nodes: int, table: IntArray, first_node: int) -> Graph:
    if table.shape[1] < 3:
        raise GraphError(f"an arc must have a tail, a head and at least one cost, got {table.shape[1]} numbers")
    return Graph.from_arcs(nodes, table[:, 0] - first_node, table[:, 1] - first_node, table[:, 2:])


# Fronts


def front_hash(vectors: ArrayLike) -> str:
    r"""Return the SHA-256 of a front: its distinct cost vectors (N, k), sorted, one per line, separated by spaces.

    >>> front_hash([[9, 1], [2, 10], [9, 1]]) == hashlib.sha256(b"2 10\n9 1\n").hexdigest()
    True
    """
    rows = sorted({tuple(row) for row in np.asarray(vectors).tolist()})
    return hashlib.sha256("".join(" ".join(map(str, row)) + "\n" for row in rows).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


# Graph files of other projects


def read_netmaker(paths: Sequence[Path]) -> Graph:
    """Read a NetMaker graph in the form of Maristany de las Casas et al. (arXiv 2110.10978); nodes count from 0."""
    (path,) = paths
    return read_graph(path, first_node=0)


def read_dimacs(paths: Sequence[Path]) -> Graph:
    """Read files of the 9th DIMACS challenge, one for each cost, which list the same arcs in the same order."""
    parts = [read_graph(path) for path in paths]
    for path, part in zip(paths, parts, strict=True):
        if not np.array_equal(part.indptr, parts[0].indptr) or not np.array_equal(part.heads, parts[0].heads):
            raise GraphError(f"{path} must have the arcs of {paths[0]} in the same order; they differ")
    return Graph.from_csr(parts[0].indptr, parts[0].heads, np.hstack([part.costs for part in parts]))


def read_raith_ehrgott(paths: Sequence[Path]) -> Graph:
    """Read the network file of Raith and Ehrgott (Computers & Operations Research 36, 2009); ``paths`` has one path.

    Line 1 is ``sp min NODES ARCS``. Lines 2 and 3, a source and a target, are skipped. Each further line is an arc
    ``TAIL HEAD COST COST``, with nodes numbered from 1. The authors added a cycle of arcs with costs 10000; it stays in
    the graph.
    """
    (path,) = paths
    with path.open(encoding="ascii", errors="replace") as file:
        words = file.readline().split()
        if words[:2] != ["sp", "min"] or len(words) != 4:
            raise GraphError(f"{path} must begin with a line `sp min NODES ARCS`, got {' '.join(words)!r}")
        file.readline()
        file.readline()
        return _graph(_whole(words[2], path), _table(file, path, skipped=0), 1)


def read_tntp(paths: Sequence[Path], costs: Sequence[str] = ("length", "free_flow_time")) -> Graph:
    """Read a network of Transportation Networks for Research (github.com/bstabler/TransportationNetworks).

    Each cost is a column, or a ratio of two such as "length/capacity". It is scaled to a median of 1,000 over the links
    on which it is positive, and rounded; a positive cost becomes at least 1.
    """
    (path,) = paths
    head, _, body = path.read_text(encoding="utf-8", errors="replace").partition("<END OF METADATA>")
    nodes = re.search(r"<NUMBER OF NODES>\s*(\d+)", head)
    rows = [SEMICOLONS.split(line.strip(" \t;\r")) for line in body.splitlines()]
    rows = [row for row in rows if len(row) >= 2 + len(TNTP_COLUMNS)]
    if nodes is None or not rows:
        raise GraphError(f"{path} must have <NUMBER OF NODES>, <END OF METADATA> and links of ten columns")
    try:
        table = np.array([row[: 2 + len(TNTP_COLUMNS)] for row in rows if row[0] != "~"], np.float64)
    except ValueError as error:
        raise GraphError(f"{path}: a link must have ten numbers ({error})") from None
    columns = np.column_stack([_scaled(_tntp_cost(table, name)) for name in costs])
    return _graph(int(nodes[1]), np.hstack([table[:, :2].astype(np.int64), columns]), 1)


def _tntp_cost(table: FloatArray, name: str) -> FloatArray:
    """Return one cost of all links: a column of the table, or the ratio of two columns."""
    above, _, below = name.partition("/")
    for part in filter(None, (above, below)):
        if part not in TNTP_COLUMNS:
            raise GraphError(f"a cost must be one of {', '.join(TNTP_COLUMNS)}, or a ratio of two; got {part!r}")
    column: FloatArray = table[:, TNTP_COLUMNS[above]]
    return column / table[:, TNTP_COLUMNS[below]] if below else column


def _scaled(cost: FloatArray) -> IntArray:
    """Scale a cost to a median of `MEDIAN` and round it; positive costs stay at least 1."""
    positive = cost > 0
    if not np.isfinite(cost).all() or (cost < 0).any() or not positive.any():
        raise GraphError("a cost must be finite, not negative, and positive on at least one link; use another column")
    counts = np.rint(cost * (MEDIAN / np.median(cost[positive]))).astype(np.int64)
    return np.where(positive, np.maximum(counts, 1), 0)


READERS: dict[str, Callable[[Sequence[Path]], Graph]] = {
    "netmaker": read_netmaker,
    "tntp": read_tntp,
    "dimacs": read_dimacs,
    "raith-ehrgott": read_raith_ehrgott,
}
"""Readers by the name of their format."""
