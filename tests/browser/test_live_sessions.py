"""Sessions on three maps in a real browser: no person is touched, and every number and explanation is checked.

The numbers of each card are evaluated again from its line. Each explanation is compared with a search of its own here:
label setting on the positions of the lattice, with the place as a constraint, which shares no code with the planner's.
HPOP_SESSION sets the length of the sessions among people, s; docs/benchmarks.md tells of a quarter of an hour each.
"""

from __future__ import annotations

import heapq
import math
import os
import re
import time
from collections import defaultdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from playwright.sync_api import Browser

from hpop.scenario import load_scenario
from hpop.trajectories.trajectory import Trajectory
from tests.browser.test_live_page import Guest, served

pytestmark = pytest.mark.proof  # minutes

Pose = tuple[float, float, float]
Costs = tuple[int, float]  # turns, length m

HALL = """\
world:
  polygons:
    extent: [[0, 0], [14, 0], [14, 9], [0, 9]]
    obstacles: [{obstacles}]
model:
  differential_drive: {{radius: 0.25}}
start: [1, 1, 0]
goal: [13, 8, any]
criteria: [{criteria}]
planner:
  lattice: {{step: 0.5}}
"""
HALLS = {
    "pillars": [(3, 2, 4, 3), (3, 6, 4, 7), (7, 4, 8, 5), (10, 2, 11, 3), (10, 6, 11, 7)],
    "rooms": [(4.5, 0, 4.7, 3), (4.5, 5, 4.7, 9), (9.5, 0, 9.7, 4), (9.5, 6, 9.7, 9)],
    "aisles": [(3, 2, 11, 2.6), (3, 4.2, 11, 4.8), (3, 6.4, 11, 7)],
}
SIZE = (14.0, 9.0)
SESSION = float(os.environ.get("HPOP_SESSION", "40"))  # s on each map
CROWD = 6
STEP, RADIUS = 0.5, 0.25  # m, of the lattice and of the robot
NEAR = 0.5  # m: a way passes a place as near as this
SIDES = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
SMALL = 0.02  # m: lines are told in mm


def walls_of(name: str) -> shapely.Geometry:
    return shapely.union_all([shapely.box(*corners) for corners in HALLS[name]])


def scenario_of(name: str, criteria: str) -> str:
    corners = "{{corners: [[{0}, {1}], [{2}, {1}], [{2}, {3}], [{0}, {3}]]}}"
    return HALL.format(obstacles=", ".join(corners.format(*box) for box in HALLS[name]), criteria=criteria)


# The search that shares no code


@cache
def moves(name: str) -> dict[tuple[int, int], list[tuple[int, tuple[int, int]]]]:
    """Return for each free position of the lattice the directions, by number, in which the next one can be reached.

    The lattice cuts no corners: a diagonal move needs the two positions beside it to be free.
    """
    walls = shapely.union(walls_of(name), shapely.box(0, 0, *SIZE).exterior)

    def is_free(*nodes: tuple[int, int]) -> bool:
        line = shapely.LineString([(STEP * i, STEP * j) for i, j in (*nodes, nodes[-1])])
        return bool(shapely.box(0, 0, *SIZE).covers(line) and walls.distance(line) > RADIUS - 1e-9)

    found = defaultdict(list)
    for i, j in np.ndindex(*(int(side / STEP) + 1 for side in SIZE)):
        for side, (di, dj) in enumerate(SIDES):
            if is_free((i, j), (i + di, j + dj)) and is_free((i + di, j)) and is_free((i, j + dj)):
                found[i, j].append((side, (i + di, j + dj)))
    return dict(found)


def node_of(x: float, y: float) -> tuple[int, int] | None:
    """Return the position of the lattice at (x, y); None beside it."""
    i, j = round(x / STEP), round(y / STEP)
    return (i, j) if math.dist((x, y), (STEP * i, STEP * j)) < SMALL else None


