"""Child process that reads a file of another program's format within limits of memory and time.

Its input is a line of JSON, ``{"module": .., "options": .., "memory": .., "seconds": ..}``, followed by the bytes of
the file. ``memory`` limits the address space, including the libraries; ``seconds`` is processor time. Its output is a
`ChildAnswer`: words and arrays of numbers, but no object that could run code.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

KINDS = ("<f8", "<i8", "|i1")
"""NumPy kinds of the arrays that may be returned."""
DISK = 1024**3
"""Largest temporary file, in bytes: some libraries unpack compressed data into one."""
MODULES = ("bag", "dxf", "pdf", "pieces")


class ChildRefused(Exception):
    """Refusal of a file that is not as expected; the text is for the user."""


class ChildAnswer(NamedTuple):
    """Contents of a file, as a child process returns them.

    words   numbers, texts, lists and mappings, as in JSON
    arrays  arrays by name
    """

    words: dict[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    def packed(self) -> bytes:
        """Return the answer as bytes: a line of JSON, followed by the bytes of the arrays."""
        header = {
            "words": self.words,
            "arrays": [[name, array.dtype.str, list(array.shape)] for name, array in self.arrays.items()],
        }
        bodies = (np.ascontiguousarray(array).tobytes() for array in self.arrays.values())
        return json.dumps(header).encode() + b"\n" + b"".join(bodies)


def unpack(data: bytes) -> ChildAnswer:
    """Return the answer from its bytes; raise `ChildRefused` for a refusal, ValueError for invalid bytes."""
    line, _, body = data.partition(b"\n")
    header = json.loads(line)
    if "refused" in header:
        raise ChildRefused(str(header["refused"]))
    arrays: dict[str, NDArray[Any]] = {}
    begin = 0
    for name, kind, shape in header["arrays"]:
        if kind not in KINDS or min(shape, default=0) < 0:
            raise ValueError(f"{kind} {shape}")
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(body, kind, count, begin).reshape(shape)
        begin += count * np.dtype(kind).itemsize
    return ChildAnswer(header["words"], arrays)


def refusal(text: str) -> bytes:
    """Return a refusal as bytes; ``text`` is for the user."""
    return json.dumps({"refused": text}).encode() + b"\n"


def set_limits(memory: int, seconds: int) -> None:
    """Limit the memory (bytes), processor time (s) and file size (`DISK`) of this process, if the system can do so."""
    try:
        import resource  # missing on some systems
    except ImportError:  # this system has no such limits
        return
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_FSIZE, DISK)):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, hard if kind == resource.RLIMIT_CPU else most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def answer_bytes(asked: dict[str, Any], data: bytes) -> bytes:
    """Return the answer to a request (see the module) about the bytes of a file as bytes, or the refusal."""
    try:
        if asked["module"] not in MODULES:
            raise ValueError(asked["module"])
        module = import_module(f"hpop.apart.{asked['module']}")
        answer: ChildAnswer = module.extract(data, asked["options"])
        return answer.packed()
    except ChildRefused as error:
        return refusal(str(error))
    except MemoryError:
        return refusal(f"reading it takes more than {asked['memory'] / 1e9:.2g} GB of memory; make it smaller")
    except Exception as error:  # libraries may raise any error on an invalid file
        return refusal(
            f"it cannot be read ({type(error).__name__}: {str(error)[:200]}); it may be damaged: export it again"
        )


def serve() -> None:
    """Read the request from standard input, write the answer, and end the process."""
    asked = json.loads(sys.stdin.buffer.readline())
    set_limits(asked["memory"], asked["seconds"])
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # so that output of a library does not get into the answer
    out.write(answer_bytes(asked, sys.stdin.buffer.read()))
    out.flush()
    os._exit(0)  # without clean-up, because a library might hang in it
