"""Columns of CasADi symbols that NumPy's functions and operators accept like arrays.

CasADi's array interface is new and may change, so all code that uses it is in this file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

OPERATIONS = {
    np.add: "ADD",
    np.subtract: "SUB",
    np.multiply: "MUL",
    np.divide: "DIV",
    np.power: "POW",
    np.less: "LT",
    np.less_equal: "LE",
    np.maximum: "FMAX",
    np.minimum: "FMIN",
    np.arctan2: "ATAN2",
    np.logical_and: "AND",
    np.logical_or: "OR",
    np.logical_not: "NOT",
    np.negative: "NEG",
    np.absolute: "FABS",
    np.sqrt: "SQRT",
    np.square: "SQ",
    np.sin: "SIN",
    np.cos: "COS",
    np.exp: "EXP",
    np.log: "LOG",
}
"""CasADi's names for the elementwise functions that criteria use."""
SWAPPED = {np.greater: np.less, np.greater_equal: np.less_equal}  # equal to these with swapped arguments
NUMBERS = (int, float, np.number, np.bool_)


def lift(value: Any, size: int | tuple[int, ...]) -> Any:
    """Return a CasADi value (SX or MX) as an array of symbols that NumPy functions accept.

    size  number of entries of a column, or a shape with at most two axes

    It works in CasADi's default mode; ``setNumpyMode``, which would change the whole process, is not called.
    """
    return _symbols_of(value, (size,) if isinstance(size, int) else tuple(size))


class Symbols(NDArrayOperatorsMixin):
    """Array of CasADi symbols: a column (M,), or a matrix if it has two axes.

    ``casadi.ArrayInterface`` implements NumPy's array protocol and does most of the work here. The most frequent calls,
    elementwise functions of numbers and of columns of one shape, go to CasADi directly. CasADi's Python operators would
    first try to convert their arguments to several types, which takes 18 of the 20 microseconds of an operation.
    """

    __slots__ = ("_array", "_value", "shape")

    def __init__(self, shape: tuple[int, ...], value: Any = None, array: Any = None) -> None:
        self.shape, self._value, self._array = shape, value, array

    def to_casadi(self) -> Any:
        """Return the symbols as SX or MX: of shape (M, 1) for a column, (P, M) for a matrix."""
        if self._value is None:
            self._value = self._array.to_casadi()
        return self._value

    def to_array(self) -> Any:
        """Return the symbols as a ``casadi.ArrayInterface``."""
        if self._array is None:
            import casadi

            two = len(self.shape) == 2
            array: Any = casadi.ArrayInterface
            kind = array.SX if isinstance(self._value, casadi.SX) else array.MX
            self._array = (
                array(self._value) if two and self._value.shape == self.shape else kind(self._value, self.shape)
            )
        return self._array

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """Apply one of NumPy's elementwise functions; the mixin turns operators such as + into these."""
        if method == "__call__" and not options:
            if ufunc in SWAPPED:
                ufunc, inputs = SWAPPED[ufunc], inputs[::-1]
            if ufunc in OPERATIONS and (operands := self._casadi_arguments(inputs)):
                kind, code = type(self.to_casadi()), _casadi_codes()[ufunc]
                return _symbols_of((kind.unary if len(operands) == 1 else kind.binary)(code, *operands), self.shape)
        return _wrap_result(getattr(ufunc, method)(*_interface_argument(inputs), **options))

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """Apply one of NumPy's other functions, such as ``np.where``."""
        if (
            function is np.where
            and not options
            and len(arguments) == 3
            and (operands := self._casadi_arguments(arguments))
        ):
            import casadi

            condition, chosen, otherwise = operands
            return _symbols_of(casadi.if_else(condition, chosen, otherwise), self.shape)
        return _wrap_result(
            function(
                *_interface_argument(arguments),
                **{name: _interface_argument(option) for name, option in options.items()},
            )
        )

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        """Raise an error, because symbols are not numbers."""
        return self.to_array().__array__(dtype, copy)

    def __getitem__(self, key: Any) -> Any:
        return _wrap_result(self.to_array()[key])

    def __len__(self) -> int:
        return len(self.to_array())

    def __bool__(self) -> bool:
        raise TypeError(
            "a condition must not depend on CasADi symbols, which are neither true nor false; use np.where, np.maximum "
            "or np.minimum instead of if"
        )

    def __getattr__(self, name: str) -> Any:
        """Return another attribute that arrays have, such as ``sum`` or ``reshape``."""
        if name.startswith("_"):
            raise AttributeError(name)
        member = getattr(self.to_array(), name)
        return (
            (lambda *args, **options: _wrap_result(member(*args, **options)))
            if callable(member)
            else _wrap_result(member)
        )

    def _casadi_arguments(self, inputs: Any) -> list[Any]:
        """Return arguments as CasADi values if all are numbers or columns of this shape; otherwise return []."""
        if len(self.shape) > 1:
            return []
        operands = []
        for argument in inputs:
            if isinstance(argument, Symbols) and argument.shape == self.shape:
                operands.append(argument.to_casadi())
            elif isinstance(argument, NUMBERS):
                operands.append(float(argument))
            elif isinstance(argument, np.ndarray) and argument.shape == self.shape and argument.dtype.kind in "fiub":
                operands.append(type(self.to_casadi())(_numbers(argument)))
            else:
                return []
        return operands


