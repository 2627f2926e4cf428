"""Ends of a process: a closed terminal, a signal to its whole group, Ctrl-C before the command line is loaded."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hpop.cli.beside import PicturesBeside
from hpop.cli.results import check_writable
from hpop.errors import OutputError
from hpop.problems.front import Front
from hpop.runtime.interrupts import ENDING, endings_interrupt
from tests.warm import DRAWN, UNDRAWN, Warm

INTERRUPTED_IMPORT = """\
import signal, sys
class Interruption:
    def find_spec(self, name, *where):
        if name == "click":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interruption())
from hpop.entry import main
main()
"""
JOBS = """\
import os, signal, sys
from hpop.runtime.interrupts import endings_interrupt
from hpop.runtime.sweep import Sweep, processes

def job(planning, task):
    if task == 3:
        os.killpg(planning, signal.SIGTERM)
    return task

if __name__ == "__main__":
    with endings_interrupt(), processes(2) as pool, Sweep(job, os.getpid(), pool) as sweep:
        try:
            for _ in sweep.run(range(100)):
                pass
        except KeyboardInterrupt:
            print("interrupted", sweep.notes)
"""


def test_ctrl_c_while_modules_are_imported_ends_in_one_line() -> None:
    done = subprocess.run([sys.executable, "-P", "-c", INTERRUPTED_IMPORT, "plan"], capture_output=True, text=True)
    assert (done.returncode, done.stderr, done.stdout) == (130, "error: interrupted\n", "")


def test_a_signal_to_the_group_is_for_the_process_that_plans_and_its_workers_end_quietly(tmp_path: Path) -> None:
    (tmp_path / "jobs.py").write_text(JOBS)
    done = subprocess.run(
        [sys.executable, tmp_path / "jobs.py"], capture_output=True, text=True, start_new_session=True
    )
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "interrupted []\n")


BLOCKED = """\
import signal
from multiprocessing import forkserver
from pathlib import Path
from hpop.runtime.sweep import processes

with processes(1):
    status = Path(f"/proc/{forkserver._forkserver._forkserver_pid}/status").read_text()
mask = int(status.split("SigBlk:")[1].split()[0], 16)
print([number.name for number in (signal.SIGTERM, signal.SIGHUP) if mask >> (number - 1) & 1])
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="what a process blocks is read from /proc")
def test_what_ends_a_group_does_not_end_the_process_that_workers_come_from() -> None:
    """With it they would count as lost: whatever Python starts before it must not unblock a signal."""
    done = subprocess.run([sys.executable, "-c", BLOCKED], capture_output=True, text=True)
    assert (done.stderr, done.stdout) == ("", "['SIGTERM', 'SIGHUP']\n")


def test_workers_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    """They hold its output, so reading that only ends when they have."""
    code = "import os, signal; from hpop.runtime.sweep import processes; processes(1).submit(os.getpid).result(); "
    done = subprocess.run([sys.executable, "-c", f"{code}os.kill(os.getpid(), signal.SIGKILL)"], capture_output=True)
    assert done.returncode == -signal.SIGKILL


@pytest.mark.parametrize("number", ENDING, ids=lambda number: number.name)
def test_what_ends_a_process_interrupts_a_command_unless_it_is_ignored(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # whoever runs the tests may have it ignored
    try:
        with pytest.raises(KeyboardInterrupt), endings_interrupt():
            signal.raise_signal(number)
        signal.signal(number, signal.SIG_IGN)  # as nohup does
        with endings_interrupt():
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)


def test_a_terminal_that_is_closed_takes_what_is_still_said() -> None:
    """The master of a pair of terminals closes: each write to the other one fails from then on."""
    ours, theirs = os.openpty()
    code = "import os, sys; from hpop import entry; sys.stdout = entry._tolerant_stream(sys.stdout); sys.stdin.read();"
    code += "print('to nobody', flush=True); os._exit(7)"
    child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=theirs)
    os.close(theirs)
    os.close(ours)
    child.communicate(b"now")
    assert child.returncode == 7


SMALL = """\
world: {polygons: {extent: [[0, 0], [3, 0], [3, 2], [0, 2]]}}
start: [0.5, 1, 0]
goal: [2.5, 1, 0]
criteria: [turns, length]
planner: {lattice: {step: 0.5}}
"""
CLOSED = """\
import os, sys
for number, name in enumerate(("stdin", "stdout", "stderr")):
    if name in sys.argv[1].split(","):
        os.close(number)
        setattr(sys, name, None)  # as Python begins where it is closed
del sys.argv[1]
"""


@pytest.mark.parametrize("closed", ["stdout", "stdin,stdout,stderr"])
@pytest.mark.cases("stdin,stdout,stderr")
def test_where_standard_streams_are_closed_all_is_written_as_ever(tmp_path: Path, warm: Warm, closed: str) -> None:
    """``hpop plan ... >&-``; what else is opened must not take the numbers of the streams that are closed."""
    (tmp_path / "room.yaml").write_text(SMALL)
    run = warm.run(closed, "plan", "room.yaml", "--out", "out", cwd=tmp_path, code=CLOSED + DRAWN)
    assert (run.returncode, run.stdout) == (0, "")
    assert {"front.json", "map.png", "front.png", "trace.png", "front.html"} <= {*os.listdir(tmp_path / "out")}
    assert Front.load(tmp_path / "out" / "front.json").status == "complete"
    for words in (["show", "out"], ["pick", "out", "--knee"], ["export", "out"], ["explain", "knee"]):
        assert warm.run(closed, *words, cwd=tmp_path, code=CLOSED + UNDRAWN).returncode == 0


def test_output_that_a_full_disk_does_not_take_is_one_message(tmp_path: Path, warm: Warm) -> None:
    said = tmp_path / "said.txt"
    with open("/dev/full", "wb") as full, said.open("w") as errors:
        process = warm.start("planners", cwd=tmp_path, stdout=full.fileno(), stderr=errors.fileno())
        assert process.wait() == OutputError.exit_code
    assert said.read_text() == "error: cannot print: No space left on device; send the output elsewhere\n"


def test_ctrl_c_while_drawing_begins_leaves_no_process_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    execute, begun = subprocess.Popen._execute_child, []  # type: ignore[attr-defined]

    def interrupted(process: subprocess.Popen[bytes], *arguments: object) -> None:
        execute(process, *arguments)
        begun.append(process.pid)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(subprocess.Popen, "_execute_child", interrupted)
    with pytest.raises(KeyboardInterrupt), PicturesBeside(tmp_path) as pictures:
        pictures.start()
    with pytest.raises(ProcessLookupError):
        os.kill(begun[0], 0)


def test_a_disk_that_is_full_is_told_before_planning(tmp_path: Path) -> None:
    """It takes empty files; so does a process that may write none."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        with pytest.raises(OutputError, match=r"cannot write to .*out: .*; choose another --out"):
            check_writable(tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    check_writable(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
