"""Scenario files: what they build, and that every fault is said with file, line, key and the way out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from hpop.base import registry
from hpop.criteria.base import criterion
from hpop.errors import (
    CriterionError,
    HpopError,
    MapError,
    ModelError,
    OptionError,
    QueryError,
    ScenarioError,
    StudyError,
    UnknownName,
    UnsupportedModel,
)
from hpop.frontier import ItemFront as Costs
from hpop.motions import Motions
from hpop.preference import Preference
from hpop.problems.front import Front
from hpop.scenario import load_scenario

ROOM = """\
world:
  polygons:
    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]
    obstacles:
      - {corners: [[2.5, 0], [3.5, 0], [3.5, 2.2], [2.5, 2.2]], height: [0, 2]}
model:
  differential_drive: {radius: 0.2, camera_height: 1.2}
start: [1.0, 1.0, 0]
goal: [5.0, 1.0, any]
criteria: [turns, length]
planner:
  lattice: {step: 0.5}
"""


def scenario(folder: Path, *changes: tuple[str, str], text: str = ROOM) -> Path:
    """Write the room with some of its text replaced."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "room.yaml"
    path.write_text(text)
    return path


def faults(path: Path, kind: type[HpopError] = ScenarioError) -> list[str]:
    """Lines of the error, each without the name of the file, which it must begin with."""
    with pytest.raises(HpopError) as error:
        load_scenario(path)
    assert type(error.value) is kind
    lines = str(error.value).split("\n")
    assert all(line.startswith(f"{path}, line ") for line in lines)
    return [line.removeprefix(f"{path}, ") for line in lines]


def test_a_scenario_builds_the_problem_that_it_says(tmp_path: Path) -> None:
    built = load_scenario(scenario(tmp_path))
    problem = built.problem
    assert problem.start == (1.0, 1.0, 0.0)
    assert problem.goal == (5.0, 1.0, None)
    assert [c.name for c in problem.criteria] == ["turns", "length"]
    assert (problem.model.radius, problem.model.camera_height) == (0.2, 1.2)
    assert problem.world.bounds == (0.0, 0.0, 6.0, 4.0)
    clearance = problem.world.clearance(np.array([1.0, 3.0]), np.array([1.0, 1.0]))
    assert clearance.tolist() == [1.0, 0.0]
    assert [(planner.name, planner.step) for planner in built.planners] == [("lattice", 0.5)]  # type: ignore[attr-defined]


def test_model_and_planner_have_defaults_and_a_name_alone_will_do(tmp_path: Path) -> None:
    text = ROOM.replace("planner:\n  lattice: {step: 0.5}\n", "")
    text = text.replace(
        "model:\n  differential_drive: {radius: 0.2, camera_height: 1.2}\n", "model: differential_drive\n"
    )
    built = load_scenario(scenario(tmp_path, text=text))
    assert built.problem.model.radius == 0.3
    assert [planner.name for planner in built.planners] == ["lattice"]


@pytest.mark.parametrize(
    ("order", "stop", "line", "key", "said"),
    [
        ("order: any", "{look_att: {distance: [1, 2]}}", 17, "tour.stops.1.look_att", "did you mean 'look_at'?"),
        ("order: any", "{landmark: vase}", 17, "tour.stops.1", "no landmark is called 'vase'"),
        ("order: any", "{at: [5, 9], within: 4.9}", 17, "tour.stops.1", "y 0.00 to 4.00 m. Move the stop"),
        ("some: [[a, b], [b, a]]", "{at: [5, 3], within: 1, name: b}", 14, "tour.some", "a before b before a"),
        ("order: any", "{at: [5, 3], within: 1, name: a}", 15, "tour.stops", "a name of its own, got 'a'"),
    ],
)
def test_a_fault_of_a_tour_is_said_with_the_line_of_its_stop_or_order(
    tmp_path: Path, order: str, stop: str, line: int, key: str, said: str
) -> None:
    tour = f"tour:\n  {order}\n  stops:\n    - {{at: [1, 3], within: 0.5, name: a}}\n    - {stop}\n"
    kind = ScenarioError if "look_att" in stop else QueryError
    (only,) = faults(scenario(tmp_path, text=ROOM + tour), kind)
    assert only.startswith(f"line {line}, {key}")
    assert said in only
    assert "larger" not in only


