"""Worlds of solids in scenario files: what they say, and faults with their lines."""

from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import HpopError, MapError, ScenarioError
from hpop.scenario import load_scenario
from hpop.world import Box, Cylinder, Hull, Sphere

SCENARIO = """
world:
  solids:
    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]
    obstacles:
      - {box: [1.0, 1.5, 0.75], position: [2.5, 0.75, 0.375], name: table}
      - {cylinder: {radius: 0.2, length: 1.0}, position: [1, 3, 0.2], rpy: [90 deg, 0, 0]}
      - {sphere: 0.25, position: [4, 3, 1]}
      - {hull: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], quaternion: [0, 0, 0.7071068, 0.7071068]}
start: [0.5, 0.5, 0]
goal: [5.5, 0.5, any]
criteria: [turns, length]
"""


def loaded(folder: Path, text: str = SCENARIO) -> hpop.World:
    path = folder / "plan.yaml"
    path.write_text(text)
    return load_scenario(path).problem.world


def test_solids_are_written_out_with_their_places(tmp_path):
    world = loaded(tmp_path)
    table, can, ball, wedge = world.bodies
    assert (table.name, table.shape) == ("table", Box((1.0, 1.5, 0.75)))
    np.testing.assert_allclose(table.bounds, [(2, 0, 0), (3, 1.5, 0.75)])
    assert can.shape == Cylinder(radius=0.2, length=1.0)
    np.testing.assert_allclose(can.bounds, [(0.8, 2.5, 0.0), (1.2, 3.5, 0.4)], atol=1e-12)
    assert ball.shape == Sphere(0.25)
    assert isinstance(wedge.shape, Hull)
    np.testing.assert_allclose(wedge.bounds, [(-1, 0, 0), (0, 1, 1)], atol=1e-6)
    assert world.extent.equals(shapely.box(0, 0, 6, 4))
    assert "no upright prisms, 3 of 4 (solid 1, solid 2, solid 3)" in world.notes[0]


def test_without_an_extent_there_is_room_round_the_solids(tmp_path):
    world = loaded(tmp_path, SCENARIO.replace("    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]\n", ""))
    assert world.bounds == pytest.approx((-2, -1, 5.25, 4.5))


@pytest.mark.parametrize(
    ("old", "new", "kind", "message"),
    [
        ("box: [1.0, 1.5, 0.75]", "bax: [1, 1, 1]", ScenarioError, r"line 6, .*: no such key; did you mean 'box'\?"),
        ("box: [1.0, 1.5, 0.75], ", "", ScenarioError, "line 6, .*give exactly one of box, cylinder, .*got none"),
        ("sphere: 0.25", "sphere: 0.25, box: [1, 1, 1]", ScenarioError, "line 8, .*exactly one of.*got box and sphere"),
        ("[1.0, 1.5, 0.75]", "[1.0, 1.5]", ScenarioError, r"line 6, .*expected a size \[x, y, z\] in m"),
        ("[1.0, 1.5, 0.75]", "[1.0, 1.5, -2]", MapError, "line 6, .*a box's size must be a length in m"),
        ("sphere: 0.25", "sphere: 0", ScenarioError, "line 8, .*sphere: "),
        ("radius: 0.2, ", "", ScenarioError, "line 7, .*radius: this key is missing"),
        ("[90 deg, 0, 0]", "[ninety, 0, 0]", ScenarioError, "line 7, .*rpy.*'90 deg'; got 'ninety'"),
        ("[90 deg, 0, 0]", "[90, 0, 0]", MapError, "line 7, .*math.radians"),
        ("[90 deg, 0, 0]", "[0, 0]", ScenarioError, r"line 7, .*\[roll, pitch, yaw\]"),
        ("rpy: [90 deg", "quaternion: [0, 0, 0, 1], rpy: [90 deg", ScenarioError, "line 7, .*not both"),
        ("[0, 0, 1]], q", "[1, 1, 0]], q", MapError, "line 9, .*no volume"),
        ("[0, 0, 1]], q", "[1, 1]], q", ScenarioError, r"line 9, .*a point \[x, y, z\] in m"),
        ("solids:\n", "solid:\n", ScenarioError, r"did you mean 'solids'\?"),
    ],
)
def test_faults_name_the_line_and_what_was_expected(tmp_path, old, new, kind, message):
    assert old in SCENARIO
    with pytest.raises(HpopError, match=message) as found:
        loaded(tmp_path, SCENARIO.replace(old, new))
    assert type(found.value) is kind


def test_a_missing_scene_is_an_error_of_the_map_with_its_line(tmp_path):
    text = "world:\n  moveit_scene: {path: gone.yaml}\n" + SCENARIO[SCENARIO.index("start") :]
    with pytest.raises(MapError, match=r"line 2, .*gone\.yaml' cannot be opened") as raised:
        loaded(tmp_path, text)
    assert str(raised.value).endswith(f" Paths are relative to the scenario's folder, {tmp_path}.")
