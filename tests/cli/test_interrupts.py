"""Ctrl-C and SIGTERM while a real process of `hpop plan` searches.

Nothing here waits for seconds: what is waited for is a line on the terminal, a file, or the end of the process, and a
process that never gives it is ended with the suite's own deadline (`faulthandler_timeout`).
"""

from __future__ import annotations

import os
import pty
import re
import signal
import time
from pathlib import Path

import pytest
import yaml

from hpop.problems.front import Front
from tests.warm import UNDRAWN, Process, Warm
from tests.worlds import pillars


def until(terminal: int, pattern: bytes) -> bytes:
    """Return the output of a terminal up to a pattern."""
    seen = b""
    while not re.search(pattern, seen):
        try:
            seen += os.read(terminal, 65536)
        except OSError:  # its last writer has ended
            raise AssertionError(seen[-2000:]) from None
    return seen


def until_large(file: Path, size: int, process: Process, output: Path) -> None:
    """Wait until a process has written a file of so many bytes."""
    while not file.exists() or file.stat().st_size < size:
        assert process.is_running, output.read_text()
        time.sleep(0.01)  # nothing is proven by it


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """Six costs in a room with scattered pillars: the search makes many millions of labels before it ends.

    The bound on the turns, far above what any path takes, asks for this search alone, with no stage before it that ends
    by the clock.
    """
    content = pillars() | {
        "criteria": ["exposure", "turns", "length", "rotation", "clearance", "enclosure"],
        "planner": {"lattice": {"step": 0.2, "headings": 8, "max_turns": 1000}},
    }
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(content))
    return tmp_path


def test_ctrl_c_keeps_what_a_running_search_has_found(room: Path, warm: Warm) -> None:
    ours, theirs = pty.openpty()
    said = room / "said.txt"
    with said.open("w") as output:
        process = warm.start(
            *("plan", "room.yaml", "--out", "out"),
            cwd=room,
            stdout=output.fileno(),
            stderr=theirs,
            code=UNDRAWN,
            environment={"TERM": "xterm", "COLUMNS": "120"},
        )
    os.close(theirs)
    try:
        seen = until(ours, rb"\d{3},\d{3} labels, [\d,]+ open, front [1-9]")
        assert b"search" in seen
        assert b" MB" in seen
        process.send_signal(signal.SIGINT)
        until(ours, rb"stopping: the results so far are being saved")
        assert process.wait() == 130
    finally:
        process.kill()
        os.close(ours)
    words = " ".join(said.read_text().split())  # lines break where the gap's digits make them
    assert "status: interrupted" in words
    assert "incomplete (interrupted)" in words
    front = Front.load(room / "out" / "front.json")
    assert (len(front) > 0, front.status) == (True, "interrupted")
    last = "written to out: front.json; pictures are being drawn in the background"
    assert said.read_text().endswith(f"all is drawn beside\n{last}\n")


@pytest.mark.parametrize(
    "ignored",
    [
        pytest.param(False, id="as a job", marks=pytest.mark.proof),
        pytest.param(True, id="where Ctrl-C is ignored, as for jobs of a script"),
    ],
)
def test_sigterm_keeps_what_a_running_search_has_found_and_its_checkpoint(
    room: Path, warm: Warm, ignored: bool
) -> None:
    often = (
        "import inspect; from hpop.search.machinery.checkpoint import Checkpoint; "
        "inspect.unwrap(Checkpoint.__init__).__defaults__ = (0.0,)"
    )
    said, errors = room / "said.txt", room / "errors.txt"
    with said.open("w") as output, errors.open("w") as messages:
        process = warm.start(
            *("plan", "room.yaml", "--out", "out", "--checkpoint", "search.ckpt"),
            cwd=room,
            stdout=output.fileno(),
            stderr=messages.fileno(),
            code=f"{often}\n{UNDRAWN}",
            ignore_interrupts=ignored,
        )
    try:
        until_large(room / "search.ckpt", 1_000_000, process, errors)  # by then it has found the first paths
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 130, errors.read_text()
    finally:
        process.kill()
    assert "stopping: the results so far are being saved" in errors.read_text()
    assert "status: interrupted" in said.read_text()
    assert "plan again with --checkpoint search.ckpt to continue" in said.read_text()
    front = Front.load(room / "out" / "front.json")
    assert (len(front) > 0, front.status) == (True, "interrupted")
    assert "all is drawn beside" in said.read_text()


HELD = """\
import signal
from pathlib import Path
from hpop.planners.programs.spline.job import SplineJob
solve, begun = SplineJob.solve, []
def solve_one(job, path):
    begun.append(path)
    if len(begun) == 2:
        Path("held").touch()
        signal.pause()
    return solve(job, path)
SplineJob.solve = solve_one
"""  # it makes splines of one path, and never ends those of the second


@pytest.mark.proof
def test_kill_9_between_stages_leaves_the_front_of_the_last(tmp_path: Path, warm: Warm) -> None:
    shelf = yaml.safe_load(Path("examples/arm_shelf.yaml").read_text())
    for key in ("urdf", "srdf"):
        shelf["model"]["serial_arm"][key] = str(Path("examples", shelf["model"]["serial_arm"][key]).resolve())
    splines = {"pieces": 2, "minimise": "duration", "warm_start": {"roadmap": {"samples": 60}}}
    (tmp_path / "shelf.yaml").write_text(yaml.safe_dump(shelf | {"planner": {"spline": splines}}))
    errors = tmp_path / "errors.txt"
    with errors.open("w") as messages, open(os.devnull, "w") as nothing:
        process = warm.start(
            *("plan", "shelf.yaml", "--out", "out"),
            cwd=tmp_path,
            stdout=nothing.fileno(),
            stderr=messages.fileno(),
            code=f"{HELD}{UNDRAWN}",
        )
    until_large(tmp_path / "held", 0, process, errors)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    front = Front.load(tmp_path / "out" / "front.json")
    assert front.status == "unfinished"
    assert {kind for one in front.trajectories for kind in one.kinds} == {"reach", "spline"}
    assert "not smoothed yet" in front.certificate