def test_a_stop_beside_the_map_may_reach_into_it(tmp_path: Path) -> None:
    path = scenario(tmp_path, text=f"{ROOM}tour: {{stops: [{{at: [5, 9], within: 5.1}}]}}\n")
    tour = load_scenario(path).problem.tour
    assert tour is not None
    assert tour.stops[0].at == (5.0, 9.0)


def test_several_planners_are_built_in_their_order(tmp_path: Path) -> None:
    path = scenario(tmp_path, ("  lattice: {step: 0.5}", "  - lattice\n  - lattice: {step: 1.0}"))
    assert [planner.step for planner in load_scenario(path).planners] == [0.25, 1.0]  # type: ignore[attr-defined]


def test_the_mean_itself_under_a_cap_on_the_length(tmp_path: Path) -> None:
    options = "{step: 0.5, max_detour: {length: 1.2}, max_turns: 6}"
    path = scenario(tmp_path, ("{step: 0.5}", options), ("[turns, length]", "[obstruction, turns, length]"))
    built = load_scenario(path)
    front = built.problem.solve(list(built.planners))
    assert "exact under length <= " in front.certificate
    assert "(1.2 times the least) and at most 6 turns" in front.certificate
    front.save(tmp_path / "front.json")
    assert Front.load(tmp_path / "front.json").provenance == front.provenance


@pytest.mark.parametrize(
    ("text", "yaw"), [("90 deg", math.pi / 2), ("-45deg", -math.pi / 4), ("1.5", 1.5), ("'22.5 deg'", math.pi / 8)]
)
def test_a_yaw_is_in_rad_or_says_that_it_is_in_degrees(tmp_path: Path, text: str, yaw: float) -> None:
    built = load_scenario(scenario(tmp_path, ("[1.0, 1.0, 0]", f"[1.0, 1.0, {text}]")))
    assert built.problem.start[2] == pytest.approx(yaw)


