from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.optimize import linprog

from hpop.frontier import ItemFront, is_nondominated
from hpop.frontier.choosing import _depth, knee, normalised


def test_knee_of_a_cubic_where_its_slope_is_minus_one():
    # y = (1 - x)^3 runs from (0, 1) to (1, 0), deepest below the chord where y' = -1: x = 1 - 1/sqrt(3).
    x = np.linspace(0.0, 1.0, 2001)
    front = ItemFront.of(
        np.column_stack([1000.0 * x, 3.0 + 7.0 * (1 - x) ** 3]),
        [None] * len(x),
        names=("turns", "length"),
        units=("1", "m"),
        quanta=(1e-12, 1e-12),
        status="complete",
        certificate="exact",
    )
    point = front.knee()
    assert point.costs["turns"] == pytest.approx(1000 * (1 - 3**-0.5), abs=0.5)
    assert point.costs["length"] == pytest.approx(3 + 7 * 3**-1.5, abs=0.01)


@pytest.mark.parametrize("k", [2, 3, 4, 5, 6])
def test_knee_of_a_symmetric_bulge_is_its_centre(k):
    # sum of sqrt(z_i) = 1: the extreme points are the unit vectors, the deepest point is z_i = 1 / k^2.
    rng = np.random.default_rng(k)
    shares = rng.dirichlet(np.ones(k), 300)
    Y = np.vstack([np.eye(k), np.full(k, 1 / k**2), shares**2])
    assert knee(Y * np.arange(1, k + 1) + 5.0) == k


def test_knee_is_measured_from_the_plane_through_the_extreme_points():
    # (1,0,0), (0,1,0), (.2,.2,1) span x + y + .6 z = 1. Below it (.25,.25,.6) lies 1 - .86 deep and
    # (.3,.6,.05) only 1 - .93, although the second has the lesser plain sum: .95 against 1.1.
    Y = np.array([[1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [0.3, 0.6, 0.05], [0.25, 0.25, 0.6]])
    assert knee(Y) == 4
    assert knee(Y * [1.0, 60.0, 0.01] - 3.0) == 4


def test_two_extreme_points_of_three_costs_are_enough():
    # Half of (1,1,0) and half of (0,0,1) is .1 above (.4,.4,.4) in each cost, whose sum is larger than that of (0,0,1).
    assert knee(np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.4, 0.4, 0.4]])) == 2


def test_the_best_in_several_related_costs_is_no_knee():
    # The straight way is the shortest, of fewest turns and least rotation, but the most obstructed: the least sum, 1.
    straight, clear = [1.0, 0.0, 0.0, 0.0], [0.0, 0.8, 1.0, 0.9]
    assert knee(np.array([straight, clear, [0.04, 0.57, 0.66, 0.67], [0.44, 0.43, 0.45, 0.42]])) == 2


def test_a_plane_through_the_extreme_points_that_falls_along_a_cost_is_not_followed():
    # (1,.8,.8), (0,1,0), (0,0,1) span -.6 x + y + z = 1, which rewards a large x: (.9,.82,.05) is deepest below it.
    Y = np.array([[1, 0.8, 0.8], [0, 1, 0], [0, 0, 1], [0.9, 0.82, 0.05], [0.05, 0.83, 0.05]])
    assert knee(Y) == 4


def test_knee_of_a_straight_front_is_its_middle():
    x = np.arange(11.0)
    assert knee(np.column_stack([x, 10 - x])) == 5


def test_knee_of_a_front_that_bulges_away_is_an_extreme_point():
    angle = np.linspace(0, np.pi / 2, 9)
    assert knee(np.column_stack([np.sin(angle), np.cos(angle)])) in (0, 8)


def test_constant_criteria_do_not_move_the_knee():
    Y = np.array([[0.0, 10.0], [1.0, 4.0], [3.0, 3.0], [9.0, 0.0]])
    assert knee(np.column_stack([np.full(4, 7.3), Y, np.full(4, -2.0)])) == knee(Y) == 1


@pytest.mark.parametrize("p", [0.3, 0.5, 0.9])
@pytest.mark.parametrize("k", [2, 3, 4])
def test_knee_of_a_superellipse_is_its_diagonal(k, p):
    # sum of z_i^p = 1 with p < 1 bulges towards the ideal, most at z_i = k^(-1/p); the grid holds its faces and edges.
    shares = np.array([s for s in itertools.product(range(13), repeat=k) if sum(s) == 12]) / 12
    Y = shares ** (1 / p) * 10.0 ** np.arange(k)
    assert Y[knee(Y)] / 10.0 ** np.arange(k) == pytest.approx(k ** (-1 / p))


def test_knee_of_a_sphere_that_bulges_away_is_the_best_of_a_cost():
    shares = np.array([s for s in itertools.product(range(9), repeat=3) if sum(s) == 8]) / 8
    assert 0.0 in shares[knee(np.sqrt(shares))]


small = st.integers(3, 14).flatmap(lambda n: hnp.arrays(np.int64, (n, 3), elements=st.integers(0, 9)))


@given(small.map(lambda Y: Y[is_nondominated(Y)].astype(float)))
def test_no_row_between_the_extremes_is_deeper_than_the_knee(Y):
    """Any mixture proves a least depth, any weights prove a greatest one."""
    z = normalised(Y, Y.min(axis=0), Y.max(axis=0))
    z = z[:, z.max(axis=0) > 0]
    if z.shape[1] < 2:
        return
    axes = range(z.shape[1])
    best = {min(range(len(z)), key=lambda i: (z[i, j], z[i].sum())) for j in axes}
    near = {min(range(len(z)), key=lambda i: (np.delete(z[i], j).max(), z[i, j])) for j in axes}
    extremes, chosen = z[sorted(best | near)], knee(Y)

    def simplex(size, steps):
        shares = (s for s in itertools.product(range(steps + 1), repeat=size - 1) if sum(s) <= steps)
        return np.array([(*s, steps - sum(s)) for s in shares]) / steps

    mixtures = simplex(len(extremes), 6) @ extremes
    proven = {i: (mixtures - z[i]).min(axis=1).max() for i in range(len(z)) if i not in best}
    weights = simplex(z.shape[1], 24)
    limit = ((weights @ extremes.T).max(axis=1) - weights @ z[chosen]).min()
    assert max(proven.values(), default=0.0) <= limit + 1e-9
    if any(depth > 1e-6 for depth in proven.values()):
        assert chosen not in best


@pytest.mark.seeds(6, of=30)
def test_depths_and_their_proofs_are_those_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    k, m = rng.integers(2, 7), rng.integers(1, 13)
    tied = seed % 2
    extremes = rng.integers(0, 3, (m, k)) / 2 if tied else rng.random((m, k))
    point = rng.integers(0, 3, k) / 2 if tied else rng.random(k)
    program = linprog(
        [0.0] * m + [-1.0],
        A_ub=np.hstack([-extremes.T, np.ones((k, 1))]),
        b_ub=-point,
        A_eq=[[1.0] * m + [0.0]],
        b_eq=[1.0],
        bounds=[(0.0, None)] * m + [(None, None)],
    )
    depth, weights = _depth(point, extremes)
    assert depth == pytest.approx(-program.fun, abs=1e-10)
    assert (weights >= 0).all()
    assert weights.sum() == pytest.approx(1.0)
    assert (extremes @ weights).max() - point @ weights == pytest.approx(depth, abs=1e-10)