def best_through(name: str, start: Pose, goal: tuple[int, int], place: shapely.Point | None, wide: float) -> set[Costs]:
    """Return the non-dominated turns and lengths from a pose to a goal, of the paths that pass a place within ``wide``.

    Label setting by turns, then length; for each state only a shorter path with more turns is of use.
    """
    begin, side = node_of(*start[:2]), round(start[2] / (math.pi / 4)) % 8
    assert begin is not None
    here = place is None or shapely.Point(start[:2]).distance(place) <= wide
    queue: list[tuple[int, float, tuple[int, int], int, bool]] = [(0, 0.0, begin, side, here)]
    shortest: dict[Any, float] = {}
    found = list[Costs]()
    while queue:
        turns, length, node, side, passed = heapq.heappop(queue)
        if shortest.get((node, side, passed), math.inf) <= length + 1e-9:
            continue
        shortest[node, side, passed] = length
        if node == goal and passed and (not found or length < found[-1][1] - 1e-9):
            found.append((turns, length))
        for other, after in moves(name).get(node, []):
            goes = passed
            if not passed and place is not None:
                line = shapely.LineString([(STEP * node[0], STEP * node[1]), (STEP * after[0], STEP * after[1])])
                goes = line.distance(place) <= wide
            longer = length + STEP * math.hypot(*SIDES[other])
            if shortest.get((after, other, goes), math.inf) > longer + 1e-9:
                heapq.heappush(queue, (turns + (other != side), longer, after, other, goes))
    return set(found)


def below(costs: Costs, front: set[Costs]) -> bool:
    """Return whether a cost vector is no less than one of a front, up to the rounding of lines."""
    return any(turns <= costs[0] and length <= costs[1] + SMALL for turns, length in front)


def along(line: list[list[float]], theta: float) -> list[Pose]:
    """Return the poses of a way: its corners, each with the heading with which the robot comes there."""
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(line)]
    return [(*line[0], theta), *((*point, heading) for point, heading in zip(line[1:], headings, strict=True))]


def turns_of(poses: list[Pose]) -> int:
    return sum(abs(math.remainder(b[2] - a[2], math.tau)) > 1e-2 for a, b in pairwise(poses))


def pose_of(options: dict[str, Any]) -> Pose:
    """Return the pose from which offered ways begin."""
    commit = options["commit"]
    return commit["x"], commit["y"], commit["theta"]


# Sessions


def session(guest: Guest, chance: np.random.Generator, what: list[str], seconds: float) -> list[tuple[float, float]]:
    """Choose, take, push, ask, stop and go at random for some seconds; return the places that were asked for."""
    guest.room, asked = SIZE, []
    guest.prepared()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        x, y = float(chance.uniform(0.5, 13.5)), float(chance.uniform(0.5, 8.5))
        match chance.choice(what):
            case "go":
                guest.page.keyboard.press("g")
                guest.page.mouse.click(*guest.on_map(x, y))
            case "take":
                guest.page.keyboard.press(str(chance.integers(1, 4)))
            case "push":
                guest.page.keyboard.press(str(chance.choice(["ArrowLeft", "ArrowRight", "ArrowUp"])), delay=100)
            case "why":
                guest.page.keyboard.press("q")
                guest.page.mouse.click(*guest.on_map(x, y))
                asked.append((x, y))
            case "stop":
                guest.page.keyboard.press("Escape")
                guest.page.wait_for_timeout(1000)
                guest.page.keyboard.press(" ")
        guest.page.wait_for_timeout(1500)
    return asked


def check_cards(guest: Guest, file: Path, walls: shapely.Geometry) -> int:
    """Evaluate all numbers of all ways again, from their lines; return how many were checked."""
    problem, many = load_scenario(file).problem, 0
    for options in guest.of("options"):
        start = pose_of(options)
        for way in options["all"]:
            if len(way["line"]) < 2:
                continue
            poses = along(way["line"], start[2])
            told = way["costs"]
            again = problem.evaluate(Trajectory.from_poses(problem.model, poses), also=["exposure"])
            assert walls.distance(shapely.LineString(way["line"])) > RADIUS - SMALL
            assert told["turns"] == turns_of(poses), (way, start)
            assert told["length"] == pytest.approx(sum(math.dist(a[:2], b[:2]) for a, b in pairwise(poses)), abs=SMALL)
            for name in told.keys() - {"exposure"}:
                assert told[name] == pytest.approx(again[name], abs=SMALL), name
            if "exposure" in told:  # it grows while the robot waits for people
                assert told["exposure"] > again["exposure"] - 0.05
            many += len(told)
        costs = {way["option"]: way["costs"] for way in options["all"]}
        assert all(card["costs"] == costs[card["option"]] for card in options["cards"])
    return many


