"""Open benchmark: foreign programs compared with exact fronts, formats of others, and instances made by seed."""

from __future__ import annotations

import csv
import importlib.util
import shlex
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from hpop.benchmark import READERS, front_hash, read_graph, read_tntp, write_graph
from hpop.benchmark.__main__ import main
from hpop.benchmark.running import ForeignProgram, add_query, read_queries, read_reference, run_program
from hpop.errors import GraphError, OptionError
from hpop.search import Graph, pareto_paths

OPEN = Path(__file__).parents[2] / "benchmarks/open"
GRAPH = Graph.from_arcs(4, [0, 0, 1, 2], [1, 2, 3, 3], [[1, 4], [3, 1], [1, 4], [3, 1]])
#: A program that sums costs along both paths from 1 to 4, read from the file, and prints them as `a, b`.
FOREIGN = """
import sys
arcs = [list(map(int, line.split()[1:])) for line in open(sys.argv[1]) if line[0] == "a"]
first = int(sys.argv[3])
cost = {(a - first + 1, b - first + 1): costs for a, b, *costs in arcs}
print("c two paths in 0.25 s")
for middle in (3, 2):
    print(*(a + b for a, b in zip(cost[1, middle], cost[middle, 4])), sep=", ")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_graph(GRAPH, tmp_path / "square.gr")
    add_query(tmp_path / "square.gr", 1, 4)
    return tmp_path


def python(code: str, *arguments: str) -> str:
    return shlex.join([sys.executable, "-I", "-S", "-c", code, *arguments])


def result(folder: Path, program: ForeignProgram, limit: float = 60.0):
    (row,) = run_program(program, read_queries(folder), limit)
    return row


def test_a_graph_is_the_same_once_written_and_read(tmp_path: Path) -> None:
    for first in (0, 1):
        write_graph(GRAPH, tmp_path / "graph.gr", first_node=first)
        read = read_graph(tmp_path / "graph.gr", first_node=first)
        assert (read.indptr.tolist(), read.heads.tolist()) == (GRAPH.indptr.tolist(), GRAPH.heads.tolist())
        assert read.costs.tolist() == GRAPH.costs.tolist()


@pytest.mark.parametrize("first", [0, 1])
def test_a_right_program_is_equal_with_its_seconds_and_memory(folder: Path, first: int) -> None:
    command = python(FOREIGN, "{graph}", "{source}{target}", str(first))
    row = result(folder, ForeignProgram(command, first_node=first, clock=r"in (\S+) s"))
    assert (row.front, row.found, row.clock) == ("equal", 2, 0.25)
    assert 0 < row.processor_seconds < 10 * row.seconds
    assert 5 < row.memory < 60, "the program's own memory, not that of this process"


@pytest.mark.parametrize(
    ("code", "front", "found"),
    [
        ("print(2, 8)", "differs", 1),
        ("print(6, 2); print(2, 8); print(2, 8); print('3 4 5')", "equal", 2),
        ("raise SystemExit('no such node')", "failed", 0),
        ("import time; time.sleep(60)", "time limit", None),
    ],
)
def test_other_programs_are_told_apart(folder: Path, code: str, front: str, found: int | None) -> None:
    row = result(folder, ForeignProgram(python(code)), limit=2.0 if front == "time limit" else 60.0)
    assert (row.front, row.found) == (front, found)
    assert ("no such node" in row.message) == (front == "failed")


def test_a_program_that_is_missing_failed(folder: Path) -> None:
    row = result(folder, ForeignProgram("no-such-program {graph}"))
    assert row.front == "failed"
    assert "no-such-program" in row.message


def test_a_program_may_print_a_number_and_read_a_file_for_each_cost(folder: Path) -> None:
    code = "import sys; print('size', sum('a 3 4' in open(name).read() for name in sys.argv[1:]))"
    row = result(folder, ForeignProgram(python(code, "{graphs}"), count=r"size (\d+)"))
    assert (row.front, row.found) == ("equal size", 2)


def test_the_command_runs_hpop_itself_and_writes_both_tables(folder: Path) -> None:
    own = shlex.join([sys.executable, "-m", "hpop.benchmark", "solve", "{graph}", "{source}", "{target}"])
    words = [
        "run",
        "--binary",
        own,
        "--instances",
        str(folder),
        "--clock",
        r"seconds (\S+)",
        "--out",
        str(folder / "own"),
    ]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    with (folder / "own.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["instance"], row["front"], row["vectors"]) == ("square", "equal", "2")
    assert "| square | 1 | 2 | 1 equal |" in (folder / "own.md").read_text()


def test_errors_say_what_is_wrong(folder: Path) -> None:
    with pytest.raises(OptionError, match="no instance is called 'm1'; there are square"):
        read_queries(folder, ["m1"])
    with (folder / "square.gr").open("a") as file:
        file.write("c\n")
    with pytest.raises(GraphError, match="SHA-256 differs"):
        read_queries(folder)
    (folder / "other.gr").write_text("p sp 2 2\na 1 2 3\n")
    with pytest.raises(GraphError, match="announces 2 arcs, but has 1"):
        read_graph(folder / "other.gr")
    with pytest.raises(OptionError, match="one group"):
        ForeignProgram("x", count="size")


TNTP = """<NUMBER OF NODES> 3
<NUMBER OF LINKS> 3
<END OF METADATA>


