"""Pictures where the user's home cannot be written: a container that is read-only, for a user without a home."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hpop import matplotlib_folder

USE = """\
from pathlib import Path
from hpop.pictures import PicturesBeside
with PicturesBeside(Path()) as pictures:
    pictures.start()
import hpop.view
print(*(path.name for path in Path().glob("*/*")))
"""


@pytest.fixture
def nowhere(tmp_path: Path) -> dict[str, str]:
    """Give an environment whose home lies below a file, where root can make no folder either."""
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    usual = ("MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME")
    environment = {key: value for key, value in os.environ.items() if key not in usual}
    return environment | {"HOME": str(tmp_path / "file" / "home"), "TMPDIR": str(tmp_path / "temporary")}


def test_matplotlib_is_silent_and_all_its_processes_share_a_folder_that_is_removed(nowhere: dict[str, str]) -> None:
    folder = Path(nowhere["TMPDIR"])
    command = [sys.executable, "-P", "-c", USE]
    done = subprocess.run(command, cwd=folder, env=nowhere, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    (fonts,) = done.stdout.split()
    assert fonts.startswith("fontlist")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("below", ["", "hpop-matplotlib-", "file", "file/deep/below"])
def test_a_folder_can_be_written_where_the_nearest_that_exists_can(tmp_path: Path, below: str) -> None:
    (tmp_path / "file").touch()
    assert matplotlib_folder._can_be_written(tmp_path / below) is not below.startswith("file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
