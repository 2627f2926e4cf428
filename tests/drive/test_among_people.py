"""Among people who move, options are what a search finds that is put on a clock anew, at the moment they begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive import Execution, Options
from hpop.drive.plan import between
from hpop.planners import Lattice
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import TICK
from hpop.planners.graphs.timed.plans import GraphParts
from hpop.planners.graphs.timed.presence import reading_time
from hpop.runtime.limits import Status
from hpop.search.timed import timed_paths
from hpop.trajectories.contacts import contact
from hpop.world import Person
from tests.drive.rooms import START, two_doors
from tests.drive.test_fresh_search import covered

CRITERIA = ("turns", "duration", "hall_zones")
QUANTA = {"hall_zones": 0.01}  # s
SLACK = np.array([0, 0, 10])  # counts: what standing costs is a difference of two that are rounded, each time
CLOSED = shapely.box(7.2, 2.2, 7.6, 2.6)


def among(
    *people: Person, margin: float = 0.0, speeds: tuple[float, ...] = (1.0,)
) -> tuple[hpop.Problem, hpop.Front, Lattice]:
    """Return the problem of a hall with a wall, two openings and people; its front; and the planner."""
    robot = hpop.DifferentialDrive(radius=0.3, speeds=speeds)
    world = two_doors(people=people)
    problem = hpop.Problem(world, robot, START, (9.5, 2.0, None), list(CRITERIA), quanta=QUANTA)
    planner = Lattice(step=0.5, headings=4, margin=margin)
    return problem, problem.solve(planner), planner


def walkers(rng: np.random.Generator, now: float = 0.0) -> tuple[Person, ...]:
    """Two people who come towards the robot, somehow, and are gone some seconds later."""
    x, y = rng.uniform((8.0, 1.0), (10.0, 5.0), (2, 2)).T
    return tuple(
        Person(x[i], y[i], velocity=(-rng.uniform(0.4, 1.0), rng.uniform(-0.2, 0.2)), until=6.0, name=f"{i}, {now}")
        for i in range(2)
    )


def fresh(drive: Execution, options: Options) -> np.ndarray:
    """Return the costs, in quanta, that a search finds on a newly timed graph from the tick next to the commit."""
    known, commit = drive._replanner._timed, options.commit
    assert known is not None
    surroundings, space = drive.surroundings, known.untimed.query.space
    tick = round((commit.time - surroundings.since) / TICK)
    then = surroundings.problem.at(surroundings.problem.start, tick * TICK)
    space = space.costed_in(then.world)
    timed = reading_time(known.objectives.optimised, space)
    plain = space.graph([c for j, c in enumerate(known.objectives.optimised) if j not in timed])
    node = int(known.untimed.nodes(commit.state)[0])
    laid = GraphParts(plain, known.untimed.closed, near=tuple((other, at - tick * TICK) for other, at in known.near))
    goals = known.untimed.query.goals
    graph = timed_graph(space, known.objectives.optimised, node, goals, known.options, then.quanta, laid).graph
    paths = timed_paths(graph, node, goals)
    assert paths.status is Status.COMPLETE
    return paths.costs


def counts(drive: Execution, options: Options) -> np.ndarray:
    """Return the costs, in quanta, that the drive's own search found."""
    known, commit = drive._replanner._timed, options.commit
    assert known is not None
    node = int(known.untimed.nodes(commit.state)[0])
    return known.remaining_paths(node, commit.time, drive._replanner._last_scheduled, None).costs


