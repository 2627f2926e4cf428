"""Pushes by the hundred: the way that is taken is the one that brute force finds, and among people none is touched.

The planner answers up to 2.5 s late among people. HPOP_PUSHES sets the number of pushes there.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.live.planner import LivePlanner
from hpop.live.session import MISSED
from hpop.scenario import load_scenario
from hpop.simulation import Crowd
from hpop.trajectories.trajectory import Trajectory
from tests.live.stepped import SteppedSession
from tests.live.test_planner import of
from tests.worlds import pillars

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


def pushed_among_people(folder: Path, pushes: int, seed: int) -> tuple[SteppedSession, Counter[str]]:
    """Drive to random places among eight people who react, and push at random times, until there are enough pushes.

    The planner's answers take 0.03 s (pushes) or 0.15 s in the median, and up to 2.5 s.
    """
    file, random, counts = folder / "hall.yaml", np.random.default_rng(seed), Counter[str]()
    planner = {"lattice": {"step": 0.5}}
    model = {"differential_drive": {"radius": 0.25}}
    criteria = ["obstruction", "turns", "length"]
    file.write_text(json.dumps({**pillars(), "model": model, "criteria": criteria, "planner": planner}))
    world = load_scenario(file).problem.world
    crowd = Crowd(world, 8, robot=0.25, seed=seed)
    crowd.begin((1.0, 1.0, 0.0))

    def late(kind: str) -> float:
        return min(2.5, float((0.03 if kind == "push" else 0.15) * np.exp(random.normal())))

    session = SteppedSession(file, folder, crowd, late, seed=seed, delay=0.05, slip=0.02, noise=0.02)

    def ended() -> bool:
        return session.stopped or session._has_arrived

    def is_told(before: int, holds: Callable[[dict[str, Any]], bool]) -> bool:
        return any(map(holds, session.told[before:]))

    while counts["pushes"] < pushes:
        session.go(0.3)
        before = len(session.told)
        x, y = random.uniform((0.6, 0.6), (15.4, 11.4)).tolist()
        session.say("destination", x=x, y=y)
        session.go(10.0, partial(is_told, before, lambda m: m["type"] == "options" or m.get("status") == "blocked"))
        offered = [message for message in session.told[before:] if message["type"] == "options"]
        counts["clicks"] += 1
        if not offered or not offered[-1]["all"]:
            counts["clicks without a way"] += 1
            continue
        counts["ways offered"] += len(offered[-1]["all"])
        option = int(random.integers(len(offered[-1]["all"])))
        session.say("take", option=option, asked=offered[-1]["asked"])
        session.go(5.0, lambda: not ended())
        for _ in range(10):
            if session.go(float(random.uniform(0.3, 2.0)), ended) or counts["pushes"] >= pushes:
                break
            before = len(session.told)
            session.say("push", direction=float(random.choice([-1, 1]) * random.uniform(0.2, 1.6)))
            if session.go(15.0, partial(is_told, before, lambda m: m["type"] == "pushed")):
                answer = of(session.told[before:], "pushed")
                counts["pushes"] += 1
                counts["followed"] += answer["followed"]
                counts["without a way"] += answer["option"] is None
                counts["too late"] += "has passed" in answer["words"]
    notes = [message["words"] for message in session.told if message["type"] == "note"]
    counts["plans missed"] = sum(MISSED in words for words in notes)
    counts["plans held"] = sum("people walk elsewhere" in words for words in notes)
    counts["arrived"] = sum(message["type"] == "arrived" for message in session.told)
    counts["seconds"] = round(session.t)
    return session, counts


@pytest.mark.proof
def test_pushes_among_people_who_react_touch_nobody_and_leave_no_checked_path(tmp_path: Path) -> None:
    session, counts = pushed_among_people(tmp_path, int(os.environ.get("HPOP_PUSHES", "25")), seed=3)
    assert session.gap > 0.0, counts
    assert session.met == [], counts
    assert session.off < 0.3, counts
    assert counts["followed"], counts
