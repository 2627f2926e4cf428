"""Signatures as a reader would write them, for autodoc.

A default that a dataclass makes anew each time is ``...`` (Sphinx cannot read ``<factory>`` and would print the types
beside it raw), arrays go by the names of :mod:`hpop.base.arrays`, parameters with an underscore are private,
and what a named tuple says of its own fields ("Alias for field number 0") is left out.
"""

from __future__ import annotations

import re
from collections import namedtuple
from typing import Any

from sphinx.application import Sphinx

ARRAY = re.compile(
    r"~?(?:numpy\.)?ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[~?(?:numpy\.)?(\w+)\]\]"
)
ARRAYS = {"float64": "FloatArray", "int64": "IntArray", "bool": "BoolArray", "bool_": "BoolArray"}
PRIVATE = re.compile(r", _\w+: .*?(?=, \w+:|\)$)")
GETTER = type(namedtuple("One", "one").one)  # what reads a field of a named tuple


def written(text: str) -> str:
    """Return a signature, or a type, as the site shows it.

    >>> written("(x: ~numpy.ndarray[tuple[~typing.Any, ...], ~numpy.dtype[~numpy.float64]], _kept: dict = <factory>)")
    '(x: FloatArray)'
    """
    text = ARRAY.sub(lambda found: ARRAYS.get(found[1], found[0]), text)
    return PRIVATE.sub("", text.replace("<factory>", "..."))


def on_signature(
    app: Sphinx, what: str, name: str, found: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Rewrite a signature and what is returned."""
    return signature and written(signature), returned and written(returned)


def is_left_out(app: Sphinx, what: str, name: str, found: Any, skip: bool, options: Any) -> bool | None:
    """Leave out members without a docstring."""
    return True if isinstance(found, GETTER) else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite what autodoc reads."""
    app.connect("autodoc-process-signature", on_signature)
    app.connect("autodoc-skip-member", is_left_out)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
