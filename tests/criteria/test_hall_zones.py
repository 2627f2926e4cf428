"""Hall's zones: weighted time against chords of circles and against sampling in time."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import HallZones, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(radius=0.3, speed=0.8)


def chord(radius, offset):
    return 2 * math.sqrt(radius**2 - offset**2) if radius > offset else 0.0


@pytest.mark.parametrize("offset", [0.0, 0.4, 1.0, 2.0, 3.9])
def test_passing_a_person_straight_costs_the_chords_of_the_zones(offset):
    world = ROOM.with_content(people=[Person(1.0, 2.0 + offset, 1.0, radius=0.2)])
    passing = Trajectory.from_poses(ROBOT, [(-9, 2, 0), (9, 2, 0)])
    found = trajectory_cost(HallZones(intimate=1.0, personal=0.6, social=0.1, softness=0.02), passing, world)
    # centre to centre: zone + body + robot; each zone counts by what its weight adds to that of the next
    limits = [zone + 0.2 + 0.3 for zone in (0.45, 1.2, 3.6)]
    metres = sum(step * chord(limit, offset) for limit, step in zip(limits, (0.4, 0.5, 0.1), strict=True))
    assert found == pytest.approx(metres / 0.8, abs=0.03)  # panels of 0.1 m see the sharp borders


@pytest.mark.parametrize(
    ("distance", "rate"),
    [(0.5, 1.0), (0.6 + 0.55, 0.5), (0.55 + 2.0, 0.1), (0.55 + 4.0, 0.0), (0.55 + 0.45, 0.75), (0.55 + 1.2, 0.3)],
)
def test_a_turn_in_place_costs_the_weight_of_its_zone_half_way_at_borders(distance, rate):
    world = ROOM.with_content(people=[Person(distance, 0.0)])
    turn = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, 2.0)])
    assert trajectory_cost(HallZones(), turn, world) == pytest.approx(rate * turn.duration)


def test_time_is_counted_for_each_person_also_while_they_move():
    people = [Person(2, 1, velocity=(-0.5, 0.2), radius=0.3), Person(0, -1), Person(5, 5, velocity=(0.0, -1.0))]
    world = ROOM.with_content(people=people)
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 200_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s = trajectory.at(t)
    expected = 0.0
    for p in people:
        gap = np.hypot(s.x - p.x - p.velocity[0] * t, s.y - p.y - p.velocity[1] * t) - p.radius - 0.3
        # between the borders' bands the weight is linear in the smooth step 6u⁵ - 15u⁴ + 10u³ of the gap
        bands = [np.interp(gap, [limit - 0.15, limit + 0.15], [1, 0]) for limit in (0.45, 1.2, 3.6)]
        weight = [np.polyval([6, -15, 10, 0, 0, 0], band) for band in bands]
        expected += np.mean(0.5 * weight[0] + 0.4 * weight[1] + 0.1 * weight[2]) * trajectory.duration
    assert trajectory_cost(HallZones(), trajectory, world) == pytest.approx(expected, rel=1e-3)


def test_the_robot_is_as_large_as_it_reaches_unless_a_radius_is_given():
    square = DifferentialDrive(footprint=((0.3, 0.4), (-0.3, 0.4), (-0.3, -0.4), (0.3, -0.4)))
    world = ROOM.with_content(people=[Person(0.0, 2.0)])
    turn = Trajectory.from_poses(square, [(0, 0, 0), (0, 0, 2.0)])
    same = Trajectory.from_poses(DifferentialDrive(radius=0.5), [(0, 0, 0), (0, 0, 2.0)])
    cost = HallZones(softness=0.9)
    assert trajectory_cost(cost, turn, world) == pytest.approx(trajectory_cost(cost, same, world))
    point = trajectory_cost(HallZones(softness=0.9, robot_radius=0.0), turn, world)
    assert point < trajectory_cost(cost, turn, world)


@pytest.mark.parametrize(
    "wrong",
    [
        {"intimate": 0.2},
        {"social": -0.1},
        {"intimate": 0.0, "personal": 0.0, "social": 0.0},
        {"intimate": np.inf},
        {"personal": np.nan},
        {"softness": 0.0},
        {"softness": 1.0},
        {"robot_radius": -0.1},
        {"robot_radius": np.nan},
    ],
)
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(CriterionError):
        HallZones(**wrong)
