"""Benchmark of `hpop live`: seconds from a click to the cards, and milliseconds from a push to its answer.

    python benchmarks/live.py [--map NAME ...] [--clicks 40] [--pushes 1000] [--sessions 4] [--crowd N] [--out FILE]

`hpop live` runs in a process of its own, and its planner in another; a page is connected through the websocket. Clicks
are at random places; those that the robot cannot reach are drawn again. The first click is left out, and so is reading
the map. The robot drives to each place, and is pushed at random times to the left or the right. A push that comes while
the planner is busy may wait for it; this is included. After a box was closed, one more click is timed. Processor times
are those of the planner's process from the moment at which a request comes, with all that it waits for there. They are
what the times would be on a machine that does nothing else. Thread times are those of the thread that answers. The
sessions, one after the other, have the seeds 0, 1, ... After the last push of each, brute force compares all ways among
which each push chose (checked_pushes.py), and the gap between robot and people is the least of the states that the page
was told, 20 a second.
"""

from __future__ import annotations

import argparse
import json
import math
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

from hpop.models.execution import clearance_radius
from hpop.problems.problem import Problem
from hpop.scenario import load_scenario
from hpop.world import Person

WAIT = 60.0
PUSHES = 12  # while the robot drives to one place
PAUSE = (0.1, 0.6)  # s between two pushes
CHECKED = 300.0  # s, to check the pushes of one session
SHARES = (50, 90, 95, 99)
RADIUS = Person.radius


class Page:
    """A page at the websocket of a session."""

    def __init__(self, socket: Any, reach: float) -> None:
        self.socket = socket
        self.state: dict[str, Any] = {}
        self.processor = list[float]()  # ms, of clicks
        self.gap, self.reach = math.inf, reach  # m
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
                places = [(each[0], each[1]) for each in message["people"]]
                apart = [math.dist(place, (message["x"], message["y"])) for place in places]
                self.gap = min([self.gap, *(distance - self.reach - RADIUS for distance in apart)])
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


class Times:
    """Times of all sessions on a map: s of clicks, ms of pushes."""

    def __init__(self) -> None:
        self.seconds, self.changed, self.processor = list[float](), list[float](), list[float]()
        self.answered, self.spent, self.thread = list[float](), list[float](), list[float]()
        self.followed = self.blocked = 0
        self.gaps = list[float]()
        self.checked = {"pushes": 0, "ways": 0, "wrong": 0}

    def summary(self) -> dict[str, Any]:
        """Return the figures of the benchmark."""
        return {
            "clicks": len(self.seconds),
            "click_s": quantiles(self.seconds, 3),
            "click_processor_s": round(float(np.percentile(self.processor, 95)) / 1000.0, 3),
            "clicks_after_update": len(self.changed),
            "click_after_update_s": round(max(self.changed), 3) if self.changed else None,
            "pushes": len(self.answered),
            "push_ms": quantiles(self.answered, 1),
            "push_processor_ms": quantiles(self.spent, 1),
            "push_thread_ms": quantiles(self.thread, 1),
            "pushes_within_100_ms": round(float((np.array(self.answered) <= 100.0).mean()), 4),
            "pushes_within_100_ms_of_thread": round(float((np.array(self.thread) <= 100.0).mean()), 4),
            "pushes_followed": round(self.followed / max(len(self.answered), 1), 3),
            "pushes_without_an_open_way": self.blocked,
            "pushes_by_brute_force": self.checked,
            "contacts": sum(gap <= 0.0 for gap in self.gaps),
            "least_gap_m": None if math.inf in self.gaps else round(min(self.gaps), 3),
        }


def quantiles(times: list[float], digits: int) -> dict[int, float]:
    """Return the times that some shares of all, in percent, do not exceed."""
    return dict(zip(SHARES, np.percentile(times, SHARES).round(digits).tolist(), strict=True))


