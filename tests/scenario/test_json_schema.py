"""The JSON schema of scenarios: it takes what hpop takes, and refuses faults that hpop refuses."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from click.testing import CliRunner

from hpop.base.registry import criteria, goals, models, planners
from hpop.cli import main
from hpop.errors import HpopError
from hpop.scenario import load_scenario
from hpop.scenario.json_schema import LINE, scenario_schema

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted({*(ROOT / "examples").glob("*.yaml")} - {ROOT / "examples/drive_events.yaml"})
OWN = {"own_criterion.yaml": "examples/03_own_criterion.py"}  # what its criterion comes from

WHOLE = """\
world:
  polygons:
    obstacles:
      - {corners: [[4, 2], [6, 2], [6, 4]], height: [0, 2]}
    extent: [[0, 0], [10, 0], [10, 6], [0, 6]]
model:
  differential_drive: {radius: 0.2, field_of_view: [90 deg, 60 deg]}
start: [1, 3, 90 deg]
goal: [9, 3, any]
criteria: [turns, length, exposure: {radius: 1}]
quanta: {length: 0.01}
planner:
  lattice: {step: 0.5, time_limit: 9, max_detour: {length: 1.2}, max_turns: 9}
people:
  - {x: 2, y: 1, yaw: 10 deg, name: Ada}
  - {x: 3, y: 1, velocity: [0.5, 0]}
  - {waypoints: [[0, 1, 2], [4, 3, 2]], afterwards: stays, growth: 0.1, name: Eve}
  - {x: 3, y: 2, futures: [{weight: 2, velocity: [1, 0]}, {weight: 1, waypoints: [[0, 3, 2], [1, 3, 3]]}]}
  - {track: tracks.csv, id: [1, Bo], begin: 0.5, unit: m}
horizon: 8
groups: [[Ada, 1]]
landmarks:
  - {x: 5, y: 5, z: 1.6, facing: -90 deg, weight: 2}
zones:
  - {kind: speed, area: [[3, 3], [6, 3], [6, 6]], limit: 0.5}
