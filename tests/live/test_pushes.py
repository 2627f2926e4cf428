"""Hundreds of pushes on two real maps: the way that is taken is the one that brute force finds."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hpop.live.planner import LivePlanner
from hpop.scenario import load_scenario
from hpop.trajectories.trajectory import Trajectory
from tests.live.test_planner import of

ROOT = Path(__file__).resolve().parents[2]
MANY = 250  # pushes on each map; brute force takes most of the time: 2 ms of processor for each of about 110 ways


def brute(way: Trajectory, heading: float) -> float:
    """Mean angle between a heading and that of a way, at 0, 0.1, ..., 3 s."""
    yaws = way.at(np.minimum(0.1 * np.arange(31), way.duration)).yaw
    return float(np.abs(np.angle(np.exp(1j * (yaws - heading)))).mean())


@pytest.mark.proof
@pytest.mark.parametrize("name", ["pal_office", "nav2_depot"])
def test_hundreds_of_pushes_take_the_way_that_brute_force_finds(
    name: str, shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    text = (ROOT / "examples" / f"{name}.yaml").read_text()
    file = tmp_path / "scenario.yaml"
    file.write_text(text.replace("../../shared/data", str(shared_data(name).parent)))
    planner, random = LivePlanner(load_scenario(file)), np.random.default_rng(1)
    pose, now, pushes = tuple(planner.template.start), 0.0, 0
    bounds = planner.template.world.bounds
    while pushes < MANY:
        now += 1.0
        x, y = random.uniform(bounds[:2], bounds[2:])
        told = list(planner.destination(now, pose, {"x": float(x), "y": float(y)}))
        if not any(message["type"] == "options" for message in told):
            continue
        assert planner.offer is not None
        list(planner.take(now, pose, int(random.integers(len(planner.offer.ways.trajectories)))))
        drive = planner.drive
        assert drive is not None
        while not drive.at(now).arrived and pushes < MANY:
            state = drive.at(now).state
            pose = (float(state.x[0]), float(state.y[0]), float(state.yaw[0]))
            list(planner.options(now, pose))
            ways, present = planner.offer.ways.trajectories, planner.offer.ways.present
            direction = float(random.uniform(-1.6, 1.6))
            gaps = [brute(way, pose[2] + direction) for way in ways]
            pushed = of(planner.push(now, pose, direction), "pushed")
            assert gaps[pushed["option"]] == pytest.approx(min(gaps), abs=1e-9)
            assert pushed["followed"] == (pushed["option"] != present or min(gaps) <= math.radians(30.0) + 1e-12)
            pushes += 1
            now += float(random.uniform(0.2, 1.5))
        state = drive.at(now).state
        pose = (float(state.x[0]), float(state.y[0]), float(state.yaw[0]))
        list(planner.arrived(now, pose))
