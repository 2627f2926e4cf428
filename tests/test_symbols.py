"""Symbols are to NumPy what casadi.ArrayInterface is: the same expressions, only asked for in fewer steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi
import numpy as np
import pytest

from hpop.base.math import is_symbolic
from hpop.base.symbols import OPERATIONS, SWAPPED, Symbols, lift

A, B = np.array([0.3, -0.7, 1.0]), np.array([0.5, 1.2, -0.7])
ONE = {np.sqrt, np.square, np.sin, np.cos, np.exp, np.log, np.negative, np.absolute, np.logical_not}
OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "a + b": lambda a, b: a + b,
    "1 - a": lambda a, b: 1 - a,
    "numpy - a": lambda a, b: B - a,
    "a / numpy": lambda a, b: a / B,
    "float64 * a": lambda a, b: np.float64(2.5) * a,
    "a**2": lambda a, b: a**2,
    "a % 0.4": lambda a, b: a % 0.4,
    "-abs(a)": lambda a, b: -abs(a),
    "a >= b": lambda a, b: a >= b,
    "a != b": lambda a, b: a != b,
    "where": lambda a, b: np.where(a > 0, np.sqrt(np.maximum(a, 0.0)), b),
    "where of one number": lambda a, b: np.where(a > b, 1.0, 0.0),
    "mask of numbers": lambda a, b: np.where(B > 0, a, b),
    "clip": lambda a, b: np.clip(a, -0.5, 0.5),
    "slices": lambda a, b: a[1:] - b[:-1],
    "chosen": lambda a, b: a[np.array([2, 0])] * b[-1],
    "sums": lambda a, b: a.sum() * b + np.sum(b) - a @ b,
    "two axes": lambda a, b: (a.reshape(3, 1) * b + np.array([[1.0], [2.0], [3.0]])).sum(axis=0),
    "three axes": lambda a, b: (a.reshape(3, 1, 1) * b.reshape(1, 3, 1) * np.ones(2)).sum(axis=(0, 2)),
    "stacked": lambda a, b: np.max(np.stack([a, b, 0 * a]), axis=0),
    "joined": lambda a, b: np.concatenate([a, b])[1:4],
}


def evaluated(operation: Callable[[Any, Any], Any], columns: Callable[[Any], Any], kind: Any) -> Any:
    """Shape, values and Jacobian of an operation on symbols."""
    a, b = kind.sym("a", 3), kind.sym("b", 3)
    result = operation(columns(a), columns(b))
    expression = kind(result)
    slope = casadi.jacobian(expression, casadi.vertcat(a, b))
    return result, *map(np.array, casadi.Function("f", [a, b], [expression, slope])(A, B))


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX], ids=["SX", "MX"])
@pytest.mark.parametrize("operation", OPERATORS.values(), ids=OPERATORS)
def test_operators_mean_what_they_mean_to_numbers_and_to_casadis_interface(operation, kind):
    interface = getattr(casadi.ArrayInterface, kind.__name__)
    found, values, slopes = evaluated(operation, lambda symbol: lift(symbol, 3), kind)
    expected, *wanted = evaluated(operation, lambda symbol: interface(symbol, shape=(3,)), kind)
    assert isinstance(found, Symbols)
    assert found.shape == expected.shape == np.shape(operation(A, B))
    np.testing.assert_allclose(values.ravel(), operation(A, B), rtol=1e-15)
    np.testing.assert_array_equal(values, wanted[0])
    np.testing.assert_array_equal(slopes, wanted[1])


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX], ids=["SX", "MX"])
@pytest.mark.parametrize("function", [*OPERATIONS, *SWAPPED], ids=lambda function: function.__name__)
def test_what_is_asked_of_casadi_directly_is_the_same_expression(function, kind):
    a, b = kind.sym("a"), kind.sym("b")
    interface = getattr(casadi.ArrayInterface, kind.__name__)
    for second in ([],) if function in ONE else ([b], [2.0]):
        mine, casadis = (
            [wrap(given) if isinstance(given, kind) else given for given in (a, *second)]
            for wrap in (lambda symbol: lift(symbol, 1), lambda symbol: interface(symbol, shape=(1,)))
        )
        assert str(kind(function(*mine))) == str(kind(function(*casadis)))


def test_symbols_are_known_and_are_no_numbers():
    column = lift(casadi.MX.sym("a", 3), 3)
    assert is_symbolic(column)
    assert len(column) == 3
    with pytest.raises(TypeError, match="neither true nor false"):
        bool(column > 0)
    with pytest.raises(TypeError, match="cannot convert symbolic MX"):
        np.asarray(column)
    with pytest.raises(TypeError):
        np.isfinite(column)
    with pytest.raises(AttributeError):
        _ = column.nonsense


def test_other_columns_are_not_mixed_up():
    """A column of another length is refused, one of length 1 is broadcast."""
    three, one, two = (lift(casadi.SX.sym("a", size), size) for size in (3, 1, 2))
    assert (three * one).shape == (one * three).shape == (3,)
    with pytest.raises(ValueError, match="could not be broadcast"):
        three + two