@pytest.mark.seeds(1, of=30)
def test_options_among_people_are_those_of_a_fresh_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speeds = [(1.0,), (0.5, 1.0)][seed // 2 % 2]
    problem, front, planner = among(*walkers(rng), margin=[0.0, 0.1][seed % 2], speeds=speeds)
    drive = hpop.follow(problem, front, int(rng.integers(len(front))), planner=planner)
    now = 0.0
    for event in ("none", "close", "people", "open"):
        now += float(rng.uniform(0.2, 1.2))
        if event == "people":
            drive.world(now, people=walkers(rng, now))
        elif event == "close":
            drive.world(now, close=CLOSED, name="wet floor")
        elif event == "open":
            drive.world(now, open="wet floor")
        drive.ready()
        graph = drive._replanner._timed
        options = drive.options(now, 0.2)
        assert drive._replanner._timed is graph  # it was made ready when the world changed
        settled = all(options.commit.time - drive.surroundings.since > one.until for one in drive.surroundings.people)
        if options.commit.arrives or options.status is not Status.COMPLETE or settled:
            continue
        mine, theirs = counts(drive, options), fresh(drive, options)
        assert covered(mine, theirs, SLACK)
        assert covered(theirs, mine, SLACK)
        if len(options) and rng.random() < 0.7:
            drive.take(int(rng.integers(len(options))))


def test_what_is_known_among_people_takes_no_search() -> None:
    problem, front, planner = among(Person(9.0, 4.0, velocity=(-0.6, 0.0), until=8.0))
    drive = hpop.follow(problem, front, "knee", planner=planner)
    exact = drive.options(0.5, 1.0)
    assert exact.status is Status.COMPLETE
    later = drive.options(1.0, 0.0)  # of those that pass the place where options begin by now
    assert later.labels == 0
    assert later.keep_on is not None
    rest = between(drive.announced, later.commit.time, drive.announced.duration)
    assert later[later.keep_on].item.duration == pytest.approx(rest.duration)


def test_what_was_driven_costs_what_it_did_when_the_robot_was_there() -> None:
    """A robot that is seen later than planned met people later from then on, not before."""
    problem, front, planner = among(Person(5.0, 3.6, velocity=(-0.4, 0.0), until=12.0))
    drive = hpop.follow(problem, front, "least turns", planner=planner)
    way, late = drive.plan, 1.5
    before = drive.at(3.0).past["hall_zones"]
    assert before > 0.1
    at, end = way.times[np.searchsorted(way.times, [3.0, 6.0])].tolist()  # the motion under way is of the time before
    seen = way.at(3.0)
    moment = drive.at(3.0 + late, problem.model.space.values(seen))
    assert moment.past["hall_zones"] == pytest.approx(before, abs=1e-3)
    later = drive.at(end + late).past["hall_zones"]
    first = problem.evaluate(between(way, 0.0, at))["hall_zones"]
    rest = between(way, at, end)
    then = problem.at(problem.model.space.values(rest.states.take([0])), at + late)
    assert later == pytest.approx(first + then.evaluate(rest)["hall_zones"], abs=1e-3)
    # Seen again where it is taken to be, nothing changes, however often.
    for t in (end + 0.1, end + 0.2, end + 0.3):
        drive.at(t + late, problem.model.space.values(way.at(t)))
    assert len(drive._progress.stretches) == 2


def test_a_drive_keeps_the_margin_with_which_it_was_planned() -> None:
    problem, front, planner = among(Person(9.0, 2.0, velocity=(-0.6, 0.0), until=8.0), margin=0.2)
    drive = hpop.follow(problem, front, "knee")
    assert drive.planner == replace(planner, clock=TICK)


@pytest.mark.parametrize("speed", [2.0, pytest.param(1.6, marks=pytest.mark.proof)])
def test_a_robot_at_rest_takes_nothing_in_which_its_start_would_make_it_meet_somebody(speed: float) -> None:
    """A straight move from rest is behind its plan by v/2a, 0.5 s, and people who cross do not wait for it."""
    y = 2.0 + speed * (3.0 + 1.05)  # 1.05 s behind a robot that leaves at once and never speeds up
    crosses = Person(4.0, y, velocity=(0.0, -speed), until=5.0)
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 14)).with_content(people=(crosses,))
    robot, planner = hpop.DifferentialDrive(radius=0.3), Lattice(step=0.5, headings=4)
    problem = hpop.Problem(world, robot, (1.0, 2.0, 0.0), (7.0, 2.0, None), ["turns", "duration"])
    drive = hpop.follow(problem, problem.solve(planner), 0, planner=planner, begin=2.0)
    options = drive.options(1.0, 0.5)
    assert options.commit.time == 2.0
    assert len(options)
    assert not any(contact(robot.parts, [crosses], option.item.execution()) for option in options)


def test_a_robot_that_has_just_stopped_goes_on_when_it_stands() -> None:
    """To stop takes it v/2a more than its plan says: before that no way is open again for it."""
    problem, front, planner = among(Person(9.0, 4.0, velocity=(-0.3, 0.0), until=8.0))
    drive = hpop.follow(problem, front, "knee", planner=planner)
    x, y = (
        float(column[np.searchsorted(drive.plan.times, 4.0)]) for column in (drive.plan.states.x, drive.plan.states.y)
    )
    change = drive.world(0.2, close=shapely.Point(x, y).buffer(0.1), name="spill")
    assert change.stops_at is not None
    options = drive.options(change.stops_at + 0.1, 0.0)
    assert options.commit.stands == pytest.approx(0.5)
    drive.world(change.stops_at + 0.1, open="spill")
    stood = [float(last) for last, kind in zip(drive.plan.durations, drive.plan.kinds, strict=True) if kind == "hold"]
    assert stood[-1] == pytest.approx(0.5)
    assert drive.plan.execution().duration <= drive.plan.duration + 1.0 + 1e-6
