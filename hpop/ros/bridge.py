"""A connection to rosbridge's websocket, which is made again whenever it breaks.

What comes in is bounded in size, in number waiting (what does not fit waits with the sender) and in rate; a bridge that
takes nothing is left after a while.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable
from contextlib import suppress
from math import inf
from socket import SO_SNDTIMEO, SOL_SOCKET
from threading import Event, Lock
from time import monotonic
from typing import Any
from urllib.parse import urlsplit

from hpop.base.arguments import checked_arguments
from hpop.base.lazy import library
from hpop.base.text import printable, shown
from hpop.errors import OptionError
from hpop.ros import protocol
from hpop.ros.path_server import PathServer
from hpop.runtime.status import log

MOST_WAITING = 16  # frames that wait to be read
MOST_A_SECOND = 500  # messages
OPENING, CLOSING, SENDING = 10.0, 2.0, 10.0  # s
DELAYS = (0.5, 30.0)  # s before the first next attempt, and before any at most: each is twice the one before, also
# where a bridge takes the connection and closes it at once
QUIET = logging.Logger("hpop.ros.websockets", logging.CRITICAL + 1)  # what websockets logs is told by us


class Pace:
    """Lets so many messages a second through; who sends more waits, and with it what comes behind."""

    def __init__(self, most: int, clock: Callable[[], float], wait: Callable[[float], Any]) -> None:
        self.most, self.clock, self.wait = most, clock, wait
        self.since, self.count = clock(), 0

    def step(self) -> None:
        """Count a message; wait for the next second where this one is full."""
        now = self.clock()
        if now - self.since >= 1.0:
            self.since, self.count = now, 0
        elif self.count >= self.most:
            self.wait(self.since + 1.0 - now)
            self.since, self.count = self.clock(), 0
        self.count += 1


@checked_arguments
class Bridge:
    """Serves a :class:`PathServer` over a bridge's websocket until it is stopped.

    Parameters
    ----------
    url : such as ws://localhost:9090, or wss://
    say : is told, in a line of text, what happens
    delays : s, before the first attempt after one that failed, and before any

    Raises OptionError for a url that is none, ImportError without the extra ``ros``.
    """

    def __init__(
        self,
        url: str,
        server: PathServer,
        *,
        say: Callable[[str], None] = log.info,
        delays: tuple[float, float] = DELAYS,
    ) -> None:
        self.url, self.server, self.say, self.delays = checked_url(url), server, say, delays
        self._client: Any = library("websockets.sync.client", "a bridge to ROS", "ros")
        self._errors: Any = library("websockets.exceptions", "a bridge to ROS", "ros")
        self._stopped = Event()
        self._leaving = Lock()
        self._connection: Any = None  # until it is left

    def run(self) -> None:
        """Connect, serve, and connect again, until :meth:`stop` or Ctrl-C."""
        first, most = self.delays
        delay = first
        while not self._stopped.is_set():
            since = inf
            try:
                with self._connected() as connection:
                    since = monotonic()
                    self.say(f"connected to {self.url}: goals of {self.server.known.action} are planned")
                    why = self._serve(connection)
            except (OSError, self._errors.WebSocketException, EOFError, ValueError) as error:
                why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            if not self._stopped.is_set():
                if monotonic() - since > most:  # it was one that held
                    delay = first
                self.say(printable(f"no connection to {self.url} ({why}); trying again in {delay:g} s"))
                self._stopped.wait(delay)
                delay = min(2.0 * delay, most)

    def stop(self) -> None:
        """End :meth:`run`, from any thread."""
        self._stopped.set()
        self._leave()

    def _connected(self) -> Any:
        return self._client.connect(
            self.url,
            compression=None,  # on one machine or network; and nothing grows as it is unpacked
            proxy=None,
            max_size=protocol.MOST_BYTES,
            max_queue=MOST_WAITING,
            open_timeout=OPENING,
            close_timeout=CLOSING,
            logger=QUIET,
        )

    def _serve(self, connection: Any) -> str:
        """Return bring messages until the connection is closed; why it was."""
        # A send to who reads nothing fails then, where it would hold the connection for ever.
        seconds, rest = divmod(SENDING, 1.0)
        connection.socket.setsockopt(SOL_SOCKET, SO_SNDTIMEO, struct.pack("ll", int(seconds), int(1e6 * rest)))
        closed = self._errors.ConnectionClosed

        def send(text: str) -> None:
            with suppress(closed):  # the goals are gone with it
                connection.send(text)

        pace = Pace(MOST_A_SECOND, monotonic, self._stopped.wait)
        self._connection = connection
        try:
            self.server.connected(send)
            while not self._stopped.is_set():
                self.server.received(connection.recv())
                pace.step()
            self._leave()
            return "stopped"
        except closed as error:
            return str(error)
        except KeyboardInterrupt:
            self._leave()
            raise
        finally:
            self.server.disconnected()

    def _leave(self) -> None:
        """Take back what was offered, and close: once, whichever thread is first."""
        with self._leaving:
            connection, self._connection = self._connection, None
            if connection is None:
                return
            with suppress(self._errors.ConnectionClosed):
                for message in protocol.farewells(self.server.known):
                    connection.send(protocol.encoded(message))
            connection.close()


def checked_url(url: Any) -> str:
    """Return the address of a websocket, or OptionError.

    >>> checked_url("ws://localhost:9090")
    'ws://localhost:9090'
    """
    try:
        parts = urlsplit(url) if isinstance(url, str) else None
        fits = parts is not None and parts.scheme in ("ws", "wss") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # a port that is none
        fits = False
    if not fits or not url.isprintable() or not url.isascii():
        raise OptionError(f"url must be the address of a bridge, such as ws://localhost:9090, got {shown(url)}")
    return str(url)
