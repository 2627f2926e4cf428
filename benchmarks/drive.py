"""Benchmark of a drive: the front of the rest, again and again, while places are closed and opened.

    python benchmarks/drive.py [--maps museum pal_office nav2_depot m200 visitors small] [--events 300] [--out FILE]

Of each map the lattice at 0.25 m with exposure, turns and length, prepared once (:class:`hpop.search.Prepared`), and
the exact front from its start. An event is a place on a way of that front from which all that is left is asked for; the
rest of each way that passes it is known. In two of three events a circle of 0.4 to 1.5 m a little ahead on the way is
closed before, which may leave nothing known, and opened after. Seconds are processor seconds of the thread that asks,
with a deadline of them: of 0.1 s, on m200 of 0.3 s. What a closing took, in all threads, is part of it: so the whole
from the event to the answer is ``ms``. Where an answer is complete its front is compared with that of
``pareto_paths`` on a fresh graph without what is closed; where it is not, some are, and the gap that was claimed with
the true one. Fails where any differs, or a gap is larger than claimed. Maps that are absent are skipped.

Among people who move (``visitors``, the museum of examples/visitors.yaml, and ``small``, that of timed_worlds.py) an
event is a question on a drive (:func:`hpop.follow`) along a plan of the front, at 0.25 m and 1/20 s; before one of
three a person is predicted otherwise, before another an area is closed. Beside are answers of the planner that begins
from nothing each time, with as many seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import maps
import museums
import numpy as np
import shapely
import timed_worlds

import hpop
import hpop.drive
import hpop.errors
from hpop.base.arrays import IntArray
from hpop.criteria import make_criterion
from hpop.planners import Lattice
from hpop.runtime.limits import Status
from hpop.scenario import load_scenario
from hpop.search import Graph, ParetoPaths, Prepared, pareto_paths
from hpop.world import Person

STEP = 0.25  # m
COSTS = ["exposure", "turns", "length"]
DEADLINES = {"museum": 0.1, "pal_office": 0.1, "nav2_depot": 0.1, "m100": 0.1, "m200": 0.3}  # s
RADII = (0.4, 1.5)  # m, of what is closed
AHEAD = (5, 40)  # states on the way
LONG = 10  # answers that are not complete and yet compared, for their gaps
LIMITS = (0.2, 1.0)  # s, deadlines among people
LATEST = 8.0  # s: then another drive begins
SLACK = 0.03  # s, by which no deadline is to be overrun
FIRST = 30  # events that come before those that are measured: kernels are compiled, or loaded


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", nargs="+", default=["museum", "pal_office", "nav2_depot", "m200"])
    parser.add_argument("--events", type=int, default=300)
    parser.add_argument("--out", type=Path, help="JSON file; printed in any case")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.maps:
        if name in PEOPLE:
            rows.append(among(name, arguments.events))
            print(json.dumps(rows[-1], indent=1), flush=True)
            continue
        if name in maps.FOLDERS and (reason := maps.missing(name)):
            print(f"{name} skipped: {reason}")
            continue
        rows.append(Drive(name).measured(arguments.events))
        print(json.dumps(rows[-1], indent=1), flush=True)
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps({"maps": rows}, indent=1) + "\n")
    if wrong := [row["map"] for row in rows if row.get("different") or row.get("claims_broken")]:
        sys.exit(f"answers differ from those of fresh graphs, or claim too small a gap: {', '.join(wrong)}")


def problem(name: str) -> hpop.Problem:
    """Return the museum of the examples, one of the museums by seed, or a real map."""
    if name != "museum":
        return maps.problem(name) if name in maps.FOLDERS else museums.problem(name)
    asked = hpop.examples.museum()
    return hpop.Problem(asked.world, asked.model, asked.start, asked.goal, COSTS)


class Drive:
    """A map's graph, prepared, and the front from its start."""

    def __init__(self, name: str) -> None:
        self.name, self.deadline = name, DEADLINES.get(name, 0.1)
        asked, planner = problem(name), Lattice(step=STEP)
        space, start, goals = planner.ends(planner.lattice(asked), asked)
        self.graph: Graph = space.graph([make_criterion(cost) for cost in COSTS])
        self.goals = np.array(goals)
        states = space.states(np.arange(space.size))
        self.place = np.column_stack([states.x, states.y])  # (n, 2) m
        self.tails = np.repeat(np.arange(self.graph.nodes), np.diff(self.graph.indptr))
        Prepared(self.graph, goals).paths(start, deadline=self.deadline)  # compiles
        began = time.process_time()
        self.prepared = Prepared(self.graph, goals)
        self.seconds = time.process_time() - began
        self.front = pareto_paths(self.graph, start, goals)

    def measured(self, events: int) -> dict[str, Any]:
        """Measure the seconds and claims of some events; see the module."""
        for number in range(FIRST):
            node, shut = self._event(np.random.default_rng(number), closes=number % 3 > 0)
            self.prepared.close(shut)
            self.prepared.paths(node, deadline=self.deadline)
            self.prepared.open(shut)
        rng = np.random.default_rng(0)
        rows, untouched = list[tuple[float, ParetoPaths]](), list[float]()
        closing, opening = list[float](), list[float]()
        different = broken = 0
        long: list[float] = []
        while len(rows) < events:
            node, shut = self._event(rng, closes=len(rows) % 3 > 0)
            spent = seconds(lambda shut=shut: self.prepared.close(shut)) if shut.size else 0.0
            if shut.size:
                closing.append(spent)
            known = self.front.suffixes(node)
            began = time.thread_time()
            found = self.prepared.paths(node, deadline=max(0.0, self.deadline - spent), known=known)
            rows.append((spent + time.thread_time() - began, found))
            if not shut.size:
                untouched.append(found.gap)
            if found.status.is_final or len(long) < LONG:
                exact = pareto_paths(self.graph.without(self.prepared.closed), node, self.goals)
                different += found.status.is_final and not same(found, exact)
                if not found.status.is_final:
                    long.append(true_gap(found, exact))
                    broken += long[-1] > found.gap + 1e-9
            if shut.size:
                opening.append(seconds(lambda shut=shut: self.prepared.open(shut)))
        return {
            "map": self.name,
            "states": self.graph.nodes,
            "arcs": self.graph.arcs,
            "front": len(self.front),
            "prepare_s": self.seconds,
            "prepared_mb": self.prepared.memory / 2**20,
            "graph_mb": sum(a.nbytes for a in vars(self.graph).values() if isinstance(a, np.ndarray)) / 2**20,
            "close_ms": spread(closing),
            "open_ms": spread(opening),
            "deadline_s": self.deadline,
            **answers(rows, self.deadline),
            "gap_where_nothing_is_closed": max(untouched),
            "different": different,
            "claims_broken": broken,
            "true_gaps": sorted(long),
        }

    def _event(self, rng: np.random.Generator, closes: bool) -> tuple[int, IntArray]:
        """Draw a position on a path, and the arcs that close ahead of it: none, or all at some positions."""
        while True:
            nodes = self.front.nodes(int(rng.integers(len(self.front))))
            at = int(rng.integers(nodes.size - 1))
            centre = self.place[nodes[min(nodes.size - 2, at + int(rng.integers(*AHEAD)))]]
            near = np.hypot(*(self.place - centre).T) < rng.uniform(*RADII)
            if not closes:
                return int(nodes[at]), np.zeros(0, np.int64)
            if not near[nodes[at]] and not near[self.goals].any():
                return int(nodes[at]), np.flatnonzero(near[self.tails] | near[self.graph.heads])


