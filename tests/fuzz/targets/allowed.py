"""Scenarios that are allowed: robots, planners, goals, criteria and limits combined at random, all of them small."""

from __future__ import annotations

import importlib
import math
import sys
from functools import cache
from pathlib import Path
from typing import Any

from mutations import Rng

from hpop.base.registry import criteria, make_model, planners

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
WIDTH, DEPTH = 5.0, 3.0  # m
ARM = {
    "urdf": str(EXAMPLES / "arm/arm6.urdf"),
    "srdf": str(EXAMPLES / "arm/arm6.srdf"),
    "tip": "forearm",
    "acceleration": 6.0,
}
JOINTS = ((-0.27, 0.74, 1.73, 0.87), (0.27, 0.64, 1.43, 0.5), (0.0, -1.2, 2.4, 0.0))  # rad
SHARE_OF_PEOPLE = 0.4
MOST_CRITERIA = 4
HEAVY = {"smoothing", "spline", "epsilon-constraint", "weighted-sum-corridor", "rrt"}  # planners that solve programs


@cache
def plugin() -> str:
    """Register the robot of the example package, which is not part of hpop."""
    sys.path.insert(0, str(EXAMPLES / "plugin"))
    try:
        importlib.import_module("hpop_example_plugin.holonomic")
    finally:
        sys.path.remove(str(EXAMPLES / "plugin"))
    return "holonomic"


def scenario(rng: Rng, folder: Path) -> dict[str, Any]:
    """Return the contents of a scenario file; write its other files to the folder."""
    model, states = robot(rng)
    tree: dict[str, Any] = {"world": world(rng), "model": model}
    tree["start"], tree["goal"] = ends(rng, states, len(states[0]) == 3 and next(iter(model)) == "serial_arm")
    tree |= content(rng)
    tree["criteria"] = wanted(rng)
    if rng.random() < 0.15:
        tree["quanta"] = {_name(tree["criteria"][0]): _one(rng, 1e-6, 0.01, 10.0)}
    if rng.random() < 0.2:
        tree["horizon"] = _one(rng, 1e-6, 0.5, 5.0)
    known = make_model(model).provides
    moving = any(key in person for person in tree["people"] for key in ("velocity", "waypoints", "futures"))
    some = [planner(rng, folder, number, known, moving) for number in range(_one(rng, 1, 1, 1, 1, 2, 3))]
    tree["planner"] = some[0] if len(some) == 1 else some
    return tree


def robot(rng: Rng) -> tuple[dict[str, Any], list[tuple[float, ...]]]:
    """Return a robot and some of its states: the start and others, m and rad."""
    base: dict[str, Any] = {"radius": _one(rng, 0.05, 0.2, 0.3)}
    if rng.random() < 0.3:
        base = {"footprint": [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]}
    kind = _one(rng, *["base"] * 6, "head", "head", "plugin", "arm", "carried" if rng.random() < 0.3 else "base")
    if rng.random() < 0.2 and kind == "base":
        base |= {"field_of_view": [1.0, 0.8]}
    if rng.random() < 0.2 and kind == "base":
        base["view"] = "unwound"
    if rng.random() < 0.2:
        base |= {"camera_offset": [0.2, 0.0], "camera_height": 0.8}
    plane = [(0.5, 1.5), (WIDTH - 0.5, 1.5), (WIDTH - 0.63, 1.41), (0.5, 1.5), (2.5, 0.5), (0.61, 2.3)]
    yaws = (0.0, 0.0, 0.5 * math.pi, 0.3, -math.pi)
    poses = [(x, y, float(_one(rng, *yaws))) for x, y in plane]
    if kind == "plugin":
        return {plugin(): {"length": 0.4, "width": 0.3}}, poses
    if kind == "head":
        return {"pan_tilt": {"base": {"differential_drive": base}}}, [(*pose, 0.0, 0.0) for pose in poses]
    if kind == "arm":
        return {"serial_arm": ARM}, [JOINTS[rng.integers(3)] for _ in poses]
    if kind == "carried":
        arm = ARM | {"base": [0, 0, 0.5, 0, 0, 0]}
        given = {"base": {"differential_drive": {"radius": 0.2}}, "arm": {"serial_arm": arm}}
        return {"mobile_arm": given}, [(*pose, *JOINTS[2]) for pose in poses]
    return {"differential_drive": base}, poses