def check_whys(guest: Guest, name: str, asked: list[tuple[float, float]], *, quiet: bool) -> int:
    """Compare all explanations with the search of this file; return how many were compared.

    quiet  whether no people walk about: then the answer is one of the best ways. Among people no answer is better
    """
    many, last = 0, dict[tuple[float, float], dict[str, Any]]()
    for why in guest.told:
        if why["type"] == "options":
            last[round(why["commit"]["x"], 2), round(why["commit"]["y"], 2)] = why
        if why["type"] != "why" or len(why["line"]) < 2:
            continue
        line = why["line"]
        told = re.search(r"of \(([-\d.]+), ([-\d.]+)\)", why["sentence"])
        assert told is not None, why["sentence"]
        place = shapely.Point(*map(float, told.groups()))
        assert min(map(place.distance, map(shapely.Point, asked))) < 0.1  # pixels of a small map
        assert shapely.LineString(line).distance(place) < NEAR + SMALL
        options, goal = last.get((round(line[0][0], 2), round(line[0][1], 2))), node_of(*line[-1])
        if options is None or goal is None or node_of(*line[0]) is None:
            continue
        start = pose_of(options)
        poses = along(line, start[2])
        costs = turns_of(poses), sum(math.dist(a[:2], b[:2]) for a, b in pairwise(poses))
        assert below(costs, best_through(name, start, goal, place, NEAR + SMALL)), (why, start)
        if quiet:
            exact = best_through(name, start, goal, place, NEAR)
            assert any(costs == (turns, pytest.approx(length, abs=SMALL)) for turns, length in exact), (why, exact)
            rows = [way["costs"] for way in options["all"] if math.dist(way["line"][-1], line[-1]) < SMALL]
            own = {"turns": costs[0], "length": costs[1]}
            less = [{name: own[name] - row[name] for name in own} for row in rows]
            assert any(why["costs"] == pytest.approx(each, abs=SMALL) for each in less)
            assert not (min(why["costs"].values()) < -SMALL and "never better" in why["sentence"])
        many += 1
    return many


def test_ways_and_explanations_are_those_of_a_search_that_shares_no_code(browser: Browser, tmp_path: Path) -> None:
    """No people walk about. All fronts are complete: their costs are those of the search of this file."""
    name = "pillars"
    with served(tmp_path, scenario_of(name, "turns, length")) as server:
        guest = Guest(browser, server.address())
        asked = session(guest, np.random.default_rng(5), ["go", "take", "why", "why"], 60.0)
        guest.close()
    assert check_cards(guest, tmp_path / "room.yaml", walls_of(name)) > 20
    assert check_whys(guest, name, asked, quiet=True) > 1
    for options in guest.of("options"):
        start = pose_of(options)
        goal = node_of(*options["all"][0]["line"][-1])
        if options["present"] is None and goal is not None and node_of(*start[:2]) is not None:
            told = {(way["costs"]["turns"], round(way["costs"]["length"], 3)) for way in options["all"]}
            found = best_through(name, start, goal, None, NEAR)
            assert told == {(turns, round(length, 3)) for turns, length in found}


@pytest.mark.parametrize("name", HALLS)
def test_a_session_among_people_who_react_touches_nobody_and_tells_true_numbers(
    browser: Browser, tmp_path: Path, name: str
) -> None:
    pytest.importorskip("jupedsim")
    walls, what = walls_of(name), ["go", "go", "take", "push", "push", "why", "stop"]
    with served(tmp_path, scenario_of(name, "obstruction, turns, length"), crowd=CROWD) as server:
        guest = Guest(browser, server.address())
        asked = session(guest, np.random.default_rng(7), what, SESSION)
        guest.close()
    assert guest.complaints == []
    states = guest.of("state")
    driven = sum(math.dist((a["x"], a["y"]), (b["x"], b["y"])) for a, b in pairwise(states))
    assert len(states) > 2 * SESSION
    assert driven > 1.0
    for state in states:
        here = (state["x"], state["y"])
        assert walls.distance(shapely.Point(here)) > RADIUS
        assert all(math.dist(here, person[:2]) > 2 * RADIUS for person in state["people"]), state
    nearest = min(math.dist((s["x"], s["y"]), p[:2]) for s in states for p in s["people"]) - 2 * RADIUS
    numbers, whys = check_cards(guest, tmp_path / "room.yaml", walls), check_whys(guest, name, asked, quiet=False)
    passed = states[-1]["t"] - states[0]["t"]
    said = f"{len(guest.of('pushed'))} pushes, {whys} of {len(guest.of('why'))} explanations compared"
    print(f"{name}: {passed:.0f} s, {driven:.0f} m, {len(guest.of('arrived'))} arrivals, nearest {nearest:.2f} m")
    print(f"{len(guest.of('options'))} offers with {numbers} numbers, {said}")
