"""A temporary folder for Matplotlib where the user's cannot be written, as in a read-only container.

Matplotlib would make a folder of its own in each process, and print two lines about it. This one is shared with all
processes that are started later, so that killed processes leave no folders behind and only one searches for fonts. The
process that made the folder removes it; so do processes that outlive it, since the maker may have been killed. Each
holds a lock on the folder, which the system releases when the process dies: the lock shows whether the folder is
needed.
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
except ImportError:  # no such locks on this system: only the folder's maker removes it
    fcntl = None  # type: ignore[assignment]

SHARED = "HPOP_MATPLOTLIB_FOLDER"  # names a folder made here; any other MPLCONFIGDIR is the user's, and stays


def provide() -> None:
    """Name a folder that Matplotlib can write, before it is imported, and remove the folder at the end."""
    folder = os.environ.get("MPLCONFIGDIR", "")
    if not folder and "matplotlib" not in sys.modules and not _user_has_folder():
        with suppress(OSError):  # no writable folder anywhere: Matplotlib reports what it needs
            folder = os.environ["MPLCONFIGDIR"] = os.environ[SHARED] = mkdtemp(prefix="hpop-matplotlib-")
            atexit.register(_remove, folder, os.getpid())
    if folder and folder == os.environ.get(SHARED):
        _share(folder)


def forget_current_folder() -> None:
    """Undo the settings of a ``matplotlibrc`` in the current folder where Python is told not to trust that folder.

    Such settings name programs and TeX code to run, and Matplotlib reads them when it is imported.
    """
    if not os.environ.get("PYTHONSAFEPATH"):
        return
    import matplotlib

    if os.path.realpath(matplotlib.matplotlib_fname()) == os.path.realpath("matplotlibrc"):
        matplotlib.rcdefaults()


@cache
def _share(folder: str) -> None:
    """Lock a folder, so that other processes keep it, until this process ends."""
    if fcntl is None:
        return
    with suppress(OSError):  # a file system without locks
        os.makedirs(folder, mode=0o700, exist_ok=True)  # its maker may have ended
        lock = os.open(folder, os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        atexit.register(_remove, folder, os.getpid(), lock)


def _remove(folder: str, process: int, lock: int | None = None) -> None:
    """Remove a folder at the end of this process, but not of its forks.

    With ``lock``, only if no other process holds it.
    """
    if os.getpid() == process:
        with suppress(OSError):
            if lock is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)


def _user_has_folder() -> bool:
    """Return whether Matplotlib can write, or create, its folders of configuration and fonts."""
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
    """Return whether the nearest existing parent is writable; ``Path.exists`` raises in unreadable folders."""
    existing = next(path for path in (folder, *folder.absolute().parents) if os.path.exists(path))
    return os.path.isdir(existing) and os.access(existing, os.W_OK | os.X_OK)