~ \tinit_node\tterm_node\tcapacity\tlength\tfree_flow_time\tb\tpower\tspeed\ttoll\tlink_type\t;
\t1\t2\t100\t2\t0.5\t0.15\t4\t0\t0\t1\t;
\t2\t3\t200\t4\t0\t0.15\t4\t0\t0\t1\t;
\t1\t3\t100\t1\t0.25\t0.15\t4\t0\t0\t1\t;
"""


def test_files_of_others_are_read(tmp_path: Path) -> None:
    files = {
        "netmaker": ["p sp 3 2\na 0 1 5 9\na 1 2 1 1\n"],
        "dimacs": ["c USA\np sp 3 2\na 1 2 5\na 2 3 1\n", "p sp 3 2\na 1 2 9\na 2 3 1\n"],
        "raith-ehrgott": ["sp min 3 2\n1 1\n3 -1\n1 2 5 9\n2 3 1 1\n"],
    }
    for form, texts in files.items():
        paths = [tmp_path / f"{form}{i}" for i in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_text(text)
        graph = READERS[form](paths)
        assert (graph.nodes, graph.heads.tolist(), graph.costs.tolist()) == (3, [1, 2], [[5, 9], [1, 1]])
    (tmp_path / "net.tntp").write_text(TNTP)
    graph = read_tntp([tmp_path / "net.tntp"], ["length", "free_flow_time", "length/capacity"])
    assert graph.heads.tolist() == [1, 2, 2]
    assert graph.costs.tolist() == [[1000, 1333, 1000], [500, 667, 500], [2000, 0, 1000]]
    (tmp_path / "other").write_text("p sp 3 2\na 1 2 5\na 3 2 1\n")
    with pytest.raises(GraphError, match="same order"):
        READERS["dimacs"]([tmp_path / "dimacs0", tmp_path / "other"])


# The instances of the repository


@pytest.fixture(scope="module")
def make() -> ModuleType:
    spec = importlib.util.spec_from_file_location("open_make", OPEN / "make.py")
    module = sys.modules["open_make"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["open_make"]


@pytest.mark.parametrize("name", ["grid-20-k3", "grid-14-k4", "netmaker-300-k3"])
def test_small_instances_have_the_reference_of_the_repository(name: str, make: ModuleType, tmp_path: Path) -> None:
    known = read_reference(OPEN)[name]
    graph, pairs = make.RECIPES[name].make()
    write_graph(graph, tmp_path / f"{name}.gr")
    assert make.file_hash(tmp_path / f"{name}.gr") == known["sha256"]
    for (source, target), row in zip(pairs, known["queries"], strict=True):
        front = pareto_paths(graph, source, target).costs
        assert (len(front), front_hash(front)) == (row["vectors"], row["sha256"])
        if name == "grid-14-k4" and len(front) < 50:  # larger ones take a minute
            assert np.array_equal(front, make.plain_front(tmp_path / f"{name}.gr", source + 1, target + 1))


def test_every_front_of_the_repository_was_found_by_two_methods() -> None:
    instances = read_reference(OPEN)
    assert {"m60", "m100", "netmaker-3000-k3", "grid-100-k2"} <= set(instances)
    assert all(len(row["checked_by"]) >= 2 for instance in instances.values() for row in instance["queries"])
