"""Costs of standing still: time times the rate at that pose, and the effect of people who pass meanwhile."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import criteria
from hpop.criteria import make_criterion, motion_costs
from hpop.criteria.costs import running_costs, trajectory_cost
from hpop.models.driven import driven
from hpop.motions import HOLD, Motions, States
from hpop.motions.symbolic import SymbolicMotions
from hpop.testing import random_world
from hpop.world.content.content import Landmark, Person
from tests.own_criteria import own_criterion

CAR = hpop.DifferentialDrive(camera_offset=(0.1, 0.05), seat=(0.1, -0.05, 0.6))
HEAD = hpop.PanTilt()
WORLD = random_world(np.random.default_rng(3))
NAMES = sorted(name for name, cls in criteria.items() if cls.__module__.startswith("hpop."))
ADDED = [name for name in NAMES if criteria[name].aggregate in ("sum", "time-mean")]
WORST = [name for name in NAMES if criteria[name].aggregate == "max"]
REMEMBERED = [name for name in NAMES if criteria[name].aggregate == "trajectory"]
FREE = {  # nothing is to pay for standing level: they are paid for by the metre, the radian or the turn
    "against_flow", "angular_acceleration", "bending_energy", "camera_length", "camera_roll", "cutting_between",
    "heading_mismatch", "joint_energy", "joint_length", "length", "mean_heading_mismatch", "optic_flow",
    "orientation_retention", "proximity", "rotation", "rotation_time", "speeding", "turns",
    "expected_contacts",  # nobody is touched there
    "felt_acceleration", "speed_changes", "squared_acceleration", "stale_view", "longest_turn",
}  # fmt: skip


def hold(seconds, *, world=WORLD, t0=None, panels=None, x=(1.5, 6.0, 9.5), y=(1.0, 4.4, 7.0)):
    """Return holds of a robot at three positions, at the same time."""
    x, y = (np.array(column, float) for column in (x, y))
    model = HEAD if panels == "head" else CAR
    where = {"x": x, "y": y, "yaw": np.array([0.3, -2.0, 3.0])[: x.size]}
    if model is HEAD:
        where |= {"pan": np.full(x.size, 0.5), "tilt": np.full(x.size, -0.2)}
    start, end = (States(**where, clock=np.full(x.size, clock)) for clock in (7.0, 7.0 + seconds))
    time = None if t0 is None else np.full(x.size, t0)
    return Motions(world, model, HOLD, start, end, t0=time, panels=panels if isinstance(panels, int) else None)


def asked(name):
    return "head" if "joints" in criteria[name].requires else None


@pytest.mark.parametrize("name", ADDED)
def test_standing_costs_its_time_times_the_rate_of_that_pose(name):
    criterion, robot = own_criterion(name), asked(name)
    one, several = (motion_costs(criterion, hold(seconds, panels=robot)) for seconds in (1.0, 7.25))
    np.testing.assert_allclose(several, 7.25 * one, rtol=1e-12)
    costs_nothing = bool((several == 0).all())
    assert costs_nothing == (name in FREE), (
        f"{name!r} costs {'nothing' if costs_nothing else f'up to {several.max():.3g} in 7.25 s'} of a robot that "
        f"holds: is that meant? Then {'name it in' if costs_nothing else 'take it out of'} FREE of {__file__}"
    )


def test_standing_lasts_as_long_as_it_does():
    assert motion_costs(make_criterion("duration"), hold(7.25)).tolist() == [7.25] * 3


def test_a_rate_is_that_of_the_field():
    exposed = motion_costs(make_criterion("exposure"), hold(4.0))
    motions = hold(4.0)
    np.testing.assert_allclose(exposed, 4.0 * WORLD.obstruction(CAR.pose("camera", motions.start), 2.0))
    assert exposed.max() > 0


@pytest.mark.parametrize("name", WORST)
def test_a_worst_moment_does_not_depend_on_how_long_one_stands(name):
    criterion = own_criterion(name)
    short, long = (motion_costs(criterion, hold(seconds)) for seconds in (0.1, 40.0))
    np.testing.assert_array_equal(short, long)


def test_the_worst_moment_of_standing_near_a_wall_is_how_near_it_is():
    motions = hold(3.0)
    distance = WORLD.clearance(motions.start.x, motions.start.y)
    np.testing.assert_allclose(motion_costs(make_criterion("clearance"), motions), np.maximum(0.0, 1.0 - distance))


# People who walk past


ROOM = hpop.World.from_polygons([], extent=shapely.box(0, 0, 12, 9))
WALKING = [Person(2.0, 4.0, velocity=(1.2, 0.1)), Person(9.0, 8.0, yaw=-1.6, velocity=(-0.4, -1.1))]
PASSED = ROOM.with_content(people=WALKING)
HERE = {"x": (6.0,), "y": (5.0,)}


@pytest.mark.parametrize("name", ["hall_zones", "visibility_to_people"])
def test_standing_while_people_pass_costs_the_integral_over_time(name):
    """By the midpoint rule over people who stand where they are predicted at 400 moments."""
    criterion, (begin, seconds), count = own_criterion(name), (1.0, 8.0), 400
    total = 0.0
    for t in begin + (np.arange(count) + 0.5) * (seconds / count):
        frozen = [replace(p.later(float(t)), velocity=(0.0, 0.0), yaw=math.atan2(*p.velocity[::-1])) for p in WALKING]
        stands = hold(1.0, world=ROOM.with_content(people=frozen), **HERE)
        total += motion_costs(criterion, stands)[0] * seconds / count
    found = motion_costs(criterion, hold(seconds, world=PASSED, t0=begin, **HERE))
    assert total > 0.1
    np.testing.assert_allclose(found, total, rtol=2e-3)


@pytest.mark.parametrize("name", ["social_force", "o_space", "hall_zones", "personal_space", "visibility_to_people"])
def test_a_long_hold_costs_as_much_as_many_short_ones(name):
    criterion = own_criterion(name)
    world = ROOM.with_content(people=WALKING, groups=[(0, 1)])
    whole = motion_costs(criterion, hold(9.0, world=world, t0=0.0, **HERE))
    short = [motion_costs(criterion, hold(0.05, world=world, t0=0.05 * i, panels=1, **HERE)) for i in range(180)]
    np.testing.assert_allclose(whole, np.sum(short, axis=0), rtol=2e-3)


def test_somebody_who_walks_into_the_robot_is_noticed_in_the_middle_of_a_hold():
    towards = ROOM.with_content(people=[Person(1.0, 5.0, velocity=(1.0, 0.0))])
    urgency = motion_costs(make_criterion("time_to_collision"), hold(60.0, world=towards, t0=0.0, **HERE))
    assert urgency.tolist() == [1.0]
    assert motion_costs(make_criterion("time_to_collision"), hold(0.5, world=towards, t0=0.0, **HERE)).tolist() == [0.0]


def test_long_holds_are_added_up_part_by_part(monkeypatch):
    """Integrating many hours at once would exhaust memory, above all where a person runs past."""
    runs = ROOM.with_content(people=[*WALKING, Person(1.0, 5.0, velocity=(10.0, 0.0))])
    together = hold(400.0, world=runs, t0=0.0, x=(6.0, 3.0, 9.0), y=(5.0, 5.0, 5.0))
    both = [make_criterion(name) for name in ("hall_zones", "time_to_collision")]
    expected = [motion_costs(criterion, together) for criterion in both]
    monkeypatch.setattr("hpop.motions.quadrature.AT_ONCE", 1000)
    for criterion, costs in zip(both, expected, strict=True):
        np.testing.assert_array_equal(motion_costs(criterion, replace(together)), costs)
    assert (expected[0] > 0).all()


def test_who_talks_across_a_robot_that_stands_is_cut_once():
    pair = [Person(5.0, 0.0, velocity=(0.2, 1.0)), Person(8.0, 0.0, velocity=(0.2, 1.0))]
    world = ROOM.with_content(people=pair, groups=[(0, 1)])
    cuts = motion_costs(make_criterion("cutting_between"), hold(8.0, world=world, t0=0.0, **HERE))
    assert cuts.tolist() == [1.0]


@pytest.mark.cases("who walks")
@pytest.mark.parametrize("world", [WORLD, PASSED], ids=["who stands", "who walks"])
def test_the_clock_has_a_gradient_on_symbols(world):
    """By what one stands longer one pays the rate at the end of it."""
    criterion = make_criterion("hall_zones")
    motions = hold(2.0, world=world, t0=1.0, panels=10, **HERE)
    symbols = SymbolicMotions.of(motions)
    value, jacobian = symbols.values_and_jacobian(criterion.cost(symbols.motions))
    np.testing.assert_allclose(value, motion_costs(criterion, motions), rtol=1e-9)
    last = motion_costs(criterion, hold(1e-3, world=world, t0=3.0, panels=1, **HERE)) / 1e-3
    np.testing.assert_allclose(jacobian[0, -1], last, rtol=1e-2, atol=1e-9)


# Along trajectories


ZIGZAG = [(1, 1, 0), (3, 1, 0), (5, 3, 0), (7, 3, 0), (9, 1, 1.0)]


@pytest.mark.parametrize("name", ["turns", "rotation", "orientation_retention", "length", "net_winding"])
def test_what_is_counted_is_the_same_wherever_one_stands(name):
    criterion, goes = make_criterion(name), hpop.Trajectory.from_poses(CAR, ZIGZAG)
    costs = {trajectory_cost(criterion, goes.with_hold(at=at, seconds=2.0), WORLD) for at in range(len(goes) + 1)}
    assert costs == {trajectory_cost(criterion, goes, WORLD)}


def test_who_stands_bends_to_no_side_and_ends_no_stretch(arcs):
    """Pieces of a path are cut evenly between turns in place; a hold on its way would cut them otherwise."""
    criterion = make_criterion("curvature_sign_changes")
    goes = arcs([0.3, 0.31, 0.17, 0.3, 0.0, 0.33, 0.29], [0.3, -0.03, 0.09, -0.3, 1.0, 0.02, 0.4])
    expected = running_costs(criterion, goes, WORLD)
    assert expected[-1] > 0
    for at in range(len(goes) + 1):
        found = running_costs(criterion, goes.with_hold(at=at, seconds=2.0), WORLD)
        np.testing.assert_array_equal(np.delete(found, at), expected)


def test_curves_on_either_side_of_a_hold_are_turns_of_their_own():
    goes = driven(CAR, (1, 1, 0), [(0, 2, 0.5), (0, -2, 0.5), (0, 2, 0.5), (0, -2, 0.5)])
    assert trajectory_cost(make_criterion("turns"), goes, WORLD) == 1.0
    assert trajectory_cost(make_criterion("turns"), goes.with_hold(at=2, seconds=1.0), WORLD) == 2.0


def test_smoothness_takes_a_hold_for_time_and_for_no_jerk():
    """(T⁵/D²) ∫|p'''|² dt: T is longer; between two turns the robot stands anyhow."""
    goes = hpop.Trajectory.from_poses(CAR, [(1, 1, 0), (5, 1, 1.0), (5, 1, 0.0), (9, 1, 0)])
    held = goes.with_hold(at=2, seconds=2.0)
    times = (trajectory.execution().duration for trajectory in (held, goes))
    longer = next(times) / next(times)
    smooth = [trajectory_cost(make_criterion("smoothness"), trajectory, WORLD) for trajectory in (held, goes)]
    np.testing.assert_allclose(smooth[0], longer**5 * smooth[1], rtol=1e-9)


@pytest.mark.parametrize("name", ["sickness", "msdv", "jerk"])
def test_who_stands_before_setting_out_is_as_sick_of_it_in_the_end(name):
    criterion, goes = make_criterion(name), hpop.Trajectory.from_poses(CAR, ZIGZAG)
    rested = running_costs(criterion, goes.with_hold(at=0, seconds=3.0), WORLD)
    np.testing.assert_allclose(rested[-1], trajectory_cost(criterion, goes, WORLD), rtol=0.02)


@pytest.mark.parametrize("name", REMEMBERED)
def test_a_criterion_with_memory_sees_time_pass(name):
    criterion = own_criterion(name)
    goes = hpop.Trajectory.from_poses(CAR, ZIGZAG).with_hold(at=3, seconds=4.0)
    running = running_costs(criterion, goes, WORLD)
    assert running.shape == (len(goes),)
    assert np.isfinite(running).all()


def test_a_landmark_is_seen_by_who_stands_before_it_for_long_enough():
    """Seen for a second on the way, where two are asked."""
    glimpse = hpop.World.from_polygons(
        [shapely.box(0, 4, 5.5, 5), shapely.box(6.5, 4, 12, 5)], extent=shapely.box(0, 0, 12, 9)
    ).with_content(landmarks=[Landmark(6.0, 8.0)])
    goes = hpop.Trajectory.from_poses(CAR, [(1, 1, 0), (6, 1, 0), (11, 1, 0)])
    unseen = make_criterion({"unseen_landmarks": {"least": 4.0}})
    assert trajectory_cost(unseen, goes, glimpse) == 1.0
    assert running_costs(unseen, goes.with_hold(at=1, seconds=4.5), glimpse).tolist() == [1.0, 0.0, 0.0]
