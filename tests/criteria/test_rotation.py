"""Rotation of the camera: angle, time, turns, winding, roll and angular acceleration."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import hpop
from hpop.criteria import (
    AngularAcceleration,
    CameraRoll,
    LongestTurn,
    NetWinding,
    OrientationRetention,
    Rotation,
    RotationTime,
    Turns,
    UnforeseenTurns,
    motion_costs,
    trajectory_cost,
)
from hpop.criteria.costs import running_costs, trajectory_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive, ViewModel
from hpop.models.driven import driven
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from tests.jointed import Jointed, agrees_everywhere, moments, tour

OPEN = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
WORLD_ROTATION = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT_ROTATION = DifferentialDrive()


@given(st.lists(st.floats(0.01, 3.1).flatmap(lambda a: st.sampled_from([a, -a])), max_size=6))
def test_rotation_adds_the_absolute_angles(angles):
    yaw = np.cumsum([0.5, *angles])
    trajectory = Trajectory.from_poses(ROBOT_ROTATION, [(0, 0, a) for a in yaw])
    assert trajectory_cost(Rotation(), trajectory, WORLD_ROTATION) == pytest.approx(np.abs(angles).sum(), abs=1e-9)


def test_a_polygon_walked_round_turns_once_in_all_and_a_straight_line_never():
    square = [(0, 0, 0), (1, 0, np.pi / 2), (1, 1, np.pi), (0, 1, -np.pi / 2), (0, 0, 0)]
    assert trajectory_cost(Rotation(), Trajectory.from_poses(ROBOT_ROTATION, square), WORLD_ROTATION) == pytest.approx(
        2 * np.pi
    )
    assert (
        trajectory_cost(Rotation(), Trajectory.from_poses(ROBOT_ROTATION, [(0, 0, 1), (2, 0, 1)]), WORLD_ROTATION) > 1.9
    )
    assert (
        trajectory_cost(Rotation(), Trajectory.from_poses(ROBOT_ROTATION, [(0, 0, 0), (9, 0, 0)]), WORLD_ROTATION)
        == 0.0
    )


def test_a_spin_rotates_as_much_as_the_turn_that_planned_it():
    planned = Trajectory.from_poses(ROBOT_ROTATION, [(0, 0, 0), (0, 0, -2.5)])
    assert trajectory_cost(Rotation(), planned.execution(), WORLD_ROTATION) == pytest.approx(2.5)


def test_rotation_is_a_comfort_criterion_in_radians_and_needs_a_camera():
    assert (Rotation.group, Rotation.unit, Rotation.aggregate, Rotation.requires) == ("C", "rad", "sum", ("camera",))


WORLD_ROTATION_TIME = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
ROBOT_ROTATION_TIME = DifferentialDrive(turn_rate=1.5, turn_acceleration=3.0)


@pytest.mark.parametrize("angle", [np.pi, -np.pi / 2, 0.75])
def test_a_turn_that_reaches_its_rate_takes_its_angle_over_the_rate_and_one_ramp(angle):
    path = Trajectory.from_poses(ROBOT_ROTATION_TIME, [(1, 1, 0), (1, 1, angle)])
    assert trajectory_cost(RotationTime(), path, WORLD_ROTATION_TIME) == pytest.approx(abs(angle) / 1.5 + 1.5 / 3.0)


def test_a_short_turn_only_speeds_up_and_slows_down():
    path = Trajectory.from_poses(ROBOT_ROTATION_TIME, [(1, 1, 0), (1, 1, 0.3)])
    assert trajectory_cost(RotationTime(), path, WORLD_ROTATION_TIME) == pytest.approx(2 * np.sqrt(0.3 / 3.0))


def test_with_fast_ramps_it_is_the_total_rotation_over_the_turn_rate():
    robot = DifferentialDrive(turn_rate=0.5, turn_acceleration=1e6)
    path = Trajectory.from_poses(robot, [(1, 1, 0), (1, 3, np.pi), (5, 3, 0)])
    assert trajectory_cost(RotationTime(), path, WORLD_ROTATION_TIME) == pytest.approx(
        (np.pi / 2 + np.pi / 2 + np.pi) / 0.5, rel=1e-5
    )


def test_only_the_time_with_a_yaw_rate_counts_not_standing_before_and_after():
    path = Trajectory.from_poses(ROBOT_ROTATION_TIME, [(1, 1, 0), (4, 1, 0), (4, 5, 2.0), (8, 8, 2.0)])
    times = np.linspace(0, path.duration, 200_001)
    turning = np.abs(path.rates(times)[0].yaw) > 1e-9
    assert trajectory_cost(RotationTime(), path, WORLD_ROTATION_TIME) == pytest.approx(
        turning.mean() * path.duration, abs=1e-3
    )
    assert (
        trajectory_cost(RotationTime(), path, WORLD_ROTATION_TIME)
        < path.durations[np.array(path.kinds) == "turn"].sum()
    )


def test_moves_are_free_and_arcs_turn_all_the_time(arcs):
    assert (
        trajectory_cost(
            RotationTime(), Trajectory.from_poses(ROBOT_ROTATION_TIME, [(1, 1, 0), (9, 1, 0)]), WORLD_ROTATION_TIME
        )
        == 0.0
    )
    curve = arcs([2.0], [0.5])
    assert trajectory_cost(RotationTime(), curve, WORLD_ROTATION_TIME) == pytest.approx(curve.duration)


def test_its_group_unit_and_aggregate_for_rotation_time():
    assert (RotationTime.group, RotationTime.unit, RotationTime.aggregate) == ("C", "s", "sum")


WORLD_TURNS = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT_TURNS = DifferentialDrive()


@pytest.mark.parametrize(
    ("poses", "count"),
    [
        ([(0, 0, 0)], 0),
        ([(0, 0, 0), (5, 0, 0)], 0),
        ([(0, 0, 1), (5, 0, 0)], 1),  # at the start
        ([(0, 0, 0), (5, 0, 1)], 1),  # at the goal
        ([(0, 0, 0), (5, 0, 0), (5, 5, np.pi / 2)], 1),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], 0),
        ([(0, 0, np.pi), (5, 0, 0), (5, 5, 0)], 3),
        ([(0, 0, 0), (0, 0, 1), (0, 0, 2)], 2),
    ],
)
def test_turns_in_place_are_counted_at_start_goal_and_between(poses, count):
    trajectory = Trajectory.from_poses(ROBOT_TURNS, poses)
    assert trajectory_cost(Turns(), trajectory, WORLD_TURNS) == count
    assert trajectory_cost(Turns(), trajectory.execution(), WORLD_TURNS) == count


@pytest.mark.parametrize("kind", ["turn", "spin"])
def test_a_turn_counts_once_it_exceeds_one_degree_either_way(kind):
    degrees = np.array([0.5, 0.999, 1.001, 179.0, -0.999, -1.001, -90.0])
    nothing = 0.0 * degrees
    start, end = States(x=nothing, y=nothing, yaw=nothing), States(x=nothing, y=nothing, yaw=np.radians(degrees))
    costs = motion_costs(Turns(), Motions(WORLD_TURNS, ROBOT_TURNS, ROBOT_TURNS.laws[kind], start, end))
    assert costs.tolist() == [0, 0, 1, 1, 0, 1, 1]


def test_turns_are_whole_numbers_and_have_no_gradient():
    assert (Turns.group, Turns.unit, Turns.quantum, Turns.smooth) == ("C", "1", 1.0, False)


# Along curves: maximal stretches in which the heading changes with one sign

START, STOP = (1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)


def bend(degrees):
    """Two intervals that turn by an angle, from no turn rate to none."""
    lasts = 1.0
    rate = np.radians(degrees) / lasts
    return [(0.0, rate / lasts, lasts), (0.0, -rate / lasts, lasts)]


CURVES = {
    "straight": ([START, (0, 0, 2), STOP], 0),
    "one bend": ([START, *bend(60), STOP], 1),
    "an S": ([START, *bend(60), *bend(-60), STOP], 2),
    "an S whose yaw rate changes its sign within an interval": (
        [START, (0, 1, 1), (0, -2, 1), (0, 1, 1), STOP],  # rates 0, 1, -1, 0
        2,
    ),
    "a slalom": ([START, *bend(40), *bend(-80), *bend(80), *bend(-40), STOP], 4),
    "a spiral": ([START, *[(0, 0.2, 1)] * 4, *[(0, -0.2, 1)] * 4, STOP], 1),
    "two bends of one sign, straight between": ([START, *bend(45), (0, 0, 1), *bend(45), STOP], 2),
    "two bends of one sign, without straight between": ([START, *bend(45), *bend(45), STOP], 1),
    "a bend of 0.9 degrees": ([START, *bend(0.9), STOP], 0),
    "a bend of 1.1 degrees": ([START, *bend(1.1), STOP], 1),
    "0.6 and 0.6 degrees of one sign": ([START, *bend(0.6), *bend(0.6), STOP], 1),
    "0.6 and 0.6 degrees, straight between": ([START, *bend(0.6), (0, 0, 1), *bend(0.6), STOP], 0),
    "on the spot": ([*bend(90), START, STOP, *bend(-90)], 2),
    "round a whole circle": ([START, *bend(400), STOP], 1),
}


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("pieces", [1, 2, 3, 64])
def test_stretches_of_one_sign_are_counted_wherever_a_curve_is_cut(name, pieces):
    controls, count = CURVES[name]
    trajectory = driven(ROBOT_TURNS, (0, 0, 0.5), controls)
    cut = trajectory.cut(np.full(len(controls), pieces))
    assert trajectory_cost(Turns(), cut, WORLD_TURNS) == count
    uneven = trajectory.cut(np.arange(1, len(controls) + 1))
    assert trajectory_cost(Turns(), uneven, WORLD_TURNS) == count
    assert trajectory_cost(Turns(), trajectory.execution(), WORLD_TURNS) == count


def test_stretches_do_not_go_on_from_one_trajectory_to_the_next():
    one = driven(ROBOT_TURNS, (0, 0, 0), [(1, 0.5, 1), (0, -0.5, 0.5)])  # still turning at its end
    other = driven(ROBOT_TURNS, (0, 0, 0), [(1, 0.5, 1), (0, -0.5, 1)])
    assert trajectory_costs([Turns()], [one, other, one], WORLD_TURNS).ravel().tolist() == [1, 1, 1]


def test_a_turn_in_place_is_one_turn_and_the_curve_after_it_another():
    curve = driven(ROBOT_TURNS, (0, 0, 1.0), [START, *bend(50), STOP]).states
    columns = {name: np.concatenate([[getattr(curve, name)[0]], getattr(curve, name)]) for name in curve.names}
    columns["yaw"][0] = 0.0
    trajectory = Trajectory(ROBOT_TURNS, States(**columns), ("turn", *["drive"] * 4))
    assert trajectory_cost(Turns(), trajectory, WORLD_TURNS) == 2


def test_a_polyline_counts_as_before_beside_a_curve():
    polyline = Trajectory.from_poses(ROBOT_TURNS, [(0, 0, 1), (5, 0, 0), (5, 5, 2)])
    curve = driven(ROBOT_TURNS, (0, 0, 0.5), CURVES["a slalom"][0])
    assert trajectory_costs([Turns()], [polyline, curve], WORLD_TURNS).ravel().tolist() == [3, 4]


def test_the_viewer_remembers_the_turns_of_a_curve_as_wholes():
    """A right angle along a curve is easy to remember, however it is cut; two of 45 degrees are not."""
    keeps = OrientationRetention()
    for pieces in (1, 5):
        whole = driven(ROBOT_TURNS, (0, 0, 0), [START, *bend(90), STOP]).cut(np.full(4, pieces))
        halves = driven(ROBOT_TURNS, (0, 0, 0), [START, *bend(45), (0, 0, 1), *bend(45), STOP]).cut(np.full(7, pieces))
        assert trajectory_cost(keeps, whole, WORLD_TURNS) == pytest.approx(0.0, abs=1e-9)
        assert trajectory_cost(keeps, halves, WORLD_TURNS) == pytest.approx(np.pi / 2)


WORLD_NET_WINDING = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
SQUARE = [(1, 1, 0), (5, 1, np.pi / 2), (5, 5, np.pi), (1, 5, -np.pi / 2), (1, 1, 0)]


def test_round_a_block_is_a_whole_turn_though_the_heading_is_as_before():
    path = Trajectory.from_poses(DifferentialDrive(), SQUARE)
    assert trajectory_cost(NetWinding(), path, WORLD_NET_WINDING) == pytest.approx(2 * np.pi)


def test_there_and_back_the_other_way_is_unwound():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (1, 1, 2), (1, 1, -1), (1, 1, 0)])
    assert trajectory_cost(Rotation(), path, WORLD_NET_WINDING) == pytest.approx(6)
    assert trajectory_cost(NetWinding(), path, WORLD_NET_WINDING) == pytest.approx(0, abs=1e-12)


def test_the_running_value_is_how_far_the_user_is_twisted_so_far():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (1, 1, -2), (1, 1, 1)])
    assert running_costs(NetWinding(), path, WORLD_NET_WINDING) == pytest.approx([2, 1])


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=8))
def test_it_is_the_unwrapped_change_of_heading(turns):
    yaw = np.concatenate([[0.4], 0.4 + np.cumsum(turns)])
    path = Trajectory(DifferentialDrive(), States(x=0 * yaw, y=0 * yaw, yaw=yaw), ("turn",) * len(turns))
    assert trajectory_cost(NetWinding(), path, WORLD_NET_WINDING) == pytest.approx(abs(yaw[-1] - yaw[0]), abs=1e-9)


def test_its_group_unit_and_aggregate_for_net_winding():
    assert (NetWinding.group, NetWinding.unit, NetWinding.aggregate) == ("C", "rad", "trajectory")


WORLD_CAMERA_ROLL = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


@pytest.mark.parametrize(("lift", "twist"), [(0.0, 0.5), (0.7, 0.5), (0.7, -2.0), (0.0, math.pi)])
def test_a_posture_costs_its_roll_times_the_cosine_of_its_pitch(lift, twist):
    swing = tour(Jointed(), [(0.0, lift, twist), (1.0, lift, twist)])
    expected = abs(twist) * math.cos(lift) * swing.duration
    assert trajectory_cost(CameraRoll(), swing, WORLD_CAMERA_ROLL) == pytest.approx(expected, rel=1e-9)


@pytest.mark.proof
def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled():
    trajectory = tour(Jointed())
    _, step, _, (_, left, up) = moments(trajectory, 4_000)
    expected = np.sum(np.hypot(left[2], up[2]) * np.abs(np.arctan2(left[2], up[2]))) * step
    assert agrees_everywhere(CameraRoll(), Jointed(), WORLD_CAMERA_ROLL) == pytest.approx(expected, rel=1e-3)


def test_bases_and_heads_keep_the_horizon_level():
    walk = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (2, 0, 0), (2, 0, 1.2)])
    assert trajectory_cost(CameraRoll(), walk, WORLD_CAMERA_ROLL) == 0.0


def test_what_it_declares():
    assert (CameraRoll.group, CameraRoll.unit, CameraRoll.aggregate) == ("C", "rad s", "sum")


WORLD_ANGULAR_ACCELERATION = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
ROBOT_ANGULAR_ACCELERATION = DifferentialDrive(turn_rate=1.5, turn_acceleration=3.0)


def turn(angle, robot=ROBOT_ANGULAR_ACCELERATION):
    return Trajectory.from_poses(robot, [(1, 1, 0), (1, 1, angle)])


@pytest.mark.parametrize("angle", [1.0, -2.0, 3.0])
def test_a_turn_that_reaches_its_rate_costs_two_ramps_above_the_threshold(angle):
    cost = trajectory_cost(AngularAcceleration(threshold=0.6), turn(angle), WORLD_ANGULAR_ACCELERATION)
    assert cost == pytest.approx(2 * 1.5 * (1 - 0.6 / 3.0))


def test_a_short_turn_accelerates_all_the_time():
    cost = trajectory_cost(AngularAcceleration(threshold=1.0), turn(0.3), WORLD_ANGULAR_ACCELERATION)
    assert cost == pytest.approx((3.0 - 1.0) * 2 * math.sqrt(0.3 / 3.0))


def test_accelerations_below_the_threshold_are_not_felt():
    assert trajectory_cost(AngularAcceleration(threshold=3.0), turn(2.0), WORLD_ANGULAR_ACCELERATION) == 0.0


def test_the_default_threshold_is_one_degree_a_second_squared():
    gentle = DifferentialDrive(turn_rate=0.05, turn_acceleration=math.radians(0.99))
    assert trajectory_cost(AngularAcceleration(), turn(1.0, gentle), WORLD_ANGULAR_ACCELERATION) == 0.0
    assert AngularAcceleration().threshold == pytest.approx(math.radians(1))


def test_a_path_agrees_with_its_sampled_accelerations():
    path = Trajectory.from_poses(ROBOT_ANGULAR_ACCELERATION, [(1, 1, 0), (4, 1, 0), (4, 5, 2.0), (8, 8, 2.2)])
    times = np.linspace(0, path.duration, 400_001)
    excess = np.maximum(np.abs(path.rates(times)[1].yaw) - 0.7, 0)
    expected = excess.mean() * path.duration
    assert trajectory_cost(AngularAcceleration(0.7), path, WORLD_ANGULAR_ACCELERATION) == pytest.approx(
        expected, rel=1e-3
    )


@pytest.mark.parametrize("threshold", [-0.1, math.inf, math.nan])
def test_a_threshold_is_an_acceleration(threshold):
    with pytest.raises(CriterionError, match="threshold must be"):
        AngularAcceleration(threshold)


def test_its_group_unit_and_aggregate_for_angular_acceleration():
    kind = AngularAcceleration
    assert (kind.group, kind.unit, kind.aggregate) == ("C", "rad/s", "sum")


def test_the_longest_turn_is_its_angle_however_many_there_are() -> None:
    robot = DifferentialDrive()
    path = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, 0.5), (2, 1.1, -1.0), (2, 1.1, 0.2)])
    found = trajectory_cost(LongestTurn(), path, OPEN)
    assert found == pytest.approx(1.0 + math.atan2(1.1, 2))  # from the way's heading to -1
    bend = driven(robot, (0, 0, 0), [(1, 0, 1), (0, 2, 0.5), (0, -2, 1), (0, 2, 0.5), (-1, 0, 1)])
    left = 0.5 * 2 * 0.5**2 * 2  # speeds up to 1 rad/s in half a second, and down again
    assert trajectory_cost(LongestTurn(), bend, OPEN) == pytest.approx(left)
    parts = bend.cut(np.full(5, 3))
    assert trajectory_cost(LongestTurn(), parts, OPEN) == pytest.approx(left, abs=1e-6)


def corner(*walls, **robot):
    """Return a world with walls, and a drive 6 m east, a turn to the left, and 4 m north."""
    world = World.from_polygons([*walls], extent=shapely.box(-3, -4, 14, 8))
    return world, Trajectory.from_poses(DifferentialDrive(**robot), [(0, 0, 0), (6, 0, 0), (6, 4, np.pi / 2)])


def test_a_turn_into_a_corridor_that_a_wall_hides_is_unforeseen() -> None:
    count = UnforeseenTurns()
    assert trajectory_cost(count, *corner()[::-1]) == 0  # all is open
    inner = shapely.box(-3, 0.6, 5.8, 8)  # (6, 2) is seen from x > 5.71 on, which takes 0.76 s of braking
    assert trajectory_cost(count, *corner(inner)[::-1]) == 1
    assert trajectory_cost(UnforeseenTurns(notice=0.2), *corner(inner)[::-1]) == 0


def test_a_narrow_view_does_not_foresee_what_lies_aside() -> None:
    count = UnforeseenTurns()
    wide, narrow = (corner(field_of_view=(angle, 1.5)) for angle in (2.0, 0.3))
    assert trajectory_cost(count, *wide[::-1]) == 0  # (6, 2) lies 18 degrees aside from the start, and 45 at (4, 0)
    assert trajectory_cost(count, *narrow[::-1]) == 1


def test_the_last_turn_leads_nowhere_and_one_at_the_start_was_never_foreseen() -> None:
    robot, count = DifferentialDrive(), UnforeseenTurns()
    last = Trajectory.from_poses(robot, [(0, 0, 0), (4, 0, 0), (4, 0, 2.0)])
    first = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, 1.0), (2, 2 * math.tan(1.0), 1.0)])
    assert [trajectory_cost(count, path, OPEN) for path in (last, first)] == [0, 1]
    unwound = Trajectory(ViewModel(robot), first.states, first.kinds)
    assert trajectory_cost(count, unwound, OPEN) == 0  # the view does not turn
