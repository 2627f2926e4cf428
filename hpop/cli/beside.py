"""Background processes of ``hpop plan``: for the page of the running search, for pictures, and for compiling kernels.

Drawing takes seconds of Python, which would slow down the search or delay the prompt after Ctrl-C. The processes of
page and pictures read only the saved front and the user's own code.

The page of ``hpop plan --web`` is served to this machine only, by :mod:`hpop.cli.live_server`. The command opens the
port before the search begins, and notifies the server of each saved front. The server ends with the command.

``python -P -m hpop.cli.beside all|map FOLDER BYTES [FILE_OR_MODULE ...]`` draws pictures. BYTES limits the memory for
the grid of obstruction values behind the map (0: no limit). -P keeps the current folder off the import path.
"""

from __future__ import annotations

import os
import secrets
import socket
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from threading import Timer
from types import TracebackType
from typing import TYPE_CHECKING, Any

import hpop
from hpop import cli, runtime
from hpop.cli import results
from hpop.errors import OutputError
from hpop.runtime import matplotlib_folder
from hpop.runtime.interrupts import interrupts_held

if TYPE_CHECKING:
    from hpop.planners import Planner
    from hpop.problems.problem import Problem
    from hpop.search.machinery.beside import Onset

TOKEN = "HPOP_LIVE_TOKEN"  # environment variable of the server
HOST = "127.0.0.1"  # reachable from this machine only
WAITING = 64  # requests that may wait until the server is ready
LAST = 20.0  # s to wait until the last front is shown


def kernels_beside(planners: Sequence[Planner], problem: Problem) -> AbstractContextManager[Onset | None]:
    """Return a context in which background processes compile the code (kernels) that the planners' exact searches need.

    Kernels that are cached are not compiled again. Compiling begins after the first early result if the first planner
    yields one, else at once. The value of the context says which of the two: an :class:`.Onset`, or None if no planner
    needs kernels.
    """
    # Imported here, as in all commands: these modules are heavy.
    from hpop.criteria.base import index_of_role
    from hpop.planners.objectives import edge_objectives
    from hpop.search.machinery.beside import Onset, compiling_beside
    from hpop.search.pareto_paths import main_kernels

    searching = [planner for planner in planners if planner.needs_kernels]
    if not searching:
        return nullcontext()
    criteria = edge_objectives(problem.criteria, searching[0].name).optimised
    turns = index_of_role("turns", criteria)
    onset = Onset.AFTER_FIRST if planners[0].answers_in_stages else Onset.AT_ONCE
    aggregates = ["max" if criterion.aggregate == "max" else "sum" for criterion in criteria]
    return compiling_beside(aggregates, -1 if turns is None else turns, onset, main_kernels)


class LivePage:
    """Web page that shows the newest front of a running search, served by another process.

    Use it in a ``with`` statement: at its end the page shows the last front, and the server ends.

    port     0: any free port
    folder   the front is read from this folder each time that `saved` is called
    imports  files and modules with the user's criteria, models and planners

    Raises OutputError if the port is taken.
    """

    def __init__(self, port: int, folder: Path, imports: Sequence[str] = ()) -> None:
        self._process: Popen[bytes] | None = None
        token = secrets.token_urlsafe(16)  # requests need it
        with socket.socket() as listening:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listening.bind((HOST, port))
                listening.listen(WAITING)
            except OSError as error:
                raise OutputError(
                    f"--web: port {port} of this machine cannot be used: {error.strerror or error}; choose "
                    "another port, or 0 for any free port"
                ) from None
            self.address = f"http://{HOST}:{listening.getsockname()[1]}/{token}/"
            number = listening.fileno()
            command = [sys.executable, "-P", "-m", "hpop.cli.live_server", str(number), str(folder), *imports]
            environment = {**os.environ, TOKEN: token}  # not in the command line, which all users of a machine see
            # A session of its own: Ctrl-C on the terminal does not reach it. Without a process there is no page.
            with suppress(OSError), interrupts_held():
                quiet: dict[str, Any] = {"stdout": DEVNULL, "stderr": DEVNULL, "start_new_session": True}
                self._process = Popen(command, stdin=PIPE, pass_fds=[number], env=environment, **quiet)

    @property
    def is_served(self) -> bool:
        """Return whether a process serves the page; False if it could not be started."""
        return self._process is not None

    def __enter__(self) -> LivePage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def saved(self) -> None:
        """Notify the server that a new front was saved."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError):  # the server is gone, but the search goes on
                self._process.stdin.write(b"\n")
                self._process.stdin.flush()

    def stop(self) -> None:
        """Let the server show the last front, then end the server."""
        if self._process is None:
            return
        process, self._process = self._process, None
        if process.stdin is not None:
            with suppress(OSError):
                process.stdin.close()
        try:
            process.wait(LAST)
        except (TimeoutExpired, KeyboardInterrupt):
            process.kill()
            process.wait()


NICENESS = 10  # lower priority than the search
STANDS = 2.0  # s after which an intermediate front is drawn, unless a newer front came


class PicturesBeside:
    """Process that draws pictures of the front saved in a folder.

    Use it in a ``with`` statement: at its end the process is stopped.

    imports     files and modules with the user's criteria, models and planners
    max_memory  bytes  limit for the grid of obstruction values behind the map
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
        """Begin to draw the map alone after 2 s (`STANDS`), unless a newer front is saved or drawn before then."""
        self.stop()
        self._timer = Timer(STANDS, self._begin, ["map"])
        self._timer.daemon = True
        self._timer.start()

    def start(self) -> None:
        """Start a process that draws all pictures. If it cannot be started, no pictures are drawn."""
        self.stop()
        self._begin("all")

    def _begin(self, which: str) -> None:
        arguments = [which, str(self.folder), str(self.max_memory or 0), *self.imports]
        command = [sys.executable, "-P", "-m", "hpop.cli.beside", *arguments]
        with suppress(OSError), interrupts_held():  # an interrupted start would leave an orphaned process
            # A session of its own, so that Ctrl-C on the terminal does not reach it.
            self._process = Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL, start_new_session=True)

    def stop(self) -> None:
        """Stop drawing, and remove unfinished pictures. Called before a new front is saved."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()  # the timer may just have fired
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
    """Draw pictures of the front saved in a folder, at low priority: only the map if ``which`` is "map", else all."""
    runtime.interrupts.collect_rarely()

    if hasattr(os, "nice"):
        os.nice(NICENESS)
    cli.user_code.register(imports)
    front = hpop.Front.load(folder / results.SAVED)
    problem = hpop.Problem.from_description(front.problem or {})
    results.draw(problem, front, folder, map_alone=which == "map", max_memory=max_memory)


if __name__ == "__main__":
    draw(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]) or None, sys.argv[4:])
