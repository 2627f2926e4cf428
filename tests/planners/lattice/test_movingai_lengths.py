"""Shortest paths on the MovingAI benchmark maps equal the optima published with them."""

import numpy as np
import pytest

from hpop.planners.graphs.lattice.grid import STEPS, steps_from
from hpop.search import Graph, pareto_paths
from hpop.world import World

QUANTUM = 1e-9  # m
QUERIES = 200  # a map


@pytest.mark.cases("room-64-64-8")
@pytest.mark.parametrize("name", ["den312d", "room-64-64-8"])
def test_the_length_of_a_grid_path_equals_the_published_optimum(shared_data, name):
    folder = shared_data("movingai") / name
    free = ~World.from_movingai(folder / f"{name}.map").raster.cells  # row 0 is the bottom
    height, width = free.shape
    arcs = []
    for step in STEPS[8]:
        rows, columns, to_rows, to_columns = steps_from(free, step, corner_cutting=False)
        cost = np.full(rows.size, round(np.hypot(*step) / QUANTUM))
        arcs.append(np.stack([rows * width + columns, to_rows * width + to_columns, cost]))
    tails, heads, costs = np.concatenate(arcs, axis=1)
    graph = Graph.from_arcs(free.size, tails, heads, costs[:, None])
    queries = read_queries(next(folder.glob("*.scen")), name, (width, height))
    picked = queries[:: max(1, len(queries) // QUERIES)]
    assert len(picked) >= QUERIES
    for (column, row), (to_column, to_row), length in picked:
        # The file counts rows from the top.
        source = (height - 1 - row) * width + column
        target = (height - 1 - to_row) * width + to_column
        paths = pareto_paths(graph, source, target)
        assert paths.costs[:, 0] * QUANTUM == pytest.approx([float(length)], abs=1e-6 + rounding(length))


def read_queries(path, name, size):
    """Start (column, row), goal (column, row) and optimal length of every query."""
    queries = []
    for line in path.read_text().splitlines()[1:]:
        if not line.strip():
            continue
        _, file, width, height, *numbers, length = line.split()
        assert (file.rpartition("/")[2], int(width), int(height)) == (f"{name}.map", *size)
        a, b, c, d = map(int, numbers)
        queries.append(((a, b), (c, d), length))
    return queries


def rounding(number):
    """Half a unit of the last digit that the file gives: den312d has six digits in all."""
    return 0.5 * 10.0 ** -len(number.partition(".")[2])
