"""Benchmark of the first answer: seconds from the start of `hpop plan` until a front is saved, on real maps.

    python benchmarks/first_answer.py [--data ../shared/data] [--map NAME ...] [--out FILE]

Each map at a step of 0.25 m, criteria obstruction, turns, length, start and goal far apart. A process runs until its
first front is on the disk, and is then ended; `cpu_s` is the processor time that it had taken, which depends less on
what else the machine does. Of each map the least of three runs counts, after one that may have to compile. Maps whose
files are not there are left out.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
STEP = 0.25  # m
PATIENCE = 600  # s
RUNS = 3
# World, radius of the robot, start, goal.
MAPS: dict[str, tuple[dict[str, Any], float, list[Any], list[Any]]] = {
    "pal_office": ({"ros_map": {"path": "pal_office/map.yaml"}}, 0.3, [6.0, -8.0, "90 deg"], [-10.0, 1.0, "any"]),
    "nav2_depot": (
        {"ros_map": {"path": "nav2_depot/depot.yaml", "keep_out": "nav2_depot/depot_keepout.yaml"}},
        0.3,
        [1.5, 1.5, 0],
        [29.0, 10.5, "any"],
    ),
    "aws_bookstore": ({"ros_map": {"path": "aws_bookstore/map.yaml"}}, 0.2, [-6.75, 7.0, 0], [6.25, -6.5, "any"]),
    "field_museum_main": (
        {
            "geojson": {
                "path": "field_museum_main/main_level_outline.geojson",
                "polygons": "outline",
                "scale": 0.7447,
                "origin": [-9753627.0, 5140874.0],
            }
        },
        0.3,
        [2.18, 15.59, 0],
        [210.43, 119.09, "any"],
    ),
    "Berlin_1_256": (
        {"movingai": {"path": "movingai/Berlin_1_256/Berlin_1_256.map", "resolution": 0.25}},
        0.2,
        [0.375, 0.375, 0],
        [63.625, 63.625, "any"],
    ),
    "den312d": (
        {"movingai": {"path": "movingai/den312d/den312d.map", "resolution": 0.25}},
        0.2,
        [3.875, 1.375, 0],
        [14.625, 18.625, "any"],
    ),
    "room-64-64-8": (  # its doors are one cell wide
        {"movingai": {"path": "movingai/room-64-64-8/room-64-64-8.map", "resolution": 0.5}},
        0.2,
        [1.25, 1.25, 0],
        [30.25, 30.25, "any"],
    ),
}


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data")),
        help="folder with the maps",
    )
    parser.add_argument("--map", choices=list(MAPS), nargs="+", default=list(MAPS))
    parser.add_argument("--out", type=Path, help="JSON file; printed in any case")
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        rows = []
        for name in arguments.map:
            scenario = write(Path(folder), name, arguments.data.absolute())
            if scenario is None:
                print(f"{name}: its files are not in {arguments.data}")
                continue
            first_answer(scenario)
            runs = [first_answer(scenario) for _ in range(RUNS)]
            rows.append({"map": name, **min(runs, key=lambda run: run["first_front_s"])})
            print(json.dumps(rows[-1]))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(rows, indent=1) + "\n")


def write(folder: Path, name: str, data: Path) -> Path | None:
    """Write the scenario of a map; return None where its files are missing."""
    world, radius, start, goal = MAPS[name]
    ((reader, given),) = world.items()
    paths = {key: str(data / given[key]) for key in ("path", "keep_out") if key in given}
    if not all(Path(path).exists() for path in paths.values()):
        return None
    scenario = {
        "world": {reader: {**given, **paths}},
        "model": {"differential_drive": {"radius": radius, "camera_height": 1.2}},
        "start": start,
        "goal": goal,
        "criteria": ["obstruction", "turns", "length"],
        "planner": {"lattice": {"step": STEP}},
    }
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return path


def first_answer(scenario: Path) -> dict[str, Any]:
    """Seconds until the first front of a scenario is saved, and how many trajectories it has."""
    with TemporaryDirectory() as folder:
        saved = Path(folder) / "out" / "front.json"
        began = time.perf_counter()
        command = [
            sys.executable,
            "-c",
            "from hpop.cli import main; main()",
            "plan",
            str(scenario),
            "--out",
            str(saved.parent),
        ]
        # As where hpop is installed, Python keeps what it has compiled.
        kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=kept
        ) as process:
            try:
                while not saved.exists():
                    seconds = time.perf_counter() - began
                    if process.poll() is not None or seconds > PATIENCE:
                        said = process.stderr.read() if process.stderr and process.poll() is not None else "too slow"
                        raise RuntimeError(f"no front of {scenario.stem}: {said}")
                    time.sleep(0.005)
                seconds, cpu = time.perf_counter() - began, cpu_seconds(process.pid)
            finally:
                process.kill()
        front = json.loads(saved.read_text())
        return {
            "first_front_s": round(seconds, 3),
            "cpu_s": cpu,
            "trajectories": front["points"]["count"],
            "status": front["status"],
        }


def cpu_seconds(pid: int) -> float | None:
    """Processor time of a running process, user and system; None where the system does not say (only Linux does)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
