"""Websocket connection to rosbridge, which reconnects whenever it breaks.

Incoming messages are limited in size, number and rate; further ones wait at the sender. A bridge that accepts no data
is disconnected after a while.
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

MOST_WAITING = 16  # most unread websocket frames
MOST_A_SECOND = 500  # messages
OPENING, CLOSING, SENDING = 10.0, 2.0, 10.0  # s
# First and longest delay before connecting again, s. Each delay is twice the one before, also if a bridge accepts the
# connection and closes it at once.
DELAYS = (0.5, 30.0)
QUIET = logging.Logger("hpop.ros.websockets", logging.CRITICAL + 1)  # silent: this module itself reports errors


class Pace:
    """Limit on the number of messages per second; the caller waits when the limit is reached."""

    def __init__(self, most: int, clock: Callable[[], float], wait: Callable[[float], Any]) -> None:
        self.most, self.clock, self.wait = most, clock, wait
        self.since, self.count = clock(), 0

    def step(self) -> None:
        """Count a message; if ``most`` were counted in this second before it, first wait until the second is over."""
        now = self.clock()
        if now - self.since >= 1.0:
            self.since, self.count = now, 0
        elif self.count >= self.most:
            self.wait(self.since + 1.0 - now)
            self.since, self.count = self.clock(), 0
        self.count += 1


@checked_arguments
class Bridge:
    """Client of rosbridge that offers the action of a :class:`PathServer` until it is stopped.

    Parameters
    ----------
    url : such as ws://localhost:9090, or wss://
    server : plans the goals that come
    say : called with a line of text for each event
    delays : (first, longest), s, before attempts to connect again; each delay is twice the one before

    Raises OptionError for an invalid url, ImportError without the extra ``ros``.
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
        self._connection: Any = None  # None while disconnected

    def run(self) -> None:
        """Connect, serve, and reconnect whenever the connection breaks, until :meth:`stop` or Ctrl-C."""
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
                if monotonic() - since > most:  # the connection was stable
                    delay = first
                self.say(printable(f"no connection to {self.url} ({why}); trying again in {delay:g} s"))
                self._stopped.wait(delay)
                delay = min(2.0 * delay, most)

    def stop(self) -> None:
        """Make :meth:`run` return; may be called from any thread."""
        self._stopped.set()
        self._leave()

    def _connected(self) -> Any:
        """Open a websocket connection to the bridge."""
        return self._client.connect(
            self.url,
            compression=None,  # not needed in one network, and no message grows when unpacked
            proxy=None,
            max_size=protocol.MOST_BYTES,
            max_queue=MOST_WAITING,
            open_timeout=OPENING,
            close_timeout=CLOSING,
            logger=QUIET,
        )

    def _serve(self, connection: Any) -> str:
        """Pass messages to the server until the connection is closed or `stop` is called; return why it ended."""
        # With a time-out, sending to a bridge that reads nothing fails instead of blocking for ever.
        seconds, rest = divmod(SENDING, 1.0)
        connection.socket.setsockopt(SOL_SOCKET, SO_SNDTIMEO, struct.pack("ll", int(seconds), int(1e6 * rest)))
        closed = self._errors.ConnectionClosed

        def send(text: str) -> None:
            with suppress(closed):  # the goals ended with the connection
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
        """Withdraw the action and close the connection, if there is one; only the first of several threads does so."""
        with self._leaving:
            connection, self._connection = self._connection, None
            if connection is None:
                return
            with suppress(self._errors.ConnectionClosed):
                for message in protocol.farewells(self.server.known):
                    connection.send(protocol.encoded(message))
            connection.close()


def checked_url(url: Any) -> str:
    """Return a valid websocket address; raise OptionError for another value.

    >>> checked_url("ws://localhost:9090")
    'ws://localhost:9090'
    """
    try:
        parts = urlsplit(url) if isinstance(url, str) else None
        fits = parts is not None and parts.scheme in ("ws", "wss") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # an invalid port
        fits = False
    if not fits or not url.isprintable() or not url.isascii():
        raise OptionError(f"url must be the address of a bridge, such as ws://localhost:9090, got {shown(url)}")
    return str(url)
