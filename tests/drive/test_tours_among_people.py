"""Drives of tours among people who move: options are those of a new search on the clock, with the stops that remain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.drive import Execution, Options
from hpop.planners import Lattice
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import TICK
from hpop.planners.graphs.timed.plans import GraphParts
from hpop.planners.graphs.timed.presence import reading_time
from hpop.planners.graphs.timed.tour_layers import timed_tour
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.graphs.tour_stops import tour_members
from hpop.runtime.limits import Status
from hpop.search.timed import timed_paths
from tests.drive.rooms import two_doors
from tests.drive.test_among_people import CLOSED, walkers

STOPS: list[dict[str, Any]] = [
    {"at": (3.0, 3.0), "within": 0.4, "dwell": 2.0, "name": "west"},
    {"at": (8.0, 4.0), "within": 0.4, "dwell": 1.0, "name": "east"},
    {"at": (4.0, 1.0), "within": 0.3, "name": "passed", "optional": True},
]


def driving(seed: int) -> tuple[Execution, np.random.Generator]:
    """Return a drive of a tour of the hall with a wall, two openings and two people."""
    rng = np.random.default_rng(seed)
    world, tour = two_doors(people=walkers(rng)), hpop.Tour(STOPS, order="any")
    criteria = ["turns", "duration", "stops_missed"]
    robot = hpop.DifferentialDrive(radius=0.3, speeds=[(1.0,), (0.5, 1.0)][seed % 2])
    problem = hpop.Problem(world, robot, (1.0, 2.0, 0.0), (9.5, 2.0, None), criteria, tour=tour)
    planner = Lattice(step=0.5, headings=4)
    front = problem.solve(planner)
    return hpop.follow(problem, front, int(rng.integers(len(front))), planner=planner), rng


def fresh(drive: Execution, options: Options) -> np.ndarray | None:
    """Return the costs, in quanta, of a new search on the clock, over the stops that remain at the commit.

    None if a person stands by then, who would be a closed area in a new drive.
    """
    known, commit = drive._replanner._timed, options.commit
    assert known is not None
    surroundings, space = drive.surroundings, known.untimed.query.space
    tick = round((commit.time - surroundings.since) / TICK)
    then = surroundings.problem.at(surroundings.problem.start, tick * TICK)
    if not all(person.moves for person in then.world.content.people):
        return None
    space, criteria = space.costed_in(then.world), known.objectives.optimised
    timed = reading_time(criteria, space)
    plain = space.graph([c for j, c in enumerate(criteria) if j not in timed])
    node, goals = int(known.untimed.nodes(commit.state)[0]), tuple(known.untimed.query.goals)
    laid = GraphParts(plain, known.untimed.closed, near=tuple((other, at - tick * TICK) for other, at in known.near))
    graph = timed_graph(space, criteria, node, goals, known.options, then.quanta, laid, passes_goals=True)
    remaining = commit.tour
    assert remaining is not None
    members = tour_members(space, remaining, then.world)
    layers = TourGraph(space.model, space.world, space, remaining, members, goals)
    tour = timed_tour(graph, layers, goals, criteria)
    paths = timed_paths(tour.graph, node, tour.goals)
    assert paths.status is Status.COMPLETE
    return paths.costs


def stands(plan: hpop.Trajectory, at: tuple[float, float], within: float) -> float:
    """Return the longest time, s, for which a robot stands near a place, sampled; -1 if it is never there."""
    times = np.arange(0.0, plan.duration, 0.02)
    here = plan.at(times)
    near = np.hypot(here.x - at[0], here.y - at[1]) <= within + 1e-9
    if not near.any():
        return -1.0
    still = near[:-1] & (np.hypot(np.diff(here.x), np.diff(here.y)) < 1e-9) & (np.abs(np.diff(here.yaw)) < 1e-9)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    return float((edges[1::2] - edges[::2]).max(initial=0)) * 0.02


@pytest.mark.seeds(1, of=30)
def test_options_of_a_tour_among_people_are_those_of_a_fresh_search(seed: int) -> None:
    drive, rng = driving(seed)
    now = 0.0
    for event in ("none", "close", "people", "open"):
        now += float(rng.uniform(0.2, 4.0))
        if event == "people":
            drive.world(now, people=walkers(rng, now))
        elif event == "close":
            drive.world(now, close=CLOSED, name="wet floor")
        elif event == "open":
            drive.world(now, open="wet floor")
        drive.ready(now)
        options = drive.options(now, 2.0)
        if options.commit.arrives or options.status is not Status.COMPLETE:
            continue
        known = drive._replanner._timed
        assert known is not None
        mine = known.remaining_paths(known.begins(options.commit), options.commit.time, [], None).costs
        if (theirs := fresh(drive, options)) is not None:
            assert set(map(tuple, mine.tolist())) == set(map(tuple, theirs.tolist()))
        assert len(options) >= len(mine)
        if len(options) and rng.random() < 0.7:
            drive.take(int(rng.integers(len(options))))
    visited = {visit.name for visit in drive.at(drive.plan.duration).visits}
    assert {"west", "east"} <= visited or drive._progress.plan.stops is not None
    for stop in STOPS:
        if stop["name"] in visited:
            assert stands(drive.plan, stop["at"], stop["within"]) >= stop.get("dwell", 0.0) - 0.05


def test_a_stop_that_cannot_be_reached_is_named_and_may_be_skipped(tmp_path: Path) -> None:
    drive, _ = driving(0)
    drive.world(0.1, close=[(7.2, 3.2), (8.8, 3.2), (8.8, 4.8), (7.2, 4.8)], name="works")
    drive.ready()
    options = drive.options(0.1, 2.0)
    assert (len(options), options.unreachable) == (0, ("east",))
    assert "closed: 'works'. Open what is closed, or skip with drive.skip('east')" in options.front.notes[0]
    drive.skip("east")
    drive.ready()
    options = drive.options(0.2, 2.0)
    assert {option.stops for option in options} <= {("west",), ("west", "passed"), ("passed", "west")}
    drive.take(options.best("stops_missed"))
    assert {visit.name for visit in drive.at(drive.plan.duration).visits} == {"west", "passed"}
    drive.save(tmp_path / "drive.json")
    assert hpop.drive.load(tmp_path / "drive.json").plan.describe() == drive.plan.describe()
