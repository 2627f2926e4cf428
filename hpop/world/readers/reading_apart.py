"""Files of foreign formats are read in another process, which may crash, hang or hoard without harm to this one."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

from hpop.apart.answer import Answer, Refused, unpacked
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import READING
from hpop.world.files import named

CODE = "from hpop.apart.child import serve; serve()"
MEMORY = 2 * 10**9
"""Bytes of address space that reading takes, at most."""
SECONDS = 60
"""Processor seconds that reading takes, at most."""
POLL = 0.05
"""Seconds between two looks at the limits."""
WAITS = 10 * SECONDS
"""Seconds until a process is given up that takes none of the processor's."""
STAYS = 8
"""Bytes for each of an answer: its geometries."""


def extract(module: str, path: str | Path, data: bytes, options: dict[str, Any]) -> Answer:
    """What a module of `hpop.apart` finds in a file's bytes; `MapError` says what is wrong with the file.

    Limits of whoever plans are looked at meanwhile, and end the process when they are passed.
    """
    asked = {"module": module, "options": options, "memory": MEMORY, "seconds": SECONDS}
    said = _said(asked, data, path)
    try:
        answer = unpacked(said)
    except Refused as refused:
        raise MapError(f"{named(path)}: {refused}.") from None
    except (ValueError, KeyError, TypeError):
        raise MapError(f"{named(path)} cannot be read: the process that reads it gave no answer.") from None
    limits.hold(READING, STAYS * len(said))
    return answer


def _said(asked: dict[str, Any], data: bytes, path: str | Path) -> bytes:
    """What the process answers, `hpop.apart.child.said` within bounds."""
    with TemporaryDirectory(prefix="hpop-") as folder:
        question = Path(folder) / "asked"  # a pipe would have to be fed while the limits are looked at
        question.write_bytes(json.dumps(asked).encode() + b"\n" + data)
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "TMPDIR": folder}
        with question.open("rb") as stdin, interrupts_held():
            # A session of its own: Ctrl-C on the terminal is not meant for it.
            process = Popen(
                [sys.executable, "-P", "-c", CODE],
                stdin=stdin,
                stdout=PIPE,
                stderr=DEVNULL,
                env=environment,
                start_new_session=True,
            )
        try:
            end = monotonic() + WAITS
            while True:
                try:
                    said, _ = process.communicate(timeout=POLL)
                    break
                except TimeoutExpired:
                    limits.check(READING)
                    if monotonic() > end:
                        raise MapError(f"{named(path)} was not read within {WAITS} s; make it smaller.") from None
        finally:
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()
    if process.returncode == -getattr(signal, "SIGXCPU", 0):
        raise MapError(f"{named(path)} takes more than {SECONDS} processor seconds to read; make it smaller.")
    if process.returncode:
        raise MapError(
            f"{named(path)} cannot be read: the process that reads it broke down ({process.returncode}). Is the file "
            f"broken, or does it take more than {MEMORY / 1e9:.2g} GB to read?"
        )
    return said
