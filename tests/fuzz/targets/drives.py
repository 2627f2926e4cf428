"""Drives: what happens on the way, in YAML, and the record of a drive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mutations import Rng, bent_bytes, bent_tree
from verdicts import verdict

import hpop
from hpop.drive import load
from hpop.scenario.events import load_events
from targets.given import as_json, as_yaml, box, written

EVENTS: dict[str, Any] = {
    "choice": "knee",
    "events": [
        {"at": 0.5, "close": [[3, 2], [4, 2], [4, 3]], "name": "wet floor"},
        {"at": 1, "wish": {"length": -0.2}},
        {"at": 1.5, "options": True},
        {"at": 2, "people": [{"x": 5, "y": 1, "velocity": [-0.3, 0]}]},
        {"at": 2.5, "stop": 0},
        {"at": 3, "open": "wet floor"},
        {"at": 3, "take": "least turns"},
    ],
}
_RECORD: list[bytes] = []


def asked() -> hpop.Problem:
    """Return the problem that is driven."""
    world = hpop.World.from_polygons([], extent=box(0, 0, 6, 4))
    return hpop.Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (5, 3, None), ["turns", "length"])


def saved_drive() -> bytes:
    """Return the saved record of a drive with some events; driven once."""
    if not _RECORD:
        problem = asked()
        drive = hpop.follow(problem, problem.solve("lattice", step=1.0), "knee")
        drive.world(0.5, close=box(3, 2, 4, 3), name="wet floor")
        drive.options(1.0, deadline=5.0)
        drive.world(1.5, open="wet floor")
        drive.at(2.0)
        path = Path("drive.json")
        drive.save(path)
        _RECORD.append(path.read_bytes())
        path.unlink()
    return _RECORD[0]


def events(rng: Rng, folder: Path) -> str:
    path = written(folder / "events.yaml", EVENTS, rng, as_yaml)
    return verdict(lambda: repr(load_events(path, asked(), ("turns", "length"))))


def drive(rng: Rng, folder: Path) -> str:
    """Replay a bent record in its own world: planning in a larger world would take long."""
    path = folder / "drive.json"
    if rng.random() < 0.3:
        path.write_bytes(bent_bytes(saved_drive(), rng))
    else:
        record = json.loads(saved_drive())
        world = record["problem"].pop("world")
        bent = bent_tree(record, rng, most=2)
        if isinstance(bent, dict) and isinstance(bent.get("problem"), dict):
            bent["problem"]["world"] = world
        path.write_bytes(as_json(bent).encode("utf-8", "surrogatepass"))
    return verdict(lambda: load(path).save(folder / "again.json"))
