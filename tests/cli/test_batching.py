"""``hpop batch`` and the summary of ``hpop show``: from a clean folder to a figure, again, interrupted, and refused."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from hpop.batches import Results, running
from hpop.cli import main

SPECIFICATION = """\
world: {polygons: {extent: [[0, 0], [8, 0], [8, 6], [0, 6]], obstacles: [{corners: [[3, 0], [4, 0], [4, 3], [3, 3]]}]}}
model: {differential_drive: {radius: 0.3}}
start: [1, 1, 0]
criteria: [turns, length]
planner: {lattice: {step: 1.0}}
vary: {goal: [[7, 1, any], [3.5, 1, any]], planner.lattice.step: [1.0, 0.5]}
"""


@pytest.fixture
def specification(tmp_path: Path) -> Path:
    (tmp_path / "batch.yaml").write_text(SPECIFICATION)
    return tmp_path / "batch.yaml"


def run(*arguments: object) -> Result:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert "Traceback" not in result.output
    return result


def test_a_batch_is_solved_summarised_and_shown(specification: Path) -> None:
    out = specification.parent / "out"
    done = run("batch", specification, "--out", out)
    assert done.exit_code == 0, done.output
    summary = [line.split()[:5] for line in done.stdout.splitlines()[1:3]]
    assert summary == [["lattice(step=1.0)", "2", "1", "0", "1"], ["lattice(step=0.5)", "2", "1", "0", "1"]]
    assert "note: 2 of 4 cases ended with an error" in done.stderr
    assert (out / "summary.png").stat().st_size > 1000
    assert run("show", out).stdout == done.stdout
    again = run("batch", specification, "--out", out)
    assert f"continuing: {out} has 4 of 4 cases" in again.stdout


def test_without_the_library_of_tables_one_message_says_what_to_install(
    specification: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    done = run("batch", specification, "--out", specification.parent / "out")
    assert done.exit_code == 12
    assert "pip install 'hpop[tables]'" in done.stderr
    assert done.stderr.count("\n") == 1
    (specification.parent / "out" / "results").mkdir(parents=True)
    assert "pip install 'hpop[tables]'" in run("show", specification.parent / "out").stderr


def test_ctrl_c_keeps_what_is_finished_and_the_same_command_goes_on(
    specification: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = running.solve
    solved: list[object] = []

    def interrupted(*arguments: object) -> object:
        if len(solved) == 2:
            raise KeyboardInterrupt
        solved.append(arguments)
        return solve(*arguments)  # type: ignore[arg-type]

    out = specification.parent / "out"
    with monkeypatch.context() as patch:
        patch.setattr(running, "solve", interrupted)
        stopped = run("batch", specification, "--out", out)
    assert stopped.exit_code == 130
    assert f"interrupted: 2 of 4 cases are saved in {out}" in stopped.stderr
    assert run("batch", specification, "--out", out).exit_code == 0
    assert set(Results(out).table(["case"])["case"].to_pylist()) == {0, 1, 2, 3}


def test_mistakes_are_told_without_a_trace(specification: Path) -> None:
    out = specification.parent / "out"
    both = run("batch", specification, "--out", out, "--workers", "2", "--ray", "auto")
    assert (both.exit_code, "give only one of --workers, --dask and --ray" in both.stderr) == (2, True)
    specification.write_text(SPECIFICATION.replace("step: [1.0", "stepp: [1.0"))
    typo = run("batch", specification, "--out", out)
    assert typo.exit_code not in (0, 1)
    assert "stepp" in typo.stderr
    assert "vary" not in run("batch", specification.parent / "none.yaml", "--out", out).stdout
    assert not out.exists()
