"""Claims: fronts on public general graphs have the published sizes, by the method that the rule of "auto" gives."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from hpop.errors import GraphError
from hpop.search import pareto_paths

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def general(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("general")


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("netmaker_79134", slice(9, 13, 3)),
        ("philadelphia", slice(4, 7, 2)),
        pytest.param("netmaker_79134", slice(None), marks=pytest.mark.proof),
        pytest.param("philadelphia", slice(None), marks=pytest.mark.proof),
    ],
)
def test_fronts_have_the_published_sizes(shared_data, general, name, rows):
    """NetMaker 79134: sizes published with T-MDA; Philadelphia: sizes on which four programs agreed."""
    graph, queries = general.published(shared_data("general_graphs"), name)
    for source, target, front in queries[rows]:
        paths = pareto_paths(graph, source, target)
        assert (len(paths), paths.stats.method) == (front, "general")


def test_sets_made_by_seed_have_equal_fronts_by_every_method(general):
    graph, queries = general.netmaker(200, 1200, 0)
    made = general.row("small", graph, queries, 3)
    assert made["queries"] == 3
    assert made["labels_generated"]["auto"] > 0
    cells, ends = general.headings(6, 0)
    assert general.row("cells", cells, ends, 1)["methods_of_auto"] == ["staircase"]


def test_a_file_in_the_format_of_dimacs_is_read_and_a_bad_line_is_named(general, tmp_path):
    file = tmp_path / "small.gr"
    file.write_text("c a comment\np sp 3 2\na 0 1 5 7\na 1 2 1 1\n")
    graph = general.read_dimacs(file)
    assert (graph.nodes, graph.arcs) == (3, 2)
    np.testing.assert_array_equal(graph.costs, [[5, 7], [1, 1]])
    file.write_text("p sp 3 2\na 0 one 5 7\n")
    with pytest.raises(GraphError, match="line 2: expected integers"):
        general.read_dimacs(file)
    file.write_text("p sp 3 2\na 0 1 5 7\na 0 1 5\n")
    with pytest.raises(GraphError, match="one number of costs"):
        general.read_dimacs(file)
