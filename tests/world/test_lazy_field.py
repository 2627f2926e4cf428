"""A lazy field is the field sampled as a whole, of which only what is looked at is computed."""

import pickle
from collections.abc import Callable

import casadi
import numpy as np
import pytest
import shapely

import hpop
from hpop.base.arrays import FloatArray
from hpop.planners.programs.nlp import SparseField
from hpop.world.fields.field import BLOCK, Field, LazyField

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
