"""Every block of Python, every scenario and every command in the documents is what hpop takes.

Blocks that claim something are tested for it in tests/test_docs.py; here all others run, and those that come.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import re
import shlex
import sys
import tomllib
from pathlib import Path
from typing import Any

import click
import pytest
import yaml
from click.testing import CliRunner
from PIL import Image

import hpop
from hpop import study
from hpop.batches.cases import Specification
from hpop.cli import main
from hpop.cli.beside import PicturesBeside
from hpop.errors import MapError
from hpop.frontier import ItemFront
from hpop.scenario import load_scenario
from hpop.scenario.events import load_events
from hpop.world.content.content import Landmark

ROOT = Path(__file__).resolve().parents[1]
FILES = ["README.md", "CONTRIBUTING.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").glob("*.md"))]
#: Whole pages that tests run from top to bottom, the first plan, and the template of a planner.
RUN_THERE = {
    *("docs/arm.md", "docs/front.md", "docs/front_reference.md", "docs/optimisers.md", "docs/preferences.md"),
    *("docs/questions.md", "docs/study.md"),
}
WORK = (
    "t,base_to_shoulder,shoulder_to_upper_arm,upper_arm_to_elbow,elbow_to_forearm,forearm_to_wrist,wrist_to_hand\n"
    "0,0,0.1,0.2,0,0,0\n2,0,0.2,0.4,0,0,0\n"
)  # motion of an arm, as `hpop pick --body joints` writes it
CLAIMED = ("save_pictures(problem", "class Straight:")
TOUR = yaml.safe_load((ROOT / "examples/museum.yaml").read_text())
pytestmark = pytest.mark.usefixtures("registered_as_before")


def blocks(language: str) -> list[Any]:
    """Each block of a language: its text, named by its file and place."""
    found = {
        f"{file}-{i}": text
        for file in FILES
        for i, text in enumerate(re.findall(rf"```{language}\n(.*?)```", (ROOT / file).read_text(), re.DOTALL))
        if language != "python" or not (file in RUN_THERE or any(words in text for words in CLAIMED))
    }
    return [pytest.param(text, id=name) for name, text in found.items()]


def commands() -> list[str]:
    """Each line that shows a command: indented, or in a block without a language."""
    lines = []
    for file in [*FILES, "examples/plugin/README.md"]:
        text = (ROOT / file).read_text()
        lines += re.findall(
            r"^    ((?:hpop|make|pip) .*)$", re.sub(r"```\w+\n.*?```", "", text, flags=re.DOTALL), re.MULTILINE
        )
        lines += re.findall(
            r"^((?:hpop|make|pip) .*)$", "\n".join(re.findall(r"```\n(.*?)```", text, re.DOTALL)), re.MULTILINE
        )
    return sorted(set(lines))


#: What `hpop.study.fit_criterion` writes.
LEARNT = {
    "schema": "hpop-learnt",
    "version": 1,
    "parts": [{"criterion": {"rotation": {}}, "weight": 1.5}],
    "learnt": {
        "question": "comfort", "source": "nobody", "ratings": 9, "people": 3, "trajectories": 5,
        "error": 0.5, "error_of_mean": 0.7,
    },
}  # fmt: skip


def at(x: float, y: float, step: int) -> str:
    """State of a car of a CommonRoad file."""
    place = f"<position><point><x>{x}</x><y>{y}</y></point></position>"
    return f"{place}<orientation><exact>0</exact></orientation><time><exact>{step}</exact></time>"


#: Road of one lane with a limit, a car that drives on it, and a goal behind that car.
ROAD = f"""<commonRoad commonRoadVersion="2018b" timeStepSize="0.1">
<lanelet id="1"><leftBound><point><x>0</x><y>4</y></point><point><x>60</x><y>4</y></point></leftBound>
<rightBound><point><x>0</x><y>0</y></point><point><x>60</x><y>0</y></point></rightBound>
<speedLimit>8</speedLimit></lanelet>
<obstacle id="2"><role>dynamic</role><type>car</type>
<shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>
<initialState>{at(20, 2, 0)}</initialState><trajectory><state>{at(40, 2, 40)}</state></trajectory></obstacle>
<planningProblem id="3"><initialState>{at(3, 2, 0)}</initialState>
<goalState><position><circle><radius>2</radius><center><x>30</x><y>2</y></center></circle></position></goalState>
</planningProblem></commonRoad>"""


@pytest.fixture(scope="module")
def tour() -> hpop.Problem:
    museum = hpop.examples.museum()
    world = museum.world.with_content(landmarks=[Landmark(15, 10, z=1.6)])
    return hpop.Problem(world, museum.model, museum.start, museum.goal, museum.criteria)


@pytest.fixture(scope="module")
def preference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the preference of a person, as `hpop prefer` does."""
    path = tmp_path_factory.mktemp("people") / "p07.json"
    front = ItemFront.of([[1.0, 2.0], [2.0, 1.0]], names=["turns", "length"], units=["1", "m"])
    study.Preference.fit(front, [(0, 1)]).save(path)
    return path


