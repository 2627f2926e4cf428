"""Surroundings of the camera: obstruction and openness."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from hpop.criteria import Duration, Enclosure, Exposure, Obstruction, Openness, WorstObstruction, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

EXTENT, WALL = shapely.box(-4, -3, 10, 6), shapely.box(-4, -3, 10, 0)  # the wall is all of y < 0
WORLD = World.from_polygons([WALL], extent=EXTENT)
ROBOT = DifferentialDrive(speed=0.5)
FIELD = 0.003  # the field's promise beside straight walls, with a spacing of at most a tenth of the radius


def half_space(d, r):
    """Fraction of a ball of radius r beyond a plane at distance d from its centre: a spherical cap."""
    return (r - d) ** 2 * (2 * r + d) / (4 * r**3) if d < r else 0.0


@given(st.floats(0.1, 3.0), st.floats(1.0, 2.0))
@settings(max_examples=settings.default.max_examples // 2)
def test_a_straight_run_along_a_wall_is_obstructed_as_the_half_space_formula_says(d, r):
    r = round(r, 1)  # a field is built for each radius
    path = Trajectory.from_poses(ROBOT, [(0, d, 0), (5, d, 0)])
    expected = half_space(d, r)
    assert trajectory_cost(Obstruction(r), path, WORLD) == pytest.approx(expected, abs=FIELD)
    assert trajectory_cost(Exposure(r), path, WORLD) == pytest.approx(expected * 10.0, abs=FIELD * 10.0)


def test_the_facts_of_one_metre_to_a_wall_and_of_a_corridor_two_metres_wide():
    path = Trajectory.from_poses(ROBOT, [(0, 1, 0), (5, 1, 0)])
    assert trajectory_cost(Obstruction(), path, WORLD) == pytest.approx(0.15625, abs=5e-4)
    corridor = World.from_polygons([WALL, shapely.box(-4, 2, 10, 6)], extent=EXTENT)
    assert trajectory_cost(Obstruction(2.0), path, corridor) == pytest.approx(0.3125, abs=1e-3)


def test_driving_away_from_a_wall_averages_the_formula_over_time():
    path = Trajectory.from_poses(ROBOT, [(0, 0.3, np.pi / 2), (0, 3.3, np.pi / 2)])
    expected = quad(half_space, 0.3, 2.0, args=(2.0,))[0] / 3.0
    assert trajectory_cost(Obstruction(), path, WORLD) == pytest.approx(expected, abs=5e-4)
    executed = path.execution()  # slower near the wall, so more obstructed

    def rate(t):
        return half_space(executed.at(t).y[0], 2.0)

    T = executed.duration
    slow = quad(rate, 0, T, limit=300)[0] / T
    assert slow > expected + 0.005
    assert trajectory_cost(Obstruction(), executed, WORLD) == pytest.approx(slow, abs=5e-4)


def test_a_turn_costs_what_the_camera_sees_while_it_swings():
    robot = DifferentialDrive(camera_offset=(0.6, 0.0))
    turn = Trajectory.from_poses(robot, [(3, 1, -np.pi / 2), (3, 1, np.pi / 2)])

    def rate(t):
        return half_space(1 + 0.6 * math.sin(turn.at(t).yaw[0]), 1.5)

    expected = quad(rate, 0, turn.duration, limit=300)[0]
    assert trajectory_cost(Exposure(1.5), turn, WORLD) == pytest.approx(expected, abs=1e-3 * turn.duration)
    still = Trajectory.from_poses(ROBOT, [(3, 1, -np.pi / 2), (3, 1, np.pi / 2)])
    phi = half_space(1, 1.5)
    assert trajectory_cost(Exposure(1.5), still, WORLD) == pytest.approx(
        phi * still.duration, abs=1e-3 * still.duration
    )
    assert trajectory_cost(Obstruction(1.5), still, WORLD) == pytest.approx(phi, abs=1e-3)


def test_a_low_wall_obstructs_only_the_part_of_the_ball_below_its_top():
    world = World.from_polygons([(WALL, (0.0, 0.4))], extent=EXTENT)
    path = Trajectory.from_poses(DifferentialDrive(camera_height=1.2), [(0, 0.7, 0), (5, 0.7, 0)])

    def segment(z, d=0.7, r=2.0):
        R = math.sqrt(r * r - z * z)
        return R * R * math.acos(d / R) - d * math.sqrt(R * R - d * d) if d < R else 0.0

    expected = quad(segment, -1.2, -0.8)[0] / (4 / 3 * math.pi * 8)
    assert trajectory_cost(Obstruction(2.0), path, world) == pytest.approx(expected, abs=5e-4)


@given(st.lists(st.tuples(st.floats(0, 6), st.floats(0.5, 4), st.floats(-3, 3)), min_size=2, max_size=5))
def test_exposure_is_obstruction_times_duration(where):
    path = Trajectory.from_poses(ROBOT, where)
    v, s, t = (trajectory_cost(c, path, WORLD) for c in (Obstruction(), Exposure(), Duration()))
    assert s == pytest.approx(v * t, rel=1e-12, abs=1e-15)
    assert 0.0 <= v <= 1.0


def test_the_integral_of_an_obstruction_is_the_exposure_of_its_radius():
    assert Obstruction(1.25).integral == Exposure(1.25)
    assert (Exposure.unit, Exposure.aggregate, Exposure.group) == ("s", "sum", "P")
    assert (Obstruction.unit, Obstruction.aggregate, Obstruction.requires) == ("1", "time-mean", ("camera",))


@pytest.mark.parametrize("cls", [Exposure, Obstruction])
@pytest.mark.parametrize("radius", [0, -1.0, 1e-5, 0.099, 1e3, math.inf, math.nan])
def test_the_radius_of_the_ball_must_make_sense(cls, radius):
    with pytest.raises(CriterionError, match="radius must be a length"):
        cls(radius)


MODEL = DifferentialDrive()


def test_driving_up_to_a_wall_costs_the_cap_at_the_end():
    r, d = 2.0, 1.0
    world = World.from_polygons([shapely.box(8, -20, 20, 20)], extent=shapely.box(0, -5, 8, 5))
    up_and_back = Trajectory.from_poses(MODEL, [(1, 0, 0), (8 - d, 0, 0), (1, 0, 0)])
    cap = (r - d) ** 2 * (2 * r + d) / (4 * r**3)
    assert trajectory_cost(WorstObstruction(r), up_and_back, world) == pytest.approx(cap, abs=3e-3)


def test_a_short_squeeze_in_a_long_walk_costs_what_it_costs_there():
    posts = [shapely.box(14, 0.8, 15, 6), shapely.box(14, -6, 15, -0.8)]
    world = World.from_polygons(posts, extent=shapely.box(0, -6, 30, 6))
    walk = Trajectory.from_poses(MODEL, [(1, 0, 0), (29, 0, 0)])
    s = walk.at(np.linspace(0, walk.duration, 20_001))
    phi = world.obstruction_field(2.0, MODEL.camera_height)(s.x, s.y)
    worst, mean = (trajectory_cost(c, walk, world) for c in (WorstObstruction(), Obstruction()))
    assert worst == pytest.approx(phi.max(), abs=1e-3)
    assert mean < worst / 4


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan, 1e4])
def test_a_ball_needs_a_radius(radius):
    with pytest.raises(CriterionError, match="radius"):
        WorstObstruction(radius)


def closed(d, r):
    """Share of a disc beyond a wall at distance d of its centre: a circular segment."""
    return (r * r * np.arccos(d / r) - d * np.sqrt(r * r - d * d)) / (np.pi * r * r) if d < r else 0.0


def test_the_way_to_a_wall_costs_the_mean_of_the_segments_that_it_cuts_off():
    r = 2.0
    world = World.from_polygons([shapely.box(9, -30, 10, 30)], extent=shapely.box(0, -10, 9, 10))
    way = Trajectory.from_poses(MODEL, [(3, 0, 0), (8.5, 0, 0)])
    expected, _ = quad(lambda x: closed(9 - x, r), 3, 8.5, points=[7])
    assert trajectory_cost(Openness(r), way, world) == pytest.approx(expected / 5.5, abs=2e-3)
    assert trajectory_cost(Openness(r).integral, way, world) == pytest.approx(expected / MODEL.speed, abs=1e-2)


def test_nothing_to_see_but_free_space_costs_nothing():
    world = World.from_polygons([], extent=shapely.box(0, 0, 10, 5))
    assert trajectory_cost(Openness(), Trajectory.from_poses(MODEL, [(1, 1, 0), (8, 4, 2)]), world) == 0.0


def test_a_thin_wall_closes_as_much_as_a_thick_one():
    way = Trajectory.from_poses(MODEL, [(1, 4, 0), (5, 4, 0)])
    costs = []
    for thickness in (0.05, 2.0):
        world = World.from_polygons([shapely.box(6, 0, 6 + thickness, 8)], extent=shapely.box(0, 0, 12, 8))
        costs.append(trajectory_cost(Openness(), way, world))
    assert costs[0] == pytest.approx(costs[1], abs=1e-9)
    assert costs[0] > 0.05


def test_the_mean_stands_for_its_integral():
    assert Openness(3.0).integral == Enclosure(3.0)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan, 1e4])
@pytest.mark.parametrize("cls", [Openness, Enclosure])
def test_an_isovist_needs_a_radius(cls, radius):
    with pytest.raises(CriterionError, match="radius"):
        cls(radius)
