"""Kernels where their cache cannot be written: a container that is read-only, for a user without a home."""

from __future__ import annotations

import os
import pickle
import re
import runpy
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.caching import NullCache

import hpop
from hpop.runtime.compiled import kernel, lean, numba, wide

PACKAGE = Path(hpop.__file__).parent
KERNELS = sorted(
    ".".join(("hpop", *path.relative_to(PACKAGE).with_suffix("").parts))
    for path in PACKAGE.rglob("*.py")
    if re.search(r"^@(kernel|lean|wide)$|njit", path.read_text(encoding="utf-8"), re.MULTILINE)
)
USE = """\
import importlib, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
import numpy as np
from hpop.world.fields._kernels import spline
out, one, half = np.zeros(1), np.ones(1, np.int64), np.full(1, 0.5)
spline(np.ones((4, 4)), one, one, half, half, out)
print(out.round(9).tolist(), "coverage" in sys.modules)
"""


@pytest.fixture(scope="module", params=[1000, pytest.param(1, marks=pytest.mark.proof)], ids=["one", "all"])
def unwritable(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> subprocess.CompletedProcess[str]:
    """Use a kernel in a copy of hpop where no cache can be written, not even by root."""
    folder = tmp_path_factory.mktemp("read_only")
    shutil.copytree(PACKAGE, folder / "hpop", ignore=shutil.ignore_patterns("__pycache__"))
    for inside in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        (inside / "__pycache__").write_text("a file where a folder should be")
    file = folder / "file"
    file.write_text("no folder below this")
    elsewhere = {"HOME": str(file / "home"), "NUMBA_CACHE_DIR": str(file / "cache"), "PYTHONPATH": str(folder)}
    environment = {**os.environ, **elsewhere, "XDG_CACHE_HOME": str(file / "xdg")}
    environment.pop("COVERAGE_PROCESS_START", None)
    command = [sys.executable, "-P", "-c", USE, *KERNELS[:: request.param]]
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)


def test_every_kernel_works_where_no_cache_can_be_written(unwritable: subprocess.CompletedProcess[str]) -> None:
    assert len(KERNELS) > 15
    assert "Traceback" not in unwritable.stderr
    assert unwritable.stdout.startswith("[1.0] ")


def test_coverage_is_not_imported_for_numba_where_it_does_not_measure(
    unwritable: subprocess.CompletedProcess[str],
) -> None:
    assert unwritable.stdout.endswith(" False\n")


def test_that_they_are_compiled_anew_each_time_is_said_once_with_what_helps(
    unwritable: subprocess.CompletedProcess[str],
) -> None:
    said = [line for line in unwritable.stderr.splitlines() if "Warning" in line]
    assert len(said) == 1
    assert "each process compiles it again" in said[0]
    assert "NUMBA_CACHE_DIR" in said[0]


def test_a_wide_kernel_takes_neighbouring_numbers_in_one_instruction() -> None:
    def added(one: Any, other: Any) -> None:
        a, b, c, d = one[0] + other[0], one[1] + other[1], one[2] + other[2], one[3] + other[3]
        other[0], other[1], other[2], other[3] = a, b, c, d

    vectors = {}
    for compiled in (lean, wide):
        made, sums = compiled(added), np.arange(4.0)
        made._cache = NullCache()  # of what is kept numba does not tell the instructions
        made(np.full(4, 0.5), sums)
        assert sums.tolist() == [0.5, 1.5, 2.5, 3.5]
        (code,) = made.inspect_llvm().values()
        vectors[compiled] = re.findall(r"fadd <(\d+) x double>", code)
    assert not vectors[lean]
    assert vectors[wide]


def test_ctrl_c_while_llvm_calls_back_is_neither_lost_nor_leaves_half_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    def doubled(x: int) -> int:
        return 2 * x

    made = kernel(doubled)
    made._cache = numba.core.caching.NullCache()
    engine = numba.core.registry.cpu_target.target_context.codegen()._engine._ee
    notified = engine._object_cache_notify

    def interrupted(module: Any, code: bytes) -> None:
        signal.raise_signal(signal.SIGINT)
        notified(module, code)

    with monkeypatch.context() as once:
        once.setattr(engine, "_object_cache_notify", interrupted)
        with pytest.raises(KeyboardInterrupt):
            made(2)
    assert made(2) == 4


@pytest.mark.parametrize("index", [b"no pickle", b"chpop.gone\nBodies\n."], ids=["damaged", "of a module that is gone"])
def test_an_index_that_cannot_be_read_is_written_anew(tmp_path: Path, index: bytes) -> None:
    source = tmp_path / "own.py"
    source.write_text("from hpop.runtime.compiled import kernel\n\n@kernel\ndef doubled(x):\n    return 2 * x\n")
    assert runpy.run_path(str(source))["doubled"](2) == 4
    (kept,) = (tmp_path / "__pycache__").glob("*.nbi")
    kept.write_bytes(pickle.dumps(numba.__version__) + index)
    assert runpy.run_path(str(source))["doubled"](2) == 4
    with kept.open("rb") as file:
        assert pickle.load(file) == numba.__version__
        assert len(pickle.load(file)) == 2


FOUND = """\
import json
import numpy as np, shapely
import hpop
from hpop.search import Graph, pareto_paths, supported_paths

def fronts():
    rng, found = np.random.default_rng(0), []
    for k in (1, 2, 3):
        (tails, heads), costs = rng.integers(0, 20, (2, 60)), rng.integers(1, 9, (60, k))
        for last in ("sum", "max"):
            graph = Graph.from_arcs(20, tails, heads, costs, aggregates=["sum"] * (k - 1) + [last])
            for method in ("auto", "general"):
                found.append(sorted(pareto_paths(graph, 0, 19, method=method).costs.tolist()))
        found.append(sorted(supported_paths(Graph.from_arcs(20, tails, heads, costs), 0, 19).costs.tolist()))
    boxes = [shapely.box(1.4, 0.7, 1.6, 1.2), shapely.box(1.2, 0.0, 1.9, 0.2)]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(0, 0, 3, 3))
    walker = hpop.Person(2.5, 0.5, velocity=(-0.5, 0.2), until=3.0)
    robot, coarse = hpop.DifferentialDrive(radius=0.2), {"step": 0.5, "headings": 4}
    for people, criteria, planner in [
        ([], ["exposure", "turns", "length"], {"lattice": coarse}),
        ([], ["obstruction", "length"], {"lattice": {**coarse, "max_detour": 1.5}}),
        ([], ["exposure", "length"], {"weighted-sum": coarse}),
        ([walker], ["hall_zones", "length", "turns"], {"lattice": {**coarse, "clock": 0.5}}),
    ]:
        among = world.with_content(people=people)
        front = hpop.Problem(among, robot, (0.5, 1, 0), (2.5, 1, None), criteria).solve(planner)
        found.append([front.costs.round(9).tolist(), front.status, front.certificate])
    return json.dumps(found)
"""


def test_without_just_in_time_compilation_kernels_run_as_plain_python_and_find_the_same() -> None:
    """As people set for coverage and for debuggers; warnings are errors there, as in the tests of many projects."""
    compiled: dict[str, Any] = {}
    exec(FOUND, compiled)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    asks = f"{FOUND}\nfrom hpop.search.machinery.kernels import push\nprint(type(push).__name__, fronts())"
    plain = subprocess.run(
        [sys.executable, "-W", "error", "-c", asks], env=environment, capture_output=True, text=True, check=False
    )
    assert plain.stderr == ""
    assert plain.stdout.strip() == f"_PlainKernel {compiled['fronts']()}"
