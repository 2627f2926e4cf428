"""Files: replaced whole or not at all, also where the writer is killed, and read up to a bounded size.

A writer fills a hidden file beside the target. Once that file is whole and on the disk, it takes the target's place.
The writer holds a lock on the hidden file, which the system releases when the writer dies. The next writer of the
target removes the hidden files that have no lock.

Only regular files are read: reading a FIFO would block, and /dev/zero has no end.
"""

from __future__ import annotations

import errno
import os
import re
import stat
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from stat import S_ISREG
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # no such locks on this system: what dead writers left stays
    fcntl = None  # type: ignore[assignment]


PARTIAL = re.compile(r"\..+\.[0-9a-f]{32}\.tmp", re.DOTALL)
"""Names of files that are not whole yet."""


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file that replaces ``path`` at the end of the block; after any error ``path`` is as it was.

    A link stays one: what it leads to is replaced.

    Several may write the same file at once: each is whole, and the last one stays.

    Raises
    ------
    OSError
        If it cannot be written, or something is there that is no file, such as a device or a pipe, whose place a file
        must not take; the error names ``path``.
    """
    asked = Path(path)
    try:
        target = _place(asked)
        _sweep(target)
        with _locked(target) as file:
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
        raise OSError(error.errno, error.strerror or str(error), str(asked)) from None


def check_replaceable(path: str | os.PathLike[str]) -> None:
    """Raise OSError where :func:`replacing` could not write; nothing is left behind, nor what dead writers left."""
    target = _place(Path(path))
    _sweep(target)
    with _locked(target) as file:
        os.unlink(file.name)


def _place(target: Path) -> Path:
    """Return where a file is written, links followed; OSError where a folder, a device, a pipe or a socket is there."""
    if not target.name or target.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if target.exists() and not S_ISREG(target.stat().st_mode):
        raise OSError(errno.EEXIST, "A device, a pipe or a socket is there")
    return Path(os.path.realpath(target))


def _locked(target: Path) -> BinaryIO:
    """Return a new file beside another, held by this writer."""
    while True:
        file = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp").open("xb")
        _hold(file)
        if os.fstat(file.fileno()).st_nlink:
            return file
        file.close()  # swept by another writer before it was held


def sweep(folder: Path, begins: str = ".") -> None:
    """Remove what dead writers left in a folder of the files whose hidden names begin so."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            is_partial = PARTIAL.fullmatch(entry.name) and entry.name.startswith(begins)
            if is_partial and entry.is_file(follow_symlinks=False):
                with suppress(OSError), open(entry.path, "rb") as file:
                    if _hold(file, wait=False):
                        os.unlink(entry.path)


def _sweep(target: Path) -> None:
    """Remove what dead writers of a file left."""
    sweep(target.parent, f".{target.name}.")


def _hold(file: BinaryIO, *, wait: bool = True) -> bool:
    """Hold a file until it is closed; False where another does and there is no waiting, or where none can be held."""
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
"""What else may be opened."""
PIECE = 2**20
"""Bytes that are read at once."""


def open_regular(path: str | os.PathLike[str], most: int) -> BinaryIO:
    """Open a regular file of at most ``most`` bytes for reading; it is looked at when open, so nothing can change it.

    Raises OSError, whose ``strerror`` says what lies there instead; also for what no path can be.
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
    """Return the bytes of a regular file, at most ``most``, also of one that grows; raises as :func:`open_regular`."""
    data = bytearray()
    with open_regular(path, most) as file:
        while len(data) <= most and (piece := file.read(PIECE)):  # read(most) would take that much memory
            data += piece
    if len(data) > most:
        raise OSError(errno.EFBIG, f"expected at most {most:,} bytes, found more", path)
    return bytes(data)


def _without_waiting(path: str, flags: int) -> int:
    """Open a file with these flags, without waiting for a writer if it is a FIFO."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
