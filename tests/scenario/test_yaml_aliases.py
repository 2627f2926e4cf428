"""Aliases of aliases double what a file holds with every line: refused in maps, bounded in scenarios."""

import time

import pytest

from hpop import World
from hpop.errors import MapError, ScenarioError
from hpop.scenario import load_scenario
from hpop.scenario.yaml_lines import MAX_EXPANDED, Document

MAP = "image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
SCENARIO = """
world: {polygons: {obstacles: [{corners: &square [[1, 1], [2, 1], [2, 2]]}], extent: [[0, 0], [9, 0], [9, 9], [0, 9]]}}
start: [0.5, 0.5, 0]
goal: [8, 8, any]
criteria: [length]
zones:
  - {kind: keep-out, area: *square}
"""


def laughs(levels, width=8):
    """Return a list of lists of ... of one text: width to the power of levels values."""
    lines = ["a0: &a0 [lol]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * width)}]" for i in range(1, levels)]
    return "\n".join(lines) + "\n"


def written(path, text):
    path.write_text(text)
    return path


def test_a_map_of_aliases_is_refused_at_once(tmp_path):
    text = MAP + laughs(9) + "mode: *a8\n"
    assert len(text) < 600
    began = time.process_time()
    with pytest.raises(MapError, match=r"map\.yaml, line 7: anchors and aliases are not read"):
        World.from_ros_map(written(tmp_path / "map.yaml", text))
    assert time.process_time() - began < 5


@pytest.mark.parametrize("levels", [6, 9, 18, 100])
def test_a_scenario_whose_aliases_make_too_many_values_is_refused_with_the_line(tmp_path, levels):
    began = time.process_time()
    with pytest.raises(ScenarioError, match=r"line \d+: (with its aliases .* 10,000 values|values are nested)"):
        load_scenario(written(tmp_path / "scenario.yaml", laughs(levels) + SCENARIO))
    assert time.process_time() - began < 5


def test_a_chain_of_aliases_is_as_deep_as_what_it_stands_for(tmp_path):
    with pytest.raises(ScenarioError, match="line 20: values are nested more than 20 deep"):
        Document(written(tmp_path / "deep.yaml", laughs(30, width=1)))


def test_an_alias_stands_for_a_copy_of_what_its_anchor_names(tmp_path):
    problem = load_scenario(written(tmp_path / "scenario.yaml", SCENARIO)).problem
    (zone,) = problem.world.content.zones
    assert zone.area.equals(problem.world.obstacles[0].polygon)


def test_a_fault_in_an_alias_is_told_with_the_line_where_it_is_written(tmp_path):
    text = SCENARIO.replace("[2, 2]]}", "[2, x]]}")
    with pytest.raises(ScenarioError, match=r"line 2, zones\.0\.area\.2: expected a point"):
        load_scenario(written(tmp_path / "scenario.yaml", text))


def test_the_bound_is_on_files_with_aliases(tmp_path):
    numbers = ", ".join(["1"] * MAX_EXPANDED)
    assert len(Document(written(tmp_path / "long.yaml", f"a: [{numbers}]\n")).values["a"]) == MAX_EXPANDED
    with pytest.raises(ScenarioError, match="line 2: with its aliases written out"):
        Document(written(tmp_path / "long.yaml", f"a: [&one {numbers}]\nb: *one\n"))
