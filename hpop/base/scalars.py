"""Conversion of scalars of NumPy and pandas, and of arrays without axes, to Python's numbers."""

from __future__ import annotations

from dataclasses import fields
from numbers import Integral, Real
from typing import Any


def python_value(value: Any) -> Any:
    """Return the Python value of a NumPy scalar or of an array without axes; return other values unchanged.

    NumPy itself is not imported: any object with the shape ``()`` and a method ``item`` is such a value.

    >>> import numpy as np
    >>> python_value(np.int64(3)), python_value(np.array(0.5)), python_value(np.True_), python_value("3")
    (3, 0.5, True, '3')
    """
    if isinstance(value, bool | int | str) or type(value) is float:
        return value
    shape = getattr(value, "shape", None)
    return value.item() if isinstance(shape, tuple) and not shape and callable(getattr(value, "item", None)) else value


def is_number(value: Any) -> bool:
    """Return whether a value is a single real number, of Python or NumPy; True and False are not.

    >>> import numpy as np
    >>> [is_number(value) for value in (1, np.float32(0.5), np.array(2), True, np.True_, "1", None)]
    [True, True, True, False, False, False, False]
    """
    value = python_value(value)
    return isinstance(value, Real) and not isinstance(value, bool)


def is_whole(value: Any) -> bool:
    """Return whether a value is a single whole number, of Python or NumPy; True and False are not.

    >>> import numpy as np
    >>> [is_whole(value) for value in (1, np.int64(2), np.array(2), 1.0, True, np.True_)]
    [True, True, True, False, False, False]
    """
    value = python_value(value)
    return isinstance(value, Integral) and not isinstance(value, bool)


def set_python_values(owner: Any) -> None:
    """Replace NumPy scalars in the fields of a frozen dataclass by Python's numbers, in its ``__post_init__``."""
    for field in fields(owner):
        value = getattr(owner, field.name)
        if (number := python_value(value)) is not value:
            object.__setattr__(owner, field.name, number)
