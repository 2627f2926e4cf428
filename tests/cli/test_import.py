"""`--import`: the user's own Python on the command line, in processes of their own as a user starts them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from hpop.cli.beside import PicturesBeside
from hpop.problems.front import Front
from tests.warm import UNDRAWN, Warm

EXAMPLES = Path(__file__).parents[2] / "examples"
WAY = """\
from dataclasses import dataclass
import hpop

@hpop.criterion("my_way", group="C", unit="m", aggregate="sum")
@dataclass(frozen=True)
class Way:
    def cost(self, m):
        return 2.0 * m.base.length
"""
MORE = """\
from dataclasses import dataclass
import hpop
from hpop.planners import planner
from hpop.planners.graph_planners import Lattice
from hpop.base.registry import readers

@planner("my_lattice")
@dataclass(frozen=True)
class MyLattice(Lattice):
    "A planner of somebody's own."

readers.add("my_map", lambda path: hpop.World.from_ros_map(path))
"""
GRAPH = """\
from dataclasses import dataclass
from typing import ClassVar
from hpop.planners.graphs import GraphFamily, RoadmapGraph, graph_family

@graph_family("few")
@dataclass(frozen=True)
class Few(GraphFamily):
    "A roadmap of twelve samples."

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move"})

    def build(self, problem, objectives, spending):
        return RoadmapGraph(samples=12, neighbours=12, seed=1).build(problem, objectives, spending)
"""
OWN = [("turns, length", "my_way, length"), ("lattice: {step: 0.5}", "weighted-sum: {step: 0.5}")]


Hpop = Callable[..., CompletedProcess[str]]


@pytest.fixture(scope="session")
def hpop(warm: Warm) -> Hpop:
    """Run a command; like the installed one it does not look for modules in the current folder by itself."""

    def hpop(*arguments: object, cwd: Path, path: Path | None = None) -> CompletedProcess[str]:
        looked_in = os.pathsep.join(filter(None, [str(path or ""), os.environ.get("PYTHONPATH", "")]))
        environment = {"COLUMNS": "200", "PYTHONPATH": looked_in}
        done = warm.run(*arguments, cwd=cwd, code=UNDRAWN, environment=environment)
        assert "Traceback" not in done.stderr
        return done

    return hpop


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """Return a folder with a user's code, apart from scenarios and from the working directory."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "ways.py").write_text(WAY)
    return tmp_path / "mine"


@pytest.mark.proof
def test_a_file_serves_to_plan_with_workers_to_show_and_to_draw_meanwhile(
    hpop: Hpop, room: Path, write: Callable[..., None], mine: Path
) -> None:
    write(room, *OWN)
    planned = hpop("plan", "room.yaml", "--out", "out", "--workers", "2", "--import", "mine/ways.py", cwd=room)
    assert planned.returncode == 0, planned.stderr
    front = Front.load(room / "out" / "front.json")
    assert front.names == ("my_way", "length")
    assert front.costs[:, 0] == pytest.approx(2.0 * front.costs[:, 1])
    assert not any("worker" in note for note in front.notes)  # they found the code

    shown = hpop("show", "out", "--import", mine / "ways.py", cwd=room)
    assert (shown.returncode, "verified" in shown.stdout) == (0, True), shown.stderr

    with PicturesBeside(room / "out", [str(mine / "ways.py")]) as pictures:
        pictures._begin("map")
        assert pictures._process is not None
        assert pictures._process.wait() == 0
    assert (room / "out" / "map.png").exists()

    without = hpop("show", "out", cwd=room)
    assert without.returncode == 7
    assert "out/front.json was planned with a criterion that is unknown here: unknown criterion 'my_way'" in (
        without.stderr
    )
    assert "--import FILE_OR_MODULE" in without.stderr


def test_what_a_scenario_names_is_not_imported_for_it(hpop: Hpop, room: Path, write: Callable[..., None]) -> None:
    write(room, ("turns, length", "ways, length"))
    (room / "ways.py").write_text("open('ran', 'w')\n" + WAY.replace("my_way", "ways"))
    refused = hpop("plan", "room.yaml", "--out", "out", cwd=room)
    assert refused.returncode == 7
    assert "line 7, criteria.0: unknown criterion 'ways'" in refused.stderr
    assert "--import FILE_OR_MODULE" in refused.stderr
    assert not (room / "ran").exists()
    assert hpop("criteria", "--import", "ways", cwd=room).returncode == 0
    assert (room / "ran").exists()  # by the command line alone


