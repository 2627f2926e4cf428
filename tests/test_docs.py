"""Examples in the documentation run as they are printed."""

from __future__ import annotations

import importlib
import re
import shlex
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import hpop
from hpop.cli import main
from hpop.motions import States
from hpop.scenario import load_scenario
from hpop.testing import check_model, check_planner
from hpop.testing.worlds import latency
from hpop.view import save_pictures
from tests.own_criteria import NEEDED

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.usefixtures("registered_as_before")


def blocks(file: str, language: str = "python") -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / file).read_text(), re.DOTALL)


@pytest.mark.parametrize("map_alone", [True, pytest.param(False, marks=pytest.mark.proof)])
def test_the_first_plan_in_the_docs_plans_and_draws(tmp_path, monkeypatch, map_alone):
    monkeypatch.setattr("hpop.view.save_pictures", partial(save_pictures, dpi=40, map_alone=map_alone))
    monkeypatch.chdir(tmp_path)
    first = blocks("docs/first_plan.md")[0].replace(
        "step=0.25, progress", f"step={0.5 if map_alone else 0.25}, progress"
    )
    exec(compile(first, "docs/first_plan.md", "exec"), {})
    written = {path.name for path in (tmp_path / "out/museum").iterdir()}
    others = set() if map_alone else {"front.png", "trace.png", "where.png"}
    assert {"front.json", "front.html", "map.png", *others} <= written
    assert {path.name for path in tmp_path.iterdir()} == {"out"}  # which git ignores in a clone


def test_the_python_in_the_readme_writes_the_motion_of_a_camera(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(blocks("README.md")[0], "README.md", "exec"), names)
    assert names["chosen"].costs["turns"] <= 5
    assert (tmp_path / "camera.csv").read_text().startswith("t (s),x (m),")


def test_the_scenario_in_the_docs_is_the_one_of_the_demo():

    shown = yaml.safe_load(blocks("docs/command_line.md", "yaml")[0])
    assert shown == yaml.safe_load((ROOT / "examples/museum.yaml").read_text())


def test_the_holds_in_the_docs_are_what_is_said_beside_them():
    (block,) = (block for block in blocks("docs/motions.md") if "with_hold" in block)
    names: dict[str, Any] = {}
    exec(compile(block, "docs/motions.md", "exec"), names)
    assert names["held"].kinds == ("move", "hold", "turn", "move", "turn")
    assert names["held"].states.clock.tolist() == [0, 0, 2.5, 2.5, 2.5, 2.5]


@pytest.mark.parametrize(
    ("page", "name"),
    [("criteria", "Glare"), ("criteria", "DoorDistance"), ("criteria_rules", "Boredom"), ("criteria_rules", "Effort")],
)
def test_a_criterion_in_the_docs_passes_its_conformance_checks(page, name, tmp_path, monkeypatch):
    from hpop.testing import check_criterion

    (block,) = (block for block in blocks(f"docs/{page}.md") if f"class {name}:" in block)
    module = tmp_path / f"docs_{name.lower()}.py"  # pickling needs an importable module
    module.write_text(re.sub(r'criterion\("', r'criterion("docs_', block))
    monkeypatch.syspath_prepend(tmp_path)
    check_criterion(getattr(importlib.import_module(module.stem), name)())


def test_the_quanta_in_the_docs_are_fine_enough_for_the_problem_of_the_readme():

    (shown,) = (block for block in blocks("docs/criteria_rules.md", "yaml") if "quanta:" in block)
    scenario = load_scenario(ROOT / "examples/museum.yaml")
    problem = replace(scenario.problem, **yaml.safe_load(shown))
    front = problem.solve(scenario.planners)
    assert "quanta as set" in front.certificate
    assert not [note for note in front.notes if "coarse" in note]


def test_what_the_page_of_fronts_does_with_one_runs(tmp_path, monkeypatch):
    import json

    monkeypatch.chdir(tmp_path)
    problem = load_scenario(ROOT / "examples/museum.yaml").problem
    front = problem.solve("lattice", step=1.0)[::4]
    front.save("front.json")
    names = {"problem": problem, "front": front, "json": json, "Path": Path}
    for page in ("docs/front.md", "docs/front_reference.md"):
        for block in blocks(page):
            exec(compile(block, page, "exec"), names)
    assert 0 < len(names["few"]) < len(front)
    assert names["table"].units["vx"] == "m/s"
    assert (tmp_path / "camera.csv").read_text().startswith("t (s),x (m),")
    assert len(names["path"]) > 10


