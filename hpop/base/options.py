"""Checks of numbers that users enter: each number is checked once, against bounds stated here.

The bounds are wide: they refuse only values that no robot and no building has. No value within them overflows, divides
by zero or makes a computation endless.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from math import nan, radians
from numbers import Integral
from typing import Annotated, Any, TypeVar

from hpop.base.scalars import is_number, is_whole, python_value
from hpop.base.text import shown
from hpop.errors import HpopError, OptionError, did_you_mean

T = TypeVar("T")

LEAST = 1e-6
"""Least length, time, speed, ..., SI units: the default quantum of costs, below which nothing differs."""
MOST = 1e6
"""Greatest length, time, speed, factor, ..., SI units: maps are at most 1,000 km long."""
FARTHEST = 1e8
"""Greatest coordinate, m: map projections of the earth stay below 5e7, where a double is exact to 15 nm."""
MOST_SEED = 2**63 - 1
"""Greatest seed of random numbers."""
MOST_WORKERS = 1024
"""Greatest number of processes, above the cores of any machine."""
EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?e[-+]?\d+", re.IGNORECASE)
"""Pattern of numbers such as 1e-3, which YAML 1.1 reads as text."""
MOST_COUNTED = 2**60
"""Greatest count: no cost of a path is larger, and sums of a few counts fit 64 bits."""


class Degrees:
    """Marker of an angle in rad that scenario files may also give as text, such as "90 deg"."""

    TEXT = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*deg\s*")

    @classmethod
    def in_radians(cls, value: Any) -> Any:
        """Return the angle, rad, of a text in degrees; other values unchanged.

        >>> Degrees.in_radians("180 deg"), Degrees.in_radians("half a turn"), Degrees.in_radians(0.5)
        (3.141592653589793, 'half a turn', 0.5)
        """
        match = cls.TEXT.fullmatch(value) if isinstance(value, str) else None
        return radians(float(match.group(1))) if match else value

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON schema of such a text, for editors."""
        return {"type": "string", "pattern": f"^{cls.TEXT.pattern}$"}

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(cls.in_radians, handler(source))

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> Any:
        return {"anyOf": [handler(schema), cls.json_schema()]}


Angle = Annotated[float, Degrees]


