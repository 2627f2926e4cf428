"""A scenario in a stranger's folder: nothing that lies there is run, and where it is or who listens costs no front."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from hpop.problems.front import Front

SCENARIO = """\
world: {ros_map: {path: map.yaml}}
model: {differential_drive: {radius: 0.2}}
start: [0.5, 0.5, 0]
goal: [3.5, 0.5, 0]
criteria: [turns, length]
planner:
  - lattice: {step: 0.5}
  - smoothing: {}
  - epsilon-constraint: {step: 0.5, max_points: 3}
"""
NOT_UTF8 = b"caf\xe9"
MODULES = ("shapely", "numpy", "struct", "socket", "selectors", "signal", "yaml", "numba", "matplotlib", "hpop")


class Run(NamedTuple):
    """Files that a run left, and its standard error."""

    code: int
    folder: Path
    ran: list[str]
    stderr: str


@pytest.fixture(scope="module", params=[1, pytest.param(2, marks=pytest.mark.proof)])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, write_map) -> Run:
    """Run the command among traps, with a standard output that has no reader."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path_factory.mktemp("strange")) + b"/" + NOT_UTF8))
    folder.mkdir()
    write_map(folder)
    (folder / "room.yaml").write_text(SCENARIO)
    for name in MODULES:
        (folder / f"{name}.py").write_text(f"open('ran-{name}', 'w')\n")
    (folder / "matplotlibrc").write_text("figure.figsize: .1, .1\ntext.usetex: true\n")
    (folder / "ipopt.opt").write_text("output_file ran-ipopt\n")
    reader, writer = os.pipe()
    os.close(reader)
    script = tmp_path_factory.mktemp("bin") / "hpop"  # as it is installed: Python looks in the script's own folder
    script.write_text("from hpop.entry import main\n\nif __name__ == '__main__':\n    main()\n")
    command = [sys.executable, script]
    arguments = ["plan", "room.yaml", "--out", "out", "--workers", str(request.param)]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
    environment["MPLBACKEND"] = "no such backend"  # what a desktop or a notebook draws with may be set for all programs
    done = subprocess.run([*command, *arguments], cwd=folder, stdout=writer, stderr=subprocess.PIPE, env=environment)
    os.close(writer)
    ran = sorted(path.name for path in folder.glob("ran-*"))
    return Run(done.returncode, folder, ran, done.stderr.decode(errors="replace"))


def test_no_module_and_no_solver_s_options_of_the_current_folder_are_run(run: Run) -> None:
    assert run.ran == []


def test_a_reader_that_leaves_changes_neither_the_result_nor_the_exit_code(run: Run) -> None:
    assert run.code == 0, run.stderr
    assert "Traceback" not in run.stderr
    assert "Broken" not in run.stderr


def test_a_folder_whose_name_is_no_utf8_gets_front_and_pictures_whatever_a_desktop_draws_with(
    run: Run,
) -> None:
    front = Front.load(run.folder / "out" / "front.json")
    assert len(front) > 1
    assert os.fsencode(front.problem["world"]["path"]).endswith(NOT_UTF8 + b"/map.yaml")
    drawn = sorted(path.name for path in (run.folder / "out").iterdir())
    assert drawn == ["front.html", "front.json", "front.png", "map.png", "trace.png", "where.png"]


def test_a_folder_with_settings_of_numba_is_refused_before_anything_is_imported(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path}\n")
    done = subprocess.run(
        [sys.executable, "-P", "-m", "hpop", "demo"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (4, "")
    assert "run hpop from another folder" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [".numba_config.yaml"]
