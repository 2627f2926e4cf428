"""Safe files: written completely or not at all, even if the process is killed, and read up to a bounded size.

A writer fills a hidden file beside the target. Once that file is complete and on the disk, it takes the target's place.
The writer holds a lock on the hidden file, which the system releases when the process ends. The next writer of the
target removes hidden files without a lock, which killed processes have left.

Only regular files are read, because reading a FIFO would block and /dev/zero has no end.
"""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from stat import S_ISREG
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # no such locks on this system: hidden files of killed processes stay
    fcntl = None  # type: ignore[assignment]


PARTIAL = re.compile(r"\..+\.[0-9a-f]{32}\.tmp", re.DOTALL)
"""Pattern of the names of incomplete, hidden files."""


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file for writing that replaces ``path`` at the end of the block; after an error ``path`` is unchanged.

    If ``path`` is a link, its target is replaced. Several processes may write one file at once: each writes a complete
    file, and the last one stays.

    Raises
    ------
    OSError
        If the file cannot be written, or if ``path`` is a folder, a device or a pipe; the error names ``path``.
    """
    try:
        target = _target(Path(path))
        _sweep(target)
        with _locked_file(target) as file:
            partial = Path(file.name)
            try:
                yield file
                file.flush()
                os.fsync(file.fileno())
                os.replace(partial, target)
            except BaseException:
                with suppress(OSError):
                    partial.unlink(missing_ok=True)
                raise
    except OSError as error:  # it may name the temporary file
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from None


def check_replaceable(path: str | os.PathLike[str]) -> None:
    """Raise OSError if :func:`replacing` could not write to a path.

    Hidden files that killed processes have left are removed.
    """
    target = _target(Path(path))
    _sweep(target)
    with _locked_file(target) as file:
        os.unlink(file.name)


def _target(path: Path) -> Path:
    """Return the path that is written, with links resolved; OSError if it is a folder, a device, a pipe or a socket."""
    if not path.name or path.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not S_ISREG(path.stat().st_mode):
        raise OSError(errno.EEXIST, "expected a file or a free path, found a device, a pipe or a socket")
    return Path(os.path.realpath(path))


def _locked_file(target: Path) -> BinaryIO:
    """Return a new hidden file beside a target file, locked by this writer."""
    while True:
        file = target.with_name(f".{target.name}.{os.urandom(16).hex()}.tmp").open("xb")
        _lock(file)
        if os.fstat(file.fileno()).st_nlink:
            return file
        file.close()  # another writer removed the file before it was locked: try again


def sweep(folder: Path, begins: str = ".") -> None:
    """Remove hidden files that killed processes have left in a folder; their names begin with ``begins``."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            is_partial = PARTIAL.fullmatch(entry.name) and entry.name.startswith(begins)
            if is_partial and entry.is_file(follow_symlinks=False):
                with suppress(OSError), open(entry.path, "rb") as file:
                    if _lock(file, wait=False):
                        os.unlink(entry.path)


def _sweep(target: Path) -> None:
    """Remove hidden files that killed writers of a target file have left."""
    sweep(target.parent, f".{target.name}.")


def _lock(file: BinaryIO, *, wait: bool = True) -> bool:
    """Lock a file until it is closed; return whether this process now holds the lock.

    Without ``wait``, return False at once if another process holds it. On a system without such locks, return False.
    """
    if fcntl is None:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
"""Things other than regular files that can be opened, in words."""
PIECE = 2**20
"""Number of bytes that are read at a time."""


def open_regular(path: str | os.PathLike[str], most: int) -> BinaryIO:
    """Open a regular file of at most ``most`` bytes for reading.

    The open file itself is checked, so it cannot be replaced between the check and the read. For anything else, and for
    an impossible path, raise OSError, whose ``strerror`` says what was found.
    """
    try:
        file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115  # the caller's ``with``
    except IsADirectoryError:
        raise OSError(errno.EISDIR, "expected a regular file, found a folder", path) from None
    except ValueError as error:  # a null byte, or half of a surrogate pair
        raise OSError(errno.EINVAL, f"this cannot be the path of a file ({error})", path) from None
    try:
        info = os.fstat(file.fileno())
        if not stat.S_ISREG(info.st_mode):
            kind = KINDS.get(stat.S_IFMT(info.st_mode), "something else")
            raise OSError(errno.EINVAL, f"expected a regular file, found {kind}", path)
        if info.st_size > most:
            raise OSError(errno.EFBIG, f"expected at most {most:,} bytes, found {info.st_size:,}", path)
    except OSError:
        file.close()
        raise
    return file


def read_regular(path: str | os.PathLike[str], most: int) -> bytes:
    """Return the bytes of a regular file of at most ``most`` bytes; the limit holds even if the file grows meanwhile.

    Raises the errors of :func:`open_regular`.
    """
    data = bytearray()
    with open_regular(path, most) as file:
        while len(data) <= most and (piece := file.read(PIECE)):  # read(most) would take that much memory
            data += piece
    if len(data) > most:
        raise OSError(errno.EFBIG, f"expected at most {most:,} bytes, found more", path)
    return bytes(data)


def _without_waiting(path: str, flags: int) -> int:
    """Open a file with some flags of the system, without waiting for a writer if it is a FIFO."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
