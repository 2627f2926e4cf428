"""Values and faults of calls as text for messages, short and printable, and values as Python's numbers."""

from __future__ import annotations

import inspect
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from itertools import islice
from math import log10
from numbers import Integral, Real
from reprlib import Repr
from typing import Any

HARMFUL = re.compile(
    "[\x00-\x1f\x7f-\x9f\u00ad\u034f\u061c\u115f\u1160\u180b-\u180f\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\u3164"
    "\ud800-\udfff\ufeff\uffa0\ufff9-\ufffb\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e007f]"
    "|(?:(?<=[\x00-\u024f])|^)[\u200c\u200d]|[\u200c\u200d](?=[\x00-\u024f]|$)"
)
"""Pattern of characters that would control a terminal or mislead a reader. It matches control characters, marks of
writing direction, line separators, halves of surrogate pairs, and invisible characters, including joiners unless they
are between letters of Persian or Hindi, or within emoji."""
LENGTH = 80
"""Largest number of characters of a value in a message."""


def printable(text: object, *, newlines: bool = False) -> str:
    r"""Return a text in which characters that would control a terminal or reorder a line are escaped.

    With ``newlines``, line breaks stay as they are.

    >>> print(printable("Käthe \x1b[2J \u202e!"))
    Käthe \x1b[2J \u202e!
    """
    return HARMFUL.sub(lambda match: "\n" if newlines and match[0] == "\n" else ascii(match[0])[1:-1], str(text))


def argument(path: str | os.PathLike[str]) -> str:
    r"""Return a path as an argument of a shell command that is printed for the user, quoted if the shell needs it.

    Control characters are escaped in quotes of bash ($'...'), so that the command stays on one line.

    >>> print(argument("floor.yaml"), argument("ground floor.yaml"), argument("-a.yaml"), argument("a\nb"))
    floor.yaml 'ground floor.yaml' ./-a.yaml $'a\nb'
    """
    text = os.fspath(path)
    text = f"./{text}" if text.startswith("-") else text
    if not HARMFUL.search(text):
        return shlex.quote(text)
    escaped = (ascii(c)[1:-1] if HARMFUL.match(c) else f"\\{c}" if c in "\\'" else c for c in text)
    return f"$'{''.join(escaped)}'"


def shown(value: Any, most: int = LENGTH) -> str:
    """Return a short repr of a value for a message; this works for huge and nested values, and if their repr fails.

    >>> shown([1, "two"]), shown("x" * 1000, 20)
    ("[1, 'two']", "'xxxxxxx...xxxxxxxx'")
    >>> shown({"b": 1, "a": {"c": {"d": {"e": 2}}}})
    "{'b': 1, 'a': {'c': {'d': {...}}}}"
    >>> shown(10**5000)
    'a whole number of 5,001 digits'
    """
    try:
        text = _ShortRepr(most).repr(value)
    except Exception:  # the caller's own repr failed
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= most else text[: most - 3] + "..."


def article(noun: str) -> str:
    """Return a noun with its indefinite article, by its first letter.

    >>> article("yaw"), article("upper_arm_roll")
    ('a yaw', 'an upper_arm_roll')
    """
    return f"a{'n' if noun[:1].lower() in set('aeiou') else ''} {noun}"


def counted(number: int, noun: str) -> str:
    """Return a number and its noun as text, with a plural s unless the number is 1.

    >>> counted(1, "path"), counted(1200, "path")
    ('1 path', '1,200 paths')
    """
    return f"{number:,} {noun}{'s' if number != 1 else ''}"


def some(several: Sequence[str], most: int = 4) -> str:
    """Return the first few of several names, followed by the number of the remaining names.

    >>> some(["Ada", "Ben"]), some(["Ada", "Ben", "Cleo", "Dan", "Eve"], 3)
    ('Ada, Ben', 'Ada, Ben, Cleo and 2 others')
    """
    others = f" and {counted(len(several) - most, 'other')}" if len(several) > most else ""
    return ", ".join(several[:most]) + others


class _ShortRepr(Repr):
    """Maker of short reprs, with only a few entries and levels of nested values."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdict = 8
        self.maxstring = self.maxother = most
        self.maxlong = 40

    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        """Return the short repr of a dictionary, in the order of its keys."""
        if level <= 0 and x:
            return "{...}"
        pieces = [f"{self.repr1(key, level - 1)}: {self.repr1(x[key], level - 1)}" for key in islice(x, self.maxdict)]
        return f"{{{', '.join([*pieces, *['...'] * (len(x) > self.maxdict)])}}}"

    def repr_int(self, x: int, level: int) -> str:
        """Return the repr of a whole number; for one too long for Python to print, return its number of digits."""
        if x.bit_length() > 10_000:
            return f"a whole number of {int(x.bit_length() * log10(2)) + 1:,} digits"
        return super().repr_int(x, level)


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


def call_fault(signature: inspect.Signature, args: Sequence[Any], kwargs: Mapping[str, Any]) -> str:
    """Return what is wrong with a call that has an unknown or a surplus argument; "" if it has neither."""
    known = [name for name in signature.parameters if name not in ("self", "cls")]
    if unknown := next((name for name in kwargs if name not in known), ""):
        near = "".join(f" Did you mean {name!r}?" for name in get_close_matches(unknown, known, n=1))
        return f"there is no argument {unknown!r}.{near} Its arguments: {', '.join(known)}"
    placed = [name for name in known if signature.parameters[name].kind is not inspect.Parameter.KEYWORD_ONLY]
    values = args[len(signature.parameters) - len(known) :]
    if len(values) <= len(placed):
        return ""
    rest = f"; give others by name: {', '.join(known[len(placed) :])}" if len(known) > len(placed) else ""
    if len(placed) == 1 and all(map(is_number, values)):
        rest = f"; put them in brackets: ({', '.join(map(shown, values))})"
    most = counted(len(placed), "argument")
    return f"expected at most {most} without a name ({', '.join(placed)}), got {len(values)}{rest}"
