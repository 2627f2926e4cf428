"""Claims of options: what is listed, what each would change, wishes, and what the robot changes by itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive.plan import between, held
from hpop.drive.wishes import wished
from hpop.errors import DriveError, HpopError
from hpop.preference import Preference
from hpop.runtime.limits import Status
from hpop.world import Person
from tests.drive.rooms import NORTH, SOUTH, STEP, asked, planned, through, two_doors


@cache
def among_people() -> tuple[hpop.Problem, hpop.Front]:
    problem = asked(two_doors(people=(Person(3.5, 4.5, name="visitor"),)), "hall_zones", "turns", "length")
    return problem, problem.solve("lattice", step=STEP)


def drive_of(name: str = "knee") -> hpop.drive.Execution:
    return hpop.follow(*planned(), name)


def test_a_deadline_of_nothing_is_answered_with_what_is_known() -> None:
    drive = drive_of()
    at_once, exact = drive.options(1.0, 0.0), drive.options(1.0, 1.0)
    assert at_once.status is Status.TIME_LIMIT
    assert at_once.keep_on is not None
    assert exact.status is Status.COMPLETE
    # The gap holds: each point of the exact front is covered within the factor 1 + gap, edge costs rounded up.
    rounded = 40 * 1e-6
    worse = at_once.front.costs[None] <= (1.0 + at_once.gap) * (exact.front.costs[:, None] + rounded)
    worse = worse.all(axis=2)
    assert worse.any(axis=1).all()


def test_options_cost_what_their_ways_cost_and_end_at_the_goal() -> None:
    drive = drive_of()
    problem, _ = planned()
    options = drive.options(2.0)
    for option in options:
        costs = problem.at(tuple(float(c[0]) for c in vars(options.commit.state).values()), 2.0).evaluate(option.item)
        assert costs["length"] == pytest.approx(option.costs["length"])
        assert costs["turns"] == option.costs["turns"]
        assert (option.item.states.x[-1], option.item.states.y[-1]) == pytest.approx((10.0, 2.0))


def test_each_option_leaves_the_announced_way_when_a_robot_on_it_would_be_elsewhere() -> None:
    drive = drive_of()
    announced = drive.plan
    options = drive.options(1.0)
    for option in options:
        begin = options.commit.time
        times = np.arange(0.0, min(option.item.duration, announced.duration - begin), 0.01)
        here, there = option.item.at(times), announced.at(begin + times)
        apart = np.hypot(here.x - there.x, here.y - there.y) + np.abs(np.sin(0.5 * (here.yaw - there.yaw)))
        elsewhere = np.flatnonzero(apart > 1e-3)
        if option.keeps_on:
            assert option.leaves_at is None
            assert not elsewhere.size
        elif elsewhere.size:
            assert option.leaves_at is not None
            # A turn begins with half of what stopping loses, 0.5 s, in which one stands or goes straight on.
            assert -0.02 <= begin + times[elsewhere[0]] - option.leaves_at <= 0.6


def test_an_option_is_on_the_same_side_where_it_takes_the_same_door() -> None:
    drive = drive_of()
    options = drive.options(0.5)
    doors = {through(option.item) for option in options}
    assert doors == {"north", "south"}
    for option in options:
        assert option.same_side == (through(option.item) == through(drive.plan))


def test_the_next_turn_is_that_of_the_way_that_would_be_driven() -> None:
    drive = drive_of()
    now = 0.3
    options = drive.options(now)
    for option in options:
        way = hpop.drive.plan.joined(between(drive.plan, 0.0, options.commit.time), option.item)
        turns = [t for t, kind in zip(way.times, way.kinds, strict=False) if kind == "turn" and t > now]
        assert option.next_turn == (pytest.approx(turns[0] - now) if turns else None)


def test_what_was_worst_stays_worst_so_no_way_is_left_for_the_sake_of_a_moment_that_is_past() -> None:
    problem = asked(two_doors(), "clearance", "length")
    front = problem.solve("lattice", step=STEP)
    drive = hpop.follow(problem, front, "least length")
    before = drive.options(0.5)
    assert len(before) > 1
    past_door = drive.plan.times[np.flatnonzero(drive.plan.states.x > 6.6)[0]] + 0.1
    after = drive.options(float(past_door))
    worst = drive.at(float(past_door)).past["clearance"]
    assert worst == pytest.approx(problem.evaluate(drive.plan)["clearance"])
    # The door is behind: whatever is chosen, the worst clearance is that of the door, so the shortest way is the front.
    assert [option.costs["clearance"] for option in after] == [pytest.approx(worst)]
    assert after.keep_on == 0


def test_a_mean_is_that_of_the_whole_drive() -> None:
    problem, front = planned()
    drive = hpop.follow(problem, front, "knee")
    for now in (1.0, 6.0):
        options = drive.options(now)
        kept = options[options.keep_on or 0]
        assert kept.reported["obstruction"] == pytest.approx(problem.evaluate(drive.plan)["obstruction"])


@pytest.mark.parametrize("wish", ["fewer turns", "less exposure", "less length"])
def test_a_wish_for_less_is_fulfilled_at_the_least_loss(wish: str) -> None:
    drive = drive_of()
    options = drive.options(1.0)
    name = wish.split()[1]
    plan = options[options.keep_on or 0].costs
    rows = [option for option in options if option.costs[name] < plan[name] and not option.dominated]
    answer = drive.wish(wish)
    if not rows:
        assert answer.option is None
        assert "no option" in answer.words
        return
    spans = {n: max(o.costs[n] for o in options) - min(o.costs[n] for o in options) for n in plan}

    def loss(option: hpop.drive.Option) -> float:
        return sum(max(0.0, option.costs[n] - plan[n]) / spans[n] for n in plan if spans[n])

    assert answer.option is not None
    assert loss(answer.option) == pytest.approx(min(map(loss, rows)), abs=1e-6)


def test_a_wish_with_a_share_keeps_it_and_hurry_is_quicker() -> None:
    problem = asked(two_doors(), "duration", "exposure", "turns")
    front = problem.solve("lattice", step=STEP)
    slow = int(np.argmax(front.costs[:, 0]))
    drive = hpop.follow(problem, front, slow)
    options = drive.options(0.5)
    plan = options[options.keep_on or 0].costs
    answer = drive.wish(duration=-0.1)
    assert answer.option is not None
    assert answer.option.costs["duration"] <= 0.9 * plan["duration"] + 1e-6
    quick = drive.wish("hurry", exposure=100.0, turns=100.0)
    assert quick.option is not None
    assert quick.option.costs["duration"] == min(option.costs["duration"] for option in options)
    assert drive.wish(duration=-0.99).option is None


def test_what_becomes_of_a_wish_is_told_without_costs_that_rounding_tells_apart() -> None:
    options = drive_of().options(1.0)
    noise = np.where(np.arange(len(options.front)) == options.keep_on, 0.0, 1e-13)
    costs = options.front.costs + noise[:, None] * [name == "turns" for name in options.front.names]
    noisy = replace(options, front=replace(options.front, costs=costs))
    answer = wished(noisy, "less length", {})
    assert answer.option is not None
    changes = answer.words.rpartition(": ")[2]
    assert [change.split()[0] for change in changes.split(", ")] == ["exposure", "length"]


@pytest.mark.parametrize(
    ("words", "shares", "said"),
    [
        ("fewer turnns", {}, "no cost 'turnns' to wish for. Did you mean 'turns'"),
        (None, {"rotation": -0.1}, "no cost 'rotation'"),
        (None, {"turns": float("nan")}, "the wish for turns"),
        ("please", {}, "a wish must be 'hurry'"),
        (None, {}, "a wish must be words"),
    ],
)
def test_a_wish_for_what_is_not_there_is_an_error(words: str | None, shares: dict[str, float], said: str) -> None:
    drive = drive_of()
    with pytest.raises(DriveError, match="call options"):
        drive.wish("fewer turns")
    drive.options(1.0)
    with pytest.raises(HpopError, match=said):
        drive.wish(words, **shares)


def test_a_robot_is_where_it_is_seen_and_not_where_its_plan_has_it() -> None:
    drive = drive_of()
    move = drive.plan.kinds.index("move", 8)
    t = float(drive.plan.times[move]) + 0.2
    seen = tuple(float(column[0]) for column in vars(drive.plan.at(t)).values())
    moment = drive.at(t + 2.5, seen)
    assert moment.planned == pytest.approx(t, abs=2e-3)
    assert drive.at(t + 3.0).planned == pytest.approx(t + 0.5, abs=2e-3)
    assert drive.commit(t + 2.5, 0.5).time > t + 3.0
    with pytest.raises(DriveError, match="m from its plan"):
        drive.at(t + 3.0, (0.5, 5.5, 0.0))


def test_options_that_are_past_or_closed_cannot_be_taken() -> None:
    drive = drive_of()
    options = drive.options(1.0, 0.1)
    with pytest.raises(DriveError, match=r"call options\(now\) again"):
        drive.take(0, options.commit.time + 0.5)
    options = drive.options(options.commit.time + 0.6, 0.1)
    doomed = next(option for option in options if through(option.item) == "south")
    change = drive.world(close=SOUTH)
    assert doomed.index in change.invalid
    with pytest.raises(DriveError, match="has been closed"):
        drive.take(doomed)
    with pytest.raises(DriveError, match="one of the last options"):
        drive.take(drive_of().options(1.0)[0])


def test_a_robot_changes_its_plan_by_itself_for_a_tenth_and_with_notice_alone() -> None:
    problem, front = planned()
    rows = np.argsort(-front.costs[:, front.names.index("length")])
    patient = hpop.follow(problem, front, int(rows[0]), patience=1.0)
    assert patient.adapt(patient.options(0.5)) is None
    changed = 0
    for row in rows[::4].tolist():
        eager = hpop.follow(problem, front, row)
        options = eager.options(0.5)
        plan = options[options.keep_on or 0].costs
        taken = eager.adapt(options)
        if taken is not None:
            changed += 1
            assert np.mean([taken.costs[n] / plan[n] for n in plan]) <= 0.9
            turns = [t for t, kind in zip(taken.item.times, taken.item.kinds, strict=False) if kind == "turn"]
            later = [
                options.commit.time + t for t in turns if options.commit.time + t >= (taken.leaves_at or 0.0) - 1e-6
            ]
            assert not later or later[0] - options.now >= 2.0
    assert 0 < changed < len(front)
    closed = hpop.follow(problem, front, "knee")
    closed.world(0.5, close=NORTH)
    closed.world(0.5, close=SOUTH)
    assert closed.adapt(closed.options(0.5)) is None  # nothing is open


def test_a_person_decides_what_is_driven_and_what_is_better_on_the_way() -> None:
    problem, front = planned()
    longest = int(front.costs[:, front.names.index("length")].argmax())
    short = Preference.fit(front, [(front.best("length").index, longest)] * 6)
    drive = hpop.follow(problem, front, short)
    assert drive.choice is front.select(preference=short).trajectory
    assert drive.adapt(drive.options(0.5)) is None  # it is the best one already
    changed = 0
    for row in range(0, len(front), 4):
        planner, ways = drive.planner, front.trajectories
        aboard = hpop.drive.Execution(problem, ways, ways[row], planner, preference=short)
        options = aboard.options(0.5)
        costs = short.expected(options.front, np.array([list(option.costs.values()) for option in options]))
        taken = aboard.adapt(options)
        if taken is not None:
            changed += 1
            assert costs[taken.index] <= 0.9 * costs[options.keep_on or 0]
    assert changed > 0
    closed = hpop.follow(problem, front, short)
    closed.world(0.5, close=NORTH if through(closed.plan) == "north" else SOUTH)
    options = closed.options(0.5)
    best = options.select(preference=short).index
    assert best != options.knee().index  # what a robot without a preference would take
    taken = closed.adapt(options)
    assert taken is not None
    assert taken.index == best


def test_a_visitor_who_steps_into_the_way_is_passed_and_costs_what_a_new_plan_says() -> None:
    problem, front = among_people()
    drive = hpop.follow(problem, front, "least length")
    change = drive.world(1.0, people=[Person(5.6, 5.3, name="visitor"), Person(9.0, 1.0)])
    options = drive.options(1.0, 1.0)
    assert change.invalid == ()
    assert {through(option.item) for option in options} == {"south"}
    drive.take(options.knee())
    drive.world(3.0, people=[])
    assert drive.options(3.0, 1.0).best("hall_zones").costs["hall_zones"] == 0.0
    assert drive.at(3.0).past["hall_zones"] > 0.0  # those who left were there


def test_somebody_who_walks_into_the_way_cuts_it_and_the_robot_waits_or_gives_way() -> None:
    problem = asked(two_doors(), "turns", "length")
    front = problem.solve("lattice", step=STEP)
    drive = hpop.follow(problem, front, "least length")
    x, y = (float(column[0]) for column in (drive.plan.at(5.0).x, drive.plan.at(5.0).y))
    change = drive.world(0.5, people=[Person(x, y - 0.1 * 4.5, velocity=(0.0, 0.1), name="visitor")])
    assert change.safe_until is not None
    drive.ready()
    options = drive.options(0.5, 0.5)
    if len(options):
        drive.take(options.knee())
        assert drive._progress.plan.stops is None
    drive.world(1.0, stop="visitor")
    assert not drive.surroundings.moving
    assert drive.options(1.0).status is Status.COMPLETE


def test_those_who_have_gone_by_the_time_that_a_door_closes_cost_nothing_any_more() -> None:
    people = (Person(3.0, 4.5, until=1.0, name="visitor"), Person(9.0, 1.0, name="guard"))
    problem = asked(two_doors(people=people), "hall_zones", "length")
    front = problem.solve("lattice", step=STEP, headings=4, eps=0.5)
    drive = hpop.follow(problem, front, "least length", planner={"lattice": {"step": STEP, "headings": 4}})
    drive.world(4.0, close=SOUTH)
    options = drive.options(4.0, 1.0)
    assert options.status is Status.COMPLETE
    alone = asked(two_doors(people=people[1:]), "hall_zones", "length")
    for option in options:
        assert option.costs["hall_zones"] == pytest.approx(alone.evaluate(option.item)["hall_zones"])
    assert [closing.person for closing in drive.surroundings.closed] == ["", "guard"]


def test_a_mean_of_the_whole_drive_counts_the_time_for_which_it_stood_before_a_door() -> None:
    problem, front = planned()
    drive = hpop.follow(problem, front, "least length")
    change = drive.world(0.5, close=SOUTH)
    assert change.stops_at is not None
    options = drive.options(change.stops_at + 5.0)
    assert options.commit.stands > 4.0
    stood, longer = (drive.at(change.stops_at + seconds).past["obstruction"] for seconds in (0.0, 5.0))
    assert longer == pytest.approx(problem.evaluate(held(drive.plan, 5.0))["obstruction"])
    assert longer != pytest.approx(stood)
    option = options.knee()
    drive.take(option)
    assert option.reported["obstruction"] == pytest.approx(problem.evaluate(drive.plan)["obstruction"])


def test_where_nothing_was_searched_no_more_is_claimed_than_bounds_tell() -> None:
    problem = asked(two_doors(), "turns", "length", "duration")
    drive = hpop.follow(problem, problem.solve("lattice", step=STEP), "knee")
    drive.world(0.5, people=[Person(9.0, 5.0, velocity=(-0.5, 0.0), name="visitor")])
    drive.ready()
    options = drive.options(0.5, deadline=0.0)
    assert options.status is Status.TIME_LIMIT
    assert options.labels == 0
    exact = drive.options(0.5, deadline=0.2)
    assert exact.status is Status.COMPLETE
    missed = np.maximum(options.front.costs[None] / np.maximum(exact.front.costs[:, None], 1e-9) - 1, 0)
    assert missed.max(axis=2).min(axis=1).max() <= options.gap + 1e-9


def test_options_whose_beginning_is_cut_are_invalid_and_are_not_taken() -> None:
    drive = drive_of("least length")
    options = drive.options(0.1, 4.5)
    x = float(options.commit.state.x[0])
    corner = shapely.box(x - 1.05, 1.0, x - 1.0, 1.1)  # on the way there, and on none of theirs
    change = drive.world(0.2, close=corner, name="a trolley")
    assert change.stops_at is not None
    assert change.stops_at < options.commit.time
    assert change.invalid == tuple(range(len(options)))
    for option in options:
        with pytest.raises(DriveError, match=r"these options begin; call options\(now\) again"):
            drive.take(option)
    drive.world(0.3, open="a trolley")
    assert drive.take(options[0]).duration > options.commit.time
