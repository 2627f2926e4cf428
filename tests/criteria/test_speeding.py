"""Speeding: metres in excess, against lengths cut by shapely."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import Speeding, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Zone

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
FAST = DifferentialDrive(speed=1.5)


def line(*points, robot=FAST):
    return Trajectory.from_poses(robot, [(x, y, 0) for x, y in points])


def expected(trajectory, parts, speed):
    """(v - limit) times the seconds spent in each part."""
    way = shapely.LineString(np.stack([trajectory.states.x, trajectory.states.y], axis=1))
    return sum(max(speed - limit, 0.0) * way.intersection(area).length / speed for area, limit in parts)


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 4, 1.2])
def test_crossing_a_zone_costs_its_width_times_the_share_in_excess(angle):
    zone = shapely.box(-2, -8, 1.5, 8)
    world = ROOM.with_content(zones=[Zone("speed", zone, limit=0.9)])
    across = line((-6 * math.cos(angle), -6 * math.sin(angle)), (6 * math.cos(angle), 6 * math.sin(angle)))
    assert trajectory_cost(Speeding(), across, world) == pytest.approx(expected(across, [(zone, 0.9)], 1.5), rel=2e-3)
    assert trajectory_cost(Speeding(), across, world) == pytest.approx(3.5 / math.cos(angle) * 0.4, rel=2e-3)


def test_who_is_slow_or_stays_out_or_turns_in_place_pays_nothing():
    world = ROOM.with_content(zones=[Zone("speed", shapely.box(-2, -2, 2, 2), limit=0.9)])
    slow = DifferentialDrive(speed=0.9)
    assert trajectory_cost(Speeding(), line((-4, 0), (4, 0), robot=slow), world) == 0
    assert trajectory_cost(Speeding(), line((-4, 2.5), (4, 2.5)), world) == pytest.approx(0, abs=1e-12)
    turn = Trajectory.from_poses(FAST, [(0, 0, 0), (0, 0, 3.0)])
    assert trajectory_cost(Speeding(), turn, world) == 0


def test_where_zones_overlap_the_lowest_limit_holds_and_only_that():
    one, other, third = shapely.box(-5, -5, 1, 5), shapely.box(-1, -5, 4, 5), shapely.Point(-3, 0).buffer(1)
    zones = [Zone("speed", one, limit=1.2), Zone("speed", other, limit=0.5), Zone("speed", third, limit=1.2)]
    world = ROOM.with_content(zones=zones)
    across = line((-8, 0.3), (8, 0.5), (-8, 3.1))
    parts = [(other, 0.5), (one.difference(other), 1.2)]
    assert trajectory_cost(Speeding(), across, world) == pytest.approx(expected(across, parts, 1.5), rel=2e-3)


def test_only_what_is_executed_above_the_limit_counts():
    world = ROOM.with_content(zones=[Zone("speed", shapely.box(-9, -9, 9, 9), limit=0.6)])
    run = line((-3, 0), (1, 0), robot=DifferentialDrive(speed=1.0, acceleration=0.5)).execution()
    t = np.linspace(0, run.duration, 100_001)
    excess = np.maximum(run.rates(t)[0].x - 0.6, 0)
    assert trajectory_cost(Speeding(), run, world) == pytest.approx(np.trapezoid(excess, t), rel=2e-3)


def test_it_holds_on_coarse_maps_and_for_zones_with_holes():
    holed = shapely.box(-4, -4, 4, 4).difference(shapely.box(-1, -1, 1, 1))
    cells = World.from_cells(np.zeros((40, 40), dtype=bool), 0.5, origin=(-10.0, -10.0, 0.0))
    world = cells.with_content(zones=[Zone("speed", holed, limit=0.5)])
    assert trajectory_cost(Speeding(), line((-6, 0.2), (6, 0.1)), world) == pytest.approx(6 * 1.0 / 1.5, rel=5e-3)


@pytest.mark.proof
@pytest.mark.seeds(1, of=[1, 2])
def test_it_is_a_good_criterion_in_other_worlds_too(seed):
    check_criterion(Speeding(), rng=seed)


def test_it_asks_for_speed_zones():
    with pytest.raises(CriterionError, match="requires speed zones"):
        trajectory_cost(Speeding(), line((0, 0), (1, 0)), ROOM)
