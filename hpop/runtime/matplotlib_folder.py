"""Temporary folder for Matplotlib, if the user's own folder cannot be written, as in a read-only container.

By itself, Matplotlib would make a folder in each process and print two lines about it. Here one folder is shared with
all processes that are started later. So killed processes leave no folders behind, and only one process searches for
fonts. The process that made the folder removes it. Processes that end later remove it too, since the first one may have
been killed. Each process holds a lock on the folder, which the system releases when the process ends. The lock shows
whether the folder is still needed.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

try:
    import fcntl
except ImportError:  # no such locks on this system: only the process that made the folder removes it
    fcntl = None  # type: ignore[assignment]

SHARED = "HPOP_MATPLOTLIB_FOLDER"  # environment variable with the folder made here; another MPLCONFIGDIR is kept


def provide() -> None:
    """Make a temporary folder for Matplotlib if the user's own is not writable, and set MPLCONFIGDIR to it.

    No folder is made if MPLCONFIGDIR is already set, or Matplotlib is already imported. The folder is removed when the
    process ends.
    """
    folder = os.environ.get("MPLCONFIGDIR", "")
    if not folder and "matplotlib" not in sys.modules and not _user_has_folder():
        with suppress(OSError):  # no writable folder anywhere: Matplotlib reports what it needs
            folder = os.environ["MPLCONFIGDIR"] = os.environ[SHARED] = mkdtemp(prefix="hpop-matplotlib-")
            atexit.register(_remove, folder, os.getpid())
    if folder and folder == os.environ.get(SHARED):
        _share(folder)


def forget_current_folder() -> None:
    """Undo Matplotlib's settings from a file ``matplotlibrc`` in the current folder, if PYTHONSAFEPATH is set.

    The variable says that the current folder must not be trusted. Such settings can name programs and TeX code to run,
    and Matplotlib reads them when it is imported.
    """
    if not os.environ.get("PYTHONSAFEPATH"):
        return
    import matplotlib

    if os.path.realpath(matplotlib.matplotlib_fname()) == os.path.realpath("matplotlibrc"):
        matplotlib.rcdefaults()


@cache
def _share(folder: str) -> None:
    """Lock a folder until this process ends, so that no other process removes it."""
    if fcntl is None:
        return
    with suppress(OSError):  # a file system without locks
        os.makedirs(folder, mode=0o700, exist_ok=True)  # the process that made it may have removed it
        lock = os.open(folder, os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        atexit.register(_remove, folder, os.getpid(), lock)


def _remove(folder: str, process: int, lock: int | None = None) -> None:
    """Remove a folder if this process has the id ``process``; a fork, which runs this at its end too, removes nothing.

    With ``lock``, an open file, the folder stays if another process holds the lock.
    """
    if os.getpid() == process:
        with suppress(OSError):
            if lock is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)


def _user_has_folder() -> bool:
    """Return whether Matplotlib can write or create the user's folders for its configuration and its fonts."""
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
    """Return whether a folder, or its nearest existing parent, is writable."""
    # Path.exists would raise an error in unreadable folders.
    existing = next(path for path in (folder, *folder.absolute().parents) if os.path.exists(path))
    return os.path.isdir(existing) and os.access(existing, os.W_OK | os.X_OK)