def measure(address: str, problem: Problem, clicks: int, pushes: int, seed: int, times: Times) -> None:
    """Click and push in one session until there are enough of both."""
    random, bounds = np.random.default_rng(seed), problem.world.bounds
    clicked = pushed = 0
    with connect(address.replace("http", "ws", 1) + "socket", max_size=None) as socket:
        page = Page(socket, clearance_radius(problem.model, 0.0))
        while page.until("note")["words"] != "the map is prepared":
            pass
        while clicked < clicks + 1 or pushed < pushes:
            x, y = random.uniform(bounds[:2], bounds[2:])
            took, options = page.click(x, y)
            if not options:
                continue
            clicked += 1
            if clicked > 1:
                times.seconds.append(took)
            if clicked % 8 == 0:  # a map update, far from the robot
                far = (bounds[0], bounds[1]) if page.state["x"] > (bounds[0] + bounds[2]) / 2 else bounds[2:]
                corners = [[far[0] + dx, far[1] + dy] for dx, dy in ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2))]
                page.say("close", corners=corners, name="box")
                page.until("closed", "refused")
                took, again = page.click(x, y)
                if again:
                    times.changed.append(took)
                page.say("open", name="box")
                page.until("closed", "refused")
            page.say("take", option=int(random.integers(len(options["all"]))))
            page.until("taken", "refused")
            for _ in range(PUSHES):
                if page.until("arrived", seconds=float(random.uniform(*PAUSE))) or pushed >= pushes:
                    break
                began = time.perf_counter()
                page.say("push", direction=float(random.choice([-1, 1]) * random.uniform(0.2, 1.6)))
                answer = page.until("pushed", "arrived")
                if answer.get("type") != "pushed" or "choose a destination first" in answer["words"]:
                    break
                times.answered.append(1000.0 * (time.perf_counter() - began))
                times.spent.append(answer["processor"])
                times.thread.append(answer["thread"])
                times.followed += answer["followed"]
                times.blocked += answer["option"] is None
                pushed += 1
        page.end()
    times.processor += page.processor[1:]
    times.gaps.append(page.gap)


def machine() -> str:
    """Return the name of the processor, and the number of its cores."""
    about = Path("/proc/cpuinfo")
    lines = about.read_text().splitlines() if about.exists() else []
    names = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    return f"{[*names, platform.machine()][0]}, {os.cpu_count()} cores"


def session(name: str, step: float, crowd: int, clicks: int, pushes: int, seed: int, times: Times) -> None:
    """Serve one session on a map, measure it, and check its pushes by brute force."""
    examples = maps.ROOT / "examples"
    text = (examples / f"{name}.yaml").read_text().replace("../../shared/data", str(maps.DATA))
    text = text.replace("museum.geojson", str(examples / "museum.geojson"))
    with tempfile.TemporaryDirectory() as folder:
        file, asked = Path(folder) / f"{name}.yaml", Path(folder) / "checked"
        file.write_text(text.replace("step: 0.25", f"step: {step:g}"))
        command = [sys.executable, "-P", "-m", "hpop", "live", file.name, "--port", "0", "--out", "out"]
        command += ["--crowd", str(crowd), "--import", str(Path(__file__).with_name("checked_pushes.py"))]
        variables = {**os.environ, "CHECKED_PUSHES": str(asked)}
        with subprocess.Popen(command, cwd=folder, env=variables, stdout=subprocess.PIPE, text=True) as server:
            try:
                assert server.stdout is not None
                address = server.stdout.readline().strip().removeprefix("drive: ")
                measure(address, load_scenario(file).problem, clicks, pushes, seed, times)
                asked.touch()
                result, last = asked.with_suffix(".json"), time.monotonic() + CHECKED
                while not result.exists() and time.monotonic() < last:
                    time.sleep(0.2)
                for what, count in json.loads(result.read_text()).items():
                    times.checked[what] += count
            finally:
                server.terminate()


def main() -> None:
    """Measure each map, and print or write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--map", nargs="*", default=["pal_office", "nav2_depot"])
    parser.add_argument("--clicks", type=int, default=40)
    parser.add_argument("--pushes", type=int, default=1000)
    parser.add_argument("--sessions", type=int, default=4)
    parser.add_argument("--crowd", type=int, default=0, help="people who walk about")
    parser.add_argument("--step", type=float, default=0.25)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    found: dict[str, Any] = {"machine": machine()}
    for name in asked.map:
        if name in maps.FOLDERS and (lacks := maps.missing(name)):
            print(f"{name}: {lacks}")
            continue
        load, times = os.getloadavg()[0], Times()
        for seed in range(asked.sessions):
            clicks, pushes = -(-asked.clicks // asked.sessions), -(-asked.pushes // asked.sessions)
            session(name, asked.step, asked.crowd, clicks, pushes, seed, times)
        found[name] = {"load": [round(load, 1), round(os.getloadavg()[0], 1)], **times.summary()}
        print(name, json.dumps(found[name]))
    if asked.out is not None:
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        asked.out.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
