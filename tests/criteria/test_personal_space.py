"""Personal space: Kirby's values, and the integral against closed form and sampling."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import PersonalSpace, trajectory_cost
from hpop.criteria.others.personal_space import spreads
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(speed=0.8)


def turn_at(x, y):
    return Trajectory.from_poses(ROBOT, [(x, y, 0), (x, y, 2.0)])


def rate_at(x, y, *people, **options):
    turn = turn_at(x, y)
    return trajectory_cost(PersonalSpace(**options), turn, ROOM.with_content(people=people)) / turn.duration


@pytest.mark.parametrize(
    ("speed", "ahead", "side", "behind"),
    [(0.0, 0.5, 1 / 3, 0.25), (0.2, 0.5, 1 / 3, 0.25), (0.25, 0.5, 1 / 3, 0.25), (1.5, 3.0, 2.0, 1.5)],
)
def test_who_walks_faster_needs_more_space(speed, ahead, side, behind):
    assert spreads(Person(0, 0, velocity=(0.0, speed))) == pytest.approx((ahead, side, behind))


@pytest.mark.parametrize(("forward", "left", "exponent"), [(0.5, 0, 0.5), (-0.25, 0, 0.5), (0, 1 / 3, 0.5), (0, 0, 0)])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_one_standard_deviation_off_each_way_costs_the_same(forward, left, exponent, yaw):
    x = 1 + forward * math.cos(yaw) - left * math.sin(yaw)
    y = 2 + forward * math.sin(yaw) + left * math.cos(yaw)
    assert rate_at(x, y, Person(1, 2, yaw)) == pytest.approx(math.exp(-exponent))


def test_passing_behind_costs_half_of_passing_in_front():
    person = Person(0.0, 0.0, math.pi / 2)
    front, behind = (
        trajectory_cost(
            PersonalSpace(),
            Trajectory.from_poses(ROBOT, [(0, end * 0.05, math.pi / 2), (0, end * 8, math.pi / 2)]),
            ROOM.with_content(people=[person]),
        )
        for end in (1, -1)
    )
    # the turn to drive away at the same place is no part of the integrals below; its rate differs a little
    for cost, sigma, turns in ((front, 0.5, 0), (behind, 0.25, 2)):
        integral = sigma * math.sqrt(math.pi / 2) * math.erfc(0.05 / sigma / math.sqrt(2)) / ROBOT.speed
        near = math.exp(-0.5 * (0.05 / sigma) ** 2)
        turning = turn_half().duration * near if turns else 0.0
        assert cost == pytest.approx(integral + turning, rel=1e-4)


def turn_half():
    return Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, math.pi)])


def test_people_add_up_or_the_worst_counts():
    one, other = Person(0.3, 0.0, 2.0), Person(-0.2, 0.3, -1.0)
    alone = [rate_at(0, 0, person) for person in (one, other)]
    assert rate_at(0, 0, one, other) == pytest.approx(sum(alone))
    assert rate_at(0, 0, one, other, people="max") == pytest.approx(max(alone))


@pytest.mark.parametrize("combine", ["sum", "max"])
def test_people_who_move_are_met_where_they_are_then_and_face_where_they_go(combine):
    people = [
        Person(2, 1, yaw=1.0, velocity=(-0.6, -0.1)),
        Person(0, -0.5, yaw=0.5),
        Person(3, 5, velocity=(0.0, -0.7), yaw=3.0),
    ]
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 200_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s = trajectory.at(t)
    rates = []
    for p in people:
        v = math.hypot(*p.velocity)
        facing = math.atan2(p.velocity[1], p.velocity[0]) if v else p.yaw
        way = np.stack([s.x - p.x - p.velocity[0] * t, s.y - p.y - p.velocity[1] * t])
        x, y = np.array([[math.cos(facing), math.sin(facing)], [-math.sin(facing), math.cos(facing)]]) @ way
        ahead = max(2 * v, 0.5)
        rates.append(np.exp(-(x**2) / 2 / np.where(x > 0, ahead, ahead / 2) ** 2 - y**2 / 2 / (ahead * 2 / 3) ** 2))
    expected = np.mean(np.sum(rates, 0) if combine == "sum" else np.max(rates, 0)) * trajectory.duration
    found = trajectory_cost(PersonalSpace(combine), trajectory, ROOM.with_content(people=people))
    assert expected > 0.1
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.proof
def test_the_nearest_person_alone_makes_a_good_criterion_too():
    check_criterion(PersonalSpace("max"))


def test_another_way_to_combine_people_is_refused():
    with pytest.raises(CriterionError, match="one of sum, max, got 'mean'"):
        PersonalSpace("mean")