@pytest.fixture
def here(tmp_path: Path, preference: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder in which the arm's files lie, as the pages name them."""
    (tmp_path / "arm").symlink_to(ROOT / "examples/arm")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for name in ("arm6.urdf", "arm6.srdf"):
        (tmp_path / name).symlink_to(ROOT / "examples/arm" / name)
    (tmp_path / "p07.json").symlink_to(preference)
    (tmp_path / "comfort.json").write_text(json.dumps(LEARNT))
    (tmp_path / "wifi.csv").write_text("x,y,wifi\n2,10,-50\n4,10,-60\n")
    Image.new("L", (80, 80)).save(tmp_path / "latency.png")
    (tmp_path / "visitors.csv").write_text("1,1500,4,9\n1,1600,6,9\n")  # id, frame, x, y
    (tmp_path / "road.xml").write_text(ROAD)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", list(dict.fromkeys(each.id.rpartition("-")[0] for each in blocks("python"))))
def test_python_in_a_document_runs_block_by_block_where_a_problem_is_given(
    page: str, tour: hpop.Problem, here: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.NOTSET, "hpop")  # and back again, whatever a block sets
    names = {"world": tour.world, "model": tour.model, "start": tour.start, "goal": tour.goal, "problem": tour}
    for block in blocks("python"):
        if block.id.rpartition("-")[0] == page:
            names = run_block(block.values[0], monkeypatch, names)


def run_block(text: str, monkeypatch: pytest.MonkeyPatch, given: dict[str, Any]) -> dict[str, Any]:
    """Run a block of Python as a module, in which some names are given; return the names that it has at its end."""
    spec = importlib.util.spec_from_loader("a_document", loader=None)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)  # dataclasses look there
    vars(module).update(given, hpop=hpop)
    exec(compile(text, "document", "exec"), vars(module))
    return {name: value for name, value in vars(module).items() if not name.startswith("__")}


@pytest.mark.parametrize("page", ["criteria", "own_planner", "own_robot"])
def test_a_key_of_a_scenario_in_a_comment_beside_a_command_is_accepted(
    page: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (ROOT / f"docs/{page}.md").read_text()
    run_block(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], monkeypatch, {})
    (said,) = re.findall(r"^    hpop plan .*# (\w+: .*)$", text, re.MULTILINE)
    world = {"geojson": {"path": str(ROOT / "examples/museum.geojson")}}
    planner = {"roadmap": {"samples": 1}}  # for every robot
    shown = {**TOUR, "world": world, "planner": planner, **yaml.safe_load(said)}
    (here / "shown.yaml").write_text(yaml.safe_dump(shown))
    assert load_scenario(here / "shown.yaml").problem


