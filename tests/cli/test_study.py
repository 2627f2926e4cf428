"""`hpop study`: a study from its first command to its tables, as a researcher types it; mistakes end in one message."""

from __future__ import annotations

import socket
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
import shapely
from click.testing import CliRunner, Result

import hpop
from hpop.cli import main
from hpop.study import Design
from tests.study.sessions import answered

Study = Callable[..., Result]


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a front, as `hpop plan` writes it."""
    folder = tmp_path_factory.mktemp("planned")
    world = hpop.World.from_polygons([shapely.box(2, 1, 3, 3)], extent=shapely.box(0, 0, 5, 4))
    robot = hpop.DifferentialDrive(radius=0.2)
    problem = hpop.Problem(world, robot, (0.5, 2, 0), (4.5, 2, None), ["exposure", "turns", "length"])
    problem.solve(step=0.5).save(folder / "front.json")
    return folder


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Study:
    """Run a command in a folder of its own, in which a text of consent lies."""
    monkeypatch.chdir(tmp_path)
    Path("consent.txt").write_text("You ride along with a robot, and may stop at any time.\n")

    def run(*given: object) -> Result:
        return CliRunner().invoke(main, ["study", *map(str, given)])

    return run


def test_from_the_front_to_the_tables_and_without_whoever_withdrew(study: Study, planned: Path) -> None:
    """init, answers, check, score, withdraw, score."""
    options = ["--rows", "knee,least turns", "--count", 3, "--participants", 12, "--strata", "sex=f,m", "--seed", 7]
    begun = study("init", "s", "--front", planned, *options, "--consent", "consent.txt")
    assert begun.exit_code == 0, begun.output
    assert "12 participants, 6 orders of 3 stimuli" in begun.output
    design = Design.load("s")
    assert {condition.name for condition in design.conditions} == {"knee", "least turns", ""}

    people = [person.id for person in design.participants]
    answered(design, Path("s"), people, lambda who, place, form, item: float(who == "p07" and item == "nausea"))
    checked = study("check", "s")
    assert checked.exit_code == 0, checked.output
    assert "note: 12 of 12 sessions are complete" in checked.output
    assert checked.output.endswith("no faults\n")

    scored = study("score", "s")
    assert scored.exit_code == 0, scored.output
    lines = [line.split() for line in scored.output.splitlines()]
    assert ["ssq", "total", *["0.00", "(n", "12)"] * 4] in lines
    assert not [one for one in design.conditions if str(one) in scored.output]  # in mid-study all stay blind
    assert "s/design.json says which letter is which row" in scored.output
    assert totals() == (12, 29.92)  # nausea 1 is in N and in D: 2 x 3.74, before and after each of three

    unsure = study("withdraw", "s", "p07")  # nobody is there to be asked
    assert unsure.exit_code == 17
    assert "give --yes to delete all data of p07" in unsure.output
    assert Path("s/answers/p07.json").exists()
    gone = study("withdraw", "s", "p07", "--yes")
    assert gone.exit_code == 0, gone.output
    assert "removed: answers/p07.json, pages/p07.html" in gone.output
    assert "p13 takes the place" in gone.output
    again = study("score", "s")
    assert again.exit_code == 0, again.output
    assert "11 of 12 sessions are complete" in again.output
    assert totals() == (11, 0.0)


def totals() -> tuple[int, float]:
    """Return the number of participants with SSQ totals, and the sum of the totals."""
    with sqlite3.connect("s/answers.sqlite") as base:
        found = base.execute(
            "SELECT count(DISTINCT participant), sum(value) FROM scores WHERE score = 'total'"
        ).fetchone()
    base.close()
    return found[0], round(found[1], 6)


@pytest.mark.proof
def test_a_report_is_written_beside_the_answers(study: Study, planned: Path) -> None:
    begun = study("init", "s", "--front", planned, "--participants", 6, "--consent", "consent.txt")
    assert begun.exit_code == 0, begun.output
    design = Design.load("s")
    people = [person.id for person in design.participants]
    answered(design, Path("s"), people, lambda who, place, form, item: float(int(who[1:]) * place % 4))
    reported = study("report", "s", "--score", "ssq.N", "--method", "paper")
    assert reported.exit_code == 0, reported.output
    assert "written: s/report/report.html" in reported.output
    assert Path("s/report/report.html").is_file()
    planned_before = study("preregister", "s", "--method", "mixed")
    assert planned_before.exit_code == 0
    assert f"SHA-256 {design.digest}" in planned_before.output
    misspelt = study("report", "s", "--method", "papre")
    assert misspelt.exit_code == 17
    assert "Did you mean 'paper'" in misspelt.output
    assert study("report", "s", "--score", "ssq").exit_code == 2


def test_a_study_with_faults_ends_with_its_exit_code(study: Study, planned: Path) -> None:
    assert study("init", "s", "--front", planned, "--participants", 6, "--consent", "consent.txt").exit_code == 0
    Path("s/answers/p01.json").write_text("{}")
    done = study("check", "s")
    assert done.exit_code == 17
    assert "fault: s/answers/p01.json: expected the answers of a participant" in done.output
    assert done.output.endswith("error: s has 1 fault\n")
    assert study("score", "s").exit_code == 17
    dropped = study("replace", "s", "p02")
    assert dropped.exit_code == 0, dropped.output
    assert "p02 dropped out; p07 takes the place" in dropped.output


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--rows", "knee,lest turns"], 7, "Did you mean 'least turns'"),
        (["--rows", "knee,99"], 10, "no row 99"),
        (["--rows", "knee"], 17, "shows 2 to 26 stimuli"),
        (["--count", "27"], 17, "count must be"),
        (["--count", "4", "--share", "0.001"], 17, "allow a larger share"),
        (["--participants", "7"], 17, "multiple of 6 participants, got 7: take 6 or 12"),
        (["--order", "latn"], 17, "Did you mean 'latin'"),
        (["--consent", "empty.txt"], 17, "the consent text is empty"),
        (["--consent", "nowhere.txt"], 17, "cannot read the consent text nowhere.txt: No such file"),
        (["--consent", "latin1.txt"], 17, "the consent text must be UTF-8"),
        (["--consent", "steers.txt"], 17, r"control character, '\x1b'"),
        (["--forms", "sqq"], 17, "Did you mean 'ssq'"),
        (["--strata", "sex=f"], 17, "two or more levels"),
        (["--strata", "sex"], 2, "expected NAME=LEVEL,LEVEL"),
        (["--front", "nowhere"], 12, "cannot read nowhere"),
        (["--language", "xx"], 17, "without texts in 'xx'"),
        (["--rest", "-1"], 17, "rest_s must be"),
        (["--rows", "knee,view", "--share", "0.1"], 2, "give --count as well"),
        (["--rows", "knee,view", "--count", "1"], 2, "expected 2 or more, got 1"),
        (["--count", "0"], 2, "expected 2 or more, got 0"),
        (["--rows", "knee,view,view"], 17, "the still view is named more than once"),
        (["--words", "nowhere.json"], 17, "give a translation of"),
        (["--words", "empty.txt"], 17, "empty.txt: expected texts as JSON"),
        (
            ["--language", "fr", "--words", "stop.json"],
            17,
            "without texts in 'fr': ssq (but in de, en, fi), comfort (but in de, en, fi), preference (but in de, en, "
            "fi); translate the file "
            "of each, and give the path of the translation; and stop.json lacks the texts agree, ",
        ),
    ],
)
def test_a_mistake_is_one_message_and_leaves_nothing(
    study: Study, planned: Path, options: list[str], code: int, said: str
) -> None:
    for name, data in {"empty": b" \n", "latin1": b"caf\xe9", "steers": b"Yes \x1b[2J"}.items():
        Path(f"{name}.txt").write_bytes(data)
    Path("stop.json").write_text('{"stop": "Halt"}')
    before = sorted(Path().iterdir())
    given = {"--front": planned, "--participants": 6, "--consent": "consent.txt"} | {
        options[i]: options[i + 1] for i in range(0, len(options), 2)
    }
    done = study("init", "s", *[part for pair in given.items() for part in pair])
    assert done.exit_code == code, done.output
    assert said in done.output
    assert "Traceback" not in done.output
    assert "\x1b" not in done.output
    assert sorted(Path().iterdir()) == before


def test_a_folder_that_is_no_study_is_said_by_every_command(study: Study) -> None:
    for command in (["check"], ["score"], ["report"], ["serve"], ["withdraw"], ["replace"], ["power", "--pilot"]):
        who = ["p01"] if command[0] in ("withdraw", "replace") else []
        done = study(*command, "nowhere", *who)
        assert done.exit_code == 17
        assert "nowhere is not the folder of a study: expected design.json in it; give the folder" in done.output
    assert not Path("nowhere").exists()


def test_tables_and_reports_of_a_study_whose_front_changed_do_not_pass_for_whole(study: Study, planned: Path) -> None:
    begun = ["--rows", "knee,least turns", "--participants", 2, "--consent", "consent.txt", "--forms", "comfort"]
    assert study("init", "s", "--front", planned, *begun).exit_code == 0
    answered(Design.load("s"), Path("s"), ["p01", "p02"])
    hpop.Front.load("s/front.json")[1:].save("s/front.json")
    for command in (["score"], ["report", "--score", "comfort.comfort"]):
        done = study(command[0], "s", *command[1:])
        assert done.exit_code == 17
        assert "has changed since the study began" in done.output


def test_power_is_asked_before_a_study_and_never_after(study: Study) -> None:
    done = study("power", "--effect", "0.5", "--people", 35, "--stimuli", 2)
    assert done.exit_code == 0, done.output
    assert done.output.startswith("With 35 people the Wilcoxon test finds the difference")
    observed = study("power", "--effect", "observed", "--people", 35)
    assert observed.exit_code == 17
    assert "observed power is not given" in observed.output
    for wrong, said in {
        "": "give either --effect or --pilot",
        "--effect some": "expected a number, or numbers between commas",
        "--effect 0": "means no difference, which no study can find",
        "--effect 1,1,1": "means no difference",
        "--effect 0,1 --stimuli 3": "or several numbers, set it already",
        "--effect 1 --score ssq.total": "--score only with --pilot",
        "--pilot s --correlation 0.5": "give --correlation only with --effect",
    }.items():
        done = study("power", *wrong.split())
        assert (done.exit_code, said in done.output) == (2, True), done.output


def test_what_commands_do_is_said_whole(study: Study) -> None:
    assert "..." not in study("--help").output.partition("Commands:")[2]


def test_serve_says_where_and_what_cannot_be_served_is_told(study: Study, planned: Path) -> None:
    study(
        "init", "s", "--front", planned, "--rows", "knee,least turns", "--participants", 2, "--consent", "consent.txt"
    )
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = study("serve", "s", "--port", other.getsockname()[1])
    assert (taken.exit_code, "choose another --port" in taken.output) == (12, True)
    assert "Traceback" not in study("serve", "nowhere").output
    assert study("serve", "nowhere").exit_code == 17
    assert not Path("nowhere").exists()
    Path("s/stimuli/A.html").unlink()
    gone = study("serve", "s", "--port", 0)
    assert (gone.exit_code, "write the stimuli again" in gone.output) == (17, True)


def test_tasks_and_factors_of_a_new_study(study: Study, planned: Path) -> None:
    """A file of tasks and levels of factors become part of the design; mistakes in them are named."""
    options = [
        "--front",
        planned,
        "--rows",
        "knee",
        "--participants",
        4,
        "--order",
        "williams",
        "--consent",
        "consent.txt",
    ]
    Path("tasks.yaml").write_text("head:\ncounting: {least: 1, most: 2}\n")
    begun = study("init", "s", *options, "--tasks", "tasks.yaml", "--factor", "latency=0,0.5", "--factor", "cue=none,2")
    assert begun.exit_code == 0, begun.output
    design = Design.load("s")
    assert set(design.protocol.options) == {"head", "counting"}
    assert {(one.factors["latency"], one.factors["cue"]) for one in design.conditions} == {
        (late, cue) for late in (0.0, 0.5) for cue in (None, 2.0)
    }
    Path("tasks.yaml").write_text("head: {rat: 30}\n")
    wrong = study("init", "t", *options, "--tasks", "tasks.yaml")
    assert "each option of tasks.head must be one of rate, got 'rat'. Did you mean 'rate'?" in wrong.output
    assert "no such file" in study("init", "t", *options, "--tasks", "task.yaml").output.lower()
    assert "Did you mean 'latency'?" in study("init", "t", *options, "--factor", "latncy=0,1").output
    assert not Path("t").exists()
