"""Claims: max_turns leaves the part of the exact front with no more turns, and says so where there is none."""

from __future__ import annotations

import re

import pytest
import shapely

from hpop import DifferentialDrive, Problem, World
from hpop.errors import OptionError
from hpop.planners import Lattice
from hpop.runtime.limits import Status

ROOM = World.from_polygons(
    [shapely.box(3, 0, 3.4, 3.6), shapely.box(6, 1.6, 6.4, 6), shapely.box(4.5, 4.2, 5, 5)],
    extent=shapely.box(0, 0, 10, 6),
)


def problem(criteria=("exposure", "turns", "length")) -> Problem:
    return Problem(ROOM, DifferentialDrive(), (1, 1, 0), (9, 5, None), list(criteria))


def test_max_turns_keeps_what_of_the_front_has_no_more():
    exact = problem().solve("lattice", step=0.5)
    turns = sorted(set(exact.costs[:, 1].tolist()))
    assert len(turns) > 3
    for most in turns[:-1]:
        front = problem().solve("lattice", step=0.5, max_turns=int(most))
        expected = exact.costs[exact.costs[:, 1] <= most]
        assert sorted(front.costs.round(6).tolist()) == sorted(expected.round(6).tolist())
        assert f"and at most {int(most)} turns" in front.certificate


def test_too_few_turns_are_told_with_the_least():
    least = int(problem().solve("lattice", step=0.5).costs[:, 1].min())
    front = problem().solve("lattice", step=0.5, max_turns=least - 1)
    assert front.status == Status.NO_PATH
    assert any(f"at most {least - 1} turns; the fewest turns are {least}" in note for note in front.notes)


def test_turns_that_are_too_few_for_a_cap_are_told_with_the_cap_that_they_need():
    exact = problem(("turns", "length")).solve("lattice", step=0.5)
    fewest, shortest = exact.costs[exact.costs[:, 0].argmin()], exact.costs[:, 1].min()
    assert fewest[1] > 1.01 * shortest
    capped = problem(("obstruction", "turns", "length"))

    def planned(factor):
        return capped.solve("lattice", step=0.5, max_detour={"length": factor}, max_turns=int(fewest[0]))

    blocked = planned(1.0)
    assert blocked.status == Status.NO_PATH
    (note,) = [note for note in blocked.notes if "turns" in note]
    found = re.fullmatch(
        r"no path with at most (\d+) turns satisfies .*least length .* is (\S+) times .* Raise .*", note
    )
    assert int(found[1]) == fewest[0]
    enough = float(found[2])
    assert 0 <= enough - fewest[1] / shortest < 0.0011
    assert planned(enough).status == Status.COMPLETE
    assert planned(enough - 0.002).status == Status.NO_PATH


def test_every_stage_keeps_the_bound():
    fronts = [problem().front(candidates) for candidates in Lattice(step=0.25, max_turns=5).stages(problem())]
    assert fronts
    assert all((front.costs[:, 1] <= 5).all() for front in fronts)


@pytest.mark.parametrize(
    ("options", "criteria", "message"),
    [
        ({"max_turns": -1}, ("turns", "length"), "max_turns must be a whole number of at least 0"),
        ({"max_turns": 2.5}, ("turns", "length"), "max_turns must be a whole number of at least 0"),
        ({"max_turns": 3}, ("exposure", "length"), "max_turns needs the criterion 'turns', but the search"),
    ],
)
def test_bounds_that_mean_nothing_are_refused(options, criteria, message):
    with pytest.raises(OptionError, match=message):
        problem(criteria).solve(Lattice(step=0.5, **options))
