"""Real processes of hpop without seconds of imports for each: forked from one that has imported everything.

What runs in them is Python's own main program from its start to its end: signals, exit code, what is printed where,
what is done at exit are those of a process started anew. What is not: nothing is imported any more. A test of what
imports do starts Python itself.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import pkgutil
import select
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

COMMAND = "from hpop.entry import main; main()"
_ENDING = """\
import atexit, os, sys, threading
import hpop.cli.beside
hpop.cli.beside.PicturesBeside._begin = lambda pictures, which: print(which, "is drawn beside")
from hpop.entry import main
try:
    main()
except SystemExit as end:
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(end.code or 0)
"""
#: `hpop plan`, but that no process is left to draw what it has found, seconds of work; that pictures have few pixels;
#: and that a process ends once what is to be done at exit is done: taking all modules apart would copy them first.
DRAWN = f"""\
import functools
import hpop.view
hpop.view.save_pictures = functools.partial(hpop.view.save_pictures, dpi=40)
{_ENDING}"""
#: The same without pictures, most of what a small plan takes.
UNDRAWN = f"""\
import hpop.view
hpop.view.save_pictures = lambda *given, **options: []
{_ENDING}"""


class Process:
    """A forked process: its id, and its end."""

    def __init__(self, status: IO[str]) -> None:
        self._status = status
        self.pid = int(status.readline())
        self.returncode: int | None = None

    def wait(self) -> int:
        """Wait for its end; exit code as subprocess gives it."""
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(int(self._status.readline()))
            self._status.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    @property
    def is_running(self) -> bool:
        """Return True until the process has ended."""
        return self.returncode is None and not select.select([self._status], [], [], 0)[0]

    def kill(self) -> None:
        """End it, if it runs still."""
        if self.is_running:
            self.send_signal(signal.SIGKILL)
        self.wait()


class Warm:
    """A process that has imported hpop, and forks at request."""

    def __init__(self, python: str | Path = sys.executable) -> None:
        self._ours, theirs = socket.socketpair()
        command = [str(python), "-P", __file__, str(theirs.fileno())]
        self._server = subprocess.Popen(command, pass_fds=[theirs.fileno()])
        theirs.close()

    def start(
        self,
        *arguments: object,
        cwd: Path,
        stdout: int,
        stderr: int,
        code: str = COMMAND,
        environment: Mapping[str, str] | None = None,
        ignore_interrupts: bool = False,
    ) -> Process:
        """Start `python -P -c code arguments` in a folder; `environment` is added to that of the tests.

        Of its variables those that Python itself reads when it starts have no effect, but for PYTHONPATH.
        """
        request = {"arguments": ["-c", *map(str, arguments)], "cwd": str(cwd), "code": code}
        request |= {"environment": os.environ | (environment or {}), "ignore": ignore_interrupts}
        reading, writing = os.pipe()
        with open(os.devnull) as nothing:
            fds = [writing, nothing.fileno(), stdout, stderr]
            socket.send_fds(self._ours, [json.dumps(request).encode()], fds)
        os.close(writing)
        return Process(os.fdopen(reading))

    def run(self, *arguments: object, cwd: Path, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run it to its end."""
        with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
            process = self.start(*arguments, cwd=cwd, stdout=out.fileno(), stderr=errors.fileno(), **options)
            process.wait()
            out.seek(0)
            errors.seek(0)
            return subprocess.CompletedProcess(list(arguments), process.wait(), out.read(), errors.read())

    def close(self) -> None:
        self._ours.close()
        self._server.wait()


def import_everything() -> None:
    """Import all modules of hpop, and what they import when they are first used."""
    import hpop

    for module in pkgutil.walk_packages(hpop.__path__, "hpop."):
        importlib.import_module(module.name)
    for name in ("casadi", "moocore", "rich.live"):
        importlib.import_module(name)


def serve(connection: socket.socket) -> dict[str, Any] | None:
    """Fork for every request; return in the forked process with its request, and in the server with None at the end."""
    while True:
        message, fds, _, _ = socket.recv_fds(connection, 1 << 20, 4)
        with suppress(ChildProcessError):  # that their processor time is counted
            while os.waitpid(-1, os.WNOHANG if message else 0)[0]:
                pass
        if not message:
            return None
        if os.fork():
            for fd in fds:
                os.close(fd)
            continue
        status, *standard = fds
        if child := os.fork():
            for fd in standard:
                os.close(fd)
            os.write(status, f"{child}\n".encode())
            os.write(status, f"{os.waitpid(child, 0)[1]}\n".encode())
            os._exit(0)
        os.close(status)
        connection.close()
        for number, fd in enumerate(standard):
            os.dup2(fd, number)
            os.close(fd)
        request: dict[str, Any] = json.loads(message)
        return request


def enter(request: Mapping[str, Any]) -> None:
    """Make this process the one that was asked for."""
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["environment"])
    path = os.environ.get("PYTHONPATH", "")
    sys.path[:0] = [folder for folder in path.split(os.pathsep) if folder and folder not in sys.path]
    sys.argv = request["arguments"]
    del sys.modules["__main__"].__file__  # else processes that it starts would run this file first
    signal.signal(signal.SIGINT, signal.SIG_IGN if request["ignore"] else signal.default_int_handler)


if __name__ == "__main__":
    gc.disable()
    import_everything()
    gc.enable()
    gc.freeze()  # else each process looks through all of it when it ends, and copies it so: half a second
    if (asked := serve(socket.socket(fileno=int(sys.argv[1])))) is not None:
        enter(asked)
        exec(compile(asked["code"], "<string>", "exec"), {"__name__": "__main__"})