def test_paths_are_relative_to_the_scenario_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "two.map").write_text("type octile\nheight 1\nwidth 2\nmap\n..\n")
    text = "world:\n  movingai: {path: maps/two.map}\nstart: [0.5, 0.5, 0]\ngoal: [1.5, 0.5, 0]\ncriteria: [length]\n"
    monkeypatch.chdir("/")
    assert load_scenario(scenario(tmp_path, text=text)).problem.world.bounds == (0.0, 0.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("change", "line", "key", "said"),
    [
        # a typo in any key
        (("criteria:", "criterea:"), 10, "criterea", "did you mean 'criteria'?"),
        (("criteria:", "objectives:"), 10, "objectives", "did you mean 'criteria'?"),
        (("radius: 0.2", "radius: 30 cm"), 7, "model.differential_drive.radius", "30 cm is 0.3, in m"),
        (("radius: 0.2", "radius: 90deg"), 7, "model.differential_drive.radius", "90deg is 1.5708, in rad"),
        (("polygons:", "polygon:"), 2, "world.polygon", "did you mean 'polygons'?"),
        (("extent:", "extend:"), 3, "world.polygons.extend", "did you mean 'extent'?"),
        (("corners:", "corner:"), 5, "world.polygons.obstacles.0.corner", "did you mean 'corners'?"),
        (("radius:", "raduis:"), 7, "model.differential_drive.raduis", "did you mean 'radius'?"),
        (("step:", "stp:"), 12, "planner.lattice.stp", "did you mean 'step'?"),
        (("step:", "max_points:"), 12, "planner.lattice.max_points", "hpop plan --points 20"),
        (("turns,", "{obstruction: {radios: 1}},"), 10, "criteria.0.obstruction.radios", "did you mean 'radius'?"),
        (("goal:", "str:"), 9, "str", "no such key"),
        # missing keys and entries
        (("goal: [5.0, 1.0, any]\n", ""), 1, "goal", "missing"),
        (("corners: [[2.5, 0], [3.5, 0], [3.5, 2.2], [2.5, 2.2]], ", ""), 5, "world.polygons.obstacles.0.corners",
         "missing"),
        (("[1.0, 1.0, 0]", "[1.0, 1.0]"), 8, "start", "expected [x, y, yaw], numbers in m, m and rad (or a yaw such as "
         "90 deg), got [1.0, 1.0]"),
        (("[1.0, 1.0, 0]", "[1.0, 1.0, 0, 0]"), 8, "start", "got [1.0, 1.0, 0, 0]"),
        (("[5.0, 1.0, any]", "[5.0, 1.0]"), 9, "goal", "(or a yaw such as 90 deg, or any), got [5.0, 1.0]"),
        (("[2.5, 0], ", "[2.5], "), 5, "world.polygons.obstacles.0.corners.0", "a point [x, y] in m, got [2.5]"),
        (("height: [0, 2]", "height: 2"), 5, "world.polygons.obstacles.0.height", "[z_min, z_max] in m, got 2"),
        (("radius: 0.2", "camera_offset: [1]"), 7, "model.differential_drive.camera_offset", "expected 2 entries"),
        (("[turns, length]", "[]"), 10, "criteria", "at least 1 entry, got 0"),
        (("[3.5, 0], [3.5, 2.2], ", ""), 5, "world.polygons.obstacles.0.corners", "at least 3 entries, got 2"),
        (("\n  lattice: {step: 0.5}", " []"), 11, "planner", "at least 1 entry, got 0"),
        # wrong types
        (("0.5}", "5e-1}"), 12, "planner.lattice.step", "write it with a point and a sign"),
        (("radius: 0.2", "radius: no"), 7, "model.differential_drive.radius", "truth values"),
        (("0.5}", "fine}"), 12, "planner.lattice.step", "expected a number, got 'fine'"),
        (("step: 0.5", "headings: 8.5"), 12, "planner.lattice.headings", "expected a whole number, got 8.5"),
        (("step: 0.5", "corner_cutting: 1"), 12, "planner.lattice.corner_cutting", "expected true or false, got 1"),
        (("[turns, length]", "turns"), 10, "criteria", "expected a list, got 'turns'"),
        (("turns,", "3,"), 10, "criteria.0", "expected text or keys with values, got 3"),
        (("turns,", "~,"), 10, "criteria.0", "got nothing"),
        (("turns,", "{},"), 10, "criteria.0", "one name with its parameters, got none"),
        (("turns,", "{turns: {}, rotation: {}},"), 10, "criteria.0", "got turns, rotation"),
        (("{step: 0.5}", "{}\n  roadmap: {}"), 11, "planner", "got lattice, roadmap; several planners"),
        (("turns,", "{turns: 3},"), 10, "criteria.0.turns", "expected keys with values"),
        (("[1.0, 1.0, 0]", "{x: 1}"), 8, "start", "expected [x, y, yaw]"),
        (("[1.0, 1.0, 0]", "[1e3, 1.0, 0]"), 8, "start", "YAML reads 1e3 as text"),
        (("{step: 0.5}", "[step, 0.5]"), 12, "planner.lattice", "expected keys with values"),
        # floats that are no numbers
        (("[1.0, 1.0, 0]", "[.nan, 1.0, 0]"), 8, "start", "got [nan, 1.0, 0]"),
        (("[5.0, 1.0, any]", "[5.0, -.inf, any]"), 9, "goal", "got [5.0, -inf, 'any']"),
        (("0.5}", ".inf}"), 12, "planner.lattice.step", "expected a finite number, got inf"),
        (("step: 0.5", "time_limit: .inf"), 12, "planner.lattice.time_limit", "seconds, got inf; leave it out for no"),
        (("step: 0.5", 'max_memory: "9 MB"'), 12, "planner.lattice.max_memory", "whole number of bytes, got '9 MB'"),
        (("radius: 0.2", "radius: .nan"), 7, "model.differential_drive.radius", "expected a finite number, got nan"),
        (("differential_drive: {radius: 0.2, camera_height: 1.2}", "pan_tilt: {pan: 3}"), 7, "model.pan_tilt.pan",
         "expected a list of 2 numbers or 'all round', got 3"),
        # yaws
        (("[1.0, 1.0, 0]", "[1.0, 1.0, any]"), 8, "start.2", "the yaw at the start must be in rad"),
        (("any]", "north]"), 9, "goal.2", "or 'any'; got 'north'"),
        (("any]", "no]"), 9, "goal", "got [5.0, 1.0, False] (YAML reads no"),
    ],
)  # fmt: skip
def test_a_fault_is_said_with_line_key_and_what_to_do(
    tmp_path: Path, change: tuple[str, str], line: int, key: str, said: str
) -> None:
    said_first, *others = [text for text in faults(scenario(tmp_path, change)) if f", {key}: " in text]
    assert said_first.startswith(f"line {line}, {key}: ")
    assert said in said_first
    assert not others


