"""Text for people out of what comes from files and callers: short whatever its size, and harmless to a terminal."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from itertools import islice
from math import log10
from reprlib import Repr
from typing import Any

HARMFUL = re.compile(
    "[\x00-\x1f\x7f-\x9f\u00ad\u034f\u061c\u115f\u1160\u180b-\u180f\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\u3164"
    "\ud800-\udfff\ufeff\uffa0\ufff9-\ufffb\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e007f]"
    "|(?:(?<=[\x00-\u024f])|^)[\u200c\u200d]|[\u200c\u200d](?=[\x00-\u024f]|$)"
)
"""Control characters, what turns the direction of writing, what separates lines, halves of surrogate pairs, and what is
not seen; joiners only where they join no letters of Persian or Hindi, and no emoji."""
LENGTH = 80
"""Characters of a value that a message shows, at most."""


def printable(text: object, *, newlines: bool = False) -> str:
    r"""Return text that can be printed: what would steer a terminal or reorder a line is written as its escape.

    >>> print(printable("Käthe \x1b[2J \u202e!"))
    Käthe \x1b[2J \u202e!
    """
    return HARMFUL.sub(lambda found: "\n" if newlines and found[0] == "\n" else ascii(found[0])[1:-1], str(text))


def argument(path: str | os.PathLike[str]) -> str:
    r"""Return a path as an argument of a printed command, quoted where the shell needs it.

    Control characters are escaped in quotes of bash ($'...'), so that a command stays on its line.

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
    """Return a repr for a message, short whatever the value: it may be huge, an alias of an alias, or fail to print.

    >>> shown([1, "two"]), shown("x" * 1000, 20)
    ("[1, 'two']", "'xxxxxxx...xxxxxxxx'")
    >>> shown({"b": 1, "a": {"c": {"d": {"e": 2}}}})
    "{'b': 1, 'a': {'c': {'d': {...}}}}"
    >>> shown(10**5000)
    'a whole number of 5,001 digits'
    """
    try:
        text = _Short(most).repr(value)
    except Exception:  # a repr of the caller's own
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= most else text[: most - 3] + "..."


def article(noun: str) -> str:
    """Return a noun with its indefinite article, by its first letter.

    >>> article("yaw"), article("upper_arm_roll")
    ('a yaw', 'an upper_arm_roll')
    """
    return f"a{'n' * (noun[:1].lower() in set('aeiou'))} {noun}"


def counted(number: int, noun: str) -> str:
    """Return so many of a noun whose plural ends in s.

    >>> counted(1, "path"), counted(1200, "path")
    ('1 path', '1,200 paths')
    """
    return f"{number:,} {noun}{'s' * (number != 1)}"


def some(several: Sequence[str], most: int = 4) -> str:
    """Return the first few in a row, and how many others there are.

    >>> some(["Ada", "Ben"]), some(["Ada", "Ben", "Cleo", "Dan", "Eve"], 3)
    ('Ada, Ben', 'Ada, Ben, Cleo and 2 others')
    """
    others = f" and {counted(len(several) - most, 'other')}" if len(several) > most else ""
    return ", ".join(several[:most]) + others


class _Short(Repr):
    """Reprs that look at a few entries and levels only."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdict = 8
        self.maxstring = self.maxother = most
        self.maxlong = 40

    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        """Return the representation of a dictionary, in the order of its keys."""
        if level <= 0 and x:
            return "{...}"
        pieces = [f"{self.repr1(key, level - 1)}: {self.repr1(x[key], level - 1)}" for key in islice(x, self.maxdict)]
        return f"{{{', '.join([*pieces, *['...'] * (len(x) > self.maxdict)])}}}"

    def repr_int(self, x: int, level: int) -> str:
        """Return the representation of a number, also of one that Python does not print."""
        if x.bit_length() > 10_000:
            return f"a whole number of {int(x.bit_length() * log10(2)) + 1:,} digits"
        return super().repr_int(x, level)
