"""The process that reads a file of a foreign format: it bounds its own memory and time, reads, and answers.

What it is asked comes on its input: a line of JSON, ``{"module": .., "options": .., "memory": .., "seconds": ..}``, and
the file's bytes. Memory is address space, the libraries' own included; seconds are of the processor.
"""

from __future__ import annotations

import json
import os
import sys
from importlib import import_module
from typing import Any

from hpop.apart.answer import Answer, Refused, refusal

DISK = 1024**3
"""Bytes of a file that it writes: some libraries unpack what is compressed into a temporary one."""
MODULES = ("bag", "dxf", "pdf")


def bound(memory: int, seconds: int) -> None:
    """Bound the memory (bytes) and time (s) of this process, where the system can."""
    try:
        import resource
    except ImportError:  # no such limits on this system
        return
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_FSIZE, DISK)):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, hard if kind == resource.RLIMIT_CPU else most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def said(asked: dict[str, Any], data: bytes) -> bytes:
    """The answer to what is asked of a file's bytes, or the refusal, in bytes."""
    try:
        if asked["module"] not in MODULES:
            raise ValueError(asked["module"])
        module = import_module(f"hpop.apart.{asked['module']}")
        answer: Answer = module.extract(data, asked["options"])
        return answer.packed()
    except Refused as error:
        return refusal(str(error))
    except MemoryError:
        return refusal(f"it takes more than {asked['memory'] / 1e9:.2g} GB of memory to read; make it smaller")
    except Exception as error:  # of a library, on a file that may be anything
        return refusal(f"it cannot be read ({type(error).__name__}: {str(error)[:200]}); is it broken?")


def serve() -> None:
    """Read what is asked and answer; never returns."""
    asked = json.loads(sys.stdin.buffer.readline())
    bound(asked["memory"], asked["seconds"])
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no part of the answer
    out.write(said(asked, sys.stdin.buffer.read()))
    out.flush()
    os._exit(0)  # nothing is tidied: a library may hang there
