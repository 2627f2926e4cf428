"""Pictures where the user's home cannot be written: a container that is read-only, for a user without a home."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hpop.runtime import matplotlib_folder

USE = """\
from pathlib import Path
from hpop.cli.beside import PicturesBeside
with PicturesBeside(Path()) as pictures:
    pictures.start()
import hpop.view
print(*(path.name for path in Path().glob("*/*")))
"""

PROVIDED = "import os, subprocess, sys; from hpop.runtime import matplotlib_folder; matplotlib_folder.provide(); "
SHORT = f"""\
{PROVIDED}
subprocess.run([sys.executable, "-P", "-c", {PROVIDED!r}], check=True)
if os.fork() == 0:
    sys.exit()
os.wait()
print(os.path.isdir(os.environ["MPLCONFIGDIR"]))
"""
OUTLIVING = f"""\
{PROVIDED}
print("begun", flush=True)
sys.stdin.read()
os.makedirs(os.environ["MPLCONFIGDIR"], exist_ok=True)  # as Matplotlib does
"""
OUTLIVED = f"""\
{PROVIDED}
import signal
signal.signal(signal.SIGTERM, lambda *_: sys.exit())
subprocess.Popen([sys.executable, "-P", "-c", {OUTLIVING!r}])
sys.stdin.read()
"""


@pytest.fixture
def nowhere(tmp_path: Path) -> dict[str, str]:
    """Give an environment whose home lies below a file, where root can make no folder either."""
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    usual = ("MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME")
    environment = {key: value for key, value in os.environ.items() if key not in usual}
    return environment | {"HOME": str(tmp_path / "file" / "home"), "TMPDIR": str(tmp_path / "temporary")}


@pytest.mark.proof
def test_matplotlib_is_silent_and_all_its_processes_share_a_folder_that_is_removed(nowhere: dict[str, str]) -> None:
    folder = Path(nowhere["TMPDIR"])
    command = [sys.executable, "-P", "-c", USE]
    done = subprocess.run(command, cwd=folder, env=nowhere, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    (fonts,) = done.stdout.split()
    assert fonts.startswith("fontlist")
    assert list(folder.iterdir()) == []


def test_a_process_that_ends_leaves_the_folder_to_the_one_that_began_it(nowhere: dict[str, str]) -> None:
    command = [sys.executable, "-P", "-c", SHORT]
    done = subprocess.run(command, env=nowhere, capture_output=True, text=True)
    assert (done.stderr, done.stdout) == ("", "True\n")
    assert os.listdir(nowhere["TMPDIR"]) == []


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM], ids=["killed", "ended"])
def test_a_process_that_outlives_the_one_that_made_the_folder_removes_it(
    nowhere: dict[str, str], ending: signal.Signals
) -> None:
    """It ends with its input, which it shares with the one that made the folder."""
    command = [sys.executable, "-P", "-c", OUTLIVED]
    with subprocess.Popen(command, env=nowhere, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as maker:
        assert maker.stdout is not None
        assert maker.stdout.readline() == b"begun\n"
        maker.send_signal(ending)
        maker.wait()
        assert len(os.listdir(nowhere["TMPDIR"])) == (ending == signal.SIGKILL)
        maker.communicate()
    assert os.listdir(nowhere["TMPDIR"]) == []


@pytest.mark.parametrize("name", ["hpop-matplotlib-mine", "mine"])
def test_a_folder_of_the_user_stays_whatever_its_name(nowhere: dict[str, str], tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "matplotlibrc").touch()
    own = {"MPLCONFIGDIR": str(tmp_path / name)}
    subprocess.run([sys.executable, "-P", "-c", PROVIDED], env=nowhere | own, check=True)
    assert os.listdir(tmp_path / name) == ["matplotlibrc"]
    assert os.listdir(nowhere["TMPDIR"]) == []


def test_a_home_that_may_not_be_looked_into_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of root, for another user in a container."""
    closed = tmp_path / "closed"
    (closed / "home").mkdir(parents=True)
    monkeypatch.setenv("HOME", str(closed / "home"))
    for name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert matplotlib_folder._user_has_folder()
    closed.chmod(0)
    try:
        with _no_root():
            with pytest.raises(PermissionError):
                (closed / "home").stat()
            assert not matplotlib_folder._user_has_folder()
    finally:
        closed.chmod(0o700)


@contextmanager
def _no_root() -> Iterator[None]:
    """Be a user who may not look into each folder."""
    if os.geteuid() != 0:
        yield
        return
    os.setresuid(65534, 65534, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)


@pytest.mark.parametrize("below", ["", "hpop-matplotlib-", "file", "file/deep/below"])
def test_a_folder_can_be_written_where_the_nearest_that_exists_can(tmp_path: Path, below: str) -> None:
    (tmp_path / "file").touch()
    assert matplotlib_folder._can_be_written(tmp_path / below) is not below.startswith("file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
