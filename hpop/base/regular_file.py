"""Regular files of bounded size: a FIFO would be waited for, /dev/zero has no end."""

from __future__ import annotations

import errno
import os
import stat
from typing import BinaryIO

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
    """The bytes of a regular file, at most ``most``, also of one that grows; raises as :func:`open_regular`."""
    data = bytearray()
    with open_regular(path, most) as file:
        while len(data) <= most and (piece := file.read(PIECE)):  # read(most) would take that much memory
            data += piece
    if len(data) > most:
        raise OSError(errno.EFBIG, f"expected at most {most:,} bytes, found more", path)
    return bytes(data)


def _without_waiting(path: str, flags: int) -> int:
    """Open as asked, without waiting for somebody to write to a FIFO."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
