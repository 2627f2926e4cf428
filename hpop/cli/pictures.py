"""Pictures of a front that is saved, drawn by another process: of a stage, and where the user wants the prompt back.

Drawing takes seconds of Python, which would stand in the way of a search that goes on, and of a user who has stopped
one. The other process reads what is saved, a front with its problem, so it needs nothing else but the user's own code,
if there is any; ``python -P -m hpop.cli.pictures all|map FOLDER BYTES [FILE_OR_MODULE ...]`` is all it runs, BYTES the
most for the map's field (0: no limit); nothing of the current folder (-P).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from subprocess import DEVNULL, Popen
from threading import Timer
from types import TracebackType
from typing import Any

from hpop.runtime import matplotlib_folder
from hpop.runtime.interrupts import interrupts_held

NICENESS = 10  # the search comes first
STANDS = 2.0  # s: a front of a stage that stands so long is worth a picture; most give way to the next one before


class PicturesBeside:
    """Draws the front that is saved in a folder, beside what else is done; at the end of a ``with`` it stops.

    imports     files and modules that register what the front was planned with
    max_memory  bytes  for the map's field
    """

    def __init__(self, folder: Path, imports: Sequence[str] = (), max_memory: int | None = None) -> None:
        self.folder = folder
        self.imports = imports
        self.max_memory = max_memory
        self._timer: Timer | None = None
        self._process: Popen[Any] | None = None
        matplotlib_folder.provide()

    def __enter__(self) -> PicturesBeside:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def stage(self) -> None:
        """Draw the map alone, if no better front comes soon."""
        self.stop()
        self._timer = Timer(STANDS, self._begin, ["map"])
        self._timer.daemon = True
        self._timer.start()

    def start(self) -> None:
        """Begin to draw all pictures; they are a help, so where no process can be had there are none."""
        self.stop()
        self._begin("all")

    def _begin(self, which: str) -> None:
        given = [which, str(self.folder), str(self.max_memory or 0), *self.imports]
        command = [sys.executable, "-P", "-m", "hpop.cli.pictures", *given]
        with suppress(OSError), interrupts_held():  # or a process would be begun that nobody can stop
            # A session of its own: Ctrl-C on the terminal is not meant for it.
            self._process = Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL, start_new_session=True)

    def stop(self) -> None:
        """Make sure that nothing is drawn any more: a new front is about to be saved. No half of a picture is left."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()  # it may just have begun
            self._timer = None
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        self._process = None
        for ending in (".png", ".html"):
            for half in self.folder.glob(f".*{ending}.*.tmp"):
                half.unlink(missing_ok=True)


def draw(which: str, folder: Path, max_memory: int | None, imports: Sequence[str]) -> None:
    """Draw the front saved in a folder, when there is nothing better to do: the map, or all pictures."""
    from hpop.runtime import garbage

    garbage.seldom()
    from hpop.cli import results, user_code
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem

    if hasattr(os, "nice"):
        os.nice(NICENESS)
    user_code.register(imports)
    front = Front.load(folder / results.SAVED)
    problem = Problem.from_description(front.problem or {})
    results.draw(problem, front, folder, map_alone=which == "map", max_memory=max_memory)


if __name__ == "__main__":
    draw(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]) or None, sys.argv[4:])
