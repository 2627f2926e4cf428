"""What the pages of a study keep to, and tell participants before anything else."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arguments import checked_arguments
from hpop.base.options import real
from hpop.base.text import HARMFUL
from hpop.errors import StudyError

MOST_TEXT = 20_000
"""Characters of a text that participants read."""
LONGEST = 3600
"""Seconds of a rest."""
STOP_RULE = (
    "You may stop at any time, without a reason and without disadvantage. Stop at once if you feel unwell: you need "
    "not wait for the end of a ride."
)


@checked_arguments
@dataclass(frozen=True)
class Protocol:
    """What is kept to between stimuli.

    rest_s     s, rest after each stimulus, at least; longer, until the participant feels as before
    stop_rule  what a participant is told about stopping; this default is told in the language of the pages
    """

    rest_s: float = 180.0
    stop_rule: str = STOP_RULE

    def __post_init__(self) -> None:
        rest = real("rest_s", self.rest_s, 0, LONGEST, "a time in s", error=StudyError)
        object.__setattr__(self, "rest_s", float(rest))
        checked_text("the stop rule", self.stop_rule)


def checked_text(what: str, text: object) -> str:
    """A text that participants read, as it is: StudyError where it is empty, endless, or would steer a screen."""
    if not isinstance(text, str) or not text.strip():
        raise StudyError(f"{what} is empty: write what participants read, and agree to, before they begin")
    if len(text) > MOST_TEXT:
        raise StudyError(f"{what} has {len(text):,} characters; expected at most {MOST_TEXT:,}")
    if harmful := HARMFUL.search(text.replace("\n", " ").replace("\t", " ")):
        raise StudyError(f"{what} has a control character, {harmful[0]!a}; write plain text")
    return text
