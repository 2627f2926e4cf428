"""Ctrl-C and SIGTERM while a real process of `hpop plan` searches."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from hpop.front import Front

# `hpop plan`, but that no process is left to draw what it has found.
UNDRAWN = """\
import hpop.pictures
hpop.pictures.PicturesBeside._begin = lambda pictures, which: print(which, "is drawn beside")
from hpop.cli import main
main()
"""


def until(terminal: int, pattern: bytes, seconds: float) -> bytes:
    """What a terminal shows until some pattern appears."""
    seen, end = b"", time.monotonic() + seconds
    while not re.search(pattern, seen) and time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            seen += os.read(terminal, 65536)
    assert re.search(pattern, seen), seen[-2000:]
    return seen


def scenario(folder: Path) -> None:
    """Six costs in a large room with scattered pillars: a search that would take far longer than these tests."""
    pillars = [(x + 0.37 * (y % 3), y) for x in range(2, 28, 3) for y in range(2, 18, 3)]
    boxes = [{"corners": [[x, y], [x + 0.6, y], [x + 0.6, y + 0.7], [x, y + 0.7]]} for x, y in pillars]
    content = {
        "world": {"polygons": {"extent": [[0, 0], [30, 0], [30, 20], [0, 20]], "obstacles": boxes}},
        "start": [1.0, 1.0, 0],
        "goal": [29.0, 19.0, "any"],
        "criteria": ["exposure", "turns", "length", "duration", "rotation", "clearance"],
        "planner": {"lattice": {"step": 0.3}},
    }
    (folder / "room.yaml").write_text(yaml.safe_dump(content))


def test_ctrl_c_keeps_what_a_running_search_has_found(tmp_path: Path) -> None:
    scenario(tmp_path)
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", UNDRAWN, "plan", "room.yaml", "--out", "out"]
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs, env=environment, text=True)
    os.close(theirs)
    try:
        # Only the exact search has millions of labels: first answers take a fraction of a second.
        seen = until(ours, rb"\d,\d{3},\d{3} labels, [\d,]+ open, front [1-9]", 60)
        assert b"search" in seen
        assert b" MB" in seen
        process.send_signal(signal.SIGINT)
        until(ours, rb"stopping: what was found is kept", 5)
        assert process.poll() is None  # told before it is done
        output, _ = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    assert process.returncode == 130
    assert "status: interrupted" in output
    assert "incomplete (interrupted)" in " ".join(output.split())  # lines break where the gap's digits make them
    front = Front.load(tmp_path / "out" / "front.json")
    assert len(front) > 0
    assert front.status == "interrupted"
    assert output.endswith("all is drawn beside\nwritten to out: front.json; pictures follow\n")


@pytest.mark.parametrize(
    "ignoring", ["", "trap '' INT; "], ids=["as a job", "where Ctrl-C is ignored, as for jobs of a script"]
)
def test_sigterm_keeps_what_a_running_search_has_found_and_its_checkpoint(tmp_path: Path, ignoring: str) -> None:
    scenario(tmp_path)
    often = "from hpop.planners.search.checkpoint import Checkpoint; Checkpoint.__init__.__defaults__ = (0.0,)"
    plan = [sys.executable, "-c", f"{often}\n{UNDRAWN}"]
    plan += ["plan", "room.yaml", "--out", "out", "--checkpoint", "search.ckpt"]
    command = ["sh", "-c", ignoring + 'exec "$@"', "sh", *plan]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 60
        while not (tmp_path / "search.ckpt").exists():
            assert time.monotonic() < end
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130, errors
    assert "stopping: what was found is kept" in errors
    assert "status: interrupted" in output
    assert "plan again with --checkpoint search.ckpt to go on" in output
    front = Front.load(tmp_path / "out" / "front.json")
    assert (len(front) > 0, front.status) == (True, "interrupted")
    assert "all is drawn beside" in output
