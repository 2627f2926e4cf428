"""After any events the options are what a fresh search finds, from the same place in the world as it is then.

The fresh search knows nothing of drives: it is a new problem, in a new world with the closed areas as keep-out zones,
from where the options begin, on a lattice that is laid out for it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive.plan import between
from hpop.errors import DriveError, QueryError
from hpop.frontier import is_nondominated
from hpop.planners import Lattice
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.query import built_query
from hpop.planners.objectives import edge_objectives
from hpop.runtime.limits import Budget, Status
from hpop.world import Person, World
from hpop.world.content.content import Zone

EVENTS = 5
DEADLINE = 1.0  # s of processor time, hundreds of times what a search of such a hall takes
EXTENT = shapely.box(0, 0, 9, 6)
ROBOTS: list[dict[str, Any]] = [
    {"radius": 0.3},
    {"radius": 0.25, "speed": 0.7},
    {"footprint": ((0.4, 0.2), (0.4, -0.2), (-0.2, -0.2), (-0.2, 0.2))},
]
CRITERIA: list[list[Any]] = [
    ["obstruction", "turns", "length"],
    ["length", "turns"],
    ["clearance", "turns", "length"],
    ["length", "proximity"],
    ["rotation", "length", "duration"],
    ["duration", "rotation", "exposure", "turns"],
    ["hall_zones", "turns", "length"],
]
PLANNERS: list[dict[str, Any]] = [{}, {}, {"corner_cutting": True}, {"headings": 4}, {"headings": 16}]


class Hall:
    """A hall with pillars, a robot, criteria; what is closed and who is there, written down beside the drive."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        pillars = [shapely.box(x, y, x + 0.4, y + 0.7) for x, y in rng.uniform((1.8, 0), (7, 5.5), (5, 2))]
        self.ground = World.from_polygons([shapely.union_all(pillars)], extent=EXTENT)
        self.criteria = CRITERIA[seed % len(CRITERIA)]
        self.robot = hpop.DifferentialDrive(**ROBOTS[seed % len(ROBOTS)])
        self.planner = Lattice(step=0.5, **PLANNERS[seed % len(PLANNERS)])
        self.people = [self.person(rng)] if "hall_zones" in self.criteria else []
        self.closed: list[Any] = [self.area()] if seed % 4 == 1 else []
        self.zones = [Zone("keep-out", area, name=f"door {i}") for i, area in enumerate(self.closed)]
        self.names = {f"door {i}": area for i, area in enumerate(self.closed)}
        yaw = [0.0, 0.0, 0.4][seed % 3]
        self.start, self.goal = (1.0, 3.0, yaw), [(8.0, 3.0, None), (8.1, 2.93, 0.2)][seed % 2]

    def person(self, rng: np.random.Generator) -> Person:
        return Person(*rng.uniform((2.5, 1.0), (7.0, 5.0)).tolist(), name="somebody")

    def area(self) -> Any:
        """Return a triangle or a bar of random size."""
        at = self.rng.uniform((2.0, 0.5), (7.0, 5.5))
        if self.rng.random() < 0.5:
            return shapely.MultiPoint(at + self.rng.uniform(-0.9, 0.9, (3, 2))).convex_hull
        return shapely.box(*at, *(at + self.rng.choice([(0.2, 1.6), (1.4, 0.2), (0.05, 0.05)])))

    def problem(self, start: Any, zones: list[Zone]) -> hpop.Problem:
        world = self.ground.with_content(people=self.people, zones=zones)
        return hpop.Problem(world, self.robot, start, self.goal, self.criteria)

    def fresh(self, start: tuple[float, ...]) -> Any:
        """Return the result of a new search from a state; None where the start or the goal is closed.

        The lattice goes through the drive's first place, wherever the robot stands.
        """
        problem = self.problem(start, [Zone("keep-out", area) for area in self.closed])
        try:
            lattice = replace(self.planner.lattice(problem), anchor=self.start[:2])
            built = BuiltGraph(self.planner.ends(lattice, problem), problem)
        except QueryError:
            return None
        query = built_query(built, edge_objectives(problem.criteria, "lattice"))
        return query.exact("lattice", Budget())

    def event(self, drive: hpop.drive.Execution, now: float) -> None:
        """Something that happens, to the drive and to the notes beside."""
        what = self.rng.choice(["close", "close", "open", "people"])
        if what == "close":
            area = self.area()
            drive.world(now, close=area)
            self.closed.append(area)
        elif what == "open" and self.closed:
            area = self.closed.pop(int(self.rng.integers(len(self.closed))))
            name = next((name for name, named in self.names.items() if named is area), None)
            drive.world(now, open=area if name is None else name)
        elif what == "people" and self.people:
            someone = self.person(self.rng)
            drive.world(now, people=[someone])
            self.people = [someone]


