"""What a process that reads a file says: words and arrays of numbers, no object that could run code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

KINDS = ("<f8", "<i8", "|i1")
"""Kinds of numbers that are passed on."""


class Refused(Exception):
    """A file is not what it should be; the text is for its user."""


class Answer(NamedTuple):
    """What a file holds.

    words   numbers, texts, lists and mappings, as JSON has them
    arrays  by name
    """

    words: dict[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    def packed(self) -> bytes:
        """As a line of JSON and the arrays' bytes."""
        header = {
            "words": self.words,
            "arrays": [[name, array.dtype.str, list(array.shape)] for name, array in self.arrays.items()],
        }
        bodies = (np.ascontiguousarray(array).tobytes() for array in self.arrays.values())
        return json.dumps(header).encode() + b"\n" + b"".join(bodies)


def unpacked(data: bytes) -> Answer:
    """The answer in bytes; `Refused` with the text of a refusal, ValueError for what is neither."""
    line, _, body = data.partition(b"\n")
    header = json.loads(line)
    if "refused" in header:
        raise Refused(str(header["refused"]))
    arrays: dict[str, NDArray[Any]] = {}
    begin = 0
    for name, kind, shape in header["arrays"]:
        if kind not in KINDS or min(shape, default=0) < 0:
            raise ValueError(f"{kind} {shape}")
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(body, kind, count, begin).reshape(shape)
        begin += count * np.dtype(kind).itemsize
    return Answer(header["words"], arrays)


def refusal(text: str) -> bytes:
    """A refusal in bytes."""
    return json.dumps({"refused": text}).encode() + b"\n"
