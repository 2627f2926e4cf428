"""Rules of zones: one-way zones and limits of speed."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely

from hpop.criteria import AgainstFlow, Speeding, trajectory_cost
from hpop.criteria.others.zones import one_way_flows, speed_limits
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Zone

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(speed=0.8)
CORRIDOR = shapely.box(-3, -1, 3, 1)


def one_way(area, *points):
    return Zone("one-way", area, path=shapely.LineString(points))


def line_of_against_flow(*points):
    return Trajectory.from_poses(ROBOT, [(x, y, 0) for x, y in points])


def cost(trajectory, *zones):
    return trajectory_cost(AgainstFlow(), trajectory, ROOM.with_content(zones=zones))


@pytest.mark.parametrize("angle", [0.0, 0.2, -0.3])
def test_against_the_direction_each_metre_counts_by_its_cosine(angle):
    zone = one_way(CORRIDOR.buffer(5), (-9, 0), (9, 0))
    dx, dy = 4 * math.cos(angle), 4 * math.sin(angle)
    assert cost(line_of_against_flow((2, 0), (2 - dx, -dy)), zone) == pytest.approx(dx)
    assert cost(line_of_against_flow((2 - dx, -dy), (2, 0)), zone) == pytest.approx(0, abs=1e-9)


def test_along_across_outside_and_turning_cost_nothing():
    zone = one_way(CORRIDOR, (-3, 0), (3, 0))
    assert cost(line_of_against_flow((-5, 0), (5, 0)), zone) == pytest.approx(0, abs=1e-9)
    assert cost(line_of_against_flow((0, -3), (0, 3)), zone) == pytest.approx(0, abs=1e-9)
    assert cost(line_of_against_flow((5, 1.5), (-5, 1.5)), zone) == pytest.approx(0, abs=1e-9)
    assert cost(Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, 3.0)]), zone) == 0


def test_driving_through_against_it_costs_the_length_of_the_zone():
    assert cost(line_of_against_flow((6, 0.2), (-6, 0.2)), one_way(CORRIDOR, (-3, 0), (3, 0))) == pytest.approx(
        6.0, rel=1e-3
    )


def test_zones_that_overlap_count_each():
    zones = [one_way(CORRIDOR, (-3, 0), (3, 0)), one_way(CORRIDOR, (0, -1), (0, 1))]
    assert cost(line_of_against_flow((6, 0.2), (-6, 0.2)), *zones) == pytest.approx(6.0, rel=1e-3)
    assert cost(line_of_against_flow((6, 0.2), (-6, 0.2)), zones[0], zones[0]) == pytest.approx(12.0, rel=1e-3)


def test_the_direction_is_that_of_the_nearest_segment():
    corners = np.array([(-4.0, -3.0), (-1.0, 3.0), (-1.0, 3.0), (4.0, 2.0), (3.0, -4.0)])  # one corner is given twice
    zone = one_way(shapely.box(-5, -5, 5, 5), *corners)
    ahead, left = one_way_flows(ROOM.with_content(zones=[zone]))[0]
    rng = np.random.default_rng(2)
    checked = 0
    for x, y in rng.uniform(-4, 4, (300, 2)):
        segments = [(a, b) for a, b in itertools.pairwise(corners) if (a != b).any()]
        distances = [shapely.LineString(segment).distance(shapely.Point(x, y)) for segment in segments]
        if np.diff(np.sort(distances)[:2])[0] < 0.6:
            continue  # the border between two directions is blurred, and beyond corners two are equally near
        a, b = segments[int(np.argmin(distances))]
        found = (ahead(np.array([x]), np.array([y]))[0], left(np.array([x]), np.array([y]))[0])
        assert found == pytest.approx(tuple((b - a) / np.hypot(*(b - a))))
        checked += 1
    assert checked > 100


def test_many_small_zones_cost_what_each_of_them_costs_alone():
    rng = np.random.default_rng(4)
    zones = []
    for x, y, turn in rng.uniform([-8, -8, 0], [8, 8, 6], (30, 3)).tolist():
        cos, sin = math.cos(turn), math.sin(turn)
        path = shapely.LineString([(x - 2 * cos, y - 2 * sin), (x + 2 * cos, y + 2 * sin)])
        zones.append(Zone("one-way", path.buffer(0.8, cap_style="flat"), path=path))
    for ahead, left in (rng.uniform(-9, 9, (2, 2)) for _ in range(10)):
        trajectory = line_of_against_flow(ahead, left)
        assert cost(trajectory, *zones) == pytest.approx(sum(cost(trajectory, zone) for zone in zones), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_squares_of_the_grid_have_the_shares_that_shapely_gives_each_of_them(seed):
    rng = np.random.default_rng(seed)
    area = shapely.union_all([shapely.Point(*rng.uniform(-4, 4, 2)).buffer(rng.uniform(0.1, 2)) for _ in range(4)])
    area = shapely.difference(area, shapely.Point(0, 0).buffer(1))
    ((_, inside),) = speed_limits(ROOM.with_content(zones=[Zone("speed", area, limit=1.0)]))
    x, y = np.meshgrid(*(inside.origin[i] + inside.spacing * np.arange(inside.values.shape[1 - i]) for i in (0, 1)))
    half = 0.5 * inside.spacing
    squares = shapely.box(x - half, y - half, x + half, y + half)
    assert inside.values == pytest.approx(
        shapely.area(shapely.intersection(squares, area)) / inside.spacing**2, abs=1e-9
    )


@pytest.mark.parametrize("turn", [0.0, 0.7, 4.0])
def test_beyond_a_corner_it_is_half_way_between_two_directions(turn):
    def turned(x, y):
        return x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)

    square = shapely.Point(0, 0).buffer(6)
    zone = one_way(square, turned(-4, 0), turned(0, 0), turned(0, 4))
    ahead, left = one_way_flows(ROOM.with_content(zones=[zone]))[0]
    place = turned(2, -1)
    assert (float(ahead(*place)), float(left(*place))) == pytest.approx(turned(math.sqrt(0.5), math.sqrt(0.5)))


def test_beyond_a_point_where_the_path_turns_back_what_comes_after_counts():
    zone = one_way(shapely.Point(0, 0).buffer(6), (-4, 0), (0, 0), (-2, 0))
    ahead, left = one_way_flows(ROOM.with_content(zones=[zone]))[0]
    assert (float(ahead(2.0, 0.5)), float(left(2.0, 0.5))) == pytest.approx((-1.0, 0.0), abs=1e-9)


def test_a_path_round_a_bend_against_sampling():
    corners = [(-4.0, 0.0), (0.0, 0.0), (0.0, 4.0)]
    area = shapely.union(shapely.box(-4, -1, 1, 1), shapely.box(-1, 0, 1, 4))
    zone = one_way(area, *corners)
    trajectory = line_of_against_flow((0.3, 6), (0.2, 0.1), (-6, -0.4), (3, -0.3))
    n = 40_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s, (v, _) = trajectory.at(t), trajectory.rates(t)
    inside = shapely.contains_xy(area, s.x, s.y)
    upwards = np.hypot(np.maximum(s.x, 0), s.y) > np.hypot(s.x, np.minimum(s.y, 0))  # nearer to the second segment
    along = np.where(upwards, v.y, v.x)
    expected = np.mean(np.maximum(-along, 0) * inside) * trajectory.duration
    assert expected == pytest.approx(8, abs=0.3)
    assert cost(trajectory, zone) == pytest.approx(expected, rel=0.02)


@pytest.mark.proof
@pytest.mark.seeds(1, of=[1, 2])
def test_it_is_a_good_criterion_in_other_worlds_too_for_against_flow(seed):
    check_criterion(AgainstFlow(), rng=seed)


def test_it_asks_for_one_way_zones():
    with pytest.raises(CriterionError, match="requires one-way zones"):
        cost(line_of_against_flow((0, 0), (1, 0)), Zone("speed", CORRIDOR, limit=1.0))


FAST = DifferentialDrive(speed=1.5)


def line_of_speeding(*points, robot=FAST):
    return Trajectory.from_poses(robot, [(x, y, 0) for x, y in points])


def expected(trajectory, parts, speed):
    """(v - limit) times the seconds spent in each part."""
    way = shapely.LineString(np.stack([trajectory.states.x, trajectory.states.y], axis=1))
    return sum(max(speed - limit, 0.0) * way.intersection(area).length / speed for area, limit in parts)


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 4, 1.2])
def test_crossing_a_zone_costs_its_width_times_the_share_in_excess(angle):
    zone = shapely.box(-2, -8, 1.5, 8)
    world = ROOM.with_content(zones=[Zone("speed", zone, limit=0.9)])
    across = line_of_speeding((-6 * math.cos(angle), -6 * math.sin(angle)), (6 * math.cos(angle), 6 * math.sin(angle)))
    assert trajectory_cost(Speeding(), across, world) == pytest.approx(expected(across, [(zone, 0.9)], 1.5), rel=2e-3)
    assert trajectory_cost(Speeding(), across, world) == pytest.approx(3.5 / math.cos(angle) * 0.4, rel=2e-3)


def test_who_is_slow_or_stays_out_or_turns_in_place_pays_nothing():
    world = ROOM.with_content(zones=[Zone("speed", shapely.box(-2, -2, 2, 2), limit=0.9)])
    slow = DifferentialDrive(speed=0.9)
    assert trajectory_cost(Speeding(), line_of_speeding((-4, 0), (4, 0), robot=slow), world) == 0
    assert trajectory_cost(Speeding(), line_of_speeding((-4, 2.5), (4, 2.5)), world) == pytest.approx(0, abs=1e-12)
    turn = Trajectory.from_poses(FAST, [(0, 0, 0), (0, 0, 3.0)])
    assert trajectory_cost(Speeding(), turn, world) == 0


def test_where_zones_overlap_the_lowest_limit_holds_and_only_that():
    one, other, third = shapely.box(-5, -5, 1, 5), shapely.box(-1, -5, 4, 5), shapely.Point(-3, 0).buffer(1)
    zones = [Zone("speed", one, limit=1.2), Zone("speed", other, limit=0.5), Zone("speed", third, limit=1.2)]
    world = ROOM.with_content(zones=zones)
    across = line_of_speeding((-8, 0.3), (8, 0.5), (-8, 3.1))
    parts = [(other, 0.5), (one.difference(other), 1.2)]
    assert trajectory_cost(Speeding(), across, world) == pytest.approx(expected(across, parts, 1.5), rel=2e-3)


def test_only_what_is_executed_above_the_limit_counts():
    world = ROOM.with_content(zones=[Zone("speed", shapely.box(-9, -9, 9, 9), limit=0.6)])
    run = line_of_speeding((-3, 0), (1, 0), robot=DifferentialDrive(speed=1.0, acceleration=0.5)).execution()
    t = np.linspace(0, run.duration, 100_001)
    excess = np.maximum(run.rates(t)[0].x - 0.6, 0)
    assert trajectory_cost(Speeding(), run, world) == pytest.approx(np.trapezoid(excess, t), rel=2e-3)


def test_it_holds_on_coarse_maps_and_for_zones_with_holes():
    holed = shapely.box(-4, -4, 4, 4).difference(shapely.box(-1, -1, 1, 1))
    cells = World.from_cells(np.zeros((40, 40), dtype=bool), 0.5, origin=(-10.0, -10.0, 0.0))
    world = cells.with_content(zones=[Zone("speed", holed, limit=0.5)])
    assert trajectory_cost(Speeding(), line_of_speeding((-6, 0.2), (6, 0.1)), world) == pytest.approx(
        6 * 1.0 / 1.5, rel=5e-3
    )


@pytest.mark.proof
@pytest.mark.seeds(1, of=[1, 2])
def test_it_is_a_good_criterion_in_other_worlds_too_for_speeding(seed):
    check_criterion(Speeding(), rng=seed)


def test_it_asks_for_speed_zones():
    with pytest.raises(CriterionError, match="requires speed zones"):
        trajectory_cost(Speeding(), line_of_speeding((0, 0), (1, 0)), ROOM)
