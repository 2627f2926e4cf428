"""Scenarios, read and planned."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import patch

from harness import Wrong
from mutations import Rng, bent_tree
from verdicts import verdict

import hpop
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from targets.given import PLANNERS, ROOM, as_yaml, command, written

SOLIDS = {
    "extent": [[0, 0], [6, 0], [6, 4], [0, 4]],
    "obstacles": [
        {"box": [1.0, 1.0, 0.75], "position": [2.5, 1.5, 0.375], "rpy": [0, 0, "30 deg"], "name": "table"},
        {"cylinder": {"radius": 0.1, "length": 1.0}, "position": [4, 1, 0.5], "quaternion": [0, 0.1, 0, 1]},
        {"sphere": 0.2, "position": [4, 3, 1]},
        {"hull": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "position": [5, 2, 0]},
    ],
}


def scenario(rng: Rng, folder: Path) -> str:
    tree = ROOM | {"planner": PLANNERS[rng.integers(len(PLANNERS))]}
    if rng.random() < 0.3:
        tree["world"] = {"solids": SOLIDS}
    path = written(folder / "room.yaml", tree, rng, as_yaml)

    def read() -> None:
        loaded = load_scenario(path)
        description = json.loads(json.dumps(loaded.problem.describe(), allow_nan=False))
        repr(hpop.Problem.from_description(description))

    return verdict(read)


def plan(rng: Rng, folder: Path) -> str:
    """Run the command line from a scenario with hostile numbers to a front that `hpop show` accepts."""
    spec = PLANNERS[rng.integers(len(PLANNERS))]
    tree = ROOM | {"planner": spec}
    key = ("planner", "planner", "start", "goal", "model", "criteria")[rng.integers(6)]
    tree[key] = bent_tree(tree[key], rng, most=1)
    try:
        (folder / "room.yaml").write_text(as_yaml(tree))
    except UnicodeEncodeError:
        return "refused"
    # Pictures take most of the time: one in eight is drawn.
    with nullcontext() if rng.random() < 0.125 else patch("hpop.cli.results.draw", return_value=[]):
        told = command(["plan", "room.yaml", "--out", "out"])
    if told == "accepted":
        front = hpop.Front.load(folder / "out" / "front.json")
        faults = verify(hpop.Problem.from_description(front.problem or {}), front)
        if faults:
            raise Wrong("a planned front that verify finds faults with")
    return told
