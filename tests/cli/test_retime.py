"""`hpop retime`: the front that Python returns, in a folder that other commands read, and mistakes in one message."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

import hpop
from hpop.problems.front import Front

Run = Callable[..., Result]


def test_it_writes_the_front_that_python_returns(run: Run, folder: Path, no_pictures) -> None:
    result = run("retime", folder, "--rows", "0", "--points", "3", "--jerk", "4")
    assert result.exit_code == 0, result.output
    written, front = Front.load(folder / "retimed/front.json"), Front.load(folder / "front.json")
    problem = hpop.Problem.from_description(front.problem)
    wanted = hpop.retime(problem, front[0].trajectory, points=3, jerk=4.0)
    assert np.allclose(written.costs, wanted.costs)
    assert written.names == ("duration", "squared_acceleration")
    again = run("show", folder / "retimed")
    assert again.exit_code == 0, again.output
    assert "verified" in again.output


def test_a_second_call_keeps_the_front_of_the_first(run: Run, folder: Path, tmp_path: Path, no_pictures) -> None:
    shutil.copytree(folder.parent, tmp_path / "room", ignore=shutil.ignore_patterns("retimed*"))
    folder = tmp_path / "room/out"
    run("retime", folder, "--rows", "0", "--points", "2")
    first = (folder / "retimed/front.json").read_bytes()
    result = run("retime", folder, "--rows", "0", "--points", "3")
    assert result.exit_code == 0, result.output
    assert "retimed_2" in result.output
    assert (folder / "retimed/front.json").read_bytes() == first
    assert len(Front.load(folder / "retimed_2/front.json")) == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--rows", "99"), "no row 99"),
        (("--rows", "kne"), "no row is called 'kne'"),
        (("--points", "0"), "points must be"),
        (("--discomfort", "turns"), "discomfort must be one of"),
        (("--jerk", "-1"), "jerk must be"),
    ],
)
def test_mistakes_end_in_one_message(run: Run, folder: Path, options: tuple[str, ...], message: str) -> None:
    result = run("retime", folder, *options, "--out", folder / "not")
    assert result.exit_code not in (0, 1)
    assert message in result.output.replace("\n", " ")
    assert not (folder / "not").exists()
