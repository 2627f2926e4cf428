"""`hpop pick`: the row that the same choice in Python returns, and why; what cannot be picked is told."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from hpop import frontier
from hpop.problems.front import Front, Point
from hpop.scenario import load_scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
Run = Callable[..., Result]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the museum's front on a coarse lattice: 39 points, and a reported value."""
    place = tmp_path_factory.mktemp("museum")
    load_scenario(EXAMPLES / "museum.yaml").problem.solve(step=1.0).save(place / "front.json")
    return place


@pytest.fixture(scope="module")
def front(folder: Path) -> Front:
    front = Front.load(folder / "front.json")
    assert len(front) > 8
    return front


def middle(front: Front, name: str) -> float:
    return float(np.median(front.costs[:, front.names.index(name)]))


CHOICES: dict[str, tuple[Callable[[Front], list[str]], Callable[[Front], Point]]] = {
    "the knee by default": (lambda f: [], lambda f: f.knee()),
    "the knee": (lambda f: ["--knee"], lambda f: f.knee()),
    "least": (lambda f: ["--least", "exposure"], lambda f: f.best("exposure")),
    "least, then": (lambda f: ["--least", "turns,exposure"], lambda f: f.lexicographic(["turns", "exposure"])),
    "wish": (
        lambda f: ["--wish", f"turns={middle(f, 'turns')}", "--wish", "length=30"],
        lambda f: f.nearest({"turns": middle(f, "turns"), "length": 30}),
    ),
    "wish of a reported value": (lambda f: ["--wish", "obstruction=0"], lambda f: f.nearest({"obstruction": 0})),
    "row": (lambda f: ["--row", "3"], lambda f: f[3]),
    "row by name": (lambda f: ["--row", "least turns"], lambda f: f.best("turns")),
    "least among": (
        lambda f: ["--at-most", f"turns={middle(f, 'turns')}", "--least", "exposure"],
        lambda f: f.where(turns=f"<={middle(f, 'turns')}").best("exposure"),
    ),
    "knee among": (
        lambda f: ["--at-most", f"length={middle(f, 'length')!r}", "--at-most", "turns=9"],
        lambda f: f.where(length=f"<={middle(f, 'length')!r}", turns="<=9").knee(),
    ),
    "wish among": (
        lambda f: ["--at-most", f"obstruction={float(np.median(f.reported))!r}", "--wish", "turns=4"],
        lambda f: f.where(obstruction=f"<={float(np.median(f.reported))!r}").nearest({"turns": 4}),
    ),
}  # fmt: skip


@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES)
def test_what_is_picked_is_what_the_same_choice_in_python_gives(
    run: Run,
    folder: Path,
    front: Front,
    tmp_path: Path,
    choice: tuple[Callable[[Front], list[str]], Callable[[Front], Point]],
) -> None:
    arguments, expected = choice[0](front), choice[1](front)
    result = run("pick", folder / "front.json", *arguments, "--csv", tmp_path / "camera.csv")
    assert result.exit_code == 0, result.output
    said = re.search(r"picked trajectory (\d+) of (\d+)", result.stdout)
    assert said
    assert int(said[2]) == len(front)
    assert front[int(said[1])].costs == expected.costs
    import pandas  # takes a second, which each process of `make test` would spend

    written = pandas.read_csv(tmp_path / "camera.csv")
    table = expected.trajectory.table()
    assert written.columns.tolist() == table.headings
    assert written.to_numpy().T.tolist() == [column.tolist() for column in table.columns.values()]


