"""Files that appear whole or not at all, also where the writer is killed.

What is written lies beside the file, hidden, until it is whole and on the disk; then it takes the file's place. Its
writer holds a lock on it, which the system lets go of when the writer dies, however it dies. So what nobody holds is
what a dead writer left, and the next one to write the file removes it.
"""

from __future__ import annotations

import errno
import os
import re
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
    """A file to write into, which at the end takes the place of ``path``; after any error ``path`` is as it was.

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
    """Where a file is written, links followed; OSError where a folder, a device, a pipe or a socket is there."""
    if not target.name or target.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if target.exists() and not S_ISREG(target.stat().st_mode):
        raise OSError(errno.EEXIST, "A device, a pipe or a socket is there")
    return Path(os.path.realpath(target))


def _locked(target: Path) -> BinaryIO:
    """A new file beside another, held by this writer."""
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
