"""Tools of the targets: a room to bend, files with bent structure or bytes, a command of hpop in this process."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import shapely
import yaml
from click.testing import CliRunner
from harness import Wrong
from mutations import Rng, bent_bytes, bent_tree
from verdicts import CONTROLS

from hpop.cli import main

SOFTEST = 0.5  # share of inputs whose bytes are bent; the others' structure is

ROOM: dict[str, Any] = {
    "world": {"polygons": {"extent": [[0, 0], [6, 0], [6, 4], [0, 4]], "obstacles": []}},
    "model": {"differential_drive": {"radius": 0.3, "camera_height": 1.2, "speed": 1.0}},
    "start": [1.0, 1.0, 0],
    "goal": [5.0, 3.0, "any"],
    "criteria": ["obstruction", "turns", {"enclosure": {"radius": 3.0}}, "length"],
    "planner": {"lattice": {"step": 0.5, "headings": 8, "eps": 0.0, "time_limit": 2.0, "max_labels": 100_000}},
    "people": [{"x": 3.0, "y": 3.5, "yaw": "90 deg", "name": "Ada"}, {"x": 3.5, "y": 3.5, "yaw": 0}],
    "groups": [["Ada", 1]],
    "landmarks": [{"x": 5.5, "y": 2.0, "z": 1.6, "facing": "180 deg", "weight": 2, "name": "door"}],
    "zones": [{"kind": "speed", "area": [[3, 1], [4, 1], [4, 2]], "limit": 0.5}],
}
ROOM["world"]["polygons"]["obstacles"] = [{"corners": [[2, 1], [3, 1], [3, 2], [2, 2]], "height": [0, 1.5]}]
PLANNERS: list[dict[str, dict[str, Any]]] = [
    ROOM["planner"],
    {"lattice": {"step": 0.5, "max_turns": 6, "tolerance": {"length": 0.1}, "max_memory": 10**9}},
    {"lattice": {"step": 0.5, "max_detour": 1.1, "time_limit": 2.0}},
    {"weighted-sum": {"step": 0.5, "divisions": 4}},
    {"roadmap": {"samples": 60, "neighbours": 6, "seed": 1, "time_limit": 2.0}},
    {"any-angle": {"step": 0.5, "max_positions": 60, "time_limit": 2.0}},
]
BLOCK: dict[str, Any] = {
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "triangles": [{"vertex_indices": list(face)} for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))],
}


def written(path: Path, tree: Any, rng: Rng, dump: Callable[[Any], str]) -> Path:
    """Write a tree to a file, with its structure or its bytes bent."""
    if rng.random() < SOFTEST:
        data = bent_bytes(dump(tree).encode(), rng)
    else:
        data = dump(bent_tree(tree, rng, most=int(rng.integers(1, 4)))).encode("utf-8", "surrogatepass")
    path.write_bytes(data)
    return path


def as_json(tree: Any) -> str:
    return json.dumps(tree, ensure_ascii=bool(len(str(tree)) % 2), default=str)


def as_yaml(tree: Any) -> str:
    try:
        return yaml.safe_dump(tree, allow_unicode=True, sort_keys=False)
    except RecursionError:  # the writer's, for lists within lists within lists
        return "[" * 5000


def command(arguments: list[str]) -> str:
    """Run a command of hpop in this process, and check that its output is clean."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = CliRunner().invoke(main, arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    found = CONTROLS.search(result.output)
    if found:
        raise Wrong(f"the control character {found[0]!r} on the terminal")
    if "Traceback" in result.output:
        raise Wrong("a traceback on the terminal")
    return "accepted" if result.exit_code == 0 else "refused"


def box(*corners: float) -> Any:

    return shapely.box(*corners)
