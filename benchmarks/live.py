"""Benchmark of `hpop live`: seconds from a click to the cards, and milliseconds from a push to its answer.

    python benchmarks/live.py [--map NAME ...] [--clicks 40] [--pushes 300] [--crowd N] [--step 0.25] [--out FILE]

`hpop live` runs in a process of its own, and its planner in another; a page is connected through the websocket. Clicks
are at random places; those that the robot cannot reach are drawn again. The first click is left out, and so is reading
the map. The robot drives to each place, and is pushed at random times to the left or the right. A push that comes while
the planner is busy may wait for it; this is included. After a box was closed, one more click is timed. Processor times
are those of the planner's process from the moment at which a request comes, with all that it waits for there. They are
what the times would be on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Event, Thread
from typing import Any

import maps
import numpy as np
from websockets.sync.client import connect

from hpop.scenario import load_scenario

WAIT = 60.0


class Page:
    """A page at the websocket of a session."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.state: dict[str, Any] = {}
        self.processor = list[float]()  # ms, of clicks
        self._gone = Event()
        self.say("hello", role="drive")
        Thread(target=self._live, daemon=True).start()

    def _live(self) -> None:
        while not self._gone.wait(0.15):
            self.say("alive")

    def say(self, kind: str, **values: Any) -> None:
        """Send a message."""
        self.socket.send(json.dumps({"type": kind, **values}))

    def until(self, *kinds: str, seconds: float = WAIT) -> dict[str, Any]:
        """Wait for a message of one of the kinds; {} if none comes in time."""
        last = time.monotonic() + seconds
        while time.monotonic() < last:
            try:
                message: dict[str, Any] = json.loads(self.socket.recv(timeout=max(0.001, last - time.monotonic())))
            except TimeoutError:
                break
            if message["type"] == "state":
                self.state = message
            if message["type"] in kinds:
                return message
        return {}

    def click(self, x: float, y: float) -> tuple[float, dict[str, Any]]:
        """Choose a destination; return the seconds until the ways are there, and the ways ({} if it is blocked)."""
        began = time.perf_counter()
        self.say("destination", x=x, y=y)
        place = self.until("place")
        if place["status"] != "reachable":
            return 0.0, {}
        options = self.until("options", "place")
        took = time.perf_counter() - began
        if options.get("type") != "options":
            return 0.0, {}
        self.processor.append(options["processor"])
        return took, options

    def end(self) -> None:
        """Say no more that the page is there."""
        self._gone.set()


def measure(address: str, bounds: tuple[float, ...], clicks: int, pushes: int) -> dict[str, Any]:
    """Click and push until there are enough of both."""
    random = np.random.default_rng(0)
    seconds, changed, answered, spent, followed = list[float](), list[float](), list[float](), list[float](), 0
    with connect(address.replace("http", "ws", 1) + "socket", max_size=None) as socket:
        page = Page(socket)
        while page.until("note")["words"] != "the map is prepared":
            pass
        while len(seconds) < clicks + 1 or len(answered) < pushes:
            x, y = random.uniform(bounds[:2], bounds[2:])
            took, options = page.click(x, y)
            if not options:
                continue
            seconds.append(took)
            if len(seconds) % 8 == 0:  # a map update, far from the robot
                far = (bounds[0], bounds[1]) if page.state["x"] > (bounds[0] + bounds[2]) / 2 else bounds[2:]
                corners = [[far[0] + dx, far[1] + dy] for dx, dy in ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2))]
                page.say("close", corners=corners, name="box")
                page.until("closed", "refused")
                took, again = page.click(x, y)
                if again:
                    changed.append(took)
                page.say("open", name="box")
                page.until("closed", "refused")
            page.say("take", option=int(random.integers(len(options["all"]))))
            page.until("taken", "refused")
            for _ in range(8):
                if page.until("arrived", seconds=float(random.uniform(0.3, 1.5))) or len(answered) >= pushes:
                    break
                began = time.perf_counter()
                page.say("push", direction=float(random.choice([-1, 1]) * random.uniform(0.2, 1.6)))
                pushed = page.until("pushed", "arrived")
                if pushed.get("type") == "pushed" and pushed["option"] is not None:
                    answered.append(1000.0 * (time.perf_counter() - began))
                    spent.append(pushed["processor"])
                    followed += pushed["followed"]
        page.end()
    shares = [50, 90, 95, 99]
    return {
        "clicks": len(seconds) - 1,
        "click_s": dict(zip(shares, np.percentile(seconds[1:], shares).round(3).tolist(), strict=True)),
        "click_processor_s": np.percentile(page.processor[1:], 95).round(0) / 1000.0,
        "clicks_after_update": len(changed),
        "click_after_update_s": round(max(changed), 3) if changed else None,
        "pushes": len(answered),
        "push_ms": dict(zip(shares, np.percentile(answered, shares).round(1).tolist(), strict=True)),
        "push_processor_ms": dict(zip(shares, np.percentile(spent, shares).round(1).tolist(), strict=True)),
        "pushes_within_100_ms": round(float((np.array(answered) <= 100.0).mean()), 4),
        "pushes_within_100_ms_of_processor": round(float((np.array(spent) <= 100.0).mean()), 4),
        "pushes_followed": round(followed / max(len(answered), 1), 3),
    }


def machine() -> str:
    """Return the name of the processor, and the number of its cores."""
    about = Path("/proc/cpuinfo")
    lines = about.read_text().splitlines() if about.exists() else []
    names = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    return f"{[*names, platform.machine()][0]}, {os.cpu_count()} cores"


def main() -> None:
    """Measure each map, and print or write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--map", nargs="*", default=["pal_office", "nav2_depot"])
    parser.add_argument("--clicks", type=int, default=40)
    parser.add_argument("--pushes", type=int, default=300)
    parser.add_argument("--crowd", type=int, default=0, help="people who walk about")
    parser.add_argument("--step", type=float, default=0.25)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    found: dict[str, Any] = {"machine": machine()}
    for name in asked.map:
        if name in maps.FOLDERS and (lacks := maps.missing(name)):
            print(f"{name}: {lacks}")
            continue
        examples = maps.ROOT / "examples"
        text = (examples / f"{name}.yaml").read_text().replace("../../shared/data", str(maps.DATA))
        text = text.replace("museum.geojson", str(examples / "museum.geojson"))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{name}.yaml"
            file.write_text(text.replace("step: 0.25", f"step: {asked.step:g}"))
            command = [sys.executable, "-P", "-m", "hpop", "live", file.name, "--port", "0", "--out", "out"]
            command += ["--crowd", str(asked.crowd)]
            with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as server:
                try:
                    assert server.stdout is not None
                    address = server.stdout.readline().strip().removeprefix("drive: ")
                    bounds = load_scenario(file).problem.world.bounds
                    load = os.getloadavg()[0]
                    found[name] = {"load": round(load, 1), **measure(address, bounds, asked.clicks, asked.pushes)}
                finally:
                    server.terminate()
        print(name, json.dumps(found[name]))
    if asked.out is not None:
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        asked.out.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
