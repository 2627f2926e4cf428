"""Benchmark of tours: graphs, labels, fronts, processor seconds and memory, each row in a process of its own.

    python benchmarks/tours.py [--out FILE]

The museum of examples/, criteria exposure, turns and length, discs of 1.5 m as stops, without dwells. ``layers`` are
copies of the graph, one for each set of visited stops; ``nodes`` and ``arcs`` are those of all layers, which share
the arcs of one. ``build_s`` are processor seconds of the graph with its costs, ``search_s`` of the bounds and the
search. ``process_mb`` is the peak memory of the process, ``own_mb`` its growth after a small tour, with which all
compiled code is loaded.

Goals: at most the seconds of a prototype that copied all arrays for each layer, and at most a third of the memory of
its process (``prototype_s``, ``prototype_mb``; its stops were elsewhere). ``layers``, ``nodes``, ``arcs``, ``labels``
and ``front`` do not depend on the machine. How much speeds as a decision gain is measured by benchmarks/speeds.py.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any

import hpop
from hpop.planners.spending import Limits
from hpop.search import ParetoPaths

STOPS = ((6.0, 16.5), (22.0, 16.5), (20.0, 5.0), (26.5, 16.0), (4.0, 6.5), (12.0, 17.0))  # m
WITHIN = 1.5  # m


@dataclass(frozen=True)
class Case:
    """Step of the lattice, m, number of stops, their order, and relative precision; prototype's seconds and memory."""

    step: float
    stops: int
    order: str = "given"
    eps: float = 0.0
    prototype_s: float | None = None
    prototype_mb: float | None = None


WARM = Case(1.0, 3, "any")
CASES = (
    Case(0.5, 0),
    Case(0.5, 3, "given", 0.0, 0.06, 250),
    Case(0.5, 3, "any", 0.0, 0.13, 310),
    Case(0.5, 5, "any", 0.0, 0.65),
    Case(0.5, 6, "any", 0.01, 1.5, 1100),
    Case(0.25, 0),
    Case(0.25, 3, "given", 0.0, 0.36),
    Case(0.25, 3, "any", 0.0, 0.86),
    Case(0.25, 4, "given", 0.0, 5.1),
    Case(0.25, 4, "any", 0.0, 3.0, 1100),
    Case(0.25, 5, "any", 0.01, 4.0),
)


def problem(case: Case) -> hpop.Problem:
    """Return the problem of a case, without a tour if it has no stops."""
    museum = hpop.examples.museum()
    stops = [{"at": place, "within": WITHIN} for place in STOPS[: case.stops]]
    tour = hpop.Tour(stops, order=case.order) if stops else None
    criteria = ["exposure", "turns", "length"]
    return hpop.Problem(museum.world, museum.model, museum.start, (28.0, 10.0, 0.0), criteria, tour=tour)


def searched(case: Case) -> tuple[ParetoPaths, dict[str, Any]]:
    """Build the graph of a case and search it; return the paths, and the figures."""
    asked, begun = problem(case), process_time()
    query = hpop.Lattice(step=case.step).query(asked)
    built = process_time()
    paths = query.paths(Limits(), eps=case.eps)
    assert isinstance(paths, ParetoPaths)
    figures = {
        "layers": query.space.counts.get("tour_layers", 1),
        "nodes": query.graph.nodes,
        "arcs": query.graph.arcs,
        "labels": paths.stats.labels_generated,
        "front": len(paths),
        "build_s": round(built - begun, 3),
        "search_s": round(process_time() - built, 3),
    }
    return paths, figures


def peak() -> float:
    """Return the peak memory of this process, MB."""
    status = Path("/proc/self/status")  # the peak of getrusage includes the process that started this one
    if status.exists():
        return next(int(line.split()[1]) * 1024 / 1e6 for line in status.open() if line.startswith("VmHWM"))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


def measured(case: Case) -> dict[str, Any]:
    """Return the row of a case, measured in this process after a small tour."""
    searched(WARM)
    before = peak()
    _, figures = searched(case)
    return {**asdict(case), **figures, "own_mb": round(peak() - before), "process_mb": round(peak())}


def main() -> None:
    """Measure all cases, and print or write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    rows = []
    for case in CASES:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            rows.append(process.submit(measured, case).result())
        print(json.dumps(rows[-1]), flush=True)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps({"load": round(os.getloadavg()[0], 1), "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