class SymbolsSX(Symbols):
    """Array of symbols of CasADi's type SX; CasADi's functions accept it as SX."""

    __slots__ = ()

    def __SX__(self) -> Any:  # noqa: N802
        return self.to_casadi()


class SymbolsMX(Symbols):
    """Array of symbols of CasADi's type MX; CasADi's functions accept it as MX."""

    __slots__ = ()

    def __MX__(self) -> Any:  # noqa: N802
        return self.to_casadi()


def _symbols_of(value: Any, shape: tuple[int, ...]) -> Symbols:
    return (SymbolsSX if type(value).__name__ == "SX" else SymbolsMX)(shape, value)


@cache
def _casadi_codes() -> dict[Any, int]:
    import casadi

    return {function: getattr(casadi, f"OP_{name}") for function, name in OPERATIONS.items()}


def _numbers(array: Any) -> Any:
    import casadi

    return casadi.DM(array.astype(float))


def _interface_argument(argument: Any) -> Any:
    """Return an argument with symbols as ``casadi.ArrayInterface``, also within lists and tuples."""
    if isinstance(argument, Symbols):
        return argument.to_array()
    return type(argument)(map(_interface_argument, argument)) if type(argument) in (list, tuple) else argument


def _wrap_result(result: Any) -> Any:
    """Return a result with each ``casadi.ArrayInterface`` as :class:`Symbols`, also within lists and tuples."""
    name = type(result).__name__
    if name in ("ArrayInterfaceSX", "ArrayInterfaceMX"):
        return (SymbolsSX if name.endswith("SX") else SymbolsMX)(result.shape, array=result)
    return type(result)(map(_wrap_result, result)) if type(result) in (list, tuple) else result


def sum_over_rows(function: Callable[..., Any], rows: Sequence[Sequence[float]], *columns: Any) -> Any:
    """Return the sum (M,) of ``function(*row, *columns)`` over all rows.

    rows     sequences of numbers, one for each term of the sum
    columns  columns (M,) or numbers

    For symbolic columns the function is called once, for a single entry of the columns, and CasADi maps this expression
    over rows and entries. So the expression stays small.
    """
    symbolic = [column for column in columns if not isinstance(column, (*NUMBERS, np.ndarray))]
    if not symbolic:
        return sum(function(*row, *columns) for row in rows)
    import casadi

    moment = [casadi.SX.sym("moment") for _ in symbolic]
    numbers = [casadi.SX.sym("number") for _ in rows[0]]
    alone = (lift(symbol, 1) for symbol in moment)
    own = [column if isinstance(column, (*NUMBERS, np.ndarray)) else next(alone) for column in columns]
    value = function(*(lift(number, 1) for number in numbers), *own)
    term = casadi.Function("term", [*numbers, *moment], [value.to_casadi()])
    terms = term.map(len(rows))(
        *(casadi.DM(list(row)).T for row in zip(*rows, strict=True)),
        *(casadi.repmat(symbol, 1, len(rows)) for symbol in moment),
    )
    total = casadi.Function("total", moment, [casadi.sum2(terms)])
    shape = symbolic[0].shape
    values = total.map(shape[0])(*(casadi.vec(column.to_casadi()).T for column in symbolic)).T
    return lift(values, shape)
