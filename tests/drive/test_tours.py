"""Drives of a tour: visits, options of the stops that remain, stops out of reach, and the log.

Visits are checked on samples of the driven trajectory. Options are compared with the front of a new problem, from where
they begin, whose tour has only the stops that remain.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.errors import DriveError
from hpop.goals import Tour
from hpop.planners.base import make_planner
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Zone
from tests.drive.rooms import NORTH, SOUTH, two_doors

ROBOT = hpop.DifferentialDrive(radius=0.3)
LATTICE = {"lattice": {"step": 0.5, "anchor": "world"}}
DOORS = {"north": NORTH, "south": SOUTH}
WEST = {"at": (2.5, 5.0), "within": 0.6, "dwell": 2, "name": "west"}
UPPER = {"at": (7.5, 5.0), "within": 0.6, "dwell": 3, "name": "upper"}
LOWER = {"at": (7.5, 1.0), "within": 0.6, "dwell": 4, "name": "lower"}
CORNER = {"at": (9.5, 5.0), "within": 0.6, "dwell": 1, "name": "corner", "optional": True}
DEADLINE = 5.0


def asked(
    stops: list[Any],
    order: Any = "any",
    start: Any = (1, 2, 0),
    goal: Any = (10, 3, None),
    closed: Any = (),
    people: Any = (),
) -> hpop.Problem:
    """Return the problem of a tour through the hall with two doors, of which some are closed."""
    zones = [
        Zone("keep-out" if name in closed else "speed", door, limit=None if name in closed else 1.0, name=name)
        for name, door in DOORS.items()
    ]
    criteria = ["length", "turns", "duration", *["stops_missed"] * any(stop.get("optional") for stop in stops)]
    tour = Tour(stops, order) if stops else None
    return hpop.Problem(two_doors(*zones, people=people), ROBOT, start, goal, criteria, tour=tour)


def driving(problem: hpop.Problem, choice: Any = "least length") -> hpop.drive.Execution:
    return hpop.follow(problem, problem.solve(LATTICE), choice)


def stood(trajectory: Trajectory, stop: Any) -> bool:
    """Check on samples whether the robot stands in the disc of a stop for its dwell."""
    t = np.arange(0.0, trajectory.duration + 0.01, 0.01)
    states = trajectory.at(np.minimum(t, trajectory.duration))
    inside = np.hypot(states.x - stop["at"][0], states.y - stop["at"][1]) <= stop["within"] + 1e-6
    moved = np.abs(np.diff(states.x)) + np.abs(np.diff(states.y)) + np.abs(np.diff(states.yaw)) > 1e-9
    longest = now = 0
    for still in inside[1:] & ~moved:
        now = now + 1 if still else 0
        longest = max(longest, now)
    return 0.01 * longest >= stop["dwell"] - 0.021


def names(drive: hpop.drive.Execution, now: float) -> list[str]:
    return [visit.name for visit in drive.at(now).visits]


def same_front(options: hpop.drive.Options, problem: hpop.Problem) -> None:
    """Check that options have the costs of a new search, to the quantum."""
    fresh = problem.solve(LATTICE)
    columns = [options.front.names.index(name) for name in fresh.names]
    mine, theirs = options.front.integers[:, columns], fresh.integers
    np.testing.assert_array_equal(mine[np.lexsort(mine.T)], theirs[np.lexsort(theirs.T)])
    left = [j for j in range(len(options.front.names)) if j not in columns]
    assert not options.front.integers[:, left].any()  # no stop is left that could be missed


@pytest.mark.parametrize(
    ("stops", "order"),
    [
        pytest.param([WEST, UPPER, LOWER], "any", marks=pytest.mark.proof),
        pytest.param([WEST, LOWER, UPPER], "given", marks=pytest.mark.proof),
        ([WEST, UPPER, LOWER, CORNER], [("west", "lower")]),
        ([CORNER, UPPER, LOWER], "given"),
    ],
)
def test_options_are_the_front_of_the_remaining_tour(stops: list[Any], order: Any) -> None:
    drive, rng = driving(asked(stops, order)), np.random.default_rng(3)
    now, closed, seen = 0.0, list[str](), set[int]()
    while not drive.at(now).arrived:
        options = drive.options(now, DEADLINE)
        assert options.status is Status.COMPLETE
        assert "NOT VALID" not in options.certificate
        driven = options.commit.before
        done = {stop["name"] for stop in stops if stood(driven, stop)}
        ranks = [stop["name"] for stop in stops]
        last = max((ranks.index(name) for name in done), default=-1)
        left = [s for i, s in enumerate(stops) if s["name"] not in done and (order != "given" or i > last)]
        kept = order if isinstance(order, str) else [pair for pair in order if not {*pair} & done]
        seen.add(len(left))
        state = ROBOT.space.values(options.commit.state)
        if any(stop.get("optional") for stop in left) or "stops_missed" not in options.front.names:
            same_front(options, asked(left, kept, state, closed=closed))
        for option in options:
            assert {stop["name"] for stop in left if stood(option.item, stop)} == {*option.stops}
        drive.take(int(rng.integers(len(options))))
        now = max(now + float(rng.uniform(1.0, 4.0)), options.commit.time - 0.5)
        if not closed and len(left) < len(stops):
            closed.append("south")
            drive.world(now, close="south")
    assert len(seen) >= 3
    assert {*names(drive, now)} == {stop["name"] for stop in stops if stood(drive.plan, stop)}


def test_another_order_is_taken_when_a_door_closes() -> None:
    drive = driving(asked([UPPER, LOWER], start=(1, 1, 0)))
    before = drive.options(0.0, DEADLINE)
    assert before[before.keep_on].stops == ("lower", "upper")
    drive.world(0.5, close="south")
    options = drive.options(0.5, DEADLINE)
    assert options.best("length").stops == ("upper", "lower")
    drive.take(options.best("length"))
    assert names(drive, drive.plan.duration) == ["upper", "lower"]
    same_front(options, asked([UPPER, LOWER], start=ROBOT.space.values(options.commit.state), closed=["south"]))


def test_a_stop_out_of_reach_is_told_and_skipped(tmp_path: Path) -> None:
    drive = driving(asked([UPPER, WEST, LOWER], "given", goal=(1, 4, None)), 0)
    drive.world(1.0, close="north")
    drive.world(1.0, close="south")
    options = drive.options(1.0, DEADLINE)
    assert not len(options)
    assert options.status is Status.NO_PATH
    assert options.unreachable == ("upper", "lower")
    assert any("cannot reach stops 'upper', 'lower'" in n and "drive.skip('upper')" in n for n in options.front.notes)
    assert drive.skip("upper", 2.0) == ("west", "lower")
    assert drive.options(2.0, DEADLINE).unreachable == ("lower",)
    assert drive.skip("lower") == ("west",)
    options = drive.options(2.0, DEADLINE)
    assert {option.stops for option in options} == {("west",)}
    start = ROBOT.space.values(options.commit.state)
    same_front(options, asked([WEST], start=start, goal=(1, 4, None), closed=["north", "south"]))
    drive.take(options.knee())
    end = drive.plan.duration
    assert drive.at(end).arrived
    assert stood(drive.plan, WEST)
    drive.options(end)
    log = [(event["event"], event["stop"]) for event in drive.record if "stop" in event]
    assert log == [("skip", "upper"), ("skip", "lower"), ("visited", "west")]
    drive.save(tmp_path / "drive.json")
    again = hpop.drive.load(tmp_path / "drive.json")
    assert again.record == drive.record
    assert again.at(end).visits == drive.at(end).visits
    assert again.at(end).stops == drive.at(end).stops


def test_a_door_that_opens_again_brings_the_stop_back() -> None:
    drive = driving(asked([UPPER, WEST], goal=(1, 4, None)))
    for door in DOORS:
        drive.world(0.5, close=door)
    assert drive.options(0.5, DEADLINE).unreachable == ("upper",)
    drive.world(9.0, open="south")
    options = drive.options(9.0, DEADLINE)
    assert len(options)
    assert options.unreachable == ()
    start = ROBOT.space.values(options.commit.state)
    visited = {stop["name"] for stop in (UPPER, WEST) if stood(options.commit.before, stop)}
    left = [stop for stop in (UPPER, WEST) if stop["name"] not in visited]
    same_front(options, asked(left, start=start, goal=(1, 4, None), closed=["north"]))


def test_options_during_a_dwell_begin_at_its_end() -> None:
    drive = driving(asked([WEST, UPPER], "given"), 0)
    visit = drive.at(drive.plan.duration).visits[0]
    middle = 0.5 * (visit.begin + visit.end)
    options = drive.options(middle, 0.1)
    assert options.commit.time == pytest.approx(visit.end)
    assert names(drive, middle) == []
    assert names(drive, visit.end) == ["west"]
    assert all(option.stops == ("upper",) for option in options)


def test_standing_for_a_closed_plan_counts_as_dwelling() -> None:
    west = {"at": (3.5, 5.0), "within": 2.5, "dwell": 20, "name": "west"}
    drive = driving(asked([UPPER, west], "given", start=(3, 5, 0), goal=(1, 4, None)), "least length")
    for door in DOORS:
        drive.world(0.5, close=door)
    drive.skip("upper", 0.5)
    stops_at = drive.plan.duration
    assert names(drive, stops_at + 19.0) == []
    begun_anew = drive.options(stops_at + 15.0, 1.0)
    assert begun_anew.status is Status.COMPLETE
    assert all(option.stops == ("west",) and option.costs["duration"] >= 20 for option in begun_anew)
    assert names(drive, stops_at + 20.1) == ["west"]
    assert all(option.stops == () for option in drive.options(stops_at + 21.0, DEADLINE))


def test_stops_without_a_state_of_the_lattice_are_visited() -> None:
    small = {"at": (2.3, 4.7), "within": 0.1, "dwell": 2, "name": "small"}
    drive = driving(asked([small, UPPER], "any"))
    visit = drive.at(drive.plan.duration).visits[0]
    assert visit.name == "small"
    assert stood(drive.plan, small)
    options = drive.options(visit.begin + 1.0, 0.5)  # they begin beside the lattice, where the robot stands
    assert options.commit.time == pytest.approx(visit.end)
    same_front(options, asked([UPPER], start=ROBOT.space.values(options.commit.state)))


def test_options_that_a_deadline_cut_are_repeated(tmp_path: Path) -> None:
    drive = driving(asked([WEST, UPPER, LOWER, CORNER]))
    options = drive.options(1.0, 0.0)
    assert options.keep_on is not None
    drive.take(0)
    drive.options(12.0, 0.0)
    drive.save(tmp_path / "drive.json")
    again = hpop.drive.load(tmp_path / "drive.json")
    assert again.record == drive.record
    np.testing.assert_array_equal(again.plan.states.x, drive.plan.states.x)


def test_without_time_to_search_the_option_that_misses_no_stop_is_one_of_the_front() -> None:
    """The least path in missed stops alone could wander through all states; here it is also good in other costs."""
    problem, options = asked([WEST, UPPER, CORNER]), list[hpop.drive.Options]()
    for now, deadline in ((0.5, DEADLINE), (0.5 + DEADLINE, 0.0)):  # both begin at the same commit
        drive = driving(problem, "least stops_missed")
        drive.world(0.5, close=[(8.4, 1), (8.6, 1), (8.6, 6), (8.4, 6)], name="shelf")  # across all known paths
        options.append(drive.options(now, deadline))
    whole, cut = options
    assert whole.commit.time == cut.commit.time
    assert (whole.status, cut.status) == (Status.COMPLETE, Status.TIME_LIMIT)
    best = cut.best("stops_missed").costs
    assert best["stops_missed"] == 0
    assert any(best == pytest.approx(option.costs) for option in whole)


def test_a_roadmap_is_driven() -> None:
    problem = asked([WEST, UPPER])
    drive = hpop.follow(problem, problem.solve("roadmap", samples=60), 0)
    options = drive.options(1.0, DEADLINE)
    assert options.status is Status.COMPLETE
    assert "NOT VALID" not in options.certificate
    assert all(stood(option.item, stop) for option in options for stop in (WEST, UPPER) if stop["name"] in option.stops)


def test_a_stop_that_does_not_remain_cannot_be_skipped() -> None:
    drive = driving(asked([WEST, {**CORNER, "at": (3.5, 5.0)}, UPPER, LOWER], "given"), "least length")
    visits = drive.at(drive.plan.duration).visits
    assert [visit.name for visit in visits] == ["west", "upper", "lower"]
    now = visits[1].end + 0.1
    with pytest.raises(DriveError, match=r"got 'lowr'. Did you mean 'lower'.* remain are lower"):
        drive.skip("lowr", now)
    with pytest.raises(DriveError, match="stop 'west' was visited already; the stops that remain are lower"):
        drive.skip("west", now)
    with pytest.raises(DriveError, match="stop 'corner' was passed over already"):
        drive.skip("corner", now)
    assert drive.record == []
    assert drive.skip("lower", now) == ()
    with pytest.raises(DriveError, match="stop 'lower' was skipped already; the stops that remain are none"):
        drive.skip("lower", now)
    assert [event["event"] for event in drive.record] == ["visited", "visited", "passed over", "skip"]
    with pytest.raises(DriveError, match="has no tour"):
        driving(asked([])).skip("west")


def test_at_the_goal_missed_stops_still_count_and_only_the_plan_can_be_kept_afterwards() -> None:
    drive = driving(asked([CORNER]))
    end = drive.plan.duration
    for now in (end - 0.1, end + 1.0):
        options = drive.options(now, DEADLINE)
        assert options.commit.arrives
        assert options[options.keep_on].costs["stops_missed"] == 1
        assert options.front.costs[:, options.front.names.index("stops_missed")].min() == 0
    with pytest.raises(DriveError, match=r"these options begin at .* already: plan again from the goal"):
        drive.take(options.best("stops_missed"))
    drive.take(options.keep_on)
    assert drive.at(end + 1.0).arrived


def test_visits_of_a_drive_are_those_that_miss_the_least_weight() -> None:
    far, near = ({"at": (x, 2), "within": 0.3, "name": str(x), "optional": True} for x in (4, 3))
    criteria = ["length", {"stops_missed": {"weights": {"4": 3}}}]
    problem = hpop.Problem(two_doors(), ROBOT, (1, 2, 0), (5, 2, 0), criteria, tour=Tour([far, near]))
    front = problem.solve(LATTICE)
    assert [(*point.costs.values(), *(visit["stop"] for visit in point.provenance["visits"])) for point in front] == [
        (4.0, 1.0, "4"),
        (6.0, 0.0, "4", "3"),
    ]
    drive = hpop.follow(problem, front, 0)
    assert drive.at(2.5).stops.remaining == ("4", "3")
    assert names(drive, drive.plan.duration) == ["4"]


def test_a_visit_under_way_where_options_begin_counts_for_the_plan_that_is_kept() -> None:
    first, second = ({"at": (3.5, 2), "within": 1, "dwell": dwell, "name": f"{dwell}"} for dwell in (2, 3))
    problem = asked([first, {**second, "optional": True}], "given", goal=(5, 2, 0))
    moving = Trajectory.from_poses(ROBOT, [(1, 2, 0), (3, 2, 0), (4, 2, 0), (5, 2, 0)])
    plan = moving.with_holds(np.array([1, 2, 2]), np.array([3.0, 2.0, 2.0]))
    drive = hpop.drive.Execution(problem, [plan], plan, make_planner(LATTICE))
    begin = float(plan.times[plan.kinds.index("hold", 2)])
    options = drive.options(begin + 0.5, 0.1)
    assert options.commit.time == pytest.approx(begin + 2.0)
    kept = options[options.keep_on]
    assert (kept.stops, kept.costs["stops_missed"]) == (("3",), 0)
    assert drive.at(plan.duration).stops.remaining == ()
    assert {option.costs["stops_missed"] for option in options if option.stops == ()} <= {1}
