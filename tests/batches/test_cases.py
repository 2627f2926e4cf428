"""Specifications of batches: every combination once, by dotted keys, patterns and tables; wrong ones are refused."""

import pytest

from hpop.batches.cases import OfProblems, Specification, planner_label
from hpop.errors import HpopError, OptionError, ScenarioError, UnknownName

ROOM = """\
world: {polygons: {extent: [[0, 0], [8, 0], [8, 6], [0, 6]], obstacles: [{corners: [[3, 0], [4, 0], [4, 3], [3, 3]]}]}}
model: {differential_drive: {radius: 0.3}}
start: [1, 1, 0]
goal: [7, 1, any]
criteria: [turns, length]
planner: {lattice: {step: 1.0}}
"""
GEOJSON = '{"type": "Polygon", "coordinates": [[[3, 0], [4, 0], [4, 3], [3, 3], [3, 0]]]}'


@pytest.fixture
def written(tmp_path):
    def write(more, text=ROOM):
        path = tmp_path / "batch.yaml"
        path.write_text(text + more)
        return path

    return write


def test_every_combination_is_a_case_and_the_last_key_varies_fastest(written):
    text = "vary: {goal: [[7, 1, any], [7, 5, any]], planner.lattice.step: [1.0, 0.5], criteria.0: [turns, rotation]}\n"
    cases = Specification.load(written(text))
    assert len(cases) == 8
    listed = list(cases)
    assert [case.number for case in listed] == list(range(8))
    assert [case.values["criteria.0"] for case in listed] == ["turns", "rotation"] * 4
    assert len({case.id for case in listed}) == 8
    assert len({case.problem for case in listed}) == 4  # steps compare planners on one problem
    assert len({case.world for case in listed}) == 2  # criteria
    problem, (planner,) = cases.build(listed[5])
    assert (problem.goal, problem.criteria[0].name, planner.step) == ((7.0, 5.0, None), "rotation", 1.0)


def test_cases_are_known_again_whatever_else_varies(written):
    before = {case.id for case in Specification.load(written("vary: {goal: [[7, 1, any]]}\n"))}
    after = {case.id for case in Specification.load(written("vary: {goal: [[7, 5, any], [7, 1, any]]}\n"))}
    assert before < after


def test_a_pattern_of_files_varies_over_those_that_match(written, tmp_path):
    (tmp_path / "maps").mkdir()
    for name in ("b.geojson", "a.geojson"):
        (tmp_path / "maps" / name).write_text(GEOJSON)
    text = ROOM.replace(ROOM.splitlines()[0], "world: {geojson: {path: maps/a.geojson}}")
    start = text.replace("start: [1, 1, 0]", "start: [3.5, 4, 0]").replace("goal: [7, 1, any]", "goal: [3.5, 5, any]")
    cases = list(Specification.load(written("vary: {world.geojson.path: 'maps/*.geojson'}\n", start)))
    assert [case.values["world.geojson.path"] for case in cases] == ["maps/a.geojson", "maps/b.geojson"]


def test_a_row_of_a_table_varies_several_keys_and_an_empty_cell_none(written, tmp_path):
    (tmp_path / "pairs.csv").write_text("start.x, start.y, start.yaw, planner.lattice.step\n1,5,90 deg,0.5\n7,5,0,\n")
    cases = Specification.load(written("table: pairs.csv\n"))
    (one, (planner,)), (other, (default,)) = map(cases.build, cases)
    assert one.start == pytest.approx((1.0, 5.0, 1.5707963))
    assert (planner.step, default.step, other.start) == (0.5, 1.0, (7.0, 5.0, 0.0))


@pytest.mark.parametrize(
    ("more", "kind", "says"),
    [
        ("", ScenarioError, "expected keys with lists of values"),
        ("vary: {goal: 3}\n", ScenarioError, "expected a list of values, or a pattern of files"),
        ("vary: {goal: []}\n", ScenarioError, "expected a list of values"),
        ("vary: {world.geojson.path: 'none/*.geojson'}\n", ScenarioError, "matches 'none/"),
        ("vary: {planner: [latice]}\n", UnknownName, r"line 7, planner: .* Did you mean 'lattice'"),
        ("vary: {planner.roadmap.samples: [5]}\n", HpopError, "planner"),
        ("vary: {criteria.7: [turns]}\n", ScenarioError, "the scenario has no '7' to vary"),
        ("vary: {model.differential_drive.radius: [-1]}\n", HpopError, "radius"),
        ("vary: {model.differential_drive.radius.x: [1]}\n", ScenarioError, "varies a part of 'radius'"),
        ("table: pairs.txt\n", ScenarioError, "expected a .csv or .parquet file"),
        ("table: pairs.csv\n", ScenarioError, "cannot read pairs.csv"),
    ],
)
def test_what_cannot_vary_is_told_before_anything_is_planned(written, more, kind, says):
    with pytest.raises(kind, match=says):
        Specification.load(written(more))


@pytest.mark.parametrize("text", ["start.x,start.x\n1,2\n", "start.x,\n1,2\n", "start.x\n1,2\n", "start.x\n", ""])
def test_a_table_that_is_none_is_told(written, tmp_path, text):
    (tmp_path / "pairs.csv").write_text(text)
    with pytest.raises(ScenarioError, match=r"pairs\.csv"):
        Specification.load(written("table: pairs.csv\n"))


def test_a_goal_that_cannot_be_reached_is_for_the_row_of_its_case(written):
    assert len(Specification.load(written("vary: {goal: [[3.5, 1, any], [7, 1, any]]}\n"))) == 2


def test_labels_are_short():
    assert planner_label({"lattice": {"step": 0.5, "eps": 0.1}}) == "lattice(step=0.5, eps=0.1)"
    with pytest.raises(OptionError, match="one or more"):
        OfProblems.of([], "lattice")
    with pytest.raises(OptionError, match=r"hpop\.Problem"):
        OfProblems.of([3], "lattice")
