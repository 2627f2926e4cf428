"""Turns: N counts turns in place, whatever their angle, and along curves stretches of one sign."""

import numpy as np
import pytest
import shapely

from hpop.criteria import OrientationRetention, Turns, motion_costs, trajectory_cost
from hpop.criteria.costs import trajectory_costs
from hpop.models import DifferentialDrive
from hpop.models.driven import driven
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive()


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
    trajectory = Trajectory.from_poses(ROBOT, poses)
    assert trajectory_cost(Turns(), trajectory, WORLD) == count
    assert trajectory_cost(Turns(), trajectory.execution(), WORLD) == count


@pytest.mark.parametrize("kind", ["turn", "spin"])
def test_a_turn_counts_once_it_exceeds_one_degree_either_way(kind):
    degrees = np.array([0.5, 0.999, 1.001, 179.0, -0.999, -1.001, -90.0])
    nothing = 0.0 * degrees
    start, end = States(x=nothing, y=nothing, yaw=nothing), States(x=nothing, y=nothing, yaw=np.radians(degrees))
    costs = motion_costs(Turns(), Motions(WORLD, ROBOT, ROBOT.laws[kind], start, end))
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
    trajectory = driven(ROBOT, (0, 0, 0.5), controls)
    cut = trajectory.cut(np.full(len(controls), pieces))
    assert trajectory_cost(Turns(), cut, WORLD) == count
    uneven = trajectory.cut(np.arange(1, len(controls) + 1))
    assert trajectory_cost(Turns(), uneven, WORLD) == count
    assert trajectory_cost(Turns(), trajectory.execution(), WORLD) == count


def test_stretches_do_not_go_on_from_one_trajectory_to_the_next():
    one = driven(ROBOT, (0, 0, 0), [(1, 0.5, 1), (0, -0.5, 0.5)])  # still turning at its end
    other = driven(ROBOT, (0, 0, 0), [(1, 0.5, 1), (0, -0.5, 1)])
    assert trajectory_costs([Turns()], [one, other, one], WORLD).ravel().tolist() == [1, 1, 1]


def test_a_turn_in_place_is_one_turn_and_the_curve_after_it_another():
    curve = driven(ROBOT, (0, 0, 1.0), [START, *bend(50), STOP]).states
    columns = {name: np.concatenate([[getattr(curve, name)[0]], getattr(curve, name)]) for name in curve.names}
    columns["yaw"][0] = 0.0
    trajectory = Trajectory(ROBOT, States(**columns), ("turn", *["drive"] * 4))
    assert trajectory_cost(Turns(), trajectory, WORLD) == 2


def test_a_polyline_counts_as_before_beside_a_curve():
    polyline = Trajectory.from_poses(ROBOT, [(0, 0, 1), (5, 0, 0), (5, 5, 2)])
    curve = driven(ROBOT, (0, 0, 0.5), CURVES["a slalom"][0])
    assert trajectory_costs([Turns()], [polyline, curve], WORLD).ravel().tolist() == [3, 4]


def test_the_viewer_remembers_the_turns_of_a_curve_as_wholes():
    """A right angle along a curve is easy to remember, however it is cut; two of 45 degrees are not."""
    keeps = OrientationRetention()
    for pieces in (1, 5):
        whole = driven(ROBOT, (0, 0, 0), [START, *bend(90), STOP]).cut(np.full(4, pieces))
        halves = driven(ROBOT, (0, 0, 0), [START, *bend(45), (0, 0, 1), *bend(45), STOP]).cut(np.full(7, pieces))
        assert trajectory_cost(keeps, whole, WORLD) == pytest.approx(0.0, abs=1e-9)
        assert trajectory_cost(keeps, halves, WORLD) == pytest.approx(np.pi / 2)