@pytest.mark.seeds(1, of=62)
def test_options_are_those_of_a_fresh_search_from_there(seed: int) -> None:
    hall = Hall(seed)
    problem = hall.problem(hall.start, hall.zones)
    try:
        front = hpop.problems.solving.front(problem, hall.planner.solve(problem))
    except QueryError:
        pytest.skip("start or goal is closed")
    if not len(front):
        pytest.skip("no way")
    drive = hpop.follow(problem, front, int(hall.rng.integers(len(front))))
    now = 0.0
    for _ in range(EVENTS):
        now += float(hall.rng.uniform(0.2, 4.0))
        with suppress(DriveError):  # an area that covers the robot
            hall.event(drive, now)
        options = drive.options(now, DEADLINE)
        check(hall, drive, options)
        if len(options) and hall.rng.random() < 0.7:
            drive.take(int(hall.rng.integers(len(options))))


def check(hall: Hall, drive: hpop.drive.Execution, options: hpop.drive.Options) -> None:
    space, commit = hall.robot.space, options.commit
    state = tuple(float(getattr(commit.state, name)[0]) for name in space.names)
    fresh = hall.fresh(state)
    assert options.status in (Status.COMPLETE, Status.NO_PATH)
    if fresh is None or not len(fresh.trajectories):
        assert options.keep_on is None
        assert not len(options)
        return
    again = hpop.problems.solving.front(hall.problem(state, [Zone("keep-out", area) for area in hall.closed]), fresh)
    slack = np.where(again.quanta < 1.0, 1.5 * (fresh.tolerance.max(axis=0) + again.quanta), 0.5)
    mine, theirs = (np.maximum(f.costs, past_worst(hall, drive, options)) for f in (options.front, again))
    # The present plan may pass a corner that has come meanwhile: it is free, but a new lattice would not begin it.
    others = np.arange(len(mine)) != (-1 if options.keep_on is None else options.keep_on)
    assert covered(mine[others], theirs, slack)
    assert covered(theirs, mine, slack)
    assert is_nondominated(options.front.integers).all()
    # The present plan is among them while nothing is closed on it.
    rest = between(drive.announced, commit.time - drive._progress.lag, drive.announced.duration)
    is_open = not any(hits(hall, rest, area) for area in hall.closed)
    assert (options.keep_on is not None) == (drive._progress.plan.stops is None)
    if options.keep_on is not None:
        assert is_open
        assert options[options.keep_on].item.duration == pytest.approx(rest.duration)


def past_worst(hall: Hall, drive: hpop.drive.Execution, options: hpop.drive.Options) -> np.ndarray:
    """Return the part of the costs (k,) that no remaining path can lower: the worst moment so far."""
    past = drive.at(options.commit.time).past
    return np.array([past["clearance"] if name == "clearance" else 0.0 for name in options.front.names])


def covered(some: np.ndarray, by: np.ndarray, slack: np.ndarray) -> bool:
    """Check that each of some vectors (n, k) is covered by another set, up to rounding."""
    return bool((by[None] <= some[:, None] + slack).all(axis=2).any(axis=1).all())


def hits(hall: Hall, way: hpop.Trajectory, area: Any) -> bool:
    """Check for contact of a robot with an area along a trajectory, at states two centimetres apart."""
    alone = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50), keep_out=area)
    states = way.at(np.arange(0.0, way.duration, 0.02))
    return not hall.robot.judge(alone).states_free(states).all()
