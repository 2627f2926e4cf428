"""Process of the planner of a live session: ``python -P -m hpop.cli.live_planner SCENARIO [FILE_OR_MODULE ...]``.

The process reads requests as lines of JSON from its standard input, and writes messages as lines of JSON to its
standard output. Each message has two times in ms: ``processor`` of the process since the request came, and ``thread``
of the thread that answers since it began to. A push is answered beside another request if the ways of the drive are
known, and before other requests if not. The process ends with its input, so that it never outlives the server, which
starts another one if it crashes.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from queue import PriorityQueue
from threading import Lock, Thread
from typing import Any

from hpop import cli
from hpop.base.text import printable
from hpop.errors import HpopError
from hpop.live.planner import LivePlanner
from hpop.scenario import load_scenario

KINDS = (
    "destination",
    "options",
    "show",
    "take",
    "push",
    "wish",
    "why",
    "explore",
    "close",
    "open",
    "people",
    "arrived",
    "restore",
)
"""Requests: methods of :class:`hpop.live.planner.LivePlanner`."""


SWITCH = 1e-3
"""Time, s, after which a thread lets another one run, so that a push need not wait for long."""


def at_once(planner: LivePlanner, request: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the messages that answer a request "push", while another thread may answer an earlier request.

    A push changes to the known path that lies nearest to a direction. Yield nothing if the push has to wait.
    """
    with suppress(HpopError):
        yield from planner.push_at_once(request["now"], request["pose"], request["direction"])


def answers(planner: Any, request: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the messages that answer a request.

    Errors of hpop become the message "refused". The last one is "lost" if the robot has left its plan.
    """
    values = {name: value for name, value in request.items() if name not in ("id", "kind")}
    if request["kind"] not in KINDS:
        raise ValueError(request["kind"])
    driven = planner.drive is not None
    try:
        yield from getattr(planner, request["kind"])(**values)
    except HpopError as error:
        yield {"type": "refused", "words": printable(str(error))}
    if driven and planner.drive is None and request["kind"] != "arrived":
        yield {"type": "lost"}


def main(scenario: str, imports: Sequence[str]) -> None:
    """Answer requests until the input ends."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # prints of the user's own code are no messages
    sys.setswitchinterval(SWITCH)
    cli.user_code.register(imports)
    planner = LivePlanner(load_scenario(scenario))
    planner.prepare()
    behind = [math.inf]  # s, of the session's time behind this machine's

    def clock() -> float:
        return time.monotonic() - behind[0]

    planner.clock = clock
    writing, waiting = Lock(), PriorityQueue[tuple[int, int, dict[str, Any], float]]()

    def say(message: Mapping[str, Any]) -> None:
        line = json.dumps(message, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        with writing:
            out.write(line)

    def tell(request: Mapping[str, Any], messages: Iterator[dict[str, Any]], came: float) -> bool:
        """Write the messages that answer a request, which came at a processor time, s; return whether there are any."""
        any_told, began = False, time.thread_time()
        for message in messages:
            any_told = True
            times = {"processor": time.process_time() - came, "thread": time.thread_time() - began}
            milliseconds = {name: round(1000.0 * seconds, 1) for name, seconds in times.items()}
            say({**message, "id": request["id"], **milliseconds})
        return any_told

    def read() -> None:
        """Read requests: answer a push at once if possible; let all others wait for the main thread, pushes first."""
        try:
            for line in sys.stdin.buffer:
                request, came = json.loads(line), time.process_time()
                behind[0] = min(behind[0], time.monotonic() - request["now"])  # the quickest message tells it best
                is_push = request["kind"] == "push"
                if is_push and tell(request, at_once(planner, request), came):
                    say({"type": "done", "id": request["id"]})
                else:
                    waiting.put((0 if is_push else 1, request["id"], request, came))
        finally:
            waiting.put((-1, 0, {}, 0.0))

    say({"type": "ready"})
    Thread(target=read, daemon=True).start()
    try:
        while (asked := waiting.get())[2]:
            tell(asked[2], answers(planner, asked[2]), asked[3])
            say({"type": "done", "id": asked[1]})
    except BaseException:
        traceback.print_exc()
        os._exit(1)  # without waiting for the thread that reads


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
