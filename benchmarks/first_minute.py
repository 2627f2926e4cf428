"""Benchmark of the first minute: seconds from `hpop plan` to the table and to the pictures, and where they go.

    python benchmarks/first_minute.py [--old CHECKOUT] [--scenario FILE] [--runs N] [--cold] [--out FILE]

Seconds of the processor (user and system, of all processes that the command started) and of the clock, least of the
runs: `import hpop`; `hpop --help`; `hpop plan` until a first front is told, until there is a map, until the table is on
the screen, until the pictures are written; inside one process, what reading the scenario, building the graph and the
searches take.
With the path of another checkout both take turns, and the ratios of new to old are printed. A run that may have to
compile comes first and is left out; `--cold` compiles everything instead, in a cache of its own, once; the part that
is "but compiling" leaves out the processes that compile beside the first answer.
"""

from __future__ import annotations

import argparse
import json
import os
import selectors
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[1]
HPOP = "from hpop.cli import main; main()"
LOOK = 0.05  # s between two looks whether there is a map
TICK = os.sysconf("SC_CLK_TCK")
# Lines of `hpop plan` that end a part.
FIRST, TABLE, PICTURES = " trajectories, ", "certificate: ", "written to "
INSIDE = """
import json, sys, time
began = {"import": time.process_time()}
def now(part):
    began[part] = time.process_time()
from hpop.scenario import load_scenario
import hpop.cli.report
now("read")
scenario = load_scenario(sys.argv[1])
now("build")
def progress(told):
    if told.stage not in ("graph", "compiling"):
        began.setdefault("search", time.process_time())
for front in scenario.problem.fronts(scenario.planners, progress=progress, stage=lambda front: None):
    pass
began.setdefault("search", time.process_time())
now("end")
parts = list(began)
print(json.dumps({part: began[after] - began[part] for part, after in zip(parts, parts[1:])} ))
"""

Seconds = dict[str, tuple[float, float]]  # processor and clock, by part


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=Path, help="another checkout, to compare this one with")
    parser.add_argument("--scenario", type=Path, default=ROOT / "examples" / "museum.yaml")
    parser.add_argument("--runs", type=int, default=5, help="of which the least counts")
    parser.add_argument("--cold", action="store_true", help="compile everything, once")
    parser.add_argument("--out", type=Path, help="JSON file; printed in any case")
    arguments = parser.parse_args()
    checkouts = {"new": ROOT} | ({"old": arguments.old.resolve()} if arguments.old else {})
    taken: dict[str, list[Seconds]] = {name: [] for name in checkouts}
    for run in range(1 if arguments.cold else arguments.runs + 1):
        for name, checkout in checkouts.items():
            with TemporaryDirectory() as folder:
                cache = Path(folder) / "compiled" if arguments.cold else None
                seconds = parts_of(checkout, arguments.scenario.resolve(), Path(folder) / "out", cache)
            if run or arguments.cold:
                taken[name].append(seconds)
    least = {name: _least(runs) for name, runs in taken.items()}
    _print(least)
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(_rows(least), indent=1) + "\n")


def parts_of(checkout: Path, scenario: Path, out: Path, cache: Path | None) -> Seconds:
    """Seconds of each part of a first minute with the hpop of a checkout."""
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    environment = {**kept, "PYTHONPATH": str(checkout), "PYTHONUNBUFFERED": "1"}
    if cache is not None:
        environment |= {"NUMBA_CACHE_DIR": str(cache), "MPLCONFIGDIR": str(cache.with_name("matplotlib"))}
    seconds = {"import": _whole("import hpop", environment), "help": _whole(HPOP, environment, "--help")}
    seconds |= _plan(environment, scenario, out)
    if cache is None:
        said = subprocess.run(
            [sys.executable, "-P", "-c", INSIDE, str(scenario)],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        seconds |= {f"  {part}": (value, value) for part, value in json.loads(said.stdout).items()}
    return seconds


def _whole(program: str, environment: dict[str, str], *arguments: str) -> tuple[float, float]:
    """Seconds that a program takes to its end."""
    before, began = os.times(), time.perf_counter()
    command = [sys.executable, "-P", "-c", program, *arguments]
    subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True)
    after = os.times()
    taken = after.children_user + after.children_system - before.children_user - before.children_system
    return taken, time.perf_counter() - began


def _plan(environment: dict[str, str], scenario: Path, out: Path) -> Seconds:
    """Seconds of `hpop plan` until its first front, its table, its pictures."""
    began, seconds = time.perf_counter(), {}
    command = [sys.executable, "-P", "-c", HPOP, "plan", str(scenario), "--out", str(out)]
    before = os.times()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, cwd=out.parent) as process:
        assert process.stdout is not None
        said, family = "", _Family(process.pid)

        def note(part: str) -> None:
            clock = time.perf_counter() - began
            taken, planning = family.taken()
            seconds[part] = (taken, clock)
            if planning < taken:
                seconds[f"  {part}, but compiling"] = (planning, clock)

        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            while True:
                said_more = selector.select(LOOK)
                if "map" not in seconds and (out / "map.png").exists():
                    note("map")
                if not said_more:
                    continue
                piece = os.read(process.stdout.fileno(), 65536)
                said += piece.decode()
                for part, words in (("first answer", FIRST), ("table", TABLE)):
                    if part not in seconds and words in said:
                        note(part)
                if not piece:
                    break
    if process.returncode or PICTURES not in said:
        raise RuntimeError(f"hpop plan ended with {process.returncode} and said {said!r:.2000}")
    after = os.times()
    taken = after.children_user + after.children_system - before.children_user - before.children_system
    return {**seconds, "pictures": (taken, time.perf_counter() - began)}


class _Family:
    """A running process and those that it started, of which some compile beside."""

    def __init__(self, process: int) -> None:
        self.process = process
        self._compiling: set[int] = set()

    def taken(self) -> tuple[float, float]:
        """Processor seconds of all, those that have ended too, and of all but those that compile."""
        fields: dict[int, list[str]] = {}
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                fields[int(folder.name)] = (folder / "stat").read_text().rpartition(")")[2].split()
                if b"rehearsal" in (folder / "cmdline").read_bytes():
                    self._compiling.add(int(folder.name))
            except OSError:  # it has just ended
                continue
        family = [self.process]
        for parent in family:
            family += [child for child, of in fields.items() if int(of[1]) == parent]
        ticks = {member: sum(map(int, fields[member][11:15])) / TICK for member in family if member in fields}
        return sum(ticks.values()), sum(took for member, took in ticks.items() if member not in self._compiling)


def _least(runs: list[Seconds]) -> Seconds:
    return {part: (min(run[part][0] for run in runs), min(run[part][1] for run in runs)) for part in runs[0]}


def _rows(least: dict[str, Seconds]) -> list[dict[str, Any]]:
    return [
        {"part": part.strip()}
        | {
            f"{name}_{what}": round(seconds[part][i], 3)
            for name, seconds in least.items()
            for i, what in enumerate(("cpu_s", "s"))
        }
        for part in least["new"]
    ]


def _print(least: dict[str, Seconds]) -> None:
    """Print a line for each part: seconds of the processor and of the clock, and the ratio of new to old."""
    for part, (cpu, clock) in least["new"].items():
        line = f"{part:14} new {cpu:6.2f} s of the processor, {clock:6.2f} s"
        if "old" in least and part in least["old"]:
            cpu_then, clock_then = least["old"][part]
            line += f"   old {cpu_then:6.2f}, {clock_then:6.2f}   ratio {cpu / cpu_then:.2f}, {clock / clock_then:.2f}"
        print(line)


if __name__ == "__main__":
    main()
