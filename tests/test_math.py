"""Functions with kinks: exact on numbers, smooth on symbols, and how far the two may differ."""

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.base.math import SMOOTHING, hinge, hypot, is_symbolic, smooth_abs, smooth_step, wrap
from hpop.motions.symbolic import lift

finite = st.floats(-1e6, 1e6)


def on_symbols(function, *point):
    """Value and gradient of a function of scalars, computed by CasADi."""
    vector = casadi.MX.sym("v", len(point))
    result = casadi.MX(function(*(lift(part, 1) for part in casadi.vertsplit(vector, 1))))
    value, gradient = casadi.Function("f", [vector], [result, casadi.jacobian(result, vector)])(point)
    return float(value), np.array(gradient).ravel()


@given(finite)
def test_wrapped_angles_lie_in_the_half_open_interval_and_point_the_same_way(angle):
    wrapped = wrap(angle)
    assert -np.pi < wrapped <= np.pi
    tolerance = 4e-16 * max(abs(angle), 10.0)
    assert np.hypot(np.cos(wrapped) - np.cos(angle), np.sin(wrapped) - np.sin(angle)) <= tolerance


@pytest.mark.parametrize("angle", [np.pi, -np.pi, np.nextafter(np.pi, 4), np.nextafter(-np.pi, 0)])
def test_wrap_never_returns_minus_pi(angle):
    assert -np.pi < wrap(angle) <= np.pi


def test_what_is_no_angle_is_none_when_wrapped():
    assert np.isnan(wrap(np.array([np.nan, 1.0]))).tolist() == [True, False]


def test_a_half_turn_is_counter_clockwise():
    assert wrap(-np.pi) == np.pi
    assert wrap(np.array([np.pi, -np.pi])).tolist() == [np.pi, np.pi]


@given(finite, finite)
def test_hypot_and_abs_are_exact_on_numbers(x, y):
    assert hypot(x, y) == np.hypot(x, y)
    assert smooth_abs(x) == abs(x)


def test_hypot_on_symbols_has_the_unit_vector_as_gradient_and_zero_at_the_origin():
    value, gradient = on_symbols(hypot, 3.0, 4.0)
    assert value == pytest.approx(5.0)
    assert gradient == pytest.approx([0.6, 0.8])
    value, gradient = on_symbols(hypot, 0.0, 0.0)
    assert value == 0.0
    assert gradient.tolist() == [0.0, 0.0]


@given(st.floats(-3.0, 3.0).filter(lambda s: abs(s) > 1.0))
def test_smooth_abs_is_the_absolute_value_outside_its_width(s):
    value, gradient = on_symbols(smooth_abs, s * SMOOTHING)
    assert value == abs(s * SMOOTHING)
    assert gradient[0] == np.sign(s)


@given(st.floats(-1.0, 1.0))
def test_smooth_abs_is_even_and_within_its_width_of_the_absolute_value(s):
    x = s * SMOOTHING
    value, gradient = on_symbols(smooth_abs, x)
    mirrored, opposite = on_symbols(smooth_abs, -x)
    assert value == pytest.approx(mirrored, abs=1e-15)
    assert gradient[0] == pytest.approx(-opposite[0], abs=1e-12)
    assert 0.0 <= value <= SMOOTHING * (1 + 1e-12)
    assert abs(value - abs(x)) <= SMOOTHING


def test_smooth_abs_meets_the_absolute_value_with_equal_slope_and_curvature():
    slopes = [on_symbols(smooth_abs, SMOOTHING * s)[1][0] for s in (1 - 1e-4, 1 - 2e-4)]
    assert slopes[0] == pytest.approx(1.0, abs=1e-6)
    curvature = (slopes[0] - slopes[1]) / (SMOOTHING * 1e-4)
    assert curvature == pytest.approx(0.0, abs=1.0)  # against 2 / SMOOTHING = 100 of a parabola
    assert on_symbols(smooth_abs, 0.0)[0] == 0.0


@pytest.mark.parametrize("s", [-1e3, -1.0, 1.0, 1e3])
def test_smooth_step_is_the_step_outside_its_width(s):
    value, gradient = on_symbols(smooth_step, s * SMOOTHING)
    assert value == smooth_step(s * SMOOTHING)
    assert gradient[0] == 0.0


def test_smooth_step_rises_evenly_about_one_half():
    s = np.linspace(-1, 1, 41)
    rise = np.array([on_symbols(smooth_step, SMOOTHING * u)[0] for u in s])
    assert (np.diff(rise) > 0).all()
    assert rise + rise[::-1] == pytest.approx(1.0)
    ends = [on_symbols(smooth_step, SMOOTHING * u)[1][0] for u in (-1 + 1e-4, 0.0, 1 - 1e-4)]
    assert ends == pytest.approx([0.0, 15 / 16 / SMOOTHING, 0.0], abs=1e-5)  # the slope of 15 s / 16 w


def test_the_step_is_sharp_on_numbers():
    assert smooth_step(np.array([-1e-300, 0.0, 1e-300])).tolist() == [0.0, 1.0, 1.0]


def test_symbols_are_told_from_numbers():
    assert is_symbolic(casadi.MX.sym("x"))
    assert is_symbolic(lift(casadi.MX.sym("x", 3), 3))
    assert not is_symbolic(np.zeros(3))
    assert not is_symbolic(1.0)


@given(finite)
def test_a_hinge_is_exact_on_numbers(x):
    assert hinge(x) == max(x, 0.0)


def test_a_hinge_on_symbols_lies_just_above_and_is_smooth_convex_and_exact_outside():
    x = np.linspace(-2 * SMOOTHING, 2 * SMOOTHING, 401)
    values, slopes = np.array([(v, g[0]) for v, g in (on_symbols(hinge, at) for at in x)]).T
    above = values - np.maximum(x, 0.0)
    assert (above >= -1e-15).all()
    assert above.max() == pytest.approx(3 / 32 * SMOOTHING)
    assert (np.diff(slopes) >= -1e-12).all()
    assert np.diff(slopes).max() < 0.02
    outside = np.abs(x) >= 0.5 * SMOOTHING
    np.testing.assert_allclose(values[outside], np.maximum(x, 0.0)[outside], atol=1e-15)
