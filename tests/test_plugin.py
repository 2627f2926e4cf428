"""The example plugin, installed as a package of its own: its criterion, robot and reader are found and work."""

from __future__ import annotations

import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
import yaml

from hpop.base.registry import readers
from hpop.errors import MapError, UnknownName
from hpop.world import World
from hpop.world.readers.readers import read_world
from tests.warm import DRAWN, UNDRAWN, Warm

INSTALLED = "hpop-example-plugin" in {package.name for package in importlib.metadata.distributions()}
PLUGIN = Path(__file__).resolve().parents[1] / "examples/plugin"
HOLONOMIC = {"length": 0.7, "width": 0.5, "height": 0.4, "camera_height": 1.2, "speed": 1.0, "acceleration": 1.0}
Hpop = Callable[..., CompletedProcess[str]]


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> Path:
    """Install the plugin by pip, offline, into a folder for packages."""
    source, folder = tmp_path_factory.mktemp("plugin") / "source", tmp_path_factory.mktemp("packages")
    shutil.copytree(PLUGIN, source, ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    options = ["--no-index", "--no-deps", "--no-build-isolation", "--no-compile", "--disable-pip-version-check"]
    done = subprocess.run(
        [sys.executable, "-P", "-m", "pip", "install", "--quiet", *options, "--target", folder, source],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def hpop(warm: Warm) -> Hpop:
    """Run the command line in a process of its own, where packages of a folder are seen, or those of this place."""

    def hpop(
        *arguments: str | Path, fresh: Path | None = None, cwd: Path, code: str = UNDRAWN
    ) -> CompletedProcess[str]:
        looked_in = os.pathsep.join(filter(None, [str(fresh or ""), os.environ.get("PYTHONPATH", "")]))
        environment = {"COLUMNS": "200", "PYTHONPATH": looked_in}
        return warm.run(*arguments, cwd=cwd, code=code, environment=environment)

    return hpop


@pytest.fixture
def plan(tmp_path) -> Path:
    """Copy the plugin's scenario to a folder of its own."""
    for name in ("scenario.yaml", "plan.txt"):
        shutil.copy(PLUGIN / name, tmp_path)
    return tmp_path / "scenario.yaml"


def changed(scenario: Path, world: dict) -> Path:
    content = yaml.safe_load(scenario.read_text())
    scenario.write_text(yaml.safe_dump({**content, "world": world}))
    return scenario


@pytest.mark.skipif(INSTALLED, reason="the example plugin is installed here for good")
def test_its_criterion_is_listed_where_it_is_installed_only(hpop, fresh, tmp_path):
    assert "oblique  m, sum, axis=0.0" in hpop("criteria", fresh=fresh, cwd=tmp_path).stdout
    without = hpop("criteria", cwd=tmp_path)
    assert without.returncode == 0
    assert "oblique" not in without.stdout


def test_its_criterion_passes_the_conformance_checks(hpop, fresh, tmp_path):
    done = hpop("check", "oblique", fresh=fresh, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {line.split()[0] for line in done.stdout.splitlines()} == {"ok"}


@pytest.mark.skipif(INSTALLED, reason="the example plugin is installed here for good")
def test_its_robot_is_listed_where_it_is_installed_only(hpop, fresh, tmp_path):
    listed = " ".join(hpop("models", fresh=fresh, cwd=tmp_path).stdout.split())
    assert "holonomic length=0.7, width=0.5" in listed
    assert "States (x m, y m, yaw rad). Provides base, camera, plane, rigid." in listed
    assert "holonomic" not in hpop("models", cwd=tmp_path).stdout


def test_its_robot_passes_the_conformance_checks(hpop, fresh, tmp_path):
    done = hpop("check", "holonomic", fresh=fresh, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {line.split()[0] for line in done.stdout.splitlines()} == {"ok"}


@pytest.mark.proof  # with every robot; in test_lexicographic.py with one
def test_its_planner_passes_the_conformance_checks(hpop, fresh, tmp_path):
    done = hpop("check", "lexicographic", fresh=fresh, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {line.split()[0] for line in done.stdout.splitlines()} == {"ok"}


def test_a_scenario_is_planned_on_the_world_that_its_reader_reads(hpop, fresh, plan):
    out = plan.parent / "out"
    done = hpop("plan", plan, "--out", out, fresh=fresh, cwd=plan.parent)
    assert done.returncode == 0, done.stdout + done.stderr
    costs = json.loads((out / "front.json").read_text())["points"]["costs"]
    oblique, _, length = map(np.array, costs.values())
    # The pillar of 1 x 1 m stands between start and goal, 5.5 m apart. Along the walls it is passed 1 m further down,
    # which is 2 m longer than straight; obliquely it is shorter. The front has both.
    assert length[oblique < 1e-9].min() == pytest.approx(5.5 + 2 * 1.0)
    assert length.min() < 7.5
    (plan.parent / "plan.txt").unlink()
    shown = hpop("show", out, fresh=fresh, cwd=plan.parent)
    assert shown.returncode == 0, shown.stderr
    assert "verified" in shown.stdout


@pytest.mark.skipif(INSTALLED, reason="the example plugin is installed here for good")
def test_without_the_plugin_its_names_are_unknown(hpop, plan):
    done = hpop("plan", plan, "--out", plan.parent / "out", cwd=plan.parent)
    assert done.returncode == 4
    assert "text_plan" in done.stderr
    assert "no such key" in done.stderr
    assert "unknown criterion 'oblique'" in done.stderr


@pytest.mark.proof
def test_its_robot_with_joints_is_planned_for_on_a_lattice(hpop, fresh, tmp_path):
    shutil.copy(PLUGIN / "tracked.yaml", tmp_path)
    shutil.copy(PLUGIN / "plan.txt", tmp_path)
    done = hpop("plan", tmp_path / "tracked.yaml", "--out", tmp_path / "out", fresh=fresh, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    saved = json.loads((tmp_path / "out/front.json").read_text())
    assert saved["problem"]["model"]["tracked"]["boom"] == 0.6
    shown = hpop("show", tmp_path / "out", fresh=fresh, cwd=tmp_path)
    assert "verified" in shown.stdout, shown.stderr


@pytest.mark.parametrize("code", [UNDRAWN, pytest.param(DRAWN, marks=pytest.mark.proof)], ids=["undrawn", "drawn"])
def test_its_robot_is_planned_for_by_planners_that_serve_any(hpop, fresh, tmp_path, code):
    shutil.copy(PLUGIN / "holonomic.yaml", tmp_path)
    shutil.copy(PLUGIN / "plan.txt", tmp_path)
    out = tmp_path / "out"
    done = hpop("plan", tmp_path / "holonomic.yaml", "--out", out, fresh=fresh, cwd=tmp_path, code=code)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ("map.png" in {file.name for file in out.iterdir()}) == (code == DRAWN)
    saved = json.loads((out / "front.json").read_text())
    assert saved["problem"]["model"] == {"holonomic": {**HOLONOMIC, "turn_rate": 1.0}}
    assert len(saved["points"]["costs"]["length"]) > 3
    shown = hpop("show", out, fresh=fresh, cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "verified" in shown.stdout


@pytest.mark.parametrize(
    ("robot", "code", "message"),
    [
        ({"holonomic": {"speed": -1.0}}, 9, "line 2, model.holonomic: speed must be a positive number, got -1.0"),
        ({"holonomic": {"sped": 1.0}}, 4, "model.holonomic.sped: no such key; did you mean 'speed'?"),
        (
            {"holonomic": {}},
            9,
            "holonomic does not provide (it has base, camera, plane, rigid). "
            "Planners that can use this model: exact, lexicographic, roadmap",
        ),
    ],
)
def test_what_makes_no_robot_or_none_that_the_planner_knows_is_said(hpop, fresh, plan, robot, code, message):
    content = yaml.safe_load(plan.read_text())
    plan.write_text(yaml.safe_dump({"model": robot, **content}, sort_keys=False))
    done = hpop("plan", plan, "--out", plan.parent / "out", fresh=fresh, cwd=plan.parent)
    assert (done.returncode, "Traceback" in done.stderr) == (code, False), done.stderr
    assert message in done.stderr


@pytest.mark.parametrize(
    ("world", "code", "message"),
    [
        ({"text_plan": {"path": "gone.txt"}}, 3, "cannot read the plan"),
        ({"text_plan": {"path": "plan.txt", "sell": 1.0}}, 3, "has no option sell"),
        ({"text_plan": {"path": "plan.txt", "cell": -1.0}}, 3, "cell must be a positive length"),
        ({"text_plan": {"cell": 1.0}}, 4, "world.text_plan.path: this key is missing"),
        ({"text_plan": "plan.txt"}, 4, "world.text_plan: expected keys with values"),
        ({"text_plan": {"path": "plan.txt"}, "movingai": {"path": "a.map"}}, 4, "no such key"),
    ],
)
def test_what_its_reader_cannot_take_is_said_with_the_key(hpop, fresh, plan, world, code, message):
    done = hpop("plan", changed(plan, world), "--out", plan.parent / "out", fresh=fresh, cwd=plan.parent)
    assert (done.returncode, "Traceback" in done.stderr) == (code, False), done.stderr
    assert message in done.stderr
    assert "world" in done.stderr


# Readers by name, without a package


def test_the_readers_that_come_with_hpop_have_names():
    assert {"geojson", "image", "movingai", "ros_map"} <= set(readers)


def test_a_world_is_read_by_the_name_of_its_reader(tmp_path):
    path = tmp_path / "room.map"
    path.write_text("type octile\nheight 2\nwidth 3\nmap\n...\n.@.\n")
    named, direct = read_world("movingai", path, resolution=2.0), World.from_movingai(path, resolution=2.0)
    assert named.bounds == direct.bounds == (0.0, 0.0, 6.0, 4.0)
    assert named.describe() == direct.describe()


def test_an_unknown_reader_lists_the_known_ones():
    with pytest.raises(UnknownName, match=r"unknown reader 'movingay'. Did you mean 'movingai'\? Known: "):
        read_world("movingay", "room.map")


def faulty(path, *, what="nothing"):
    if what == "error":
        raise KeyError("walls")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "reader 'faulty' must return a World, got NoneType"),
        ({"what": "error"}, "reader 'faulty' cannot read 'a.txt': KeyError: 'walls'"),
        (
            {"wat": 1},
            r"reader 'faulty': it has no option wat\. Did you mean 'what'\? Its options are what",
        ),
    ],
)
def test_a_reader_that_fails_is_named(monkeypatch, options, message):
    assert "faulty" not in readers
    monkeypatch.setitem(readers._types, "faulty", faulty)
    with pytest.raises(MapError, match=message):
        read_world("faulty", "a.txt", **options)
