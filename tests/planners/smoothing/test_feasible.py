"""The nearest point that keeps all limits, where it is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array

from hpop.planners.programs.smoothing.interval import KEPT, made_feasible

FREE = np.full(2, -np.inf), np.full(2, np.inf)
UNIT = np.ones(1), np.ones(1)


def circle(point):
    return np.array([point @ point]), csr_array(2 * point[None])


def linear(*slopes):
    slopes = csr_array(np.array(slopes, float))
    return lambda point: (slopes @ point, slopes)


@given(st.floats(0, 2 * np.pi), st.floats(-0.02, 0.02))
def test_the_nearest_point_of_a_circle_lies_on_the_same_ray(angle, off):
    ray = np.array([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(made_feasible(circle, (1 + off) * ray, FREE, UNIT), ray, atol=KEPT)


def test_what_keeps_all_limits_stays_where_it_is():
    inside = np.array([0.3, 0.4])
    np.testing.assert_array_equal(made_feasible(circle, inside, FREE, (np.zeros(1), np.ones(1))), inside)


def test_an_exceeded_limit_is_met_and_the_others_are_left_alone():
    """Two of four sides of a square are exceeded; the third is nearer than before, and not an equation."""
    sides = linear((1, 0), (0, 1), (1, 1))
    found = made_feasible(sides, np.array([1.01, -0.02]), FREE, (np.zeros(3), np.array([1.0, 1.0, 2.0])))
    np.testing.assert_allclose(found, [1.0, 0.0], atol=KEPT)


def test_a_limit_that_another_one_leads_across_is_kept_too():
    """Only y = 1 is not kept at first; the step there exceeds x + y <= 1."""
    bounds = np.array([1.0, -np.inf]), np.array([1.0, 1.0])
    found = made_feasible(linear((0, 1), (1, 1)), np.array([0.005, 0.99]), FREE, bounds)
    np.testing.assert_allclose(found, [0.0, 1.0], atol=KEPT)


@pytest.mark.parametrize("fixed", [0, 1])
def test_variables_stay_in_their_ranges(fixed):
    """One has no room at all: the other must do it alone."""
    point = np.array([0.61, 0.8])
    box = tuple(side.copy() for side in FREE)
    for side in box:
        side[fixed] = point[fixed]
    found = made_feasible(circle, point, box, UNIT)
    assert found[fixed] == point[fixed]
    assert found[1 - fixed] == pytest.approx(np.sqrt(1 - point[fixed] ** 2), abs=KEPT)


def test_limits_that_say_the_same_twice_are_no_obstacle():
    found = made_feasible(linear((1, 1), (2, 2)), np.array([0.5, 0.51]), FREE, (np.array([1.0, 2.0]),) * 2)
    np.testing.assert_allclose(found, [0.495, 0.505], atol=KEPT)


def test_limits_that_contradict_each_other_are_kept_by_no_point():
    assert made_feasible(linear((1, 0), (1, 0)), np.zeros(2), FREE, (np.array([0.0, 0.1]),) * 2) is None
