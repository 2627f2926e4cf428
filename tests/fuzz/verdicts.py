"""What is said of an input: it is accepted, or refused with a message that a person can be shown."""

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
    """A refusal, if its text is short and says nothing to the terminal but words."""
    if len(text) > LONGEST:
        raise Wrong("a message of thousands of characters")
    found = CONTROLS.search(text)
    if found:
        raise Wrong(f"the control character {found[0]!r} in a message")
    return "refused"


def asked(question: Callable[[], Any]) -> str:
    """What becomes of a question: an answer, or an error meant for the user."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            question()
    except REFUSALS as error:
        return str(error)
    return ""


def verdict(question: Callable[[], Any]) -> str:
    """ "accepted", or "refused" with a message that can be shown."""
    message = asked(question)
    return shown(message) if message else "accepted"
