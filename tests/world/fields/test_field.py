"""Fields: range, smoothing, gradients, numbers as from CasADi; and fields sampled on demand."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable

import casadi
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import hpop
from hpop.base.arrays import FloatArray
from hpop.planners.programs.nlp import SparseField
from hpop.world.fields.field import BLOCK, Field, LazyField


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


XS, YS, SPACING = 3.0 + 0.5 * np.arange(150.0), -2.0 + 0.5 * np.arange(101.0), 0.5
Sample = Callable[[FloatArray, FloatArray], FloatArray]


def wave(x: FloatArray, y: FloatArray) -> FloatArray:
    return 0.5 + 0.5 * np.sin(0.3 * x) * np.cos(0.2 * y)


def lazy(sample: Sample = wave) -> LazyField:
    return LazyField(XS, YS, SPACING, sample)


@pytest.fixture(scope="module")
def whole() -> Field:
    x, y = np.meshgrid(XS, YS)
    return Field(wave(x, y), SPACING, (XS[0], YS[0], 0.0))


def everywhere(count: int) -> tuple[FloatArray, FloatArray]:
    """Points on the grid and up to 10 m beyond, with the grid's corners and borders of blocks."""
    rng = np.random.default_rng(1)
    x, y = (rng.uniform(axis[0] - 10, axis[-1] + 10, count) for axis in (XS, YS))
    nodes = np.array([-3.0, -2.0, -1.0, 0.0, 28.0, 29.0, 30.0, 31.0, 32.0, 61.99, 62.0, 98.0, 99.0, 100.0, 102.0])
    i, j = (index.ravel() for index in np.meshgrid(nodes, nodes))
    return np.concatenate([x, XS[0] + i * SPACING]), np.concatenate([y, YS[0] + j * SPACING])


def test_each_point_asked_alone_has_the_value_of_the_whole_field(whole: Field) -> None:
    x, y = everywhere(60)
    assert [float(lazy()(x[[n]], y[[n]])[0]) for n in range(x.size)] == whole(x, y).tolist()


def test_points_asked_one_after_the_other_have_the_values_of_the_whole_field(whole: Field) -> None:
    field = lazy()
    for x, y in zip(*(np.split(axis[:200], 20) for axis in everywhere(200)), strict=True):
        assert (field(x, y) == whole(x, y)).all()
        assert all((a == b).all() for a, b in zip(field.gradient(x, y), whole.gradient(x, y), strict=True))


def test_a_node_is_sampled_once_and_far_ones_not_at_all() -> None:
    asked: list[tuple[float, float]] = []

    def sample(x: FloatArray, y: FloatArray) -> FloatArray:
        asked.extend(zip(x.tolist(), y.tolist(), strict=True))
        return wave(x, y)

    field = lazy(sample)
    for x in (20.0, 20.1, 35.0, 20.0):
        field(np.array([x]), np.array([10.0]))
    assert len(asked) == len(set(asked)) < XS.size * YS.size / 2
    assert (field.values == wave(*np.meshgrid(XS, YS))).all()
    assert len(asked) == len(set(asked)) == XS.size * YS.size


def test_nan_stays_nan_and_nothing_asked_is_nothing() -> None:
    assert np.isnan(lazy()(np.array([np.nan, 5.0]), np.array([5.0, np.nan]))).all()
    assert lazy()(np.zeros(0), np.zeros(0)).size == 0


def test_symbols_and_copies_have_all_values(whole: Field) -> None:
    x, y = everywhere(50)
    assert (pickle.loads(pickle.dumps(lazy()))(x, y) == whole(x, y)).all()
    at = [casadi.ArrayInterface(casadi.MX.sym(name, x.size)) for name in "xy"]
    value = casadi.Function("f", [c.to_casadi() for c in at], [lazy()(*at).to_casadi()])
    assert np.array(value(x, y)).ravel() == pytest.approx(whole(x, y), abs=1e-12)


def test_a_nonlinear_program_sees_all_samples(whole: Field) -> None:
    x, y = everywhere(50)
    at = [casadi.ArrayInterface(casadi.MX.sym(name, x.size)) for name in "xy"]
    sparse = SparseField.of(lazy())
    value = casadi.Function("f", [c.to_casadi() for c in at], [sparse(*at).to_casadi()])
    assert np.array(value(x, y)).ravel() == pytest.approx(whole(x, y), abs=1e-12)
    assert (sparse.values == whole.values).all()


def test_a_large_world_of_polygons_samples_obstruction_where_it_is_asked_for() -> None:
    hall = shapely.box(0, 0, 200, 100)
    world = hpop.World.from_polygons([shapely.box(10 * i, 20, 10 * i + 1, 80) for i in range(1, 20)], extent=hall)
    field = world.obstruction_field(1.0)
    x, y = np.array([10.5, 15.0]), np.array([10.0, 50.0])
    part = field(x, y)
    rest = Field(field.values, field.spacing, field.origin)
    assert (part == rest(x, y)).all()


def test_however_much_is_asked_for_a_few_blocks_are_sampled_at_once(
    whole: Field, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hpop.world.fields.field.AT_ONCE", 3)
    sizes: list[int] = []

    def sample(x: FloatArray, y: FloatArray) -> FloatArray:
        sizes.append(x.size)
        return wave(x, y)

    assert (lazy(sample).values == whole.values).all()
    assert max(sizes) <= 3 * (BLOCK + 3) ** 2
