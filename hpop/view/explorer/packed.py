"""Many numbers in little text: whole numbers taken apart into differences, all in one zlib stream, in base64.

A part holds the lowest bytes of all its numbers, then the next ones, and so on (little-endian): the upper bytes of
numbers that are near each other are alike, and a deflate stream says that once. ``order`` says how many times a reader
sums up what it finds, in the width of the numbers, so that what wrapped here wraps back there.
"""

from __future__ import annotations

import base64
import zlib
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Kind = Literal["int32", "int16", "float64"]
Part = tuple[Kind, int, int, int]
"""What a payload says of a part: kind, where it begins, bytes, how many numbers, and ``order``."""
LEVEL = 9  # of 9; a tenth of a second for a front of thousands


class Packer:
    """Collects columns of numbers; each is described by where it is in the stream."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def integers(self, values: ArrayLike, *, order: int = 0) -> Part:
        """Whole numbers (N,) within 32 bits, differenced so many times."""
        return self._added("int32", _differences(values, order), order)

    def short(self, values: ArrayLike) -> Part:
        """Whole numbers (N,) within 16 bits."""
        return self._added("int16", values, 0)

    def floats(self, values: ArrayLike) -> Part:
        """Floats (N,), bit for bit."""
        return self._added("float64", values, 0)

    def text(self) -> str:
        """All that was packed."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), LEVEL)).decode()

    def _added(self, kind: Kind, values: ArrayLike, order: int) -> Part:
        data = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
        planes: NDArray[np.uint8] = data.view(np.uint8).reshape(data.size, data.itemsize).T
        part = (kind, self._size, data.size, order)
        self._parts.append(planes.tobytes())
        self._size += data.nbytes
        return part


def _differences(values: ArrayLike, order: int) -> NDArray[np.int32]:
    """Differences from each to the next, the first from 0, taken so many times; modulo 2**32."""
    found = np.asarray(values, dtype=np.int64)
    for _ in range(order):
        found = np.diff(found, prepend=0)
    return found.astype(np.uint32).view(np.int32)
