"""Fields: range, smoothing, gradients, and the same numbers from CasADi."""

import pickle
import subprocess
import sys

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.world import Field


def column(symbol):
    return casadi.ArrayInterface.MX(symbol, shape=(symbol.numel(),))


@pytest.fixture
def field():
    return Field(np.random.default_rng(5).random((7, 9)), 0.3, (1.0, 2.0, 0.4))


@pytest.fixture
def points():
    rng = np.random.default_rng(6)
    return rng.uniform(-2, 6, 200), rng.uniform(-1, 7, 200)  # a good part outside the grid


def test_numpy_and_casadi_agree_in_value_and_gradient_also_outside(field, points):
    x, y = (casadi.MX.sym(name, 200) for name in "xy")
    value = field(column(x), column(y))
    assert value.shape == (200,)
    total = casadi.sum1(casadi.vec(value.to_casadi()))
    outputs = [value.to_casadi(), casadi.gradient(total, x), casadi.gradient(total, y)]
    function = casadi.Function("f", [x, y], outputs)
    got = [np.array(v).ravel() for v in function(*points)]
    expected = [field(*points), *field.gradient(*points)]
    for a, b in zip(got, expected, strict=True):
        assert a == pytest.approx(b, abs=1e-9)
    assert (expected[1] == 0).any()


def test_gradients_are_those_of_finite_differences(field):
    rng = np.random.default_rng(7)
    x, y = 1.6 + 0.3 * rng.random(50), 3.0 + 0.3 * rng.random(50)
    h = 1e-6
    gx, gy = field.gradient(x, y)
    assert gx == pytest.approx((field(x + h, y) - field(x - h, y)) / (2 * h), abs=1e-6)
    assert gy == pytest.approx((field(x, y + h) - field(x, y - h)) / (2 * h), abs=1e-6)


@given(
    values=hnp.arrays(np.float64, (4, 5), elements=st.floats(0, 1)),
    x=st.floats(-3, 9),
    y=st.floats(-3, 9),
)
def test_a_field_stays_within_the_range_of_its_samples(values, x, y):
    value = Field(values, 1.0)(np.array([x]), np.array([y]))[0]
    assert values.min() <= value <= values.max()


def test_a_plane_is_reproduced_and_a_parabola_is_raised_by_a_third_of_a_squared_step():
    # Cubic B-splines with sample coefficients: x^2 -> x^2 + h^2 / 3.
    h = 0.5
    x, y = np.meshgrid(h * np.arange(12), h * np.arange(12))
    px, py = np.random.default_rng(1).uniform(1.5, 4, (2, 30))
    assert Field(2 * x - 3 * y, h)(px, py) == pytest.approx(2 * px - 3 * py, abs=1e-12)
    assert Field(x**2, h)(px, py) == pytest.approx(px**2 + h**2 / 3, abs=1e-12)


def test_equal_neighbours_give_exactly_zero():
    values = np.zeros((9, 9))
    values[8, 8] = 1.0
    assert (Field(values, 1.0)(np.linspace(0, 5.9, 40), np.full(40, 3.3)) == 0.0).all()


def test_beyond_the_grid_the_nearest_border_value_holds(field):
    assert Field(np.arange(12.0).reshape(3, 4), 1.0)(99.0, -99.0) == pytest.approx(3.0)


def test_nan_in_nan_out(field):
    assert np.isnan(field(np.array([np.nan]), np.array([3.0])))[0]


def test_a_field_survives_pickling_and_cannot_be_changed(field, points):
    again = pickle.loads(pickle.dumps(field))
    assert (again(*points) == field(*points)).all()
    with pytest.raises(ValueError, match="read-only"):
        field.values[0, 0] = 1.0


def test_numbers_beside_a_column_are_broadcast(field):
    x = casadi.MX.sym("x", 3)
    value = field(column(x), np.array(3.0))
    got = np.array(casadi.Function("f", [x], [value.to_casadi()])([1.5, 2.0, 2.5])).ravel()
    assert got == pytest.approx(field(np.array([1.5, 2.0, 2.5]), 3.0), abs=1e-12)


@pytest.mark.parametrize("values", [np.zeros(3), np.zeros((0, 2)), np.array([[np.nan]])])
def test_samples_that_make_no_field_are_refused(values):
    with pytest.raises(ValueError, match="values must be"):
        Field(values, 1.0)


def test_importing_the_world_stays_light():
    code = (
        "import sys, hpop.world; "
        "print([m for m in ('numba', 'casadi', 'matplotlib', 'scipy.optimize', 'PIL') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