def visitors() -> hpop.Problem:
    """Return the museum of the examples with three walking visitors."""
    return load_scenario(Path(__file__).parent.parent / "examples" / "visitors.yaml").problem


def small() -> hpop.Problem:
    """Three rooms with two visitors who come through their doors."""
    return timed_worlds.small().problem


PEOPLE = {"visitors": visitors, "small": small}


def among(name: str, events: int) -> dict[str, Any]:
    """Measure the answers of drives among moving people."""
    asked, planner, rng = PEOPLE[name](), Lattice(step=STEP, margin=0.1), np.random.default_rng(0)
    began = time.process_time()
    front = asked.solve(planner)
    row: dict[str, Any] = {"map": name, "events": events, "front": len(front), "front_s": time.process_time() - began}
    told: dict[str, list[float]] = {"follow": [], "people": [], "close": [], "ready": []}
    at_once: list[tuple[float, int, bool]] = []  # seconds of the drive's own thread
    kept: dict[float, list[tuple[float, int, bool]]] = {limit: [] for limit in LIMITS}
    anew: dict[float, list[tuple[float, int, bool]]] = {limit: [] for limit in LIMITS}
    drive, now = None, 0.0
    for number in range(events):
        if drive is None or now > LATEST:
            now, row_of = 0.0, int(rng.integers(len(front)))
            began = time.process_time()
            drive = hpop.follow(asked, front, row_of, planner=planner)
            told["follow"].append(time.process_time() - began)
        now += float(rng.uniform(0.2, 2.5))
        change = ("none", "people", "close")[number % 3]
        try:
            spent = changed(drive, change, now, rng)
        except hpop.errors.DriveError:  # it covers the robot
            continue
        told.setdefault(change, []).append(spent)
        if change != "none":  # the graph on the clock is being made
            began = time.thread_time()
            options = drive.options(now, LIMITS[0])
            at_once.append((time.thread_time() - began, len(options), options.status.is_final))
            began = time.process_time()
            drive.ready()
            told["ready"].append(time.process_time() - began)
        for limit in LIMITS:
            began = time.thread_time()
            options = drive.options(now, limit)
            kept[limit].append((time.thread_time() - began, len(options), options.status.is_final))
            commit = options.commit
            if not commit.arrives:
                there = drive.surroundings.at(commit.state, commit.time)
                began = time.process_time()
                try:
                    found = replace(planner, time_limit=limit).solve(there)
                except hpop.errors.QueryError:
                    continue
                # Beside what is found the present plan is known.
                more = len(found.trajectories) + 1
                anew[limit].append((time.process_time() - began, more, found.status.is_final))
        options = drive.options(now, LIMITS[0])
        if len(options) and rng.random() < 0.3:
            drive.take(int(rng.integers(len(options))))
        elif options.keep_on is None:
            drive = None
    row |= {f"{what}_ms": spread(spent) for what, spent in told.items() if what != "none"}
    for limit in LIMITS:
        for words, several in (
            ("kept", kept[limit]),
            ("anew", anew[limit]),
            *[("at_once", at_once)] * (limit == LIMITS[0]),
        ):
            row[f"{words}_{limit:g}_s"] = {
                "ms": spread([spent for spent, *_ in several]),
                "more_than_the_plan": sum(count > 1 or final for _, count, final in several) / len(several),
                "exact": sum(final for *_, final in several) / len(several),
            }
    return row


