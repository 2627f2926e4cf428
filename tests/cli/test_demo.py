"""``hpop demo``: what comes with hpop, copied to a folder and planned; and completion of it all in the shell."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import hpop
from hpop.cli import main
from hpop.errors import OutputError, UnknownName
from hpop.examples import HERE, SCENARIOS
from hpop.scenario import load_scenario
from tests.warm import Warm


def demo(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["demo", *map(str, arguments)])


@pytest.mark.parametrize("name", SCENARIOS)
def test_each_example_is_a_scenario_that_needs_no_other_files(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(hpop.examples.copied(name, tmp_path / "new" / "folder"))
    assert scenario.path.parent == tmp_path / "new" / "folder"
    assert scenario.planners
    assert hpop.examples.copied(name, scenario.path.parent) == scenario.path  # again


def test_the_museum_is_the_demos_problem() -> None:
    museum, scenario = hpop.examples.museum(), load_scenario(hpop.examples.path("museum.yaml"))
    assert museum.describe() == scenario.problem.describe()


def test_work_of_ones_own_is_not_overwritten(tmp_path: Path) -> None:
    own = hpop.examples.copied("museum", tmp_path)
    own.write_text(own.read_text().replace("0.25", "0.5"))
    refused = demo("museum", "--out", tmp_path)
    assert refused.exit_code == OutputError.exit_code
    assert (
        f"{own} exists and differs from the example, so it is not overwritten; choose another folder" in refused.stderr
    )
    assert "0.5" in own.read_text()


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["muesum"], 2, "'muesum' is not one of 'arm_shelf', 'live', 'mobile_arm', 'museum', 'museum_planners'"),
        (["--out", ""], 2, "the current folder is '.'"),
        (["--out", HERE / "museum.yaml"], 12, "cannot write to"),
    ],
)
def test_what_cannot_be_is_refused(arguments: list[object], code: int, said: str) -> None:
    refused = demo(*arguments)
    assert (refused.exit_code, said in refused.stderr) == (code, True), refused.stderr


def test_an_unknown_file_of_the_examples_is_told_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match=r"Did you mean 'museum\.geojson'\?"):
        hpop.examples.path("musem.geojson")
    with pytest.raises(UnknownName, match=r"Did you mean 'museum'\?"):
        hpop.examples.copied("muesum", Path(os.devnull))


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("shell", "words"), [("bash", "complete -o nosort"), ("zsh", "#compdef hpop"), ("fish", "complete")]
)
def test_shells_are_given_what_completes_the_command(warm: Warm, tmp_path: Path, shell: str, words: str) -> None:
    code = "import sys; sys.argv[0] = 'hpop'; from hpop.entry import main; main()"
    given = warm.run(cwd=tmp_path, code=code, environment={"_HPOP_COMPLETE": f"{shell}_source"})
    assert given.returncode == 0, given.stderr
    assert words in given.stdout
    asked = {"_HPOP_COMPLETE": f"{shell}_complete", "COMP_WORDS": "hpop demo mus", "COMP_CWORD": "2"}
    named = warm.run(cwd=tmp_path, code=code, environment=asked | {"COMP_CWORD": "mus" if shell == "fish" else "2"})
    assert "museum_planners" in named.stdout, named.stderr
    assert "arm_shelf" not in named.stdout
