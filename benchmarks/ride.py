"""Benchmark of pictures and videos all round: processor time of a frame drawn, and of a video of so many seconds.

    python benchmarks/ride.py --seconds 60 --out FILE

Prints one JSON line for each width of pictures in the museum of examples/, and one for a video of 2048 x 1024 at 30
frames a second. Processor time is that of all threads; ``minutes_on_two_cores`` is half of it.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import hpop
import hpop.examples
from hpop.view import save_video
from hpop.view.ride.panorama import Panorama
from hpop.view.ride.scene import ViewScene
from hpop.view.ride.video import Clip

WAY = [(2, 10, 0), (11, 10, 0), (16, 9.9, 0), (20, 9, 0), (24, 8.5, -1.57), (24.1, 6, -1.57)]


def processor_seconds() -> float:
    """Return the processor seconds of this process so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def picture(problem: hpop.Problem, width: int) -> dict[str, Any]:
    """Return the median of seven pictures at different positions."""
    drawn, seconds = Panorama(ViewScene.of(problem), width), []
    for x in range(4, 12):
        began = time.thread_time()
        drawn.draw(np.array([x, 10.0, 1.2]), 0.1 * x, 0.0)
        seconds.append(time.thread_time() - began)
    return {"picture": f"{width} x {width // 2}", "processor_seconds": round(float(np.median(seconds[1:])), 4)}


def video(problem: hpop.Problem, seconds: float) -> dict[str, Any]:
    """Return a tour that continues until the time is up."""
    goes = hpop.Trajectory.from_poses(problem.model, WAY)
    while goes.execution().duration < seconds:
        x, y, yaw = (float(getattr(goes.states, name)[-1]) for name in ("x", "y", "yaw"))
        back = [(x, y), *[(a, b) for a, b, _ in reversed(WAY[:-1])]]
        poses = [*zip(goes.states.x, goes.states.y, goes.states.yaw, strict=True), *[(a, b, yaw) for a, b in back]]
        goes = hpop.Trajectory.from_poses(problem.model, poses)
    with tempfile.TemporaryDirectory() as folder:
        clip, began, on_clock = Clip.of(problem, goes), processor_seconds(), time.perf_counter()
        path = save_video(problem, goes, Path(folder) / "tour.mp4")
        used, lasted = processor_seconds() - began, time.perf_counter() - on_clock
        size = path.stat().st_size
    per_frame = used / clip.count
    return {
        "video": "2048 x 1024",
        "frames": clip.count,
        "processor_seconds_a_frame": round(per_frame, 4),
        "seconds_on_the_clock": round(lasted, 1),
        "minutes_on_two_cores_for_60_s": round(per_frame * 1800 / 2 / 60, 2),
        "megabytes": round(size / 1e6, 1),
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
    }


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="at least so long is the video")
    parser.add_argument("--out", type=Path, default=Path("out/bench/ride.json"), help="JSON file")
    arguments = parser.parse_args()
    problem = hpop.examples.museum()
    rows = []
    for row in (
        *(lambda w=w: picture(problem, w) for w in (1024, 2048, 4096)),
        lambda: video(problem, arguments.seconds),
    ):
        rows.append(row())
        print(json.dumps(rows[-1]), flush=True)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
