"""Optic flow and passing distance."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from hpop.criteria import Clearance, OpticFlow, PassingDistance, PeakOpticFlow, motion_costs, trajectory_cost
from hpop.errors import CriterionError, MapError
from hpop.models import DifferentialDrive, ViewModel
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Obstacle, World

WALLS = [shapely.box(-90, 1, 90, 2), shapely.box(-90, -2, 90, -1)]
CORRIDOR = World.from_polygons(WALLS, extent=shapely.box(-10, -2, 10, 2))
HALL = shapely.Polygon(shapely.box(-1, -1, 11, 9).exterior, [shapely.box(0, 0, 10, 8).exterior])
ROOM = World.from_polygons([HALL], extent=shapely.box(0, 0, 10, 8))


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_a_metre_in_the_middle_of_a_corridor_costs_half_its_inverse_half_width_at_any_speed(speed):
    path = Trajectory.from_poses(DifferentialDrive(speed=speed), [(-3, 0, 0), (4, 0, 0)])
    assert trajectory_cost(OpticFlow(), path, CORRIDOR) == pytest.approx(7 / (2 * 1.0), rel=1e-9)
    assert trajectory_cost(PeakOpticFlow(), path, CORRIDOR) == pytest.approx(speed / 1.0, rel=1e-9)


def test_near_one_wall_of_a_corridor_more_flows():
    path = Trajectory.from_poses(DifferentialDrive(), [(-3, 0.4, 0), (4, 0.4, 0)])
    assert trajectory_cost(OpticFlow(), path, CORRIDOR) == pytest.approx(7 / 4 * (1 / 0.6 + 1 / 1.4), rel=1e-9)
    assert trajectory_cost(PeakOpticFlow(), path, CORRIDOR) == pytest.approx(1 / 0.6, rel=1e-9)


def test_nearer_than_nearest_counts_as_that():
    path = Trajectory.from_poses(DifferentialDrive(), [(-3, 0.8, 0), (4, 0.8, 0)])
    assert trajectory_cost(PeakOpticFlow(nearest=0.5), path, CORRIDOR) == pytest.approx(1 / 0.5)
    assert trajectory_cost(PeakOpticFlow(nearest=0.1), path, CORRIDOR) == pytest.approx(1 / 0.2)


def test_a_turn_about_the_camera_costs_its_angle_and_its_fastest_rate():
    robot = DifferentialDrive(turn_rate=1.5, turn_acceleration=3.0)
    long, short = (Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, angle)]) for angle in (-2.0, 0.3))
    assert trajectory_cost(OpticFlow(), long, CORRIDOR) == pytest.approx(2.0)
    assert trajectory_cost(PeakOpticFlow(), long, CORRIDOR) == pytest.approx(1.5)
    assert trajectory_cost(PeakOpticFlow(), short, CORRIDOR) == pytest.approx(math.sqrt(3.0 * 0.3))


def test_no_short_turn_flows_faster_than_its_ramps_let_it():
    """A turn of less than ω²/a has no cruise, and its fastest rate is sqrt(a angle)."""
    robot = DifferentialDrive(radius=0.05)
    angles = np.linspace(0.01, 0.7, 400)
    turns = [Trajectory.from_poses(robot, [(1, 1, 0), (1, 1, angle)]) for angle in angles]
    room = World.from_polygons([], extent=shapely.box(0, 0, 2, 2))
    fastest = [trajectory_cost(PeakOpticFlow(), turn, room) for turn in turns]
    assert fastest == pytest.approx(np.sqrt(robot.laws["turn"].turn_acceleration * angles), rel=1e-6)


def brute_force(robot, path, samples):
    """Mean over bearings integrated over time, and the largest, by shapely rays at the planned states and rates."""
    times = (np.arange(samples) + 0.5) * path.duration / samples
    states, (rates, _) = path.at(times), path.rates(times)
    camera = robot.pose("camera", states)
    ahead, left = robot.camera_offset
    velocity_x = rates.x - rates.yaw * (ahead * np.sin(states.yaw) + left * np.cos(states.yaw))
    velocity_y = rates.y + rates.yaw * (ahead * np.cos(states.yaw) - left * np.sin(states.yaw))
    flows = []
    for x, y, vx, vy, w in zip(camera.x, camera.y, velocity_x, velocity_y, rates.yaw, strict=True):
        for angle in 2 * np.pi * np.arange(16) / 16:
            ray = shapely.LineString([(x, y), (x + 20 * math.cos(angle), y + 20 * math.sin(angle))])
            distance = shapely.Point(x, y).distance(shapely.intersection(ray, HALL))
            beta = angle - math.atan2(vy, vx)
            flows.append(abs(math.hypot(vx, vy) * math.sin(beta) / max(distance, 0.3) - w))
    return np.mean(flows) * path.duration, np.max(flows)


@pytest.mark.parametrize("offset", [pytest.param((0.0, 0.0), marks=pytest.mark.proof), (0.25, -0.1)])
def test_a_path_through_a_hall_agrees_with_rays_cast_along_it(offset):
    robot = DifferentialDrive(camera_offset=offset)
    path = Trajectory.from_poses(robot, [(1, 1, 0.3), (6, 2.7, 0.3), (8, 7, 2.0)])
    total, peak = brute_force(robot, path, 600)
    assert trajectory_cost(OpticFlow(), path, ROOM) == pytest.approx(total, rel=0.01)
    assert trajectory_cost(PeakOpticFlow(), path, ROOM) == pytest.approx(peak, rel=0.02)


def test_between_two_bearings_the_peak_beside_a_wall_is_missed_by_less_than_four_percent():
    tilt = math.radians(11.25)
    wall = shapely.affinity.rotate(shapely.box(-90, 1, 90, 2), math.degrees(tilt), origin=(0, 0))
    world = World.from_polygons([wall], extent=shapely.box(-5, -5, 5, 5))
    path = Trajectory.from_poses(DifferentialDrive(), [(0, 0, tilt), (3 * math.cos(tilt), 3 * math.sin(tilt), tilt)])
    found = [trajectory_cost(PeakOpticFlow(bearings=count), path, world) for count in (16, 64)]
    assert 0.96 < found[0] < found[1] <= 1.0 + 1e-9


def test_a_narrow_camera_sees_the_walls_of_a_corridor_flow_where_it_looks():
    """Along the corridor |sin b|² / w streams at the bearing b: little ahead, most to the side."""
    for view, within in ((0.0, 0.4), (np.pi / 2, np.pi / 2)):
        model = ViewModel(DifferentialDrive(field_of_view=(0.8, 0.6)), "unwound", view)
        path = Trajectory.from_poses(model, [(-3, 0, 0), (4, 0, 0)])
        angles = view + np.linspace(-0.4, 0.4, 1001)
        criterion = OpticFlow(bearings=180)
        assert trajectory_cost(criterion, path, CORRIDOR) == pytest.approx(7 * np.mean(np.sin(angles) ** 2), rel=5e-3)
        peak = trajectory_cost(PeakOpticFlow(bearings=180), path, CORRIDOR)
        assert peak == pytest.approx(math.sin(within) ** 2, rel=0.1)  # by a step


def test_a_turn_flows_alike_in_every_view():
    path = Trajectory.from_poses(DifferentialDrive(field_of_view=(1.0, 1.0)), [(0, 0, 0), (0, 0, -2.0)])
    assert trajectory_cost(OpticFlow(), path, CORRIDOR) == pytest.approx(2.0)


@pytest.mark.parametrize("kind", [OpticFlow, PeakOpticFlow])
def test_parameters_are_checked_for_optic_flow(kind):
    for nearest in (0.0, -1.0, 20.0, math.nan):
        with pytest.raises(CriterionError, match="nearest must be a distance"):
            kind(nearest=nearest)
    for bearings in (3, 16.0, 1000):
        with pytest.raises(CriterionError, match="bearings must be a number"):
            kind(bearings=bearings)


def test_one_adds_up_and_the_other_is_the_worst_moment():
    assert (OpticFlow.group, OpticFlow.unit, OpticFlow.aggregate) == ("C", "rad", "sum")
    assert (PeakOpticFlow.group, PeakOpticFlow.unit, PeakOpticFlow.aggregate) == ("C", "rad/s", "max")


KERB, TABLE, SIGN, LAMP = (
    shapely.box(2, 2, 8, 3),
    shapely.box(2, 7, 4, 8),
    shapely.box(7, 6, 8, 8),
    shapely.box(4, 4, 6, 5),
)
OBJECTS = [(KERB, (0.0, 0.2)), (TABLE, (0.0, 0.8)), (SIGN, (1.0, 1.6)), (LAMP, (2.0, 2.4))]
WORLD = World.from_polygons(OBJECTS, extent=shapely.box(0, 0, 10, 10))
EYE_LEVEL = shapely.union_all([TABLE, SIGN])  # 1.2 m ± 0.5 m
inside = st.floats(0.1, 9.9)


@given(inside, inside, inside, inside, st.floats(0.1, 4.0))
def test_a_move_costs_the_shortfall_where_the_camera_is_nearest_to_something_at_eye_level(x0, y0, x1, y1, enough):
    robot = DifferentialDrive(camera_offset=(0.2, 0.1))
    yaw = math.atan2(y1 - y0, x1 - x0)
    start, end = (States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw])) for x, y in ((x0, y0), (x1, y1)))
    motions = Motions(WORLD, robot, robot.laws["move"], start, end)
    dx, dy = 0.2 * math.cos(yaw) - 0.1 * math.sin(yaw), 0.2 * math.sin(yaw) + 0.1 * math.cos(yaw)
    line = shapely.LineString([(x0 + dx, y0 + dy), (x1 + dx, y1 + dy)])
    expected = max(enough - line.distance(EYE_LEVEL), 0.0) if line.length > 0 else 0.0
    found = motion_costs(PassingDistance(enough), motions)[0]
    assert expected - WORLD.cell / 4 - 1e-9 <= found <= expected + 1e-9


def test_the_band_says_which_heights_are_eye_level():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1.8, 0), (9, 1.8, 0)])  # 0.2 m past the kerb
    costs = [trajectory_cost(PassingDistance(1.0, band), path, WORLD) for band in (0.5, 1.1)]
    assert costs == pytest.approx([0.0, 0.8], abs=WORLD.cell / 4)


def test_turning_close_to_a_wall_is_no_passing_unless_the_camera_moves():
    turn = [(6.8, 7, 0), (6.8, 7, 2)]
    on_axis, off_axis = (DifferentialDrive(camera_offset=offset) for offset in ((0, 0), (-0.1, 0)))
    assert trajectory_cost(PassingDistance(), Trajectory.from_poses(on_axis, turn), WORLD) == 0.0
    # The camera starts 0.3 m from the sign and ends at 0.2 m minus 0.1 m cos 2, nearest of all.
    expected = 1.0 - (0.2 - 0.1 * math.cos(math.pi - 2))
    found = trajectory_cost(PassingDistance(), Trajectory.from_poses(off_axis, turn), WORLD)
    assert found == pytest.approx(expected, abs=1e-9)


def test_unlike_clearance_it_sees_no_zones_nor_borders_nor_what_lies_below_and_above():
    world = World.from_polygons(
        [(LAMP, (2.0, 2.4)), (KERB, (0.0, 0.2))],
        extent=shapely.box(0, 0, 10, 10),
        keep_out=shapely.box(0, 7, 10, 8),
    )
    path = Trajectory.from_poses(DifferentialDrive(), [(0.1, 6.5, 0), (9, 6.5, 0)])
    assert trajectory_cost(PassingDistance(), path, world) == 0.0
    assert trajectory_cost(Clearance(), path, world) > 0.5


def test_walls_beyond_the_extent_of_a_map_are_passed():
    world = World.from_cells(np.zeros((40, 40), dtype=bool), 0.1)
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 0.4, 0), (3, 0.4, 0)])
    assert trajectory_cost(PassingDistance(), path, world) == pytest.approx(0.6)


@pytest.mark.parametrize(("enough", "band"), [(0, 0.5), (5.1, 0.5), (math.nan, 0.5), (1, -0.1), (1, math.inf)])
def test_parameters_are_checked_for_passing_distance(enough, band):
    with pytest.raises(CriterionError, match="must be a"):
        PassingDistance(enough, band)


def test_its_group_unit_and_aggregate():
    kind = PassingDistance
    assert (kind.group, kind.unit, kind.aggregate) == ("C", "m", "max")


@pytest.mark.parametrize("contrast", [0.0, 0.4, 1.0])
def test_a_surface_of_low_contrast_flows_less_in_proportion(contrast):
    """One wall has contrast c, the other 1, both at the distance w: half of the flow is weighted by c."""
    walls = [Obstacle(shapely.box(-20, 1, 20, 2), contrast=contrast), shapely.box(-20, -2, 20, -1)]
    world = World.from_polygons(walls, extent=shapely.box(-20, -2, 20, 2))
    path = Trajectory.from_poses(DifferentialDrive(), [(-2, 0, 0), (2, 0, 0)])
    flow = OpticFlow(bearings=36)
    assert trajectory_cost(flow, path, world) == pytest.approx(4.0 * 0.5 * (1 + contrast) / 2, rel=0.02)
    turn = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (0, 0, 1.0)])
    assert trajectory_cost(flow, turn, world) == pytest.approx((1 + contrast) / 2, rel=0.06)


def test_walls_of_an_image_flow_by_the_contrast_of_their_colours(tmp_path):
    """A corridor with a black wall and a grey one costs the same in pixels and as polygons of these contrasts."""
    pixels = np.full((90, 400), 255, dtype=np.uint8)
    pixels[:20], pixels[70:] = 160, 0  # the upper wall is grey; the corridor is 5 m wide
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    grey = ((160 / 255 + 0.055) / 1.055) ** 2.4
    walls = [
        shapely.box(-20, -4.5, 20, -2.5),
        Obstacle(shapely.box(-20, 2.5, 20, 4.5), contrast=(1 - grey) / (1 + grey)),
    ]
    drawn = World.from_polygons(walls, extent=shapely.box(-20, -4.5, 20, 4.5))
    options = {"threshold": 0.8, "origin": (-20, -4.5, 0)}
    coloured = World.from_image(tmp_path / "plan.png", 0.1, contrast=True, **options)
    plain = World.from_image(tmp_path / "plan.png", 0.1, **options)
    path = Trajectory.from_poses(DifferentialDrive(), [(-2, 0, 0), (2, 0.5, 0)])
    drawn_cost, cost, more = (trajectory_cost(OpticFlow(bearings=36), path, one) for one in (drawn, coloured, plain))
    assert cost == pytest.approx(drawn_cost, rel=0.02)
    assert cost < 0.8 * more


def test_full_contrast_changes_no_bit_and_a_map_keeps_its_contrasts(tmp_path):
    boxes = [shapely.box(1, 1, 2, 3), shapely.box(4, 0, 4.5, 2)]
    plain, full, faint = (
        World.from_polygons([Obstacle(box, contrast=c) for box in boxes], extent=shapely.box(0, 0, 6, 4))
        for c in (1.0, 1, 0.3)
    )
    path = Trajectory.from_poses(DifferentialDrive(), [(0.5, 0.5, 0), (3, 3.3, 1), (5.5, 3, 0)])
    costs = [
        trajectory_cost(OpticFlow(), path, world)
        for world in (World.from_polygons(boxes, extent=plain.extent), plain, full)
    ]
    assert costs[0] == costs[1] == costs[2]
    assert trajectory_cost(OpticFlow(), path, faint) < 0.8 * costs[0]
    again = World.from_description(faint.describe())
    assert [obstacle.contrast for obstacle in again.obstacles] == [0.3, 0.3]
    feature = {"type": "Feature", "geometry": shapely.geometry.mapping(boxes[0])}
    for value in (0.3, 2):
        document = {"type": "FeatureCollection", "features": [{**feature, "properties": {"contrast": value}}]}
        (tmp_path / "map.geojson").write_text(json.dumps(document))
        if value == 0.3:
            assert World.from_geojson(tmp_path / "map.geojson").obstacles[0].contrast == 0.3
        else:
            with pytest.raises(MapError, match="the contrast of an obstacle must be a number"):
                World.from_geojson(tmp_path / "map.geojson")