def test_the_question_in_the_docs_is_answered():

    problem = load_scenario(ROOT / "examples/museum.yaml").problem
    names: dict = {"problem": problem, "front": problem.solve("lattice", step=1.0)[:4]}
    (block,) = blocks("docs/questions.md")
    exec(compile(block, "docs/questions.md", "exec"), names)
    assert names["more"].reported_names == ("obstruction", "sickness", "msdv", "rotation")


def test_no_page_has_the_name_of_a_page_that_sphinx_writes_itself():
    """Sphinx's page of search results had replaced a page called search.md on the site."""
    assert not {"search", "genindex", "py-modindex"} & {path.stem for path in (ROOT / "docs").glob("*.md")}


def test_the_search_in_the_docs_finds_what_it_says():
    names: dict = {}
    exec(compile(blocks("docs/graph_search.md")[0], "docs/graph_search.md", "exec"), names)
    assert names["paths"].costs.tolist() == [[2, 8], [6, 2]]
    assert names["paths"].nodes(0).tolist() == [0, 1, 3]


def test_what_the_page_for_optimisers_does_gives_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks("docs/optimisers.md"):
        exec(compile(block, "docs/optimisers.md", "exec"), names)
    paths, frontier, table = names["paths"], names["frontier"], names["Y"]
    assert paths.values == pytest.approx(np.array([[18.25, 0.1, 1], [31.75, 0.03, 3], [40, 0.015, 2]]))
    assert paths.path(0) == ["hall", "stairs", "office"]
    assert paths.edges(0) == [("hall", "stairs", "steps"), ("stairs", "office", 0)]
    assert (tmp_path / "paths.json").exists()
    assert frontier.knee(table) == 1
    assert frontier.default_reference(table).tolist() == [9.8, 9.8]
    assert names["front"].names == ("cost", "-gain")


def test_the_planner_in_the_docs_plans(tmp_path, monkeypatch):
    import shapely

    import hpop

    (block,) = (block for block in blocks("docs/own_planner.md") if "class Straight:" in block)
    (tmp_path / "docs_straight.py").write_text(block.replace('planner("straight")', 'planner("docs_straight")'))
    monkeypatch.syspath_prepend(tmp_path)
    straight = importlib.import_module("docs_straight").Straight
    world = hpop.World.from_polygons([shapely.box(4, 2, 6, 5)], extent=shapely.box(0, 0, 10, 7))
    criteria = ["obstruction", "turns", "length", "clearance", "msdv"]
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 3.5, 0), (9, 3.5, None), criteria)
    assert len(problem.solve(planner=straight())) == 0  # the block is in the way
    round_it = problem.solve(planner=straight(via=((5, 6, None),)))
    assert "NOT VALID" not in round_it.certificate
    assert round_it.runs[0]["planner"] == "docs_straight"
    assert round_it.best("length").costs["turns"] == 2
    with pytest.raises(hpop.errors.OptionError, match="via"):
        straight(via=(1,))
    check_planner(straight(), models=[hpop.DifferentialDrive(), hpop.PanTilt()])


@pytest.mark.parametrize(
    ("page", "name", "options", "provides"),
    [
        ("own_robot", "Slider", {"speed": 0.7}, {"rigid"}),
        ("own_robot_reference", "Cart", {}, {"turn-move", "joints"}),
    ],
)
def test_a_robot_in_the_docs_is_one(page, name, options, provides, tmp_path, monkeypatch):
    (block,) = (block for block in blocks(f"docs/{page}.md") if f"class {name}" in block)
    module = f"docs_{name.lower()}"
    (tmp_path / f"{module}.py").write_text(block.replace(f'model("{name.lower()}")', f'model("{module}")'))
    monkeypatch.syspath_prepend(tmp_path)
    robot = getattr(importlib.import_module(module), name)
    check_model(robot(**options))
    assert robot().provides == {"base", "camera", "plane", *provides}