def test_it_says_why_and_what_it_costs(run: Run, folder: Path, front: Front) -> None:
    result = run("pick", folder, "--at-most", "turns=8", "--least", "exposure")
    said = " ".join(result.stdout.split())
    kept = front.where(turns="<=8")
    assert f"the least exposure, among the {len(kept)} with turns <= 8" in said
    assert f"exposure {kept.best('exposure').costs['exposure']:.3f}" in said
    assert "obstruction (reported)" in said
    assert "planned by lattice" in said
    assert "certificate of the front, which `hpop show` checks: lattice: exact" in said


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--at-most", "turns=-1"], 10, "no trajectory to pick with turns <= -1, which no point meets: the nearest, "),
        (["--at-most", "turnz=5"], 7, "Did you mean 'turns'?"),
        (["--at-most", "turns=nan"], 10, "must be a finite number"),
        (["--wish", "turns=inf"], 10, "finite"),
        (["--wish", "lenght=3"], 7, "Did you mean 'length'?"),
        (["--least", "lenght"], 7, "Did you mean 'length'?"),
        (
            ["--least", "obstruction"],
            7,
            "obstruction is reported, not minimised: take --wish obstruction=0, which finds",
        ),
        (["--least", "turns,turns"], 10, "distinct"),
        (["--row", "9999"], 10, "no row 9999: the front has rows 0 to "),
        (["--row", "kneee"], 7, "Did you mean 'knee'?"),
    ],
)
def test_what_cannot_be_picked_ends_in_one_message(
    run: Run, refused: Callable[..., None], folder: Path, arguments: list[str], code: int, said: str
) -> None:
    refused(run("pick", folder, *arguments), code, said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--at-most", "turns"], "expected NAME=NUMBER, such as turns=5, got 'turns'"),
        (["--at-most", "turns=few"], "expected NAME=NUMBER"),
        (["--at-most", "turns<=5"], "expected NAME=NUMBER, such as turns=5 without < or >, got 'turns<=5'"),
        (
            ["--wish", "turns=1", "--knee"],
            "give one of --least, --wish, --row, --knee, --preference, got --wish and --knee",
        ),
        (["--row", "1", "--at-most", "turns=5"], "--row names one trajectory"),
        (["--at-most", "turns=5", "--at-most", "turns=6"], "give each name once"),
        (["--least", ","], "expected names separated by commas"),
    ],
)
def test_wrong_usage_is_told(run: Run, folder: Path, arguments: list[str], said: str) -> None:
    result = run("pick", folder, *arguments)
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.split())


def test_a_file_that_cannot_be_written_or_read_is_told(
    run: Run, refused: Callable[..., None], folder: Path, tmp_path: Path
) -> None:
    refused(run("pick", tmp_path), 12, "front.json")
    picked = run("pick", folder, "--csv", tmp_path / "gone" / "camera.csv")
    assert picked.exit_code == 12
    assert "gone/camera.csv': No such file or directory; choose another file" in " ".join(picked.stderr.split())
    assert "PosixPath" not in picked.stderr
    assert "picked trajectory" in picked.stdout


def test_further_criteria_choose_too(run: Run, refused: Callable[..., None], folder: Path) -> None:
    before = (folder / "front.json").read_bytes()
    problem = load_scenario(EXAMPLES / "museum.yaml").problem
    more = problem.evaluate(Front.load(folder / "front.json"), also=["rotation"])
    for asked, point in {"0": more.nearest({"rotation": 0}), "9.5": more.nearest({"rotation": 9.5})}.items():
        result = run("pick", folder, "--also", "rotation", "--wish", f"rotation={asked}")
        assert result.exit_code == 0, result.output
        assert f"picked trajectory {point.index} of {len(more)}" in result.stdout
        assert "rotation (reported)" in result.stdout
    refused(run("pick", folder, "--also", "rotatoin", "--knee"), 7, "Did you mean 'rotation'?")
    assert (folder / "front.json").read_bytes() == before


def test_a_front_of_something_else_than_trajectories_is_told(
    run: Run, refused: Callable[..., None], tmp_path: Path
) -> None:
    frontier.ItemFront.of([[1.0, 2.0], [2.0, 1.0]]).save(tmp_path / "front.json")
    refused(run("pick", tmp_path), 12, "found a front without them, such as one of a graph or a table")


def test_a_front_without_points_has_none_to_pick(
    run: Run, refused: Callable[..., None], front: Front, tmp_path: Path
) -> None:
    front.where(turns="<0").save(tmp_path / "front.json")
    refused(run("pick", tmp_path), 10, "no trajectories to pick from")


def test_further_criteria_are_shown_with_a_front_and_leave_it_as_it_is(run: Run, folder: Path) -> None:
    before = (folder / "front.json").read_bytes()
    result = run("show", folder, "--also", "sickness, rotation", "--also", "jerk")
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "sickness, rotation, jerk evaluated on what was found, not optimised" in said
    assert said.index("sickness") < said.index("verified")
    assert (folder / "front.json").read_bytes() == before


@pytest.mark.parametrize(
    ("also", "code", "said"),
    [
        ("sicknes", 7, "Did you mean 'sickness'?"),
        ("personal_space", 8, "requires people"),
        (",", 2, "expected names separated"),
    ],
)
def test_further_criteria_that_cannot_be_are_told(run: Run, folder: Path, also: str, code: int, said: str) -> None:
    result = run("show", folder, "--also", also)
    assert result.exit_code == code
    assert said in result.stderr