def world(rng: Rng) -> dict[str, Any]:
    """Return a room with up to three things in it, upright or solid; one in six is cut in two by a wall."""
    extent = [[0, 0], [WIDTH, 0], [WIDTH, DEPTH], [0, DEPTH]]
    boxes = []
    for _ in range(int(rng.integers(0, 4))):
        x, y = float(rng.uniform(1.0, 3.5)), float(rng.uniform(0.0, 2.5))
        boxes.append((x, y, x + float(rng.uniform(0.1, 0.8)), y + float(rng.uniform(0.1, 1.0))))
    if rng.random() < 1 / 6:
        boxes.append((2.4, 0.0, 2.6, DEPTH - float(_one(rng, 0.0, 0.3, 0.9))))
    if rng.random() < 0.2:
        solids = [
            {"box": [x1 - x0, y1 - y0, 1.0], "position": [0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5]}
            for x0, y0, x1, y1 in boxes
        ]
        return {"solids": {"obstacles": solids, "extent": extent}}
    prisms: list[dict[str, Any]] = [{"corners": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]} for x0, y0, x1, y1 in boxes]
    for prism in prisms:
        if rng.random() < 0.3:
            prism["height"] = _one(rng, [0, 0.3], [0, 1.5], [1.0, 2.0])
    return {"polygons": {"extent": extent, "obstacles": prisms}}


def ends(rng: Rng, states: list[tuple[float, ...]], on_a_table: bool) -> tuple[list[float], Any]:
    """Return a start and a goal: a state, one with free angles, several, or a point to look at."""
    start, others = list(states[0]), states[1:]

    def one() -> list[Any]:
        state: list[Any] = list(others[rng.integers(len(others))])
        if not on_a_table and rng.random() < 0.5:
            state[2:] = ["any"] * (len(state) - 2)
        return state

    kind = rng.random()
    if kind < 0.7:
        return start, one()
    if kind < 0.9:
        return start, [one() for _ in range(int(rng.integers(1, 4)))]
    return start, {"look_at": {"target": [2.5, 1.0, 0.5], "distance": [0.3, 2.0]}}


def content(rng: Rng) -> dict[str, Any]:
    """People who stand and walk, landmarks, zones."""
    people: list[dict[str, Any]] = []
    if rng.random() < SHARE_OF_PEOPLE:
        for _ in range(int(rng.integers(1, 4))):
            x, y = float(rng.uniform(1.0, 4.0)), float(rng.uniform(0.3, 2.7))
            person: dict[str, Any] = {"x": x, "y": y, "yaw": float(rng.uniform(-3, 3))}
            kind = rng.random()
            if kind < 0.4:
                person["velocity"] = rng.uniform(-1, 1, 2).tolist()
            elif kind < 0.5:
                person = {"waypoints": [[0, x, y], [2, y, 0.5], [4, x, 2.0]]}
            elif kind < 0.6:
                paths = [{"weight": 1, "velocity": rng.uniform(-1, 1, 2).tolist()} for _ in range(2)]
                person = {"x": x, "y": y, "futures": paths}
            if rng.random() < 0.3:
                person["until"] = _one(rng, 0.0, 0.3, 3.0)
            if rng.random() < 0.3:
                person["afterwards"] = "stays"
            if rng.random() < 0.2:
                person |= {"spread": 0.2, "growth": 0.1}
            people.append(person)
    found: dict[str, Any] = {"people": people}
    if len(people) > 1 and rng.random() < 0.3:
        found["groups"] = [[0, 1]]
    if rng.random() < 0.5:
        found["landmarks"] = [
            {"x": float(rng.uniform(0, WIDTH)), "y": float(rng.uniform(0, DEPTH)), "name": f"L{i}"}
            for i in range(int(rng.integers(1, 3)))
        ]
    if rng.random() < 0.3:
        area = [[2, 1], [3, 1], [3, 2.5]]
        kinds: list[dict[str, Any]] = [
            {"kind": "speed", "limit": 0.3},
            {"kind": "keep-out"},
            {"kind": "one-way", "path": [[2, 1.5], [3, 1.5]]},
        ]
        found["zones"] = [{"area": area} | kinds[rng.integers(3)]]
    return found


