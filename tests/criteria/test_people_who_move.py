"""All criteria about people, when people move: what conformance asks, with times; and no answer without a time."""

from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest

import hpop.testing.criteria
from hpop.criteria import make_criterion, motion_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.testing import conformance, random_motions, random_world
from hpop.world.content.content import Person

NAMES = [
    "hall_zones",
    "personal_space",
    "o_space",
    "cutting_between",
    "time_to_collision",
    "social_force",
    "visibility_to_people",
]
PREDICTED = "takes each possible future of a person into account"
TIMELESS = {  # asked on graphs without time, or in a frame in which velocities are not turned
    "costs the same on a trajectory as on its edges",
    "adds up along lattice edges to the trajectory's cost",
    "costs the same in any frame of the world",
}


def walking(rng):
    """Return the random world with three people who walk for a minute, two side by side, and one who stands."""
    world = random_world(rng)
    slow = (0.04, -0.03)
    people = [
        Person(4, 3, 0.5, velocity=slow),
        Person(5, 3.5, -2.0, velocity=slow),
        Person(9, 2, velocity=(-0.1, 0.05)),
        Person(6, 7, 1.0),
    ]
    return world.with_content(people=people, groups=[(0, 1), (2, 3)])


#: The others are checked where nobody moves (tests/testing), or in worlds of their own.
@pytest.mark.cases("cutting_between", "time_to_collision")
@pytest.mark.parametrize("name", NAMES)
def test_they_keep_what_criteria_promise_where_there_is_time(name, monkeypatch):
    monkeypatch.setattr(hpop.testing.criteria, "random_world", walking)
    checks = takewhile(lambda check: check.claim != PREDICTED, conformance(make_criterion(name)))  # the rest: elsewhere
    checks = [check for check in checks if check.claim not in TIMELESS]
    assert len(checks) >= 5
    faults = [check for check in checks if check.fault]
    assert not faults


@pytest.mark.parametrize("name", NAMES)
def test_when_the_robot_comes_matters(name):
    rng = np.random.default_rng(4)
    model = DifferentialDrive()
    motions = random_motions(rng, walking(rng), model, "move", 400)
    later = replace(motions, t0=motions.t0 + 15)
    assert (motion_costs(make_criterion(name), motions) != motion_costs(make_criterion(name), later)).any()


@pytest.mark.parametrize("name", NAMES)
def test_on_edges_without_time_there_is_no_answer(name):
    rng = np.random.default_rng(4)
    motions = replace(random_motions(rng, walking(rng), DifferentialDrive(), "move", 4), t0=None)
    with pytest.raises((AttributeError, CriterionError), match="time"):
        motion_costs(make_criterion(name), motions)


@pytest.mark.parametrize("name", NAMES)
def test_who_stands_needs_no_time(name):
    rng = np.random.default_rng(4)
    motions = random_motions(rng, random_world(rng), DifferentialDrive(), "move", 40)
    costs = motion_costs(make_criterion(name), motions)
    assert (costs == motion_costs(make_criterion(name), replace(motions, t0=None))).all()
