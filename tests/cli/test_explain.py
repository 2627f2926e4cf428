"""`hpop explain`: what each printed word means, and what is registered under a name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from hpop.cli.explain import REGISTRIES, explained
from hpop.cli.glossary import entries, page
from hpop.cli.report import WORDS
from hpop.cli.results import PICTURES, SAVED
from hpop.problems.front import Front
from hpop.runtime.limits import Status

pytestmark = pytest.mark.usefixtures("no_pictures")


@pytest.mark.parametrize(
    "word",
    [
        "gap",
        "certificate",
        "hypervolume",
        "supported",
        "exposure",
        "knee",
        "eps",
        "quantum",
        "commit",
        "option",
        "drive",
        "wish",
    ],
)
def test_the_words_that_puzzled_are_explained(run: Callable[..., Result], word: str) -> None:
    result = run("explain", word)
    assert result.exit_code == 0
    assert len(result.stdout) > 100


def test_each_status_has_its_meaning() -> None:
    for status in Status:
        assert explained(status.value).startswith("status: "), status


def test_what_is_registered_is_explained_by_its_docstring(run: Callable[..., Result]) -> None:
    for registry in REGISTRIES:
        for name, item in registry.items():
            first = re.split(r"[`.:\\]", item.__doc__.strip())[0]
            assert f"{name}, a {registry.kind}" in explained(name)
            assert first in explained(name)
    both = run("explain", "exposure").stdout  # a word of the glossary, and a criterion
    assert both.startswith("exposure: The obstruction added up over time")
    assert "exposure, a criterion: s, sum, requires camera, radius=2.0" in both


def test_a_word_is_found_however_it_is_written() -> None:
    assert explained("Pareto-Front") == explained("front") == explained(" pareto  front ")
    assert explained("Personal Space") == explained("personal_space")


def test_no_word_has_two_meanings() -> None:
    words = [word for entry in entries() for word in (entry.word, *entry.also)]
    assert len(words) == len(set(words))
    assert all(f"**{entry.word}**" in page() for entry in entries())


@pytest.mark.parametrize("file", [*PICTURES, SAVED, "trace", "where", "Map"])
def test_a_file_that_a_plan_writes_is_explained(file: str) -> None:
    assert len(explained(file)) > 50


def test_an_unknown_word_names_the_nearest_before_all(run: Callable[..., Result], refused: Callable[..., None]) -> None:
    result = run("explain", "hypervolum")
    refused(
        result, 7, "unknown word 'hypervolum'. Did you mean 'hypervolume'? `hpop explain` knows front, certificate, "
    )
    assert "`hpop explain` knows front, certificate, " in run("explain").stdout


def test_a_plan_ends_with_where_its_words_are_explained(plan: Callable[..., Result], room: Path) -> None:
    said = " ".join(plan(room).stdout.split())
    assert WORDS in said
    named = re.findall(r"\w+", WORDS.partition("explain")[2].partition(" and ")[0])
    assert all(explained(word) for word in named)
    assert "labels" not in said


def test_counters_are_for_those_who_ask(run: Callable[..., Result], plan: Callable[..., Result], room: Path) -> None:
    counted = r"lattice: .*labels generated"
    plan(room)
    assert not re.search(counted, run("show", room / "out").stdout)
    assert re.search(counted, " ".join(run("show", room / "out", "--verbose").stdout.split()))
    again = run("plan", room / "room.yaml", "--out", room / "out", "--verbose")
    assert re.search(counted, " ".join(again.stdout.split()))


def test_the_note_on_empty_groups_is_one_line_and_said_once(
    run: Callable[..., Result], write: Callable[..., None], room: Path
) -> None:
    several = "planner:\n  - lattice: {step: 0.5}\n  - weighted-sum: {step: 0.5}"
    write(room, ("planner:\n  lattice: {step: 0.5}", several))
    said = " ".join(run("plan", room / "room.yaml", "--out", room / "out").stdout.split())
    assert said.count("note: none of your criteria is about performance or the robot (energy, wear) or people") == 1


def test_why_no_path_passes_somewhere_is_a_sentence_and_a_table(run: Callable[..., Result], folder: Path) -> None:
    said = " ".join(run("explain", folder, "--through", "left of 2,0.5").stdout.split())  # the wall, and its door
    assert said.startswith("Passing left of (2, 0.5) is on the front: row 0 passes there.")
    assert "best path" in said
    assert "exact on the lattice of step 0.5 m, 8 headings, no corner cutting, passing left of (2, 0.5), for" in said
    answer = Front.load(folder / "front.json").why_not((3.5, 1.5), than="knee")
    corner = " ".join(run("explain", folder, "--through", "3.5,1.5", "--than", "knee").stdout.split())
    assert corner.startswith(answer.sentence)
    assert answer.sentence.endswith("than row 0; it is never better.")
    assert f"difference 0 +{answer.numbers['length']:.3f}" in corner
    none = " ".join(run("explain", folder, "--through", "right of 2,0.5").stdout.split())
    assert none.startswith("No path passes right of (2, 0.5): no motion of the lattice of step 0.5 m")
    bound = run("explain", folder, "--wish", "turns=99")
    assert bound.stdout.startswith("Row 0 is a path with at most 99 turns.")


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (
            ["--through", "left of statue"],
            5,
            "no obstacle, zone or landmark of the map is called 'statue'. Known: none",
        ),
        (["--through", "9,9"], 5, "the position where a path shall pass is off the map, which spans"),
        (["--through", "1.95,0.1 2.05,0.1 2.05,0.5"], 5, "the region where a path shall pass is wholly blocked"),
        (["--wish", "fewer pauses"], 7, "there is no cost 'pauses' to wish for. The front has the costs turns, length"),
        (["--wish", "turns=few"], 10, "--wish must be words, or a bound such as turns=3, got 'turns=few'"),
        (["--wish", "turns=3", "--than", "99"], 10, "no row 99"),
    ],
)
def test_questions_that_have_no_answer_are_refused(
    run: Callable[..., Result], refused: Callable[..., None], folder: Path, words: list[str], code: int, message: str
) -> None:
    refused(run("explain", folder, *words), code, message)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--through", "1,1"], "--through and --wish need the FOLDER of a front"),
        (["knee", "--than", "3"], "--than needs --through or --wish"),
    ],
)
def test_options_of_a_front_need_one(run: Callable[..., Result], words: list[str], message: str) -> None:
    result = run("explain", *words)
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_word_is_no_front(run: Callable[..., Result], refused: Callable[..., None]) -> None:
    refused(run("explain", "knee", "--through", "1,1"), 12, "give the folder that `hpop plan` wrote")
