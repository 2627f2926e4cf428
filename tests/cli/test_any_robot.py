"""A robot that hpop does not have on the command line: a roadmap, weighted sums on another, and their union."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

import hpop
from hpop.base.registry import models
from hpop.problems.verify import verify

ROBOT = Path(__file__).resolve().parents[2] / "examples/plugin/hpop_example_plugin/holonomic.py"


@pytest.fixture(autouse=True)
def _robot_unknown(registered_as_before: None) -> None:
    """No other test's robot of that name."""
    models._types.pop("holonomic", None)
    sys.modules.pop("holonomic", None)  # or its file would register nothing


@pytest.fixture
def scenario(room: Path, write: Callable[..., None]) -> Path:
    """Write the room's scenario with the example plugin's sliding base."""
    write(
        room,
        ("differential_drive: {radius: 0.2}", "holonomic: {length: 0.4, width: 0.3}"),
        ("goal: [3.5, 0.5, 0]", "goal: [3.5, 0.5, any]"),
        ("criteria: [turns, length]", "criteria: [duration, rotation, length]"),
        (
            "  lattice: {step: 0.5}",
            "  - roadmap: {samples: 60, seed: 1}\n  - weighted-sum: {on: {roadmap: {samples: 90, seed: 2}}}",
        ),
    )
    return room / "room.yaml"


@pytest.mark.usefixtures("no_pictures")
def test_the_union_of_a_roadmap_and_weighted_sums_on_another_is_saved_verified_and_shown(
    scenario: Path, run: Callable[..., Result]
) -> None:
    out = scenario.parent / "out"
    planned = run("plan", scenario, "--out", out, "--import", ROBOT)
    assert planned.exit_code == 0, planned.stderr
    front = hpop.Front.load(out / "front.json")
    assert {origin["planner"] for origin in front.provenance} == {"roadmap", "weighted-sum"}
    assert "seed 1" in front.certificate
    assert "seed 2" in front.certificate
    assert verify(hpop.Problem.from_description(front.problem), front) == []
    shown = run("show", out, "--import", ROBOT)
    assert shown.exit_code == 0, shown.stderr
    assert "(duration, rotation, length)" in shown.stdout


def test_what_its_planner_cannot_take_is_placed_in_the_file(
    scenario: Path, run: Callable[..., Result], refused: Callable[..., None]
) -> None:
    scenario.write_text(scenario.read_text().replace("on: {roadmap: {samples: 90, seed: 2}}", "on: smoothing"))
    refused(
        run("plan", scenario, "--out", scenario.parent / "out", "--import", ROBOT),
        7,
        "line 10, planner.1.weighted-sum: unknown graph 'smoothing'. Known: corners, lattice, primitives, roadmap",
    )
