"""Symbols stand for the numbers of a batch, in the order that their vector promises."""

import casadi
import numpy as np
import pytest
import shapely

from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.motions.symbolic import SymbolicMotions, lift
from hpop.world import World

WORLD = World.from_polygons([shapely.box(4, 4, 5, 5)], extent=shapely.box(0, 0, 10, 10))
MODEL = DifferentialDrive()


def moves():
    start = States(x=np.array([1.0, 2.0]), y=np.array([3.0, 4.0]), yaw=np.array([0.0, 0.5]))
    end = States(x=np.array([4.0, 5.0]), y=np.array([7.0, 8.0]), yaw=np.array([0.0, 0.5]))
    return Motions(WORLD, MODEL, MODEL.laws["move"], start, end)


def test_lifted_symbols_are_columns_that_numpy_functions_accept():
    vector = casadi.MX.sym("v", 3)
    column = lift(vector, 3)
    assert column.shape == (3,)
    result = casadi.Function("f", [vector], [casadi.MX(np.sin(column) * np.array([1.0, 2.0, 3.0]))])([0.1, 0.2, 0.3])
    assert np.array(result).ravel() == pytest.approx(np.sin([0.1, 0.2, 0.3]) * [1, 2, 3])


def test_the_numbers_are_start_columns_then_end_columns_in_the_models_order():
    symbols = SymbolicMotions.of(moves())
    assert symbols.point.tolist() == [1, 2, 3, 4, 0, 0.5, 4, 5, 7, 8, 0, 0.5]
    assert symbols.vector.shape == (12, 1)


def test_the_jacobian_of_a_length_is_the_unit_vector():
    symbols = SymbolicMotions.of(moves())
    value, jacobian = symbols.values_and_jacobian(symbols.motions.base.length)
    assert value.tolist() == [5.0, 5.0]
    expected = np.zeros((2, 12))
    for motion in range(2):
        expected[motion, [motion, 2 + motion, 6 + motion, 8 + motion]] = [-0.6, -0.8, 0.6, 0.8]
    assert jacobian == pytest.approx(expected, abs=1e-15)


def test_a_column_of_plain_numbers_has_no_slope():
    symbols = SymbolicMotions.of(moves())
    value, jacobian = symbols.values_and_jacobian(np.array([1.0, 2.0]))
    assert value.tolist() == [1.0, 2.0]
    assert not jacobian.any()
