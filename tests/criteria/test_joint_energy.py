"""Joint energy: the square of joint speeds over time, in closed form for a trapezoid and bounded below by θ²/T."""

import pytest
import shapely

import hpop
from hpop.criteria import JointEnergy, trajectory_cost
from tests.jointed import Jointed, agrees_everywhere, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def test_a_reach_of_one_joint_costs_its_trapezoid():
    """Ramps of v/a = .5 s whose speed squared is a third of v² on average, and cruising at v = 1 in between."""
    reach = tour(Jointed(), [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0)])
    assert reach.duration == pytest.approx(2.0)
    assert trajectory_cost(JointEnergy(), reach, WORLD) == pytest.approx(2 * 0.5 / 3 + 1.0, rel=1e-12)


@pytest.mark.parametrize("angle", [0.1, 0.7, 2.2])
def test_none_is_cheaper_than_an_even_motion_of_the_same_duration(angle):
    reach = tour(Jointed(), [(0.0, 0.0, 0.0), (angle, 0.0, 0.0)])
    assert trajectory_cost(JointEnergy(), reach, WORLD) >= angle**2 / reach.duration


def test_it_adds_up_on_edges_trajectories_and_symbols():
    agrees_everywhere(JointEnergy(), Jointed(), WORLD)


def test_what_it_declares():
    assert (JointEnergy.group, JointEnergy.unit, JointEnergy.aggregate) == ("R", "rad²/s", "sum")
