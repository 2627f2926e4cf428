"""Targets that are called: Python, the search, ROS, the command line."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from mutations import Rng, bent_bytes, bent_tree, hostile
from verdicts import shown, verdict

import hpop
from hpop.base.registry import criteria, models, planners
from hpop.ros import GoalPlanner, Interface, path_message, pose_message, protocol, trajectory_of
from hpop.search import Graph, pareto_paths
from targets.given import box, command
from targets.robots import ARM

GOOD: dict[str, Any] = {"urdf": str(ARM / "arm6.urdf"), "tip": "tool", "acceleration": 6.0, "target": (1.0, 0.5, 0.8)}
"""Values of parameters without a default."""


def python(rng: Rng, folder: Path) -> str:
    """Criteria, robots, planners and problems made of hostile parameters."""
    registry = (criteria, planners, models)[rng.integers(3)]
    cls = registry[list(registry)[rng.integers(len(registry))]]
    known = [field for field in dataclasses.fields(cls) if field.init]
    names = [field.name for field in known]
    chosen = rng.permutation(names)[: int(rng.integers(1, 3))]
    missing = dataclasses.MISSING
    needed = [field.name for field in known if field.default is missing and field.default_factory is missing]
    values = {name: GOOD[name] if name in GOOD else argument(rng) for name in needed}
    values |= {str(name): argument(rng) for name in chosen}
    return verdict(lambda: repr(cls(**values)))


def argument(rng: Rng) -> Any:
    if rng.random() < 0.2:
        return [np.array([1.0, 2.0]), np.float64(0.5), np.int64(3), np.array(0.5), {1, 2}, b"x", object(), int][
            rng.integers(8)
        ]
    return hostile(rng)


def problem(rng: Rng, folder: Path) -> str:
    parts: dict[str, Any] = {
        "world": hpop.World.from_polygons([], extent=box(0, 0, 6, 4)),
        "model": hpop.DifferentialDrive(),
        "start": (1, 1, 0),
        "goal": (5, 3, None),
        "criteria": ["obstruction", "turns", "length"],
    }
    for key in rng.permutation(list(parts))[: int(rng.integers(1, 3))]:
        whole = rng.random() < 0.3 or not isinstance(parts[str(key)], tuple | list)
        parts[str(key)] = argument(rng) if whole else bent_tree(list(parts[str(key)]), rng)
    return verdict(lambda: hpop.Problem(**parts).solve("lattice", step=0.5))


def graph(rng: Rng, folder: Path) -> str:
    """Any arrays as a graph, any ends: the search on it ends, and nothing is read outside of them."""
    nodes, arcs = int(rng.integers(1, 12)), int(rng.integers(0, 30))
    tails, heads = rng.integers(-1 if rng.random() < 0.1 else 0, nodes + (rng.random() < 0.1), (2, arcs))
    costs: Any = rng.integers(0, 9, (arcs, int(rng.integers(1, 7))))
    if rng.random() < 0.3 and costs.size:
        extremes = [-1, 2**31, 2**62, 2**63 - 1, -(2**63)]
        costs.flat[rng.integers(costs.size)] = extremes[rng.integers(len(extremes))]
    if rng.random() < 0.2:
        costs = costs.astype(rng.choice([np.float64, np.float32, np.uint8, np.bool_, object]))
    options: dict[str, Any] = {}
    if rng.random() < 0.4:
        options[("eps", "tolerance", "at_most", "method")[rng.integers(4)]] = argument(rng)
    ends = [int(rng.integers(-1, nodes + 1)) if rng.random() < 0.2 else int(rng.integers(nodes)) for _ in range(2)]
    made = argument(rng) if rng.random() < 0.1 else nodes
    return verdict(lambda: pareto_paths(Graph.from_arcs(made, tails, heads, costs), *ends, **options))


def ros(rng: Rng, folder: Path) -> str:
    """Goals as a bridge sends them, and paths as others plan them."""
    model = hpop.DifferentialDrive()
    if rng.random() < 0.3:
        tour = hpop.Trajectory.from_poses(model, [(1, 1, 0), (2, 1, 0)]).with_hold(at=0, seconds=1)
        path = bent_tree(path_message(tour, planned=True, timed=True), rng)
        return verdict(lambda: trajectory_of(path, model))
    goal = {"start": pose_message(1, 1, 0), "goal": pose_message(5, 3, 0), "planner_id": "knee", "use_start": True}
    told = {"op": "send_action_goal", "id": "1", "action": "/hpop/compute_path_to_pose", "args": goal}
    text = json.dumps(bent_tree(told, rng, most=1))
    data = bent_bytes(text.encode(), rng).decode(errors="replace") if rng.random() < 0.3 else text
    world = hpop.World.from_polygons([], extent=box(0, 0, 6, 4))
    asked_first = hpop.Problem(world, model, (1, 1, 0), (5, 3, 0), ["turns", "length"])
    planning = GoalPlanner(asked_first, [planners["lattice"](step=0.5, time_limit=2.0)], Interface())
    answers = []

    def answer() -> None:
        message = protocol.parsed(data)
        protocol.goal_id(message)
        answers.append(planning.answer(message.get("args"), None))

    said = verdict(answer)
    return shown(answers[0].values["error_msg"]) if answers and answers[0].options is None else said


def arguments(rng: Rng, folder: Path) -> str:
    """Commands with hostile arguments."""
    words = ["plan", "show", "pick", "check", "criteria", "planners", "--out", "out", "--workers", "--import"]
    words += ["--checkpoint", "--also", "--wish"]
    words += ["room.yaml", "--dask", "-h", "turns", "math:pi", "."]
    (folder / "room.yaml").write_text("world: {}\n")
    chosen = [str(words[rng.integers(len(words))]) for _ in range(int(rng.integers(1, 6)))]
    if rng.random() < 0.8:
        word = str(hostile(rng))[:5000].replace("\0", "").replace("\ud800", "\udc80")  # what a process can be given
        chosen[int(rng.integers(len(chosen)))] = word
    if "--dask" in chosen:  # would look for a scheduler
        return "refused"
    return command(chosen)
