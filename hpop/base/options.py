"""Checks of options that users set: numbers within bounds, choices, paths.

The bounds are wide and exclude only values that no robot and no building has. No value within them overflows, divides
by zero or makes a computation endless.
"""

from __future__ import annotations

import os
import re
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from math import nan, radians
from numbers import Integral
from typing import Annotated, Any, TypeVar, cast

from hpop.base.text import is_number, is_whole, python_value, shown
from hpop.errors import HpopError, OptionError, did_you_mean

T = TypeVar("T")

LEAST = 1e-6
"""Smallest length, time, speed etc., in SI units; costs that differ by less count as equal by default."""
MOST = 1e6
"""Largest length, time, speed, factor etc., in SI units; maps are at most 1,000 km long."""
FARTHEST = 1e8
"""Largest coordinate, m; map projections of the earth stay below 5e7, where a float64 is exact to 15 nm."""
MOST_SEED = 2**63 - 1
"""Largest seed of random numbers."""
MOST_WORKERS = 1024
"""Largest number of processes; no machine has so many cores."""
EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?e[-+]?\d+", re.IGNORECASE)
"""Pattern of numbers such as 1e-3, which YAML 1.1 reads as text."""
MOST_COUNTED = 2**60
"""Largest count; no cost of a path is larger, and sums of a few such counts fit into 64 bits."""


class Degrees:
    """Marker in type hints for an angle in rad, which scenario files may also give as text, such as "90 deg"."""

    TEXT = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*deg\s*")

    @classmethod
    def in_radians(cls, value: Any) -> Any:
        """Return the angle, rad, of a text such as "90 deg"; return any other value unchanged.

        >>> Degrees.in_radians("180 deg"), Degrees.in_radians("half a turn"), Degrees.in_radians(0.5)
        (3.141592653589793, 'half a turn', 0.5)
        """
        match = cls.TEXT.fullmatch(value) if isinstance(value, str) else None
        return radians(float(match.group(1))) if match else value

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON schema of a text such as "90 deg", for editors."""
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
    """Marker in type hints for a path, which in a scenario file is relative to the file's folder."""

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
    """Check that an option is a number from ``least`` to ``most``, and return it as a Python number.

    Otherwise raise ``error``: "NAME must be KIND from LEAST to MOST, got VALUE; HINT".

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
    """Check that an option is a whole number from ``least`` to ``most``, and return it as a Python int.

    Otherwise raise ``error``: "NAME must be KIND from LEAST to MOST, got VALUE; HINT".

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
    """Check that an option is one of the choices (strings or whole numbers), and return it.

    Otherwise raise ``error``, which lists the choices and names a similar one.

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
        raise error(f"{name} must be one of {', '.join(map(str, known))}, got {shown(value)}.{near}")
    raise error(f"{name} must be one of {', '.join(map(str, known))}, got {shown(value)}")


def truth(name: str, value: Any, *, error: type[HpopError] = OptionError) -> bool:
    """Check that an option is true or false (of Python or NumPy), and return it as a Python bool.

    >>> truth("corner_cutting", 1)
    Traceback (most recent call last):
    hpop.errors.OptionError: corner_cutting must be true or false, got 1
    """
    flag = python_value(value)
    if not isinstance(flag, bool):
        raise error(f"{name} must be true or false, got {shown(value)}")
    return flag


def amounts(name: str, given: Any, most: float, what: str = "amounts") -> dict[str, float]:
    """Check that an option maps names of costs to numbers from 0 to ``most``, and return it as a dict.

    The names are not checked here, since they depend on the problem. ``what`` says in a message what the numbers are.

    >>> amounts("tolerance", 0.1, MOST)
    Traceback (most recent call last):
    hpop.errors.OptionError: tolerance must map names of costs to amounts, such as {'length': 0.1}, got 0.1
    """
    if not isinstance(given, Mapping):
        raise OptionError(f"{name} must map names of costs to {what}, such as {{'length': 0.1}}, got {shown(given)}")
    return {cost: real(f"{name} of {cost}", amount, 0, most) for cost, amount in given.items()}


def set_reals(
    owner: object, *names: str, least: float, most: float, kind: str, error: type[HpopError] = OptionError
) -> None:
    """Check some attributes of a frozen dataclass by :func:`real`, and set them to Python numbers."""
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
    """Check some attributes of a frozen dataclass by :func:`whole`, and set them to Python ints.

    If they are ``optional``, they may be None.
    """
    for name in names:
        if optional and getattr(owner, name) is None:
            continue
        object.__setattr__(owner, name, whole(name, getattr(owner, name), least, most, kind, error=error))


def _bounds_text(least: float, most: float, beyond: bool) -> str:
    """Return the bounds of a number in words: "from 0 to 10".

    A very large upper bound is left out, unless the number is ``beyond`` it.
    """
    return (
        f"of at least {_bound_text(least)}"
        if most >= MOST_COUNTED and not beyond
        else f"from {_bound_text(least)} to {_bound_text(most)}"
    )


def _bound_text(bound: float) -> str:
    """Return one bound as text: 1000000.0 as "1,000,000"."""
    return f"{int(bound):,}" if bound == int(bound) else f"{bound:.6g}"


def identity(value: Any) -> Hashable:
    """Return a hashable key that is equal for equal immutable values; for a dataclass, its type and all its fields.

    Raises TypeError for a value that cannot be hashed, and for a dataclass that is not frozen.
    """
    if not is_dataclass(value):
        hash(value)
        return cast(Hashable, value)
    declared = vars(type(value)).get("__dataclass_params__")  # a subclass may hold more than fields
    if declared is None or not declared.frozen:
        raise TypeError(f"{type(value).__name__} may change")
    return type(value), *(identity(getattr(value, field.name)) for field in fields(value))