"""
TRACKS = "1,0,1,4\n1,2,2,4\nBo,0,1,5\nBo,2,2,5\n"
FAULTY = [
    ("criteria:", "criterea:"),
    ("polygons:", "polygon:"),
    ("obstacles:", "obstacle:"),
    ("extent:", "extend:"),
    ("corners:", "corner:"),
    ("[[4, 2], [6, 2], [6, 4]]", "[[4, 2], [6, 2]]"),
    ("[4, 2]", "[4, 2, 0]"),
    ("[0, 2]}", "2}"),
    ("[0, 6]]", "[0, six]]"),
    ("differential_drive:", "diferential_drive:"),
    ("radius: 0.2", "raduis: 0.2"),
    ("radius: 0.2", "radius: small"),
    ("[90 deg, 60 deg]", "[90 deg]"),
    ("[90 deg, 60 deg]", "[90 degrees, 60 deg]"),
    ("start: [1, 3, 90 deg]", "start: [1, 3, any]"),
    ("start: [1, 3, 90 deg]\n", ""),
    ("goal: [9, 3, any]", "goal: {lok_at: {target: [1, 2, 3], distance: [1, 2]}}"),
    ("goal: [9, 3, any]", "goal: {look_at: {target: [1, 2, 3], distanse: [1, 2]}}"),
    ("goal: [9, 3, any]", "goal: {look_at: {target: [1, 2, 3]}}"),
    ("goal: [9, 3, any]", "goal: [9, 3, anything]"),
    ("[turns, length, exposure: {radius: 1}]", "[]"),
    ("[turns, length, exposure: {radius: 1}]", "turns"),
    ("[turns,", "[turnz,"),
    ("exposure: {radius: 1}", "exposure: {radios: 1}"),
    ("exposure: {radius: 1}", "exposure: {radius: wide}"),
    ("exposure: {radius: 1}", "look_at"),  # which needs a target
    ("{length: 0.01}", "{length: fine}"),
    ("lattice: {step: 0.5", "latice: {step: 0.5"),
    ("step: 0.5", "stp: 0.5"),
    ("time_limit: 9", "time_limit: soon"),
    ("max_turns: 9", "max_turns: 9.5"),
    ("lattice: {step", "roadmap: {}\n  lattice: {step"),
    ("velocity: [0.5, 0]", "velocty: [0.5, 0]"),
    ("yaw: 10 deg", "yaw: north"),
    ("waypoints: [[0, 1, 2], [4, 3, 2]]", "waypoints: [[0, 1, 2]]"),
    ("[4, 3, 2]", "[4, 3]"),
    ("afterwards: stays", "afterwards: sits"),
    ("growth: 0.1", "growth: -0.1"),
    ("weight: 2, velocity", "velocity"),
    ("unit: m}", "unit: ft}"),
    ("begin: 0.5", "start: 0.5"),
    ("horizon: 8", "horizon: 0"),
    ("[[Ada, 1]]", "[[Ada]]"),
    ("x: 5,", ""),
    ("weight: 2", "weight: 0"),
    ("kind: speed", "kind: spede"),
    ("limit: 0.5", "limit: -1"),
    ("[[3, 3], [6, 3], [6, 6]]", "[[3, 3]]"),
]


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    return scenario_schema(at_home=True)


@pytest.fixture(scope="module")
def faults(schema: dict[str, Any]) -> Callable[[str], list[Any]]:
    jsonschema.Draft7Validator.check_schema(schema)
    validator = jsonschema.Draft7Validator(schema)
    return lambda text: list(validator.iter_errors(yaml.safe_load(text)))


@pytest.mark.parametrize("path", [path for path in EXAMPLES if path.name not in OWN], ids=lambda path: path.stem)
def test_every_example_is_valid_and_says_where_its_schema_is(path: Path, faults: Callable[[str], list[Any]]) -> None:
    text = path.read_text()
    assert faults(text) == []
    first = text.splitlines()[0]
    assert first == LINE.format("../docs/scenario.schema.json")
    assert (path.parent / first.partition("=")[2]).is_file()


def test_a_scenario_with_a_criterion_of_ones_own_has_a_schema_of_its_own(registered_as_before: None) -> None:
    del registered_as_before
    for name, module in OWN.items():
        text = (ROOT / "examples" / name).read_text()
        assert f"hpop schema --import {module}" in text
        printed = CliRunner().invoke(main, ["schema", "--import", str(ROOT / module)])
        assert printed.exit_code == 0, printed.output
        jsonschema.validate(yaml.safe_load(text), json.loads(printed.stdout), jsonschema.Draft7Validator)


def test_what_is_faultless_is_valid(faults: Callable[[str], list[Any]], tmp_path: Path) -> None:
    (tmp_path / "whole.yaml").write_text(WHOLE)
    (tmp_path / "tracks.csv").write_text(TRACKS)
    load_scenario(tmp_path / "whole.yaml")
    assert faults(WHOLE) == []
    solids = "world: {solids: {obstacles: [{box: [1, 1, 1], rpy: [0, 0, 45 deg]}]}}\n" + WHOLE.partition("model:")[2]
    assert faults(solids.replace("\n  diff", "\nmodel:\n  diff", 1)) == []


@pytest.mark.parametrize(("old", "new"), FAULTY)
def test_a_fault_is_refused_by_both(old: str, new: str, faults: Callable[[str], list[Any]], tmp_path: Path) -> None:
    assert old in WHOLE
    text = WHOLE.replace(old, new, 1)
    (tmp_path / "faulty.yaml").write_text(text)
    (tmp_path / "tracks.csv").write_text(TRACKS)
    with pytest.raises(HpopError):
        load_scenario(tmp_path / "faulty.yaml")
    assert faults(text)


def test_at_least_thirty_faults_are_tried() -> None:
    assert len(FAULTY) >= 30


def test_every_parameter_of_all_that_is_registered_says_what_it_is(schema: dict[str, Any]) -> None:
    kinds = {"criterion": criteria, "planner": planners, "model": models, "goal": goals}
    for kind, registry in kinds.items():
        choice = schema["definitions"][kind]
        named = choice if kind == "goal" else choice["anyOf"][-1]
        at_home = {name for name, cls in registry.items() if cls.__module__.startswith("hpop.")}
        assert named["properties"].keys() == at_home
    silent = [place for place, one in _properties(schema, "") if not one.get("description")]
    assert silent == []


def test_units_and_defaults_come_from_the_docstrings(schema: dict[str, Any]) -> None:
    drive = schema["definitions"]["model"]["anyOf"][-1]["properties"]["differential_drive"]["anyOf"][0]["properties"]
    assert drive["radius"] == {"type": "number", "description": "m, of a round footprint", "default": 0.3}
    image = schema["definitions"]["world"]["properties"]["image"]
    assert image["properties"]["resolution"]["description"] == "Side of a pixel, m."
    assert image["required"] == ["path", "resolution"]


def _properties(node: Any, place: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """All properties of a schema with where they are."""
    if isinstance(node, list):
        node = dict(enumerate(node))
    if isinstance(node, dict):
        for name, one in node.get("properties", {}).items():
            yield f"{place}/{name}", one
        for key, value in node.items():
            yield from _properties(value, f"{place}/{key}")
