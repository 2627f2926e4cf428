"""Singularity: manipulability by NumPy's determinant and by closed form, and what it costs."""

import math

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Singularity, trajectory_cost
from hpop.criteria.robot.singularity import manipulability
from hpop.errors import CriterionError
from hpop.motions import States
from tests.jointed import Jointed, agrees_everywhere, jacobian, moments, states_of, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def test_manipulability_is_the_root_of_the_determinant_of_the_jacobian_by_differences():
    rng = np.random.default_rng(0)
    model = Jointed()
    rows = rng.uniform(-1.1, 1.1, (30, 3))
    found = manipulability(model, states_of(model, rows))
    expected = [math.sqrt(np.linalg.det(j.T @ j)) for j in (jacobian(model, "camera", row) for row in rows)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


class Many:
    """Joints that move a tool by given columns of a Jacobian, whatever the state."""

    def __init__(self, columns):
        self.columns = np.array(columns)  # (n, 6)
        self.joints = tuple(f"q{i}" for i in range(len(self.columns)))
        self.provides = frozenset({"tool", "joints"})
        self.space = type("Space", (), {"names": self.joints})

    def twist(self, body, states, rates):
        assert body == "tool"
        total = sum(getattr(rates, name)[:, None] * row for name, row in zip(self.joints, self.columns, strict=True))

        class Twist:
            velocity, rotation = tuple(total.T[:3]), tuple(total.T[3:])

        return Twist


@pytest.mark.parametrize("joints", [2, 6, 7, 9])
def test_it_is_the_product_of_the_singular_values_of_any_jacobian(joints):
    rng = np.random.default_rng(joints)
    columns = rng.normal(size=(joints, 6))
    states = States(**{f"q{i}": np.zeros(2) for i in range(joints)})
    product = np.prod(np.linalg.svd(columns, compute_uv=False))
    np.testing.assert_allclose(manipulability(Many(columns), states), product, rtol=1e-9)
    columns[0] = 0.0 if joints <= 6 else columns[0]
    columns[:, 0] *= joints <= 6  # seven joints that cannot move the tool along x
    np.testing.assert_allclose(manipulability(Many(columns), states), 0.0, atol=1e-9)


def test_a_second_costs_half_where_manipulability_is_the_half_and_all_where_there_is_none():
    """Tilted up to the zenith the pan turns the camera about its own view, but the head turns still: μ is 1 always."""
    head = hpop.PanTilt(tilt=(-1.5, 1.5))
    tilt = hpop.Trajectory(head, states_of(head, [(0, 0, 0, 0.3, -1), (0, 0, 0, 0.3, 1.4)]), ("tilt",))
    for half in (1.0, 3.0):
        expected = tilt.duration / (1 + 1 / half)
        assert trajectory_cost(Singularity(half=half), tilt, WORLD) == pytest.approx(expected, rel=1e-9)


def test_it_adds_up_on_edges_trajectories_and_symbols_as_sampled():
    trajectory = tour(Jointed())
    times, step, *_ = moments(trajectory, 4_000)
    mu = manipulability(Jointed(), trajectory.at(times))
    expected = np.sum(1.0 / (1.0 + mu / 0.2)) * step
    assert agrees_everywhere(Singularity(half=0.2), Jointed(), WORLD) == pytest.approx(expected, rel=1e-4)


def test_what_it_declares():
    assert (Singularity.group, Singularity.unit, Singularity.aggregate) == ("R", "s", "sum")
    with pytest.raises(CriterionError, match="half must be a manipulability"):
        Singularity(half=0.0)
