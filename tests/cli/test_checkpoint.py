"""``hpop plan --checkpoint``: what was stopped goes on to the same front, and what cannot be kept is refused."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner, Result

import hpop.view
from hpop.cli import main
from hpop.cli.beside import PicturesBeside
from hpop.problems.front import Front
from tests.warm import COMMAND

EXTENT = [[0, 0], [9, 0], [9, 7], [0, 7]]
BOXES = [(2, 1, 2.4, 4), (4, 3, 5.5, 3.4), (6.5, 2, 7, 5), (3, 5.2, 5, 5.5)]
SCENARIO = {
    "world": {
        "polygons": {
            "extent": EXTENT,
            "obstacles": [{"corners": [[a, b], [c, b], [c, d], [a, d]]} for a, b, c, d in BOXES],
        }
    },
    "model": {"differential_drive": {"radius": 0.2, "camera_height": 0.6}},
    "start": [0.6, 0.6, 0],
    "goal": [8.1, 6.1, "any"],
    "criteria": ["exposure", "turns", "length", "rotation"],
}


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hpop.view, "save_pictures", lambda problem, front, folder, **options: [])
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)


def write(folder: Path, planner: object, **changes: object) -> Path:
    """Write the scenario with a planner."""
    (folder / "room.yaml").write_text(yaml.safe_dump(SCENARIO | {"planner": planner} | changes))
    return folder / "room.yaml"


def plan(scenario: Path, out: str, *options: object) -> Result:
    arguments = ["plan", str(scenario), "--out", str(scenario.parent / out), *map(str, options)]
    result = CliRunner().invoke(main, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def front(folder: Path) -> tuple[object, ...]:
    """Return the content of a saved front without its computing times."""
    found = Front.load(folder / "front.json")
    ways = [list(zip(t.states.x, t.states.y, t.states.yaw, strict=True)) for t in found.trajectories]
    return (found.costs.tolist(), ways, found.provenance, found.status, found.certificate)


@pytest.mark.cases("lattice")
@pytest.mark.parametrize("planner", ["lattice", "roadmap"])
def test_a_search_that_a_limit_stopped_goes_on_to_the_same_front_and_its_file_goes(tmp_path, planner):
    options = {"lattice": {"step": 0.5}, "roadmap": {"samples": 80}}[planner]
    file = tmp_path / "my search.ckpt"
    stopped = plan(write(tmp_path, {planner: options | {"max_labels": 500}}), "part", "--checkpoint", file)
    assert "label limit" in stopped.stdout
    assert f"plan again with --checkpoint '{file}' to continue" in " ".join(stopped.stdout.split())
    assert file.is_file()
    whole = write(tmp_path, {planner: options})
    assert "continuing from" not in stopped.stdout
    resumed = plan(whole, "resumed", "--checkpoint", file)
    assert resumed.exit_code == 0
    assert resumed.stdout.startswith(f"continuing from {file}\n")
    assert plan(whole, "whole").exit_code == 0
    assert front(tmp_path / "resumed") == front(tmp_path / "whole")
    assert not file.exists()
    assert not any("search.ckpt" in path.read_text() for path in tmp_path.rglob("*.json"))  # no path in results


HELD = """\
import inspect, os, signal
from hpop.search.machinery import checkpoint
inspect.unwrap(checkpoint.Checkpoint.__init__).__defaults__ = (0.0,)
checkpoint.SHARE = 0
flush = os.fsync
def flushed_once(file):
    os.fsync = lambda file: signal.pause()
    flush(file)
os.fsync = flushed_once
"""  # it writes a checkpoint after every slice of the search, and never ends to write the second


@pytest.mark.proof
def test_it_survives_kill_9_while_a_checkpoint_is_written(tmp_path, warm):
    # A bound on the turns, far above what any path takes, asks for the exact search alone: no stage answers before it.
    scenario = write(tmp_path, {"lattice": {"step": 0.125, "max_turns": 1000}})
    file = tmp_path / "search.ckpt"
    arguments = ["plan", scenario, "--out", tmp_path / "killed", "--checkpoint", file]
    with open(os.devnull, "w") as nothing:
        process = warm.start(
            *arguments, cwd=tmp_path, stdout=nothing.fileno(), stderr=nothing.fileno(), code=f"{HELD}{COMMAND}"
        )
    while not (file.exists() and list(tmp_path.glob(".search.ckpt.*"))):
        assert process.is_running, "it ended although its second checkpoint is never whole"
        time.sleep(0.005)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    resumed = plan(scenario, "resumed", "--checkpoint", file)
    assert resumed.exit_code == 0
    assert resumed.stdout.startswith(f"continuing from {file}\n")
    assert plan(scenario, "whole").exit_code == 0
    assert front(tmp_path / "resumed") == front(tmp_path / "whole")
    assert [name for name in os.listdir(tmp_path) if "ckpt" in name] == []


@pytest.mark.parametrize(
    ("planner", "said"),
    [
        ({"rrt": {"runs": 1}}, "the scenario has rrt; leave out --checkpoint, or change"),
        ([{"lattice": {}}, {"roadmap": {}}], "the scenario has lattice, roadmap; leave only one of them"),
        ([{"lattice": {}}, {"lattice": {"step": 0.5}}], "leave only one of them"),
    ],
)
def test_planners_that_keep_no_search_or_several_are_refused(tmp_path, planner, said):
    result = plan(write(tmp_path, planner), "out", "--checkpoint", tmp_path / "search.ckpt")
    assert result.exit_code == 10
    assert result.stderr.startswith("error: --checkpoint saves the search of exactly one of these planners")
    assert ": any-angle, exact, lattice, roadmap; the scenario has" in result.stderr
    assert said in result.stderr
    assert os.listdir(tmp_path) == ["room.yaml"]


def test_a_planner_beside_one_that_searches_exactly_is_no_hindrance(tmp_path):
    scenario = write(tmp_path, [{"lattice": {"step": 0.5}}, {"weighted-sum": {"step": 0.5}}])
    assert plan(scenario, "out", "--checkpoint", tmp_path / "search.ckpt").exit_code == 0


def test_places_where_no_file_can_be_are_refused_before_anything_is_planned(tmp_path):
    scenario = write(tmp_path, {"lattice": {"step": 0.5}})
    nowhere = plan(scenario, "out", "--checkpoint", tmp_path / "nowhere" / "search.ckpt")
    assert (nowhere.exit_code, nowhere.stderr.count("error: cannot write a checkpoint to")) == (12, 1)
    assert not (tmp_path / "out").exists()
    folder = plan(scenario, "out", "--checkpoint", tmp_path)
    assert folder.exit_code == 12
    assert "is a folder" in folder.stderr


def test_the_checkpoint_of_another_problem_a_damaged_one_and_none_are_refused_and_stay(tmp_path):
    file, limited = tmp_path / "search.ckpt", {"lattice": {"step": 0.5, "max_labels": 500}}
    plan(write(tmp_path, limited), "out", "--checkpoint", file)
    content = file.read_bytes()
    for changes, text, said in [
        ({"goal": [8.1, 0.6, "any"]}, content, "is of another problem"),
        ({"criteria": ["turns", "length"]}, content, "is of another problem"),
        ({}, content[:-9], "truncated or damaged"),
        ({}, b"my notes", "is neither, so it is not overwritten"),
    ]:
        file.write_bytes(text)
        result = plan(write(tmp_path, limited, **changes), "out", "--checkpoint", file)
        assert result.exit_code == 12
        assert said in result.stderr
        assert file.read_bytes() == text
