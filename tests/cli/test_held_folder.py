"""Claims: one plan at a time writes to a folder; a second one is told who does, and a dead one holds nothing."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE, Popen

import pytest
from click.testing import Result

from hpop.cli import results
from hpop.errors import OutputError

HOLD = (
    "import sys, pathlib; from hpop.cli import results\nwith results.held(pathlib.Path(sys.argv[1])): print(); input()"
)


def test_a_second_plan_into_a_folder_is_refused_by_the_process_that_writes_there(
    plan: Callable[..., Result], room: Path, no_pictures: None
) -> None:
    with results.held(room / "out"):
        result = plan(room)
        assert result.exit_code == 12
        assert f"another `hpop plan` (process {os.getpid()}) is writing to" in result.stderr
        assert "choose another --out" in result.stderr
        assert not any((room / "out").iterdir())
    assert plan(room).exit_code == 0
    assert plan(room).exit_code == 0  # over what an earlier plan left


def test_a_killed_process_holds_no_folder_and_says_its_number_until_then(tmp_path: Path) -> None:
    process = Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdin=PIPE, stdout=PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    with pytest.raises(OutputError, match=f"process {process.pid}"), results.held(tmp_path):
        pass
    process.kill()
    process.communicate()
    with results.held(tmp_path):
        pass


def test_a_folder_that_was_made_and_stayed_empty_is_removed(tmp_path: Path) -> None:
    with results.held(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").is_dir()
    assert not any(tmp_path.iterdir())
