"""Claims: any graph in a text file is searched, its figures printed as one line of JSON; bad lines are named."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import pytest

from hpop.errors import GraphError
from hpop.search.networks import MAX_SUM

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
ARCS = """# tail head, then time, money and risk
0 1 1 5 0

1 2 1 5 0   # the same again
0 2 9 1 1
"""


@pytest.fixture
def graph(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("graph")


@pytest.fixture
def run(graph, tmp_path, monkeypatch, capsys):
    def go(text: str | bytes, *options: str) -> tuple[int, str, str]:
        file = tmp_path / "arcs.txt"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        monkeypatch.setattr(sys, "argv", ["graph.py", "--arcs", str(file), *options])
        code = 0
        try:
            graph.main()
        except SystemExit as end:
            code = int(end.code or 0)
        return code, *capsys.readouterr()

    return go


def test_one_line_tells_what_was_searched_and_found(run):
    code, out, _ = run(ARCS, "--source", "0", "--target", "2", "--method", "general")
    assert code == 0
    assert out.count("\n") == 1
    told = json.loads(out)
    assert (told["nodes"], told["arcs"], told["costs"], told["front"], told["status"]) == (3, 3, 3, 2, "complete")
    assert (told["labels_generated"], told["labels_expanded"], told["method"]) == (3, 4, "general")
    assert sorted(told["order"]) == [0, 1, 2]
    assert told["peak_memory"] > 0
    assert told["seconds"] == pytest.approx(told["seconds_bounds"] + told["seconds_search"])


def test_limits_and_several_targets(run):
    _, out, _ = run(ARCS, "--source", "0", "--target", "1", "2", "--max-memory", "1")
    assert json.loads(out)["status"] == "memory limit"
    _, out, _ = run(ARCS, "--source", "0", "--target", "1", "2")
    assert json.loads(out)["front"] == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no arcs"),
        ("# nothing\n\n", "holds no arcs"),
        ("0 1 2 3\n0 x 2 3\n", "line 2: .* must be integers, got '0 x 2 3'"),
        ("# head\n0 1 2.5 3\n", "line 2: .* must be integers, got '0 1 2.5 3'; quantise"),
        ("0 1 2 3\n\n1 2 3\n", "line 3: 2 costs are expected, as in the first arc, got 1"),
        ("0 1\n", "line 1: tail, head and 1 to 6 costs are expected, got 2 numbers"),
        ("0 1 1 2 3 4 5 6 7\n", "line 1: tail, head and 1 to 6 costs are expected, got 9 numbers"),
        ("0 1 2 3\n1 2 -3 4\n", f"line 2: costs must be from 0 to {MAX_SUM}, got -3 4"),
        ("0 1 2 9999999999999999999999\n", f"line 1: costs must be from 0 to {MAX_SUM}"),
        ("-1 1 2 3\n", "line 1: nodes must be numbers from 0 to 2147483645, got -1 and 1"),
        ("0 3000000000 2 3\n", "line 1: nodes must be numbers from 0 to 2147483645, got 0 and 3000000000"),
    ],
)
def test_bad_lines_are_named(graph, tmp_path, text, message):
    file = tmp_path / "arcs.txt"
    file.write_text(text)
    with pytest.raises(GraphError, match=message):
        graph.read_arcs(file)


def test_what_is_wrong_ends_the_program_with_a_message(run):
    ends = ("--source", "0", "--target", "2")
    for text, options, message in (
        ("0 1 2\n1 2\n", ends, "line 2"),
        (ARCS, ("--source", "3", "--target", "2"), "source must be a node from 0 to 2, got 3"),
        (ARCS, ("--source", "0", "--target", "-1"), "target must be a node from 0 to 2, got -1"),
        (ARCS, ("--source", "0"), "--arcs needs --source and --target"),
        (ARCS, (*ends, "--method", "fast"), "auto, staircase, general"),
        (ARCS, (*ends, "--time-limit", "-1"), "time_limit must be"),
        (f"0 1 {MAX_SUM}\n1 2 {MAX_SUM}\n", ends, "cost 0 of a path must stay below"),
        (b"\xff\xfe0 1", ends, "utf-8"),
    ):
        code, out, error = run(text, *options)
        assert (code, out) == (2, "")
        assert message in error


def test_a_file_that_is_not_there_is_named(graph, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["graph.py", "--arcs", "nowhere.txt", "--source", "0", "--target", "1"])
    with pytest.raises(SystemExit, match="2"):
        graph.main()
    assert "nowhere.txt" in capsys.readouterr().err


def test_pulidos_queries_have_the_published_fronts(graph, shared_data, monkeypatch):
    folder = shared_data("pulido_grids")
    lines = (folder / "solutions" / "p0" / "3.txt").read_text().splitlines()
    numbers = [int(word) for line in lines if not line.startswith("%") for word in line.split()]
    sizes, at = [], 0
    while at < len(numbers):
        sizes.append(numbers[at + 2])
        at += 3 + 3 * sizes[-1]
    monkeypatch.setattr(graph, "PULIDO", folder)
    queries = list(graph.pulido(0, 3))
    assert len(queries) == 15
    told = graph.row("Pulido", queries[: len(sizes)])
    assert (told["nodes"], told["arcs"], told["costs"], told["queries"]) == (10_000, 39_600, 3, len(sizes))
    assert told["front"] == sum(sizes)