class BesideScenario:
    """Marker of a path that is relative to the folder of its scenario file."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        def joined(path: Any, info: Any) -> Any:
            folder = (info.context or {}).get("folder", "")
            return os.path.join(folder, path) if isinstance(path, str) and path else path

        return core_schema.with_info_before_validator_function(joined, handler(source))

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> Any:
        return {**handler(schema), "type": "string"}


GivenPath = Annotated[str, BesideScenario]


def real(
    name: str,
    value: Any,
    least: float,
    most: float,
    kind: str = "a number",
    *,
    hint: str = "",
    error: type[HpopError] = OptionError,
) -> float:
    """Return a finite number within bounds; otherwise raise an error that says what was expected.

    NumPy's numbers become Python's. ``hint`` is added to the message.

    >>> real("step", 0.25, LEAST, MOST, "a length in m")
    0.25
    >>> real("step", True, LEAST, MOST, "a length in m")
    Traceback (most recent call last):
    hpop.errors.OptionError: step must be a length in m from 1e-06 to 1,000,000, got True
    """
    number: Any = python_value(value) if is_number(value) else nan
    if not least <= number <= most:
        text = isinstance(value, str) and EXPONENT.fullmatch(value)
        hints = [hint, "YAML reads 1e-3 as text: write 0.001 or 1.0e-3" if text else ""]
        ending = "".join(f"; {advice}" for advice in hints if advice)
        raise error(f"{name} must be {kind} {_bounds_text(least, most, number > most)}, got {shown(value)}{ending}")
    return number if isinstance(number, int) else float(number)


def whole(
    name: str,
    value: Any,
    least: int,
    most: int = MOST_COUNTED,
    kind: str = "a whole number",
    *,
    hint: str = "",
    error: type[HpopError] = OptionError,
) -> int:
    """Return a whole number within bounds; otherwise raise an error that says what was expected.

    ``hint`` is added to the message.

    >>> whole("samples", 2**63, 1, 1000)
    Traceback (most recent call last):
    hpop.errors.OptionError: samples must be a whole number from 1 to 1,000, got 9223372036854775808
    """
    number: Any = python_value(value) if is_whole(value) else nan
    if not least <= number <= most:
        ending = f"; {hint}" if hint else ""
        raise error(f"{name} must be {kind} {_bounds_text(least, most, number > most)}, got {shown(value)}{ending}")
    return int(number)


def one_of(name: str, value: Any, choices: Iterable[T], *, error: type[HpopError] = OptionError) -> T:
    """Return a value that is one of the choices (words or whole numbers), or raise an error that lists the choices.

    >>> one_of("headings", 5, (4, 8, 16))
    Traceback (most recent call last):
    hpop.errors.OptionError: headings must be one of 4, 8, 16, got 5
    """
    known, value = tuple(choices), python_value(value)
    for choice in known:
        if isinstance(value, str | Integral) and not isinstance(value, bool) and value == choice:
            return choice
    near = did_you_mean(value, [choice for choice in known if isinstance(choice, str)])
    if near:
        raise error(f"{name} is {shown(value)}.{near} It must be one of {', '.join(map(str, known))}")
    raise error(f"{name} must be one of {', '.join(map(str, known))}, got {shown(value)}")


def truth(name: str, value: Any, *, error: type[HpopError] = OptionError) -> bool:
    """Return a truth value of Python or NumPy as Python's ``bool``, or raise an error that says what was expected.

    >>> truth("corner_cutting", 1)
    Traceback (most recent call last):
    hpop.errors.OptionError: corner_cutting must be true or false, got 1
    """
    flag = python_value(value)
    if not isinstance(flag, bool):
        raise error(f"{name} must be true or false, got {shown(value)}")
    return flag


def amounts(name: str, given: Any, most: float, what: str = "amounts") -> dict[str, float]:
    """Return a checked dictionary from names of costs to numbers >= 0; the names are checked later, against a problem.

    >>> amounts("tolerance", 0.1, MOST)
    Traceback (most recent call last):
    hpop.errors.OptionError: tolerance gives amounts by the name of a cost, such as {'length': 0.1}, got 0.1
    """
    if not isinstance(given, Mapping):
        raise OptionError(f"{name} gives {what} by the name of a cost, such as {{'length': 0.1}}, got {shown(given)}")
    return {cost: real(f"{name} of {cost}", amount, 0, most) for cost, amount in given.items()}


def set_reals(
    owner: object, *names: str, least: float, most: float, kind: str, error: type[HpopError] = OptionError
) -> None:
    """Check attributes of a frozen dataclass as :func:`real` does, and set them to Python floats."""
    for name in names:
        object.__setattr__(owner, name, real(name, getattr(owner, name), least, most, kind, error=error))


def set_wholes(
    owner: object,
    *names: str,
    least: int,
    most: int = MOST_COUNTED,
    kind: str = "a whole number",
    optional: bool = False,
    error: type[HpopError] = OptionError,
) -> None:
    """Check attributes of a frozen dataclass as :func:`whole` does, and set them to Python ints.

    ``optional`` ones may be None.
    """
    for name in names:
        if optional and getattr(owner, name) is None:
            continue
        object.__setattr__(owner, name, whole(name, getattr(owner, name), least, most, kind, error=error))


def _bounds_text(least: float, most: float, beyond: bool) -> str:
    """Return the bounds of a number in words.

    A very large upper bound is left out unless the number exceeds it (``beyond``).
    """
    return (
        f"of at least {_bound_text(least)}"
        if most >= MOST_COUNTED and not beyond
        else f"from {_bound_text(least)} to {_bound_text(most)}"
    )


def _bound_text(bound: float) -> str:
    return f"{int(bound):,}" if bound == int(bound) else f"{bound:.6g}"