def wanted(rng: Rng) -> list[Any]:
    """Return some criteria with their required options, the common criteria more often."""
    told: dict[str, Any] = {
        "look_at": {"target": [2.5, 1.0, 1.0]},
        "occlusion": {"target": [2.5, 1.0, 1.0]},
        "view_distance": {"target": [2.5, 1.0, 1.0]},
    }
    everyday = ["length", "turns", "duration", "exposure", "clearance"]
    names = [name for name in criteria if name != "learnt" and criteria[name].__module__.startswith("hpop")]
    chosen: list[Any] = []
    for _ in range(int(rng.integers(1, MOST_CRITERIA + 1))):
        name = everyday[rng.integers(5)] if rng.random() < 0.4 else names[rng.integers(len(names))]
        if name not in map(_name, chosen):
            chosen.append({name: told[name]} if name in told else name)
    return chosen


def planner(rng: Rng, folder: Path, number: int, provides: frozenset[str], moving: bool) -> dict[str, Any]:
    """Return a planner for such a robot with some of its options, limits near 0 among them."""
    names = ("lattice", "lattice", "lattice", "roadmap", "roadmap", *planners)
    able = [name for name in names if planners[name].needs <= provides] or ["roadmap"]
    name = str(_one(rng, *able))
    step = _one(rng, 0.5, 0.5, 1.0, 0.37)
    limits = {
        "time_limit": _one(rng, None, 2.0, 0.3, 0.05, 1e-9),
        "max_labels": _one(rng, None, None, 1, 30, 1000),
        "max_memory": _one(rng, None, None, None, 1, 10**6, 10**8),
    }
    kept = {"checkpoint": str(folder / f"kept{number}") if rng.random() < 0.15 else None}
    timed = {
        "clock": _one(rng, None, None, 0.1, 0.5),
        "hold": _one(rng, *["usual"] * 3, None, 0.5),
        "arrive_by": _one(rng, None, None, 0.5, 20) if moving else None,
        "margin": _one(rng, 0.0, 0.0, 0.2, 50.0),
    }
    some: dict[str, dict[str, Any]] = {
        "lattice": {
            "step": step,
            "headings": _one(rng, 4, 8, 16),
            "corner_cutting": bool(rng.random() < 0.3),
            "max_detour": _one(rng, *[None] * 6, 1.0, 1.3),
            "max_turns": _one(rng, None, None, None, 0, 3),
            "eps": _one(rng, 0.0, 0.0, 0.0, 0.1, 10.0),
            "tolerance": _one(rng, None, None, None, {"length": 0.5}),
            **limits,
            **kept,
            **timed,
        },
        "roadmap": {
            "samples": _one(rng, 1, 2, 20, 60),
            "neighbours": _one(rng, None, None, 1, 3),
            "seed": int(rng.integers(5)),
            "far": _one(rng, None, None, None, 0, 2),
            "trees": _one(rng, None, None, None, 0, 1),
            **limits,
            **kept,
            **timed,
        },
        "any-angle": {"step": step, "max_positions": _one(rng, 2, 30), **limits},
        "weighted-sum": {"step": step, "divisions": _one(rng, None, 1, 3)},
        "weighted-sum-corridor": {"step": step, "divisions": _one(rng, 1, 2)},
        "epsilon-constraint": {"step": step, "max_points": _one(rng, 1, 2), "rounds": 1},
        "smoothing": {"step": step, "intervals": 8},
        "spline": {"pieces": 2, "warm_start": {"roadmap": {"samples": 4, "trees": 1}}},
        "rrt": {"runs": _one(rng, 1, 3), "max_extensions": 500, "seed": int(rng.integers(5))},
    }
    options = some.get(name, {})
    if name == "roadmap" and "joints" in provides:  # two trees grow for seconds where no path is
        options |= {"trees": 1, "samples": min(20, options["samples"])}
    if name in HEAVY or name == "weighted-sum":
        options["time_limit"] = _one(rng, 1.0, 0.3, 1e-9)
    if name == "weighted-sum" and rng.random() < 0.3:
        options = {"divisions": 1, "on": {"roadmap": {"samples": 20}}}
    return {name: {key: value for key, value in options.items() if value not in (None, "usual")} | _unset(options)}


def _unset(options: dict[str, Any]) -> dict[str, Any]:
    """Keep a hold of None: it is a value, and says that the robot never waits."""
    return {"hold": None} if "hold" in options and options["hold"] is None else {}


def _name(spec: Any) -> str:
    return spec if isinstance(spec, str) else next(iter(spec))


def _one(rng: Rng, *values: Any) -> Any:
    return values[rng.integers(len(values))]
