"""Small wheel hpop-search: it needs numpy and numba alone, and finds the fronts of hpop.search."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import llvmlite
import numba
import numpy as np
import pytest

import hpop
from hpop.frontier import is_nondominated
from hpop.search import Graph, pareto_paths

ROOT = Path(__file__).resolve().parents[1]
#: Imported in functions, if their feature is used; the last two for type checkers.
OPTIONAL = {"networkx", "moocore", "rich", "pydantic_core", "pandas", "xarray"}
CODE = """
import json, sys
from hpop_search import Graph, Prepared, __version__, pareto_paths, supported_paths
from hpop_search.errors import QueryError
from hpop_search.timed import TimedGraph, timed_paths

n, tails, heads, costs = json.load(sys.stdin)
graph = Graph.from_arcs(n, tails, heads, costs)
fronts = [pareto_paths(graph, 0, n - 1, method=method).costs.tolist() for method in ("general", "staircase")]
fronts.append(Prepared(graph, n - 1).paths(0).costs.tolist())
supported_paths(graph, 0, n - 1)
ride = TimedGraph(Graph.from_arcs(3, [0, 0, 1], [1, 2, 2], [[1, 0], [9, 0], [1, 0]]), [1, 1, 1], 3, timed=[2],
                  costs={0: [[8, 8, 8, 0]]}, hold=1)
try:
    pareto_paths(graph, 0, "1")
except QueryError as error:
    message = str(error)
front = pareto_paths(graph, 0, n - 1).front()
others = sorted({name.partition(".")[0] for name in sys.modules} & {"hpop", "scipy", "networkx", "moocore", "pydantic"})
print(json.dumps([__version__, fronts, timed_paths(ride, 0, 2).costs.tolist(), len(front), others]))
"""


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    spec = importlib.util.spec_from_file_location("search_wheel", ROOT / "tools/search/build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_its_sources_import_numpy_and_numba_alone(builder: ModuleType, tmp_path: Path) -> None:
    builder.write_sources(tmp_path)
    at_start, later = set(), set()
    for path in (tmp_path / builder.NAME).rglob("*.py"):
        module = ast.parse(path.read_text())
        for node in ast.walk(module):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            (at_start if node in module.body else later).update(name.partition(".")[0] for name in names)
    own = {*sys.stdlib_module_names, "numpy", "numba", builder.NAME}
    assert at_start <= own
    assert later <= own | OPTIONAL
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]
    assert project["version"] == hpop.__version__
    assert [re.split("[<>=]", text)[0] for text in project["dependencies"]] == ["numpy", "numba"]


def test_dominance_without_moocore_marks_the_same_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    for costs in (1, 2, 3, 5):
        vectors = rng.integers(0, 7, (80, costs))
        expected = is_nondominated(vectors)
        with monkeypatch.context() as without:
            without.setitem(sys.modules, "moocore", None)
            assert is_nondominated(vectors).tolist() == expected.tolist()


@pytest.mark.proof
def test_the_wheel_finds_the_fronts_of_hpop_with_numpy_and_numba_alone(builder: ModuleType, tmp_path: Path) -> None:
    packages = tmp_path / "packages"
    with zipfile.ZipFile(builder.build(tmp_path / "wheels")) as wheel:
        wheel.extractall(packages)
    for library in (np, numba, llvmlite):
        folder = Path(library.__file__).parent
        for path in (folder, folder.with_name(f"{folder.name}.libs")):
            if path.exists():
                (packages / path.name).symlink_to(path)
    rng = np.random.default_rng(0)
    tails = np.repeat(np.arange(57), 3).tolist()
    heads = [tail + 1 + i % 3 for i, tail in enumerate(tails)]
    costs = rng.integers(1, 9, (len(tails), 3)).tolist()
    done = subprocess.run(
        [sys.executable, "-S", "-c", CODE],
        input=json.dumps([60, tails, heads, costs]),
        env={"PYTHONPATH": str(packages), "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PATH": os.environ["PATH"]},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    version, fronts, timed, size, others = json.loads(done.stdout)
    expected = pareto_paths(Graph.from_arcs(60, tails, heads, costs), 0, 59).costs.tolist()
    assert len(expected) > 5
    assert fronts == [expected] * 3
    assert (version, timed, size, others) == (hpop.__version__, [[1, 0]], len(expected), [])
