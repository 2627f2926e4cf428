"""A robot with corners that people touch: it has options where it can get clear of them, and reverses if it may."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive import Execution, Options
from hpop.drive.closings import Closing
from hpop.drive.plan import closed_trajectories
from hpop.drive.ways_out import ways_out
from hpop.errors import ModelError
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.world import Person, World

HX, HY = 0.4, 0.25  # m, half of the sides
BOX = ((-HX, -HY), (HX, -HY), (HX, HY), (-HX, HY))
HALL = World.from_polygons([], extent=shapely.box(0, 0, 6, 4))
AHEAD = Person(3.6, 2.0, name="Ann")
BESIDE_A_CORNER = Person(3.5626, 2.4412, name="Bob")


@cache
def planned(*, reverses: bool) -> tuple[hpop.Problem, hpop.Front]:
    robot = hpop.DifferentialDrive(footprint=BOX, reverses=reverses)
    problem = hpop.Problem(HALL, robot, (1.0, 2.0, 0.0), (5.5, 2.0, None), ["duration", "length"])
    return problem, problem.solve("lattice", step=0.5)


def asked(*people: Person, reverses: bool) -> tuple[Execution, Options]:
    """Return a drive whose robot is at (3, 2) when people are seen, and its options."""
    following = hpop.follow(*planned(reverses=reverses), "knee")
    following.world(2.0, people=people)
    following.ready(2.0)
    return following, following.options(2.0, deadline=0.5)


def gaps(trajectory: hpop.Trajectory, person: Person) -> np.ndarray:
    """Return the gaps, m, between the box and a person who stands, negative in contact, every hundredth of a second."""
    s = trajectory.at(np.arange(0.0, trajectory.duration, 0.01))
    dx, dy, cos, sin = person.x - s.x, person.y - s.y, np.cos(s.yaw), np.sin(s.yaw)
    u, v = np.abs(cos * dx + sin * dy) - HX, np.abs(cos * dy - sin * dx) - HY
    inside = np.minimum(np.maximum(u, v), 0.0)
    return np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)) + inside - person.radius


def leaves(gap: np.ndarray) -> bool:
    """Return whether the gap never shrinks while there is contact, and there is no contact afterwards."""
    free = int(np.argmax(gap >= -1e-6))
    return bool((np.diff(gap[: free + 1]) >= -1e-5).all() and gap[free:].min() >= -1e-3)


def test_a_box_that_is_touched_ahead_drives_back_if_it_may():
    following, options = asked(AHEAD, reverses=True)
    assert options.status is Status.COMPLETE
    assert "all paths first get clear of people by" in options.certificate
    assert any("m back" in note for note in options.front.notes)
    for option in options:
        gap = gaps(option.trajectory, AHEAD)
        assert gap[0] < 0.01
        assert leaves(gap)
        assert gaps(option.trajectory.execution(), AHEAD).min() >= gap[0] - 1e-3
    commit = options.commit
    assert not verify(following.surroundings.at(commit.state, commit.time), options.front)
    following.take(options.knee())
    assert following.plan.duration > 4.0


def test_a_box_that_may_not_drive_back_is_held_and_this_is_said():
    _, options = asked(AHEAD, reverses=False)
    assert not len(options)
    assert options.status is Status.NO_PATH
    assert any("moves back would (if the robot may, set reverses: true)" in note for note in options.front.notes)


def test_of_a_box_that_people_enclose_it_is_said_that_moves_back_do_not_free_it_either():
    behind = Person(2.4, 2.0, name="Bob")
    for reverses, words in ((False, "but moves back would not free it either"), (True, "ahead or back free it")):
        _, options = asked(AHEAD, behind, reverses=reverses)
        assert not len(options)
        assert any(words in note for note in options.front.notes)


def test_a_person_who_touches_a_corner_by_a_hair_may_be_left_by_a_turn():
    _, options = asked(BESIDE_A_CORNER, reverses=False)
    assert len(options)
    assert all(leaves(gaps(option.trajectory, BESIDE_A_CORNER)) for option in options)


@pytest.mark.proof
def test_while_others_walk_a_touched_box_still_has_an_option_that_meets_nobody():
    walker = Person(5.0, 3.5, velocity=(0.2, 0.0), until=3.0, name="Cem")
    _, options = asked(AHEAD, walker, reverses=True)
    assert len(options)
    for option in options:
        assert leaves(gaps(option.trajectory, AHEAD))


def test_plans_do_not_reverse_and_only_a_model_that_may_accepts_it():
    robot = planned(reverses=True)[0].model
    assert planned(reverses=True)[1].costs.tolist() == planned(reverses=False)[1].costs.tolist()
    states = robot.space.state((3.0, 2.0, 0.0)), robot.space.state((2.5, 2.0, 0.0))
    assert not robot.doubtful(robot.laws["move"], *states)[0]
    assert replace(robot, reverses=False).doubtful(robot.laws["move"], *states)[0]
    with pytest.raises(ModelError, match="reverses must be true or false, got 1"):
        hpop.DifferentialDrive(reverses=1)


def test_a_way_out_is_clear_of_people_who_stand_farther_than_its_first_moves():
    def person(x, y):
        return Closing(shapely.Point(x, y).buffer(0.25), person="person", place=(x, y))

    row = [person(x, side * 0.62) for x in np.arange(0.3, 2.6, 0.45) for side in (1, -1)]
    closings = [person(-0.3, 0.45), person(-0.5, -0.62), *row, person(3.3, 0.0)]
    robot, hall = hpop.DifferentialDrive(footprint=BOX), World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
    for way in ways_out(robot, hall, closings, robot.space.state((0, 0, 0))):
        assert not closed_trajectories([way], closings)[0]
