"""``hpop plan --web``: the explorer's page of a search that still runs, served to this machine alone.

Another process serves it (:mod:`hpop.cli.live_server`) and makes the page of each front that is saved, so that the
search goes on as if nobody looked; it begins with the command and ends with it. Here is what the command does: it takes
the port, before hours are spent on a search that nobody sees, and says each time that a front was saved.
"""

from __future__ import annotations

import os
import secrets
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from types import TracebackType
from typing import Any

from hpop.errors import OutputError
from hpop.runtime.interrupts import interrupts_held

TOKEN = "HPOP_LIVE_TOKEN"  # of the environment of the other process
HOST = "127.0.0.1"  # nobody else's machine gets there
WAITING = 64  # browsers that ask before the other process answers
LAST = 20.0  # s: so long the last front may take to be shown; then the command ends all the same


class LivePage:
    """A page that follows the front saved in a folder; at the end of a ``with`` it shows the last one and is gone.

    port     0 takes any that is free
    imports  files and modules that register what the front was planned with

    Raises OutputError where the port cannot be had.
    """

    def __init__(self, port: int, folder: Path, imports: Sequence[str] = ()) -> None:
        self._process: Popen[bytes] | None = None
        token = secrets.token_urlsafe(16)  # whoever does not know it is shown nothing
        with socket.socket() as listening:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listening.bind((HOST, port))
                listening.listen(WAITING)
            except OSError as error:
                raise OutputError(
                    f"--web: port {port} of this machine cannot be had: {error.strerror or error}; choose another, "
                    "or 0 for any that is free"
                ) from None
            self.address = f"http://{HOST}:{listening.getsockname()[1]}/{token}/"
            number = listening.fileno()
            command = [sys.executable, "-P", "-m", "hpop.cli.live_server", str(number), str(folder), *imports]
            known = {**os.environ, TOKEN: token}  # not in the command, which all users of a machine see
            # A session of its own: Ctrl-C on the terminal is not meant for it. Without a process there is no page.
            with suppress(OSError), interrupts_held():
                quiet: dict[str, Any] = {"stdout": DEVNULL, "stderr": DEVNULL, "start_new_session": True}
                self._process = Popen(command, stdin=PIPE, pass_fds=[number], env=known, **quiet)

    @property
    def is_served(self) -> bool:
        """Whether there is a process that serves it."""
        return self._process is not None

    def __enter__(self) -> LivePage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def saved(self) -> None:
        """Show the front that was just saved."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError):  # it is gone: the search matters more
                self._process.stdin.write(b"\n")
                self._process.stdin.flush()

    def stop(self) -> None:
        """Let the last front be shown, and end."""
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
