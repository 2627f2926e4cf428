"""Matplotlib's folder where the user's cannot be written, as in a container that is read-only: a temporary one.

Matplotlib would make its own and say so in two lines, each process anew. This one is shared with processes that are
started later, so none of them that is killed leaves one behind, and one of them only looks for fonts.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp

PREFIX = "hpop-matplotlib-"


def provide() -> None:
    """Before Matplotlib is imported: name a folder that it can write, and remove it when this process ends.

    So does each process that is given it: one that outlives the process that made it may have made it again.
    """
    folder = os.environ.get("MPLCONFIGDIR", "")
    if not folder and "matplotlib" not in sys.modules and not _user_has_one():
        with suppress(OSError):  # nothing can be written anywhere: Matplotlib says what it needs
            folder = os.environ["MPLCONFIGDIR"] = mkdtemp(prefix=PREFIX)
    if Path(folder).name.startswith(PREFIX):
        atexit.register(shutil.rmtree, folder, ignore_errors=True)


def _user_has_one() -> bool:
    """Whether Matplotlib can write, or make, the folders in which it keeps its configuration and its list of fonts."""
    try:
        home = Path.home()
    except RuntimeError:
        return False
    folders = [home / ".matplotlib"]
    if sys.platform.startswith(("linux", "freebsd")):
        variables = {"XDG_CONFIG_HOME": ".config", "XDG_CACHE_HOME": ".cache"}
        folders = [Path(os.environ.get(name) or home / usual, "matplotlib") for name, usual in variables.items()]
    return all(map(_can_be_written, folders))


def _can_be_written(folder: Path) -> bool:
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return there.is_dir() and os.access(there, os.W_OK)
