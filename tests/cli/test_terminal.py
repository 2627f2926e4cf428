"""Text from files cannot steer the terminal, whether hpop prints it, quotes it in an error, or draws it."""

from __future__ import annotations

import unicodedata
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import shapely
from click.testing import CliRunner, Result
from matplotlib.text import Text

from hpop import DifferentialDrive, Front, Problem, World
from hpop.base.text import HARMFUL, printable
from hpop.cli import main
from hpop.errors import ScenarioError
from hpop.scenario import load_scenario
from hpop.view import draw_front, draw_map, draw_trace, draw_where
from hpop.world.content.content import Landmark, Person

CLEAR = "\x1b[2J\x1b[31mKäthe \u202e\x9b1m\r\x07"
SHOWN = r"\x1b[2J\x1b[31mKäthe \u202e\x9b1m\r\x07"
DOLLARS = "$5 $\\frac{$"


@pytest.fixture(scope="module")
def front() -> Front:
    world = World.from_polygons([shapely.box(1, 0, 1.5, 1.2)], extent=shapely.box(0, 0, 3, 2))
    people = [Person(2.6, 1.6, name=CLEAR), Person(2.6, 0.4, name=DOLLARS)]
    content = world.with_content(people=people, landmarks=[Landmark(0.2, 1.8, name=DOLLARS)])
    robot = DifferentialDrive(radius=0.1)
    problem = Problem(content, robot, (0.5, 0.5, 0), (2, 0.5, None), ["turns", "length"])
    return problem.solve("lattice", step=0.25)


def shown(path: Path) -> Result:
    return CliRunner().invoke(main, ["show", str(path)])


def lines(text: str) -> Iterator[str]:
    """Lines as the program ended them: what a file said never ends one."""
    return iter(text.split("\n"))


def test_a_front_full_of_control_characters_is_printed_without_them(front: Front, tmp_path: Path) -> None:
    runs = [{**run, "planner": f"{CLEAR}\nerror: forged", "notes": [f"{CLEAR}\nerror: forged"]} for run in front.runs]
    replace(front, certificate=f"{CLEAR}\nerror: forged", runs=tuple(runs)).save(tmp_path / "front.json")
    result = shown(tmp_path / "front.json")
    assert result.exit_code == 0, result.output
    assert not any(HARMFUL.search(line) for line in lines(result.output))
    assert not any(line.startswith("error: forged") for line in lines(result.output))
    assert f"certificate: {SHOWN}" in result.output
    assert f"note: {SHOWN}" in "".join(result.output.split("\n"))


def test_names_of_criteria_out_of_a_file_are_told_without_control_characters(front: Front, tmp_path: Path) -> None:
    replace(front, names=(CLEAR, "length")).save(tmp_path / "front.json")
    result = shown(tmp_path / "front.json")
    assert result.exit_code == 12
    assert SHOWN in result.stderr
    assert not any(HARMFUL.search(line) for line in lines(result.output))


@pytest.mark.parametrize(
    "text",
    [
        'world: {"\\e[2Jx": 1}\n',
        'world: {ros_map: {path: "\\e[2J"}}\nstart: [0, 0, 0]\ngoal: [1, 1, 0]\ncriteria: [length]\n',
        'world: {ros_map: {path: a}}\nstart: [0, 0, "\\e[2J"]\ngoal: [1, 1, 0]\ncriteria: ["\\e[2J"]\n',
        'world: {}\n"\\e[2J\\N": 3\n"\\u202e": 4\n',
        "world: !\x1b[2J x\n",
    ],
)
def test_errors_of_a_scenario_are_told_without_control_characters(
    text: str, tmp_path: Path, run: Callable[..., Result]
) -> None:
    (tmp_path / "\x1b[2J.yaml").write_text(text)
    result = run("plan", tmp_path / "\x1b[2J.yaml", "--out", tmp_path / "out")
    assert result.exit_code in (3, 4, 5, 7)
    assert not any(HARMFUL.search(line) for line in lines(result.output))
    assert r"\x1b[2J" in result.stderr


def test_messages_in_python_say_no_control_characters_and_a_key_cannot_forge_a_line(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text('world: {}\n"\\x9b2J\\nroom.yaml, line 1: forged": 4\n')
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / "room.yaml")
    assert not any(HARMFUL.search(line) for line in lines(str(caught.value)))
    assert not any(line.startswith("room.yaml, line 1: forged") for line in lines(str(caught.value)))
    assert str(ScenarioError(CLEAR)) == SHOWN


@pytest.mark.cases("map", "trace")
@pytest.mark.parametrize("picture", ["map", "front", "trace", "where"])
def test_pictures_show_dollars_and_leave_out_control_characters(front: Front, picture: str) -> None:
    named = replace(front, names=(DOLLARS, CLEAR), units=("$", CLEAR), certificate=DOLLARS + CLEAR)
    problem = Problem.from_description(front.problem or {})
    trajectory = front.knee().item
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a font has no glyph for a control character
        figure = {
            "map": lambda: draw_map(problem, named),
            "front": lambda: draw_front(named),
            "trace": lambda: draw_trace(problem, trajectory, name=DOLLARS),
            "where": lambda: draw_where(problem, trajectory, name=DOLLARS),
        }[picture]()
        figure.canvas.draw()
    texts = figure.findobj(Text)
    assert any(DOLLARS in text.get_text() for text in texts)
    assert not any(text.get_parse_math() for text in texts if "$" in text.get_text())  # shown, no formula
    assert not any(HARMFUL.search(line) for text in texts for line in lines(text.get_text()))


def test_umlauts_accents_and_other_scripts_are_printed_as_they_are() -> None:
    text = (
        "Käthe Øystein Zoë 東京 עברית 🤖 m² √2 ≤ – … \u0646\u0645\u06cc\u200c\u062e\u0648\u0627\u0647\u0645 👩\u200d🚀"
    )
    assert printable(text) == text


def test_what_nobody_sees_is_printed_as_its_escape() -> None:
    """Every format character of Unicode that has no shape of its own: two names that look alike are told apart."""
    prefixes = {*range(0x600, 0x606), 0x6DD, 0x70F, 0x890, 0x891, 0x8E2, 0x110BD, 0x110CD}  # seen, before numbers
    unseen = [chr(code) for code in range(0x30000) if unicodedata.category(chr(code)) == "Cf" and code not in prefixes]
    unseen = [one for one in unseen if not unicodedata.name(one, "").startswith("EGYPTIAN")]
    assert {"\u200b", "\u200d", "\u2060", "\ufeff", "\u00ad"} <= set(unseen)
    for one in (*unseen, "\u3164", "\U000e0041"):
        assert printable(f"le{one}ngth") == f"le{ascii(one)[1:-1]}ngth"
        assert printable(one) == ascii(one)[1:-1]


def test_half_a_surrogate_pair_can_be_printed() -> None:
    assert printable("\ud800!").encode() == rb"\ud800!"