@pytest.mark.parametrize(
    ("change", "kind", "line", "said"),
    [
        (("turns,", "turnz,"), UnknownName, 10, "Did you mean 'turns'?"),
        (("lattice:", "latice:"), UnknownName, 12, "Did you mean 'lattice'?"),
        (("differential_drive:", "diferential_drive:"), UnknownName, 7, "Did you mean 'differential_drive'?"),
        (("0.5}", "0}"), OptionError, 12, "step"),
        (("step: 0.5", "headings: 7"), OptionError, 12, "one of 4, 8, 16"),
        (("step: 0.5", "max_detour: {length: 1.3}"), OptionError, 12, "Give max_turns, such as"),
        (("step: 0.5", "max_detour: {width: 1.3}, max_turns: 6"), OptionError, 12, "or {'length': the same"),
        (("step: 0.5", "time_limit: -1"), OptionError, 12, "time_limit must be a positive number"),
        (("radius: 0.2", "radius: -0.2"), ModelError, 7, "radius"),
        (("radius: 0.2", "radius: 200"), ModelError, 7, "a positive length in m from 1e-06 to 20, got 200"),
        (("[1.0, 1.0, 0]", "[1.0, 1.0, 90]"), QueryError, 8, "start.2: a yaw must be in radians"),
        (("[1.0, 1.0, 0]", "[1.0, 1.0, 90]"), QueryError, 8, "or '90 deg' in a scenario"),
        (("any]", "750 deg]"), QueryError, 9, "goal.2: a yaw must be in radians, within two turns of 0, got 13.09"),
        (("turns,", "{obstruction: {radius: -1}},"), CriterionError, 10, "radius"),
        (("turns,", "length,"), CriterionError, 10, "length more than once"),
        (("turns,", "obstruction, {exposure: {radius: 1}},"), CriterionError, 10, "both equal parameters"),
        (("[0, 2]}", "[2, 0]}"), MapError, 2, "z_min < z_max"),
        (("[3.5, 0], [3.5, 2.2]", "[3.5, 2.2], [3.5, 0]"), MapError, 2, "not valid"),
        (("  polygons:", "  geojson: {path: gone.json}\n  polygons:"), ScenarioError, 1, "geojson and polygons"),
        (("    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]\n", "    keep_out: [[[0, 0], [1, 1], [1, 0], [0, 1]]]\n"),
         MapError, 2, "keep_out"),
    ],
)  # fmt: skip
def test_what_the_parts_refuse_keeps_its_kind_and_gets_a_line(
    tmp_path: Path, change: tuple[str, str], kind: type[HpopError], line: int, said: str
) -> None:
    (message,) = faults(scenario(tmp_path, change), kind)
    assert message.startswith(f"line {line}, ")
    assert said in message


