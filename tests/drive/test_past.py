"""The costs so far of a drive at any moment, also in the middle of a turn, and after a stop."""

from __future__ import annotations

from functools import cache

import pytest

import hpop
from hpop.world import Person
from tests.drive.rooms import STEP, asked, two_doors

ADA = Person(2.6, 1.4, name="Ada")
CRITERIA = ("duration", "hall_zones", "rotation", "obstruction", "msdv")


@cache
def beside_somebody() -> tuple[hpop.Problem, hpop.Front]:
    """Return the hall with a person who stands where the path through the south door turns."""
    problem = asked(two_doors(people=(ADA,)), *CRITERIA)
    return problem, problem.solve("lattice", step=STEP)


def turning(share: float) -> tuple[hpop.drive.Execution, tuple[float, float, float]]:
    """Return a drive, and when its first turn near a person begins, is done to that share, and ends, s."""
    problem, front = beside_somebody()
    drive = hpop.follow(problem, front, "least duration")
    for begin, end, kind in zip(drive.plan.times, drive.plan.times[1:], drive.plan.kinds, strict=False):
        moments = float(begin), float(begin + share * (end - begin)), float(end)
        before, after = (drive.at(moment).past["hall_zones"] for moment in (begin, end))
        if kind == "turn" and after - before > 0.01:
            return drive, moments
    raise AssertionError("the plan turns nowhere near Ada")


@pytest.mark.cases("0.4", "0.9")
@pytest.mark.parametrize("share", [0.02, 0.4, 0.9])
def test_of_a_turn_that_is_under_way_counts_what_is_done(share: float) -> None:
    drive, (begin, t, end) = turning(share)
    before, now, after = (drive.at(moment).past for moment in (begin, t, end))
    assert now["duration"] == pytest.approx(t)
    # In place each second costs the same.
    gone = before["hall_zones"] + share * (after["hall_zones"] - before["hall_zones"])
    assert now["hall_zones"] == pytest.approx(gone)
    turned = abs(float(drive.plan.at(t).yaw[0] - drive.plan.at(begin).yaw[0]))
    assert now["rotation"] == pytest.approx(before["rotation"] + turned)
    total = {moment: drive.at(moment).past["obstruction"] * moment for moment in (begin, t, end)}
    assert total[begin] - 1e-9 <= total[t] <= total[end] + 1e-9
    assert before["msdv"] <= now["msdv"] <= after["msdv"]


def test_a_turn_that_is_stopped_has_cost_what_was_done_of_it() -> None:
    drive, (_, t, _) = turning(0.3)
    before, state = drive.at(t).past, drive.plan.at(t)
    comes = Person(state.x[0] + 0.95, state.y[0], velocity=(-1.0, 0.0), until=3.0, name="comes")  # touches in 0.4 s
    assert drive.world(t, people=[ADA, comes]).stops_at == pytest.approx(t)
    now, later = drive.at(t).past, drive.at(t + 0.5).past
    for name in CRITERIA[:-1]:
        assert now[name] == pytest.approx(before[name])
    assert later["duration"] == pytest.approx(t + 0.5)
    assert later["rotation"] == pytest.approx(now["rotation"])