def test_a_planner_in_the_docs_is_one_of_those_that_there_are():
    from hpop.base.registry import planners

    headings = re.findall(r"^## ([a-z][a-z-]*)$", (ROOT / "docs/planners_reference.md").read_text(), re.MULTILINE)
    at_home = {name for name, cls in planners.items() if cls.__module__.startswith("hpop.planners.")}
    assert set(headings) == at_home
    guide = (ROOT / "docs/planners.md").read_text()
    assert all(f"`{name}`" in guide for name in at_home)


def test_the_scenario_of_several_planners_is_the_one_in_the_docs():

    path = ROOT / "examples/museum_planners.yaml"
    (shown,) = (yaml.safe_load(block) for block in blocks("docs/planners.md", "yaml"))
    assert shown["planner"] == yaml.safe_load(path.read_text())["planner"]
    assert [planner.name for planner in load_scenario(path).planners] == [
        name for part in shown["planner"] for name in part
    ]


def test_the_curve_in_the_docs_is_what_it_says():
    (block,) = (block for block in blocks("docs/motions.md") if "driven(" in block)
    names: dict = {}
    exec(compile(block, "docs/motions.md", "exec"), names)
    curve = names["curve"]
    assert curve.kinds == ("drive",) * 5
    assert curve.states.names == ("x", "y", "yaw", "speed", "turn_rate", "clock")
    assert sum((abs(column) > 0.1).sum() for column in curve.turns) == 2


@pytest.mark.proof
def test_an_arm_is_planned_for_as_its_page_says(tmp_path, monkeypatch):
    """From the URDF to a front that is verified, block after block; pictures take seconds."""
    from hpop.problems.verify import verify

    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hpop.view.save_pictures", lambda problem, front, folder: Path(folder).mkdir(parents=True))
    names: dict = {}
    for block in blocks("docs/arm.md"):
        exec(compile(block, "docs/arm.md", "exec"), names)
    problem, front, smooth, path = (names[name] for name in ("problem", "front", "smooth", "path"))
    why = names["arm"].collision(names["world"]).why_blocked(names["bent"])
    assert why.startswith("the link 'hand' touches the obstacle 'can', or")
    for words in ("free states of the goal", "guides", "edges were checked in"):
        assert words in front.certificate
    assert smooth.best("duration").costs["duration"] < path.costs["duration"]
    assert {kind for trajectory in smooth.trajectories for kind in trajectory.kinds} == {"spline"}
    assert verify(problem, front) == verify(problem, smooth) == []