def changed(drive: hpop.drive.Execution, change: str, now: float, rng: np.random.Generator) -> float:
    """Tell a drive that a person will walk otherwise, or that an area is closed; the processor seconds it takes."""
    there = drive.surroundings
    people = [person.later(now - there.since) for person in there.people]
    began = time.process_time()
    if change == "people":
        i = int(rng.integers(len(people)))
        people[i] = Person(people[i].x, people[i].y, velocity=tuple(rng.uniform(-0.8, 0.8, 2)), until=10.0)
        drive.world(now, people=people)
    elif change == "close":
        way = drive.announced.at(drive.announced.duration * float(rng.uniform(0.3, 0.9)))
        drive.world(now, close=shapely.Point(float(way.x[0]), float(way.y[0])).buffer(0.3))
    return time.process_time() - began


def answers(rows: list[tuple[float, ParetoPaths]], deadline: float) -> dict[str, Any]:
    """Summarise the seconds and claims of answers."""
    spent = [row[0] for row in rows]
    gaps = [found.gap for _, found in rows if not found.status.is_final]
    over = np.array(spent) - deadline
    return {
        "events": len(rows),
        "no_path": sum(found.status is Status.NO_PATH for _, found in rows),
        "ms": spread(spent),
        "exact": 1 - len(gaps) / len(rows),
        "in_time": float((over <= 0).mean()),
        "overrun_ms": 1e3 * max(0.0, float(over.max())),
        "overruns_above_30_ms": int((over > SLACK).sum()),
        "gaps": spread(gaps, 1.0),
        "gaps_above_a_tenth": sum(gap > 0.1 for gap in gaps),
        "search_mb": max(found.stats.peak_memory for _, found in rows) / 2**20,  # beside what is kept
    }


def same(found: ParetoPaths, exact: ParetoPaths) -> bool:
    """Return True if two answers have equal status and vectors."""
    return found.status is exact.status and found.costs.tolist() == exact.costs.tolist()


def true_gap(found: ParetoPaths, exact: ParetoPaths) -> float:
    """Return the relative amount by which the worst vector of the exact front is missed."""
    beyond = found.costs[None] / np.maximum(exact.costs[:, None], 1e-9) - 1
    return float(np.maximum(beyond.max(axis=2), 0).min(axis=1).max())


def spread(values: list[float], unit: float = 1e3) -> dict[str, float]:
    """Median, 99th percentile and largest, in milliseconds."""
    if not values:
        return {}
    table = unit * np.array(values)
    return {"median": float(np.median(table)), "p99": float(np.quantile(table, 0.99)), "max": float(table.max())}


def seconds(call: Any) -> float:
    """Processor seconds of a call, of all threads."""
    began = time.process_time()
    call()
    return time.process_time() - began


if __name__ == "__main__":
    main()
