"""Process of the planner of a live session: ``python -P -m hpop.cli.live_planner SCENARIO [FILE_OR_MODULE ...]``.

The process reads requests as lines of JSON from its standard input, and writes messages as lines of JSON to its
standard output. Each message has ``processor``: the processor time, ms, since its request came. The process ends with
its input, so that it never outlives the server, which starts another one if it crashes.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
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
    "close",
    "open",
    "people",
    "arrived",
    "restore",
)
"""Requests: methods of :class:`hpop.live.planner.LivePlanner`."""


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

    def say(message: Mapping[str, Any]) -> None:
        out.write(json.dumps(message, allow_nan=False, separators=(",", ":")).encode() + b"\n")

    cli.user_code.register(imports)
    planner = LivePlanner(load_scenario(scenario))
    planner.prepare()
    say({"type": "ready"})
    for line in sys.stdin.buffer:
        request, began = json.loads(line), time.process_time()
        for message in answers(planner, request):
            say({**message, "id": request["id"], "processor": round(1000.0 * (time.process_time() - began), 1)})
        say({"type": "done", "id": request["id"]})


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
