"""Social force: against the vectors of the paper, added up in plain loops."""

import cmath
import math

import numpy as np
import pytest
import shapely

from hpop.criteria import SocialForce, motion_costs, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.motions.symbolic import SymbolicMotions
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(speed=0.8)


def force(person, person_velocity, robot, robot_velocity):
    """Moussaïd et al. 2009, equations 3 to 5, complex numbers as vectors: f = f_v t + f_θ n."""
    e = (robot - person) / abs(robot - person)
    interaction = 2.0 * (person_velocity - robot_velocity) + e
    t = interaction / abs(interaction)
    n = 1j * t
    theta = cmath.phase(e / t)
    b = 0.35 * abs(interaction)
    d = abs(robot - person)
    slowing = -4.5 * math.exp(-d / b - (3 * b * theta) ** 2)
    turning = -4.5 * math.copysign(1, theta) * math.exp(-d / b - (2 * b * theta) ** 2)
    return slowing * t + turning * n


def test_the_force_on_people_over_time_is_that_of_the_paper():
    people = [Person(2, 1, velocity=(-0.6, -0.1)), Person(0, -0.7, 0.5), Person(2.5, 5, velocity=(0.1, -0.7))]
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 20_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s, (velocity, _) = trajectory.at(t), trajectory.rates(t)
    total = 0.0
    for p in people:
        v = complex(*p.velocity)
        for i in range(0, n, 4):
            at = complex(p.x, p.y) + v * t[i]
            total += abs(force(at, v, complex(s.x[i], s.y[i]), complex(velocity.x[i], velocity.y[i])))
    expected = total * 4 * trajectory.duration / n
    assert expected > 1
    assert trajectory_cost(SocialForce(), trajectory, ROOM.with_content(people=people)) == pytest.approx(
        expected, rel=2e-3
    )


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_a_robot_that_turns_beside_somebody_pushes_by_the_distance(distance):
    world = ROOM.with_content(people=[Person(distance, 0, 1.0)])
    turn = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, 2.0)])
    expected = 4.5 * math.exp(-distance / 0.35) * math.sqrt(2) * turn.duration
    assert trajectory_cost(SocialForce(), turn, world) == pytest.approx(expected)


def test_driving_at_somebody_pushes_more_than_driving_away():
    world = ROOM.with_content(people=[Person(3, 0)])
    towards, away = (Trajectory.from_poses(ROBOT, [(a, 0, 0), (b, 0, 0)]) for a, b in ((0, 2), (4, 6)))
    assert trajectory_cost(SocialForce(), towards, world) > 10 * trajectory_cost(SocialForce(), away, world)


def test_where_nothing_is_defined_the_cost_and_its_gradient_are_still_numbers():
    # at the person's place; and at the relative velocity at which D = λΔv + e vanishes
    world = ROOM.with_content(people=[Person(0.0, 0.0)])
    robot = DifferentialDrive(speed=0.5)
    x = np.array([0.0, -0.5, 1.0])
    start = States(x=x, y=np.zeros(3), yaw=np.zeros(3))
    ends = {
        "move": States(x=x + np.array([1.0, 1.0, 1.0]), y=np.zeros(3), yaw=np.zeros(3)),
        "turn": States(x=x, y=np.zeros(3), yaw=np.full(3, 2.0)),
    }
    for kind, end in ends.items():
        motions = Motions(world, robot, robot.laws[kind], start, end, panels=3)
        symbols = SymbolicMotions.of(motions)
        value, jacobian = symbols.values_and_jacobian(SocialForce().cost(symbols.motions))
        assert np.isfinite(jacobian).all()
        assert value[[0, 2]] == pytest.approx(motion_costs(SocialForce(), motions)[[0, 2]], rel=1e-6, abs=1e-9)
        assert np.isfinite(value).all()


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1])
def test_it_is_a_good_criterion_in_other_worlds_too(seed):
    check_criterion(SocialForce(), rng=seed)


@pytest.mark.parametrize(
    "wrong",
    [{"strength": 0.0}, {"stretch": -1.0}, {"anticipation": -1.0}, {"turning": np.inf}, {"slowing": np.nan}],
)
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(CriterionError, match=next(iter(wrong))):
        SocialForce(**wrong)