@pytest.mark.parametrize("text", blocks("yaml"))
def test_a_scenario_in_a_document_is_one_but_for_maps_that_are_not_there(text: str, here: Path) -> None:
    shown = yaml.safe_load(re.sub(r"\bon:", '"on":', text))  # which is True in YAML 1.1
    if "events" in shown:
        (here / "events.yaml").write_text(text)
        assert load_events(here / "events.yaml").events
        return
    if {"vary", "table"} & shown.keys():
        world = {"geojson": {"path": str(ROOT / "examples/museum.geojson")}}
        (here / "batch.yaml").write_text(yaml.safe_dump({**TOUR, **shown, "world": world}))
        (here / "pairs.csv").write_text("start.x,start.y,start.yaw,goal.x,goal.y,goal.yaw\n2,10,0,28,10,any\n")
        assert len(Specification.load(here / "batch.yaml")) > 1
        return
    ours = (
        {"model": "differential_drive"} | TOUR | {"world": {"geojson": {"path": str(ROOT / "examples/museum.geojson")}}}
    )
    if "model" in shown:  # arms and heads have other planners and criteria
        ours |= {"criteria": ["duration"], "planner": {"roadmap": {"samples": 1}}}
    (here / "shown.yaml").write_text(yaml.safe_dump(ours | shown))
    (here / "work.csv").write_text(WORK)
    (reader,) = shown.get("world", {"": None})
    paths = [shown["world"][reader].get("path")] if reader else []
    if missing := [path for path in paths if path and not (here / path).exists()]:
        with pytest.raises(MapError, match=rf"(?i){re.escape(missing[0])}.*(no such file|does not exist)"):
            load_scenario(here / "shown.yaml")
    else:
        assert load_scenario(here / "shown.yaml").problem


def test_commands_in_documents_have_the_arguments_that_there_are() -> None:
    """An error of click names what is wrong; the line before it in the output is the command."""
    shown = [line for line in commands() if line.startswith("hpop ")]
    assert len(shown) > 50
    for line in shown:
        print(line)
        _, name, *arguments = shlex.split(line, comments=True)
        command = main.get_command(click.Context(main), name)
        if isinstance(command, click.Group):
            name = arguments.pop(0)
            command = command.get_command(click.Context(command), name)
        assert command is not None, f"no command {name}"
        whole = main.make_context("hpop", ["--help"], resilient_parsing=True)
        command.make_context(name, arguments, parent=whole).close()


def test_targets_of_make_and_extras_in_the_documents_are_there() -> None:
    targets = {*re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE), ".venv/.tools"}
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    asked = [line.split()[1] for line in commands() if line.startswith("make ")]
    text = "".join((ROOT / file).read_text() for file in FILES)
    assert {"demo", "test", "lint"} <= set(asked) <= targets
    named = re.findall(r"(?:hpop|\.)\[(\w+)\]", text)
    assert set(named) == extras


def test_the_commands_of_the_command_line_page_plan_show_and_pick(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run the commands from any folder; pictures take seconds, and are left out."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hpop.view.save_pictures", lambda problem, front, folder, **options: [])
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)
    page = (ROOT / "docs/command_line.md").read_text()
    said: dict[str, str] = {}
    for line, name in re.findall(r"^    hpop ((demo|show|pick) .*out/museum.*)$", page, re.MULTILINE):
        done = CliRunner().invoke(main, shlex.split(line, comments=True))
        assert done.exit_code == 0, done.output
        said[name] = said.get(name, "") + done.output
    assert said.keys() == {"demo", "show", "pick"}
    assert "`hpop plan out/museum/museum.yaml --out out/museum` plans it again" in said["demo"]
    assert "verified" in said["show"]
    assert "rotation (reported)" in said["pick"]
    assert (tmp_path / "camera.csv").read_text().startswith("t (s),x (m),")
    assert {path.name for path in (tmp_path / "out/museum").iterdir()} == {
        "front.json",
        "front.html",
        "museum.yaml",
        "museum.geojson",
    }
