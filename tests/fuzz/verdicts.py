"""Verdict on an input: accepted, or refused with a message that is fit for users."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any

from harness import Wrong

from hpop.errors import HpopError
from hpop.frontier.points import FrontError

REFUSALS = (HpopError, FrontError)
LONGEST = 4000  # characters of a message
CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def shown(text: str) -> str:
    """Return a refusal if its text is short and free of control characters."""
    if len(text) > LONGEST:
        raise Wrong("a message of thousands of characters")
    found = CONTROLS.search(text)
    if found:
        raise Wrong(f"the control character {found[0]!r} in a message")
    return "refused"


def asked(question: Callable[[], Any]) -> str:
    """Call a function and say "accepted", or "refused" for an error that is meant for the user."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            question()
    except REFUSALS as error:
        return str(error)
    return ""


def verdict(question: Callable[[], Any]) -> str:
    """Return "accepted", or "refused" with a message that is fit for users."""
    message = asked(question)
    return shown(message) if message else "accepted"
