"""New predictions keep the deadline: known routes are re-checked until the timed graph is rebuilt."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Event

import numpy as np
import pytest

import hpop
from hpop.drive import Execution, Options, load
from hpop.drive.plan import joined, until
from hpop.planners import Lattice
from hpop.runtime.limits import Status
from hpop.world import Person
from tests.drive.rooms import SOUTH, through
from tests.drive.test_among_people import among
from tests.drive.test_fresh_search import covered

COMES = Person(8.0, 1.0, velocity=(-0.6, 0.0), until=12.0, name="comes")
IN_SOUTH = Person(6.4, 0.7, velocity=(-0.05, 0.0), until=16.0, name="in the door")


@contextmanager
def busy(drive: Execution) -> Iterator[None]:
    """Nothing is made meanwhile: the thread beside the drive has something else to do."""
    done = Event()
    drive._replanner._worker.begin(done.wait)
    try:
        yield
    finally:
        done.set()


@cache
def asked() -> tuple[hpop.Problem, hpop.Front, Lattice]:
    return among(COMES, margin=0.1)


def drive_among() -> Execution:
    problem, front, planner = asked()
    drive = hpop.follow(problem, front, 0, planner=planner)
    assert drive.options(0.3, 0.5).status is Status.COMPLETE
    return drive


def least_gap(way: hpop.Trajectory, person: Person, begins: float) -> float:
    """Return the least gap, m, to a person as predicted, every 2 ms; the trajectory begins after ``begins`` seconds."""
    times = np.arange(0.0, way.duration, 2e-3)
    states, (x, y) = way.at(times), person.at(times + begins)
    apart = np.hypot(states.x - x, states.y - y) - 0.3 - person.radius
    return float(apart[np.asarray(person.there(times + begins)) > 0].min(initial=np.inf))


def crossing(seed: int) -> list[Person]:
    """Return five people who walk about in the hall; some of them walk into a wall or off the map, or stop."""
    rng = np.random.default_rng(seed)
    places, speeds = rng.uniform((2.5, 0.3), (10.5, 5.7), (5, 2)), rng.normal(0.0, 0.35, (5, 2))
    return [
        Person(*place, velocity=tuple(velocity), until=float(rng.uniform(1.0, 9.0)), name=f"person {i}")
        for i, (place, velocity) in enumerate(zip(places.tolist(), speeds.tolist(), strict=True))
    ]


@pytest.mark.parametrize("seed", range(2, 6))
def test_an_option_that_is_clear_is_driven_to_its_end_and_one_that_is_blocked_is_not(seed: int) -> None:
    drive = drive_among()
    options = drive.options(0.3, 0.5)
    with busy(drive):
        drive.world(0.5, people=crossing(seed))
        blocked = [drive.blocked_by(i, 0.6, options) for i in range(len(options))]
        for number, first in enumerate(blocked):
            way = options.ways[number]
            assert first is None or first <= len(way)
            alike = [i for i, other in enumerate(options.ways) if first is not None and begins_as(other, way, first)]
            assert all(blocked[i] is not None for i in alike)
            if not options[number].keeps_on:
                plan = drive.take(number, 0.6, options)
                assert (plan.duration == drive.announced.duration) == (first is None)


def begins_as(way: hpop.Trajectory, other: hpop.Trajectory, count: int) -> bool:
    """Return whether two trajectories have their first motions in common."""
    rows, names = slice(0, count + 1), way.states.names
    return way.kinds[:count] == other.kinds[:count] and all(
        np.array_equal(getattr(way.states, name)[rows], getattr(other.states, name)[rows]) for name in names
    )


@pytest.mark.parametrize("seed", range(4))
def test_people_are_predicted_as_those_of_a_problem_that_begins_later(seed: int) -> None:
    drive = drive_among()
    with busy(drive):
        drive.world(0.5, people=crossing(seed))
    for now in (0.5, 0.9, 2.5, 7.0, 12.0):
        later, people = drive.surroundings.at(drive.at(0.5).state, now), drive.surroundings.predicted(now)
        for person, expected in zip(people, later.world.content.people, strict=True):
            times = np.linspace(0.0, 10.0, 101)
            assert np.allclose(person.at(times), expected.at(times), atol=1e-6)
            assert np.array_equal(person.there(times), expected.there(times))


@pytest.mark.cases("people")
@pytest.mark.parametrize("change", ["people", "close"])
def test_until_the_graph_is_made_the_known_ways_are_looked_at_again(change: str) -> None:
    drive = drive_among()
    told = {"people": [IN_SOUTH]} if change == "people" else {"close": SOUTH, "name": "south"}
    with busy(drive):
        drive.world(0.7, **told)
        at_once = drive.options(0.7, 0.0)
    assert at_once.status is Status.TIME_LIMIT
    assert at_once.gap == np.inf
    assert at_once.labels == 0
    assert "call options again" in at_once.certificate
    assert "NOT VALID" not in at_once.certificate
    drive.ready()
    exact = drive.options(0.7, 0.25)
    assert exact.commit.time == at_once.commit.time
    assert exact.status is Status.COMPLETE
    assert len(at_once)
    problem = drive.surroundings.at(at_once.commit.state, at_once.commit.time)
    for option in at_once:
        costs = problem.evaluate(option.item)
        assert {name: option.costs[name] for name in costs} == pytest.approx(costs)
        if change == "people":
            whole = joined(until(drive.plan, at_once.commit.time), option.item)
            assert least_gap(whole, IN_SOUTH, -0.7) > 0.1 - 2e-3 or option.keeps_on
        else:
            assert through(option.item) == "north"
    # No known way is better than what the exact search finds, but for what rounding takes.
    slack = exact.front.quanta * 30
    assert covered(at_once.front.costs, exact.front.costs, slack)


@pytest.mark.proof
def test_a_record_tells_what_was_known_again(tmp_path: Path) -> None:
    drive = drive_among()
    with busy(drive):
        drive.world(0.7, people=[IN_SOUTH])
        at_once = drive.options(0.7, 0.0)
        taken = drive.take(len(at_once) - 1)
    drive.save(tmp_path / "drive.json")
    again = load(tmp_path / "drive.json")
    assert again.plan.durations.tolist() == taken.durations.tolist()
    assert again.record == drive.record


def test_of_several_changes_the_last_one_counts() -> None:
    drive, waits = drive_among(), drive_among()
    with busy(drive):
        for now, x in ((0.7, 8.0), (0.8, 7.0), (0.9, 9.0)):
            drive.world(now, people=[Person(x, 2.0, velocity=(-0.5, 0.1), until=6.0)])
    waits.world(0.9, people=[Person(9.0, 2.0, velocity=(-0.5, 0.1), until=6.0)])
    fronts = list[np.ndarray]()
    for each in (drive, waits):
        each.ready()
        options: Options = each.options(1.0, 1.0)
        assert options.status is Status.COMPLETE
        fronts.append(np.sort(options.front.costs, axis=0))
    assert fronts[0] == pytest.approx(fronts[1], abs=0.02)


def test_what_no_deadline_cut_short_is_found_again_however_long_that_takes(tmp_path: Path) -> None:
    problem, front, planner = asked()
    drive = hpop.follow(problem, front, 0, planner=planner)
    drive.world(0.7, people=[Person(8.5, 2.5, velocity=(-0.4, 0.05), until=12.0)])
    drive.ready()  # which a record does not tell
    found = drive.options(0.7, 0.08)
    drive.save(tmp_path / "drive.json")
    again = load(tmp_path / "drive.json")
    assert again.take(len(found) - 1).describe() == drive.take(len(found) - 1).describe()


def test_whom_a_way_was_chosen_to_leave_is_nobody_who_is_told_anew() -> None:
    """A route may leave a person who comes within the margin a second after it begins, if that was predicted."""
    drive = drive_among()
    drive.take(drive.options(0.3, 0.5)[-1])
    begins = drive._progress.plan.chosen
    assert begins > 0.7
    drive.world(0.5, close=SOUTH, name="south")
    assert drive._progress.plan.chosen == begins
    drive.world(0.7, people=[IN_SOUTH])
    assert drive._progress.plan.chosen == 0.0


def test_a_robot_that_stood_in_the_way_of_people_takes_an_option_as_it_is_checked_when_driven(tmp_path: Path) -> None:
    """After some seconds before a slow person, an option begins with this wait: people are compared with all of it.

    The saved drive then loads with the same plan. The present plan ends where the robot stands, before the wait.
    """
    problem, front, planner = asked()
    drive = hpop.follow(problem, front, 0, planner=planner)
    rng = np.random.default_rng(1)
    at = drive.plan.at(np.array([drive.plan.duration * rng.uniform(0.2, 0.8)]))
    people = [Person(float(at.x[0]), float(at.y[0]), velocity=(0.01, 0.0), until=60.0, name="slow")]
    for i in range(3):
        x, y = rng.uniform((2.5, 0.3), (10.5, 5.7)).tolist()
        people.append(Person(x, y, velocity=tuple(rng.normal(0.0, 0.12, 2).tolist()), until=40.0, name=f"walks {i}"))
    stops = drive.world(0.5, people=people).stops_at
    assert stops is not None
    drive.ready(0.5)
    now = stops + float(rng.uniform(2.0, 9.0))
    drive.ready(now)
    options = drive.options(now, 0.5)
    assert options.status is Status.COMPLETE
    assert options.commit.stands > 5.0
    plan = drive.take(0, now + 0.2, options)
    assert plan.duration == drive.announced.duration  # clear to its goal, as the search found it
    drive.save(tmp_path / "drive.json")
    assert load(tmp_path / "drive.json").plan.duration == plan.duration
