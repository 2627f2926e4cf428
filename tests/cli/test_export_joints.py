"""`hpop export` and `hpop pick` of joints: formats that fail stop no others."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from click.testing import Result

import hpop
from hpop.errors import UnknownName
from hpop.export import save
from hpop.export.base import jerk_limited
from hpop.problems.front import Front
from hpop.problems.verify import verify
from hpop.world import Box, Solid, pose_at
from tests.export.given import robots
from tests.models.serial_arm.arms import arm6

Run = Callable[..., Result]
ARM = robots()["serial arm"]


def front() -> Front:
    """Return a front of one trajectory of the arm, in a world without obstacles."""
    start, goal = ([float(getattr(ARM.states, name)[end]) for name in ARM.states.names] for end in (0, -1))
    problem = hpop.Problem(
        hpop.World.from_solids([Solid(Box((1, 1, 0.02)), pose_at((0, 0, -1)), "floor")]),
        ARM.model,
        start,
        goal,
        ["duration"],
    )
    named = {"names": ["duration"], "units": ["s"], "groups": ["R"], "quanta": [1e-6]}
    return Front.of([[ARM.duration]], [ARM], **named, problem=problem.describe())


def test_a_format_that_is_unknown_or_fails_stops_no_other(run: Run, tmp_path: Path) -> None:
    front().save(tmp_path / "front.json")
    asked = "csv,joint-trajectory,movit,tum,follow-joint-trajectory,mcap"
    result = run("export", tmp_path, "--body", "joints", "--jerk", "40", "--rate", "50", "--format", asked)
    assert result.exit_code == 7
    said = " ".join(result.stderr.split())
    assert "unknown format 'movit'. Did you mean 'moveit'" in said
    assert "this format writes poses, got the body joints" in said
    names = {"csv", "joint_trajectory.yaml", "follow.yaml", "mcap", "about.json"}
    assert {path.name for path in (tmp_path / "export").iterdir()} == {f"knee_0.{name}" for name in names}
    about = yaml.safe_load((tmp_path / "export/knee_0.about.json").read_text())
    assert (about["body"], about["jerk"], about["rate"]) == ("joints", 40.0, 50.0)
    assert about["duration"] == pytest.approx(jerk_limited(ARM, 40.0)[0].duration)
    with pytest.raises(UnknownName):
        save(None, front(), tmp_path / "none", formats=["movit"])
    assert not (tmp_path / "none").exists()


def test_pick_writes_joints(run: Run, tmp_path: Path) -> None:
    front().save(tmp_path / "front.json")
    result = run("pick", tmp_path, "--csv", tmp_path / "joints.csv", "--body", "joints")
    assert result.exit_code == 0, result.output
    assert "the joints every 0.1 s of the executed trajectory" in result.output
    text = (tmp_path / "joints.csv").read_text()
    heads = text.splitlines()[0].split(",")
    assert [re.sub(r" .*", "", head) for head in heads] == [
        "t", *(f"{name}{end}" for end in ("", "_rate", "_acceleration") for name in ARM.model.joints),
    ]  # fmt: skip
    assert len(text.splitlines()) == 2 + int(ARM.duration / 0.1) + 1
    misnamed = run("export", tmp_path, "--body", "joint")
    assert "Did you mean 'joints'? body must be one of camera, tool, joints" in misnamed.stderr
    refused = run("pick", tmp_path, "--body", "joints")
    assert refused.exit_code == 2
    assert "--body says whose motion --csv writes" in refused.stderr
    assert hpop.Front.load(tmp_path / "front.json")[0].trajectory.model == arm6()


def test_show_checks_an_arm_by_coal(run: Run, tmp_path: Path) -> None:
    """A box around a link, which was not in the world when the front was planned, is found."""
    front().save(tmp_path / "front.json")
    result = run("show", tmp_path, "--judge", "coal")
    assert result.exit_code == 0, result.output
    (_, poses), *_ = reversed(ARM.model.bodies(ARM.states))
    world = hpop.World.from_solids([Solid(Box((0.05, 0.05, 0.05)), pose_at(poses[1, :3, 3]), "box")])
    problem = hpop.Problem(world, ARM.model, (0.1,) * 6, (0.2,) * 6, ["duration"])
    assert verify(problem, front(), library="coal") == ["trajectory 0 collides"]
