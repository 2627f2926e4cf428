"""`hpop plan` with nothing compiled: a first answer before the search's kernels are, and nothing compiled in vain.

A cold run takes some 15 seconds of the processor, so these are for `make proof`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hpop.problems.front import Front
from tests.worlds import ONE_WALL

ROOM = ONE_WALL.replace("step: 0.25", "step: 0.25, time_limit: 5")
#: What the first answer takes, what the exact front does, and what later first answers do, as far as it is compiled.
FIELDS = {"nearest", "ball_volumes", "_primitive", "spline", "_weights"}
SEARCH = {"number_groups", "separate_turns", "write_turn_costs", "no_dearer_than_two", "fill_tables", "advance"}
SEARCH |= {
    "trace_paths",
    "node_of",
    "copy_to_double_width",
    "pack_arcs",
    "settle_groups",
    "append_group",
    "remove_group",
}
SEARCH |= {"costs_of_least_path", "open_next", "sift_down", "least_covered", "lower", "enter_stairs"}
AHEAD = {
    "arcs_onward",
    "reduce_costs",
    "weighted_path",
    "push",
    "drop_first",
    "precedes",
    "compare",
    "write_weighted_cost",
}


def plan(folder: Path) -> subprocess.CompletedProcess[str]:
    """Plan the room with a cache of kernels of the folder's own."""
    own = {"NUMBA_CACHE_DIR": str(folder / "cache"), "MPLCONFIGDIR": str(folder / "matplotlib")}
    command = [sys.executable, "-P", "-c", "from hpop.cli import main; main()", "plan", "room.yaml", "--out", "out"]
    return subprocess.run(command, cwd=folder, env=os.environ | own, capture_output=True, text=True, check=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which the room was planned twice."""
    folder = tmp_path_factory.mktemp("cold")
    (folder / "room.yaml").write_text(ROOM)
    for name in ("cold", "warm"):
        done = plan(folder)
        (folder / name).write_text(done.stdout + done.stderr)
        kept = sorted(path.name for path in folder.glob("cache/*/*.nbc"))
        (folder / f"{name}_kernels").write_text("\n".join(kept))
    return folder


@pytest.mark.proof
def test_a_first_answer_comes_before_the_search_is_compiled(folder: Path) -> None:
    cold = (folder / "cold").read_text()
    assert cold.count("the search is compiled in the background after a first answer and its map, once") == 1
    first, *_, last = re.findall(r"(?<= s  )lattice: .*", cold)
    assert first.endswith("unfinished")
    assert last.endswith("complete")
    assert "compiled" not in (folder / "warm").read_text()


@pytest.mark.proof
def test_nothing_is_compiled_that_the_room_does_not_take_and_nothing_twice(folder: Path) -> None:
    files = (folder / "cold_kernels").read_text().split()
    kernels = [match[1] for name in files if (match := re.match(r"\w+\.(\w+)-\d+\.", name))]
    assert len(set(kernels)) == len(kernels) == len(files)
    assert FIELDS <= set(kernels) <= FIELDS | SEARCH | AHEAD
    warm = (folder / "warm_kernels").read_text().split()
    assert set(files) <= set(warm)


@pytest.mark.proof
def test_no_limit_of_time_covers_compiling(folder: Path) -> None:
    front = Front.load(folder / "out" / "front.json")
    assert front.status == "complete"
    assert front.certificate.startswith("lattice: exact")
