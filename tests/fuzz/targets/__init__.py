"""Targets: readers, scenarios, fronts, checkpoints, the Python interface and the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from harness import Attempt, Target

from hpop.search import Graph, pareto_paths
from targets import allowed, combinations, drives, fronts, interfaces, maps, robots, scenarios, studies
from targets.drives import saved_drive
from targets.fronts import saved_front
from targets.given import PLANNERS, ROOM, as_yaml, command


def warm(folder: Path) -> None:
    """Import and compile what inputs use, once, so that each process need not."""
    for number, spec in enumerate(PLANNERS):
        untimed = {name: {**options, "time_limit": None} for name, options in spec.items()}
        (folder / "room.yaml").write_text(as_yaml(ROOM | {"planner": untimed}))
        if command(["plan", "room.yaml", "--out", f"out{number}"]) != "accepted":
            raise AssertionError(f"the scenario that is to be bent does not plan with {spec}")
    for costs in range(1, 7):
        for method in ("auto", "general"):
            maker = np.random.default_rng(costs)
            tails, heads = maker.integers(0, 60, (2, 400))
            pareto_paths(Graph.from_arcs(60, tails, heads, maker.integers(1, 3, (400, costs))), 0, 59, method=method)
    saved_front()
    saved_drive()
    studies.designed()
    allowed.plugin()


EVERY: list[Attempt] = [
    *(
        maps.geojson,
        maps.road,
        maps.ros_map,
        maps.movingai,
        maps.tracks,
        maps.moveit_scene,
        maps.points_and_texts,
        maps.image,
        maps.dxf,
        maps.pdf,
    ),
    *(maps.ros_bag, robots.arm, scenarios.scenario, scenarios.plan, fronts.front, fronts.show, fronts.checkpoint),
    *(fronts.pick, interfaces.python, interfaces.problem, interfaces.graph, interfaces.ros, interfaces.arguments),
    *(drives.events, drives.drive),
    *(studies.design, studies.form, studies.answers, studies.preference, studies.learnt),
]
TARGETS = {attempt.__name__: Target(attempt.__name__, attempt) for attempt in EVERY}
TARGETS["combination"] = Target("combination", combinations.combination, shares=9, seconds=90)