@pytest.mark.proof
def test_the_five_minutes_from_moveit_run_as_they_are_printed(tmp_path, monkeypatch):
    """Every command of the section; the joint trajectory is read back, and ends along the line that was asked for."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    section = (ROOT / "docs/arm.md").read_text().partition("## From MoveIt")[2].partition("\n## ")[0]
    (scenario,) = re.findall(r"```yaml\n(.*?)```", section, re.DOTALL)
    Path("pick.yaml").write_text(scenario)
    lines = re.findall(r"^    (hpop .*)$", section, re.MULTILINE)
    assert [line.split()[1] for line in lines] == ["plan", "pick", "export"]
    for line in lines:
        done = CliRunner().invoke(main, shlex.split(line)[1:])
        assert done.exit_code == 0, done.output
    arm = load_scenario(Path("pick.yaml")).problem.model
    (file,) = Path("out/pick/export").glob("*.joint_trajectory.yaml")
    message = yaml.safe_load(file.read_text())
    assert message["joint_names"] == list(arm.joints)
    rows = np.array([point["positions"] for point in message["points"]])
    times = [
        point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in message["points"]
    ]
    assert (np.diff(times) > 0).all()
    assert not np.any(message["points"][-1]["velocities"])
    tool = arm.pose("tool", States(**dict(zip(arm.joints, rows.T, strict=True))))
    begin = int(np.flatnonzero(tool.z >= tool.z[-1] + 0.0999)[-1])
    assert np.hypot(tool.x - tool.x[-1], tool.y - tool.y[-1])[begin:].max() <= 0.002
    assert np.hypot(tool.x - tool.x[-1], tool.y - tool.y[-1])[:begin].max() > 0.01
    moveit = yaml.safe_load(next(Path("out/pick/export").glob("*.moveit.yaml")).read_text())
    assert moveit["trajectory"]["joint_trajectory"]["points"] == message["points"]


def test_the_page_of_arms_says_of_each_criterion_whether_it_is_for_them():
    """Rows: improved by splines; without symbols; with memory; refused."""
    from hpop.base.registry import criteria
    from hpop.criteria.base import make_criterion
    from hpop.errors import CriterionError
    from hpop.planners.programs.spline.knots import PieceCosts
    from hpop.world.content.content import Landmark

    shelf = load_scenario(ROOT / "examples/arm_shelf.yaml").problem
    world = shelf.world.with_content(landmarks=[Landmark(0.7, 0.25, z=0.43)]).with_fields([latency()])
    table = (ROOT / "docs/arm_reference.md").read_text().partition("## Criteria")[2].partition("\n\nMeans")[0]
    rows = [re.findall(r"`(\w+)`", line.split("|")[2]) for line in table.splitlines() if "`" in line]
    at_home = {name for name, cls in criteria.items() if cls.__module__.startswith("hpop.criteria.")}
    assert sorted(name for row in rows for name in row) == sorted(at_home)
    given = NEEDED | {"target": (0.7, 0.25, 0.43)}
    improved, rough, remembering, refused = (
        [
            make_criterion({name: {key: value for key, value in given.items() if key in _options(criteria[name])}})
            for name in row
        ]
        for row in rows
    )
    can = {"look_at": {"target": (0.7, 0.25, 0.43), "distance": (0.1, 1.0)}, "optional": True}
    for criterion in (*improved, *rough, *remembering):
        tour = hpop.Tour([can]) if criterion.role == "stops_missed" else None
        replace(shelf, world=world, criteria=(criterion,), tour=tour)
    assert all(criterion.smooth for criterion in improved)
    assert all(PieceCosts.with_gradients(world, shelf.model, rough)[1].values())
    assert {criterion.aggregate for criterion in remembering} == {"trajectory"}
    for criterion in refused:
        with pytest.raises(CriterionError, match=criterion.name):
            replace(shelf, criteria=(criterion,)).solve("roadmap", samples=1)


def _options(cls: type) -> set[str]:
    return {option.name for option in fields(cls)}


def test_the_exit_codes_in_the_docs_are_those_of_the_errors_and_of_the_command_line():
    from hpop import errors

    classes = [cls for cls in vars(errors).values() if isinstance(cls, type) and issubclass(cls, errors.HpopError)]
    listed = re.findall(r"^\| (\d+) \|", (ROOT / "docs/commands.md").read_text(), re.MULTILINE)
    of_commands = {0, 2, 6, 130}  # done, wrong usage, no path, interrupted
    assert sorted(map(int, listed)) == sorted({cls.exit_code for cls in classes} | of_commands)


def test_files_that_contributing_names_are_there():
    """NAME and GROUP stand for what is contributed: the folder of such a file is there."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    named = set(re.findall(r"`((?:hpop|tests|docs|examples)/[\w/.]+)`", text))
    assert len(named) > 25
    alone = re.findall(r"^ {4}\.venv/bin/pytest (tests/\S+)", text, re.MULTILINE)  # one test file, one folder
    assert any(name.endswith(".py") for name in alone)
    for name in named.union(alone):
        path = ROOT / re.split("GROUP|NAME", name)[0].rpartition("/")[0] if "NAME" in name else ROOT / name
        assert path.exists(), name


def test_links_between_documents_lead_somewhere():
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", path.read_text()):
            assert (path.parent / target).exists(), f"{path.name} links to {target}"


def test_links_to_headings_lead_to_one():
    for path in (ROOT / "docs").glob("*.md"):
        for target, anchor in re.findall(r"\]\((?!https?:)([^)#]*)#([^)]+)\)", path.read_text()):
            text = (path.parent / target if target else path).read_text()
            headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
            anchors = {re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in anchors, f"{path.name}: {anchor}"