def test_planners_and_readers_of_several_modules_come_along(
    hpop: Hpop, room: Path, write: Callable[..., None], mine: Path
) -> None:
    write(room, ("turns, length", "my_way, length"), ("ros_map:", "my_map:"), ("lattice:", "my_lattice:"))
    (mine / "more.py").write_text(MORE)  # seen from the folder of the room, the modules are in the package `mine`
    both = ("--import", "mine.more", "--import", "mine/ways.py")
    (mine / "__init__.py").touch()
    planned = hpop("plan", "room.yaml", "--out", "out", *both, cwd=room)
    assert planned.returncode == 0, planned.stderr
    assert Front.load(room / "out" / "front.json").names == ("my_way", "length")
    assert "A planner of somebody's own." in hpop("planners", *both, cwd=room).stdout
    assert "my_way  m, sum" in hpop("criteria", *both, cwd=room).stdout


def test_a_graph_of_the_user_is_searched(hpop: Hpop, room: Path, write: Callable[..., None], mine: Path) -> None:
    (mine / "few.py").write_text(GRAPH)
    write(room, ("lattice: {step: 0.5}", "exact: {on: {few: {}}}"))
    planned = hpop("plan", "room.yaml", "--out", "out", "--import", "mine/few.py", cwd=room)
    assert planned.returncode == 0, planned.stderr
    assert "roadmap of 12 samples" in Front.load(room / "out" / "front.json").certificate


def test_a_criterion_is_checked_by_its_file_its_module_or_its_name(hpop: Hpop, mine: Path) -> None:
    for named in (["ways.py:Way"], ["ways:Way"], ["my_way", "--import", "ways.py"]):
        done = hpop("check", *named, cwd=mine)
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.count("ok") > 5


def test_a_check_of_an_unknown_name_tells_what_was_imported(hpop: Hpop, mine: Path) -> None:
    done = hpop("check", "warmth", "--import", "ways.py", cwd=mine)
    assert done.returncode == 7
    assert "my_way; for a class of your own, give" in done.stderr


def test_the_example_is_planned_as_it_says(hpop: Hpop, tmp_path: Path) -> None:
    lines = (EXAMPLES / "own_criterion.yaml").read_text().splitlines()
    (command,) = (line.removeprefix("#").split() for line in lines if "hpop plan" in line)
    said = [str(tmp_path) if word.startswith("out/") else word for word in command[1:]]
    assert hpop(*said, cwd=EXAMPLES.parent).returncode == 0
    assert Front.load(tmp_path / "front.json").names == ("glare", "turns", "length")