@pytest.mark.parametrize(
    "world", ["polygons: {}", "ros_map: {path: gone.yaml}", "movingai: {path: .}", "geojson: {path: ''}"]
)
def test_a_world_that_cannot_be_read_is_a_map_error_with_its_line(tmp_path: Path, world: str) -> None:
    text = f"world:\n  {world}\nstart: [0, 0, 0]\ngoal: [1, 1, 0]\ncriteria: [length]\n"
    (message,) = faults(scenario(tmp_path, text=text), MapError)
    assert message.startswith(f"line 2, world.{world.split(':')[0]}: ")


def test_no_world_at_all_lists_the_ways_to_give_one(tmp_path: Path) -> None:
    text = "world: {}\nstart: [0, 0, 0]\ngoal: [1, 1, 0]\ncriteria: [length]\n"
    (message,) = faults(scenario(tmp_path, text=text))
    every = (
        "ros_map, ros_bag, movingai, geojson, image, dxf, pdf, polygons, moveit_scene, point_cloud, solids, commonroad"
    )
    assert f"{every}; got none" in message


@pytest.mark.parametrize(
    ("world", "place", "instead"),
    [
        ("map.yaml", "world", "{ros_map: {path: 'map.yaml'}}"),
        ("hall.geojson", "world", "{geojson: {path: 'hall.geojson'}}"),
        ("{ros_map: map.yaml}", "world.ros_map", "{path: 'map.yaml'}"),
    ],
)
def test_a_map_that_is_named_too_shortly_is_told_as_it_is_written(
    tmp_path: Path, world: str, place: str, instead: str
) -> None:
    text = f"world: {world}\nstart: [0, 0, 0]\ngoal: [1, 1, 0]\ncriteria: [length]\n"
    lines = faults(scenario(tmp_path, text=text))
    assert lines[-1].startswith(f"line 1, {place}: ")
    assert lines[-1].endswith(instead)


