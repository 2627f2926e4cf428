"""A run is followed by a line on a terminal, by a function, and in the log."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import pytest
import shapely

import hpop
from hpop.runtime.compiled import numba
from hpop.runtime.limits import Progress, described, progress_bar
from tests.warm import Warm

#: What somebody writes into a file of their own.
FOLLOWED = """\
import shapely, hpop
world = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 5, 4))
problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (4, 1, 0), ["turns", "length"])
print(len(problem.solve(step=0.5, progress=True)))
"""


@pytest.fixture(scope="module")
def problem() -> hpop.Problem:
    world = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 5, 4))
    return hpop.Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (4, 1, 0), ["turns", "length"])


def test_progress_says_stage_labels_front_and_memory() -> None:
    said = described(Progress("search", labels=1_234_567, open=89, front=1012, memory=345_000_000))
    for words in ("search", "1,234,567 labels", "89 open", "front 1,012", "345 MB"):
        assert words in said
    assert described(Progress("compiling")) == "compiling"


def test_progress_is_silent_where_no_one_watches(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as progress:
        progress(Progress("search", labels=5))
    assert capsys.readouterr() == ("", "")


def test_a_run_in_python_is_followed_on_a_terminal_and_its_output_is_its_own(warm: Warm, tmp_path: Path) -> None:
    ours, terminal = os.openpty()
    with (tmp_path / "out").open("wb") as out:
        environment = {"TERM": "xterm", "COLUMNS": "100"}
        asked = {"cwd": tmp_path, "stdout": out.fileno(), "stderr": terminal, "environment": environment}
        process = warm.start(code=FOLLOWED, **asked)
        os.close(terminal)
        said = b""
        while piece := read(ours):
            said += piece
    os.close(ours)
    assert process.wait() == 0, said.decode()
    assert b"starting" in said
    assert int((tmp_path / "out").read_text()) > 1


def read(terminal: int) -> bytes:
    """Read the next output; empty once the last writer has closed, which Linux reports as an error."""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""


def test_the_log_tells_the_stages_and_what_each_planner_found(
    problem: hpop.Problem, caplog: pytest.LogCaptureFixture
) -> None:
    heard: list[Progress] = []
    with caplog.at_level(logging.DEBUG, "hpop"):
        front = problem.solve([{"lattice": {"step": 0.5}}, {"weighted-sum": {"step": 0.5}}], progress=heard.append)
    told = [(record.levelname, record.getMessage()) for record in caplog.records if record.name == "hpop"]
    found = [text for level, text in told if level == "INFO"]
    assert [text.split(":")[0] for text in found] == ["lattice", "weighted-sum"]
    assert f"{len(front)} found, front of {len(front)}, complete" in found[0]
    stages = [text.split(" ")[0] for level, text in told if level == "DEBUG"]
    assert stages
    assert set(stages) == {progress.stage.split(" ")[0] for progress in heard}
    assert len(stages) <= len(heard)


def test_nothing_is_logged_and_nobody_told_where_none_listens(
    problem: hpop.Problem, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    problem.solve(step=0.5, progress=False)
    assert not caplog.records
    assert capsys.readouterr() == ("", "")


def test_who_listens_to_everything_is_not_told_what_numba_compiles(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        assert numba.njit(lambda n: n + 1)(2) == 3
    assert not [record for record in caplog.records if record.name.startswith("numba")]