@pytest.mark.parametrize(
    ("content", "named", "status", "said"),
    [
        (None, "gone.py", 14, "there is no such file; give FILE.py, or a MODULE"),
        (None, "gone", 14, "No module named 'gone'; give FILE.py, or a MODULE"),
        ("import hpop\nclass :\n", "own.py", 14, "own.py, line 2: SyntaxError: invalid syntax"),
        ("import hpop\nimport gone\n", "own.py", 14, "own.py, line 2: ModuleNotFoundError: No module named 'gone'"),
        ("\n\n1 / 0\n", "own", 14, "own.py, line 3: ZeroDivisionError: division by zero"),
        ("def f():\n    return {}['x']\nf()\n", "own.py", 14, "own.py, line 2: KeyError: 'x'"),
        ("raise SystemExit\n", "own.py", 14, "own.py, line 1: SystemExit; put code that runs it as a program"),
        ("from . import ways\n", "own.py", 14, "give PACKAGE.MODULE"),
        (
            "import hpop.criteria\n",
            "own.py",
            14,
            "registers no criterion, planner, graph, model, goal, reader or format",
        ),
        (WAY.replace("my_way", "turns"), "own.py", 8, "own.py, line 4: criterion name 'turns' is taken by hpop."),
        (
            WAY.replace('"C"', '"X"'),
            "own.py",
            8,
            "own.py, line 4: criterion 'my_way' (Way) is declared wrongly: group must be one of",
        ),
        (WAY, "queue.py", 14, "its name is taken by the module 'queue'"),
        (WAY, "moocore.py", 14, "its name is taken by the module 'moocore'"),
        (WAY, "own.v2.py", 14, "NAME.py, with no other dot"),
        (WAY, "own.py:Way", 14, "a file or module is imported as a whole; give own.py"),
        (WAY, "own.txt", 14, "rename it to NAME.py"),
        (WAY, ".", 14, "it is a folder; give a file in it, such as NAME.py"),
    ],
)
def test_what_cannot_be_imported_is_told_in_one_message(
    hpop: Hpop, tmp_path: Path, content: str | None, named: str, status: int, said: str
) -> None:
    if content is not None:
        file = named.partition(":")[0].removesuffix(".py")
        (tmp_path / (file if file.endswith(".txt") else f"{file}.py")).write_text(content)
    done = hpop("criteria", "--import", named, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (status, "")
    assert said in done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1


def test_an_error_in_cost_is_told_with_file_and_line(
    hpop: Hpop, room: Path, write: Callable[..., None], mine: Path
) -> None:
    write(room, *OWN)
    own = ("--import", "mine/ways.py")
    assert hpop("plan", "room.yaml", "--out", "out", *own, cwd=room).returncode == 0
    (mine / "ways.py").write_text(WAY.replace("m.base.length", "m.base.lengths"))
    for command in (["plan", "room.yaml", "--out", "again", "--workers", "2"], ["show", "out"]):
        done = hpop(*command, *own, cwd=room)
        assert done.returncode == 8
        assert "criterion 'my_way' failed (" in done.stderr
        assert (
            "ways.py, line 8): AttributeError: 'Body' object has no attribute 'lengths'. Did you mean 'length'?"
            in done.stderr
        )
        assert "; to test the" in done.stderr
        assert "mine/ways.py:Way`\n" in done.stderr


def test_a_planner_that_fails_is_told_with_file_and_line(hpop: Hpop, room: Path, write: Callable[..., None]) -> None:
    write(room, ("lattice:", "my_lattice:"))
    fails = "    def stages(self, problem, progress=None):\n        raise ValueError('too far')\n"
    (room / "more.py").write_text(MORE.partition("readers.add")[0] + fails)
    done = hpop("plan", "room.yaml", "--out", "out", "--import", "more.py", cwd=room)
    assert done.returncode == 14
    assert "error: code of your own failed (" in done.stderr
    assert "more.py, line 13): ValueError: too far\n" in done.stderr


def test_an_unknown_reader_and_a_check_without_a_name_say_the_way_out(
    hpop: Hpop, room: Path, write: Callable[..., None], mine: Path
) -> None:
    write(room, ("ros_map:", "my_map:"))
    unknown = hpop("plan", "room.yaml", "--out", "out", cwd=room)
    assert unknown.returncode == 4
    assert "line 2, world.my_map: no such key" in unknown.stderr
    assert "--import FILE_OR_MODULE" in unknown.stderr
    nameless = hpop("check", "ways.py", cwd=mine)
    assert nameless.returncode == 8
    assert "give ways.py:NAME" in nameless.stderr


def test_two_files_of_one_name_and_one_criterion_in_two_files_are_refused(hpop: Hpop, mine: Path) -> None:
    (mine / "again").mkdir()
    for copy, status, said in [
        ("again/ways.py", 14, "its name is taken by the module 'ways'"),
        ("b.py", 8, "ways.Way"),
    ]:
        (mine / copy).write_text(WAY)
        done = hpop("criteria", "--import", "ways.py", "--import", copy, cwd=mine)
        assert (done.returncode, said in done.stderr) == (status, True), done.stderr


def test_a_name_that_an_installed_package_has_is_refused_at_once(hpop: Hpop, mine: Path, tmp_path: Path) -> None:
    info = tmp_path / "installed" / "paths-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: paths\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hpop.criteria]\nmy_way = paths:Way\n")
    (tmp_path / "installed" / "paths.py").write_text(WAY)
    done = hpop("check", "my_way", "--import", "ways.py", cwd=mine, path=tmp_path / "installed")
    assert done.returncode == 8
    assert "criterion name 'my_way' is taken by ways.Way" in done.stderr
    alone = hpop("check", "my_way", "--import", "paths", cwd=mine, path=tmp_path / "installed")
    assert alone.returncode == 0, alone.stderr  # the package's own module takes nothing away
