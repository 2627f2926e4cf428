"""Benchmark among real people: plans through a two-way corridor, judged by the recorded people.

``HPOP_DATA=folder python benchmarks/corridor.py --out out/bench/corridor.json``

At some moments of a recording (bi_corr_400_b_03 of Forschungszentrum Juelich, in PedPy's demonstration data; people
cross a corridor of 10 m x 4 m both ways) a robot begins at the left end and shall leave at the right. The people
present are predicted by a constant velocity, that of the last half second, up to a horizon; later arrivals are unknown.
The exact front of these predictions is evaluated against the recorded people, who had no robot among them. The shortest
path, which ignores people, stands beside it. (With perfect predictions there was often no path at all: people walk
where they do not see a robot.)

The error of constant velocity is measured at other moments. Intrusion is `personal_space`, s; gaps are between the
surfaces of bodies, m, negative where they overlap. Seconds are the processor's.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

import hpop
from hpop.criteria.others.metrics import social_metrics
from hpop.world import Person, Track, World

FILE = "pedpy_corridors/bi_corr_400_b_03.txt"
CORRIDOR = shapely.box(-5.6, -0.1, 4.6, 4.1)  # m, where heads are seen
MOMENTS = (
    9.0,
    11.0,
    123.0,
    124.0,
    125.0,
    126.0,
    127.0,
)  # s of the recording: not the crowded middle, where there is no way
CALIBRATION = np.arange(20.0, 120.0, 5.0)  # s, at which the error of the prediction is measured
AHEAD = (1.0, 2.0, 4.0)  # s
WINDOW = 0.5  # s, over which a velocity is taken: about a step
SEEN = 0.1  # s, for which somebody must have been seen to be predicted
HORIZON = 8.0  # s
BODY = 0.2  # m, radius of a person
ROBOT = hpop.DifferentialDrive(radius=0.25, camera_height=1.2)
CRITERIA = ("personal_space", "turns", "length")
ENDS = (-5.0, 4.0)  # m, where the robot begins, and where its goals are
LANES = np.arange(0.5, 3.6, 0.25)  # m across, where it may begin
MIDDLE = 2.0  # m across
ROOM = 0.6  # m from the robot's axis to anybody, now and up to the horizon, where it may begin
GOALS = (0.5, 1.25, 2.0, 2.75, 3.5)  # m across
LATEST = 20.0  # s, when it has arrived
STEP = 0.5  # m, of the lattice

Tracks = Mapping[Hashable, Track]


def velocity(track: Track, now: float) -> tuple[float, float]:
    """Return the mean velocity, m/s, of a person over the last moments seen."""
    seen = min(WINDOW, now - track.begin)
    (x0, y0), (x1, y1) = track.at(now - seen), track.at(now)
    return float(x1 - x0) / seen, float(y1 - y0) / seen


def present(tracks: Tracks, now: float) -> Iterator[tuple[Hashable, Track]]:
    """Yield the people who have been seen for some pictures and are still present."""
    return ((one, track) for one, track in tracks.items() if track.begin <= now - SEEN and track.end > now)


def predicted(tracks: Tracks, now: float) -> list[Person]:
    """Return the people of a moment, each with the velocity of that moment."""
    people = []
    for one, track in present(tracks, now):
        x, y = (float(place) for place in track.at(now))
        people.append(Person(x, y, velocity=velocity(track, now), radius=BODY, name=str(one)))
    return people


def recorded(tracks: Tracks, now: float) -> list[Person]:
    """Return all recorded people from a moment on, later arrivals included, while the robot may be there."""
    later = ((one, track.later(now)) for one, track in tracks.items() if track.end > now)
    there = [(one, track) for one, track in later if track.begin < LATEST]
    return [Person.along(track, radius=BODY, name=str(one), until=LATEST) for one, track in there]


def errors(tracks: Tracks) -> dict[str, float]:
    """Return the root mean square error, m along each axis, of constant velocity after some seconds."""
    found = dict[str, float]()
    for ahead in AHEAD:
        squares = []
        for now in CALIBRATION:
            for _, track in present(tracks, now):
                if track.end >= now + ahead:
                    at, then = np.array(track.at(now)), np.array(track.at(now + ahead))
                    squares.append((then - at - ahead * np.array(velocity(track, now))) ** 2)
        found[f"{ahead:g} s"] = math.sqrt(float(np.mean(squares)))
    return found


def asked(people: list[Person]) -> hpop.Problem:
    """Return the problem of a moment: from the middle of the left end, or the nearest free point, to anywhere right."""
    t = np.arange(0.0, HORIZON, 0.05)
    ways = np.array([person.at(t) for person in people])  # (people, 2, times)
    free = [lane for lane in LANES if np.hypot(ways[:, 0] - ENDS[0], ways[:, 1] - lane).min() > ROOM]
    start = (ENDS[0], float(min(free, key=lambda lane: abs(lane - MIDDLE))), 0.0)
    world = World.from_polygons([], extent=CORRIDOR).with_content(people=people)
    return hpop.Problem(world, ROBOT, start, [(ENDS[1], y, None) for y in GOALS], CRITERIA, horizon=HORIZON)


def judged(trajectory: hpop.Trajectory, truth: hpop.Problem) -> dict[str, float]:
    """Evaluate a plan among the recorded people."""
    metrics = social_metrics(trajectory.execution(), truth.world, robot_radius=ROBOT.radius)
    return {"intrusion": truth.evaluate(trajectory)["personal_space"], "least_gap": metrics.min_human_distance}


def moment(tracks: Tracks, now: float) -> dict[str, Any]:
    """Return the plans of one moment and their values."""
    problem = asked(predicted(tracks, now))
    world = problem.world.with_content(people=recorded(tracks, now))
    truth = replace(problem, world=world)
    begun = time.process_time()
    front = problem.solve("lattice", step=STEP, arrive_by=LATEST)
    seconds = time.process_time() - begun
    nobody = replace(problem, world=problem.world.with_content(), criteria=problem.criteria[1:])
    shortest = nobody.solve("lattice", step=STEP)
    expected = front.costs[:, front.names.index("personal_space")]
    plans = {
        "least intrusion": front.best("personal_space").trajectory,
        "shortest, heeding nobody": shortest.best("length").trajectory,
    }
    return {
        "now": now,
        "people": len(problem.world.content.people),
        "later": len(world.content.people) - len(problem.world.content.people),
        "front": len(front),
        "status": front.status,
        "seconds": seconds,
        "predicted_of_least": float(expected.min()),
        "plans": {name: judged(trajectory, truth) for name, trajectory in plans.items()},
    }


def main() -> None:
    """Plan at each moment and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/corridor.json"), help="JSON file")
    arguments = parser.parse_args()
    path = Path(os.environ.get("HPOP_DATA", Path(__file__).parents[2] / "shared" / "data")) / FILE
    if not path.exists():
        print(f"left out: there is no recording {path}; set HPOP_DATA to the folder that has {FILE}")
        return
    tracks = hpop.read_tracks(path)
    found: dict[str, Any] = {"people": len(tracks), "error_of_constant_velocity_m": errors(tracks), "moments": []}
    print(json.dumps(found))
    for now in MOMENTS:
        found["moments"].append(moment(tracks, now))
        print(json.dumps(found["moments"][-1]))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