@pytest.mark.parametrize(
    ("name", "content", "reader"),
    [
        ("map.yaml", "image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", "ros_map"),
        ("hall.geojson", '{"type": "FeatureCollection", "features": []}', "geojson"),
        ("scene.yaml", "name: shelf\nworld: {collision_objects: []}\n", "moveit_scene"),
    ],
)
def test_a_map_in_place_of_a_scenario_is_told_as_what_it_is(
    tmp_path: Path, name: str, content: str, reader: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(ScenarioError, match="this is a map, not a scenario") as error:
        load_scenario(tmp_path / name)
    assert f"world: {{{reader}: {{path: {name}}}}}" in str(error.value)


def test_all_faults_are_said_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    path = scenario(
        tmp_path,
        ("radius: 0.2", "radius: no"),
        ("[1.0, 1.0, 0]", "[1.0, 1.0, north]"),
        ("[turns, length]", "[turnz, length]"),
        ("0.5}", "0}"),
        ("planner:", "plan: 1\nplanner:"),
    )
    lines = faults(path)
    assert [line.split(":")[0] for line in lines] == [
        "line 7, model.differential_drive.radius",
        "line 8, start.2",
        "line 10, criteria.0",
        "line 11, plan",
        "line 13, planner.lattice",
    ]


@pytest.mark.parametrize(
    ("planners", "place"),
    [
        ("\n  smoothing: {step: 0.5}", "line 12, planner.smoothing: "),
        (" smoothing", "line 11, planner.smoothing: "),
        ("\n  - lattice: {step: 0.5}\n  - smoothing: {}", "line 13, planner.1.smoothing: "),
    ],
)
def test_a_planner_that_the_model_cannot_serve_is_placed_in_the_file(tmp_path: Path, planners: str, place: str) -> None:
    changes = [
        ("differential_drive: {radius: 0.2, camera_height: 1.2}", "pan_tilt: {}"),
        ("[1.0, 1.0, 0]", "[1.0, 1.0, 0, 0, 0]"),
        ("[5.0, 1.0, any]", "[5.0, 1.0, any, any, any]"),
        ("\n  lattice: {step: 0.5}", planners),
    ]
    with pytest.raises(UnsupportedModel) as refused:
        load_scenario(scenario(tmp_path, *changes))
    assert f"{place}smoothing needs a model with rigid" in str(refused.value)
    assert "Planners that can use this model: exact, lattice" in str(refused.value)


def test_two_unknown_names_are_one_error_of_that_kind(tmp_path: Path) -> None:
    assert len(faults(scenario(tmp_path, ("[turns, length]", "[turnz, lenght]")), UnknownName)) == 2


def test_parameters_of_a_plugin_may_have_any_type_and_default_factories(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria))

    @criterion("lamplight", group="P", unit="1", aggregate="sum")
    @dataclass(frozen=True)
    class Lamplight:
        model_of_light: str = "lamp"
        lamps: list[float] = field(default_factory=list)
        table: np.ndarray | None = None

        def cost(self, m: Motions) -> np.ndarray:
            return np.zeros(len(m))

    built = load_scenario(scenario(tmp_path, ("turns,", "{lamplight: {lamps: [1, 2.5]}},")))
    assert built.problem.criteria[0] == Lamplight(lamps=[1.0, 2.5])
    (message,) = faults(scenario(tmp_path, ("turns,", "{lamplight: {lamps: [1, x]}},")))
    assert message.startswith("line 10, criteria.0.lamplight.lamps.1: expected a number, got 'x'")


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (("turns,", "{turns: 3},"), "line 10, criteria.0.turns"),
        (("{step: 0.5}", "[step, 0.5]"), "line 12, planner.lattice"),
        (("  lattice: {step: 0.5}", "  - lattice: 3\n  - 4"), "line 12, planner.0.lattice"),
        (
            ("differential_drive: {radius: 0.2, camera_height: 1.2}", "pan_tilt: {pan: [.nan, 1]}"),
            "line 7, model.pan_tilt.pan.0",
        ),
    ],
)
def test_a_fault_inside_a_choice_is_not_said_again_for_each_other_branch(
    tmp_path: Path, change: tuple[str, str], place: str
) -> None:
    lines = faults(scenario(tmp_path, change))
    assert lines[0].split(":")[0] == place
    assert [line.split(":")[0] for line in lines[1:]] == (["line 13, planner.1"] if "- 4" in change[1] else [])


def test_a_scenario_names_whose_choice_is_marked(tmp_path):
    costs = Costs.of([[0.0, 9.0], [5.0, 4.0]], names=["turns", "length"], units=["1", "m"], quanta=[1, 1])
    Preference.fit(costs, [(0, 1)] * 3).save(tmp_path / "p07.json")
    path = scenario(tmp_path, text=f"{ROOM}choose: {{preference: p07.json}}\n")
    loaded = load_scenario(path)
    assert loaded.preference.weights["turns"] > 0.5
    front = loaded.problem.solve(loaded.planners[0])
    assert front.named(loaded.preference)["for you"].costs == front.select(preference=loaded.preference).costs


def test_a_preference_that_weighs_what_the_scenario_does_not_ask_for_is_told(tmp_path):
    costs = Costs.of([[0.0, 9.0], [5.0, 4.0]], names=["turns", "lenght"], quanta=[1, 1])
    Preference.fit(costs).save(tmp_path / "p.json")
    path = scenario(tmp_path, text=f"{ROOM}choose: {{preference: p.json}}\n")
    (said,) = faults(path, StudyError)
    assert "weighs 'lenght', which is no criterion here. Did you mean 'length'?" in said
    (tmp_path / "p.json").write_text("{}")
    assert "expected a preference" in faults(path, StudyError)[0]
    (tmp_path / "p.json").unlink()
    assert (
        "cannot read p.json: No such file or directory; give the file that `hpop prefer` wrote"
        in faults(path, StudyError)[0]
    )
