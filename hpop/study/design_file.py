"""Files of a design: design.json, which never changes, and people.json with the participants who left."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from hpop.base.arguments import checked_arguments
from hpop.base.options import real
from hpop.base.text import HARMFUL
from hpop.errors import StudyError
from hpop.study.documents import StrictObject, read
from hpop.study.participants import ID, MOST, MOST_STIMULI, Departure

FILE, PEOPLE, FRONT, SCHEDULE = "design.json", "people.json", "front.json", "schedule.csv"
MOST_BYTES = 8 * 1024**2

Letter = Annotated[str, StringConstraints(pattern="^[A-Z]$")]
Id = Annotated[str, StringConstraints(pattern=f"^{ID.pattern}$")]
Digest = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
Short = Annotated[str, StringConstraints(max_length=200)]


class FrontPart(StrictObject):
    """JSON form of the study's front: its file and SHA-256."""

    file: Literal["front.json"]
    sha256: Digest


class ConditionPart(StrictObject):
    """JSON form of :class:`hpop.study.Condition`."""

    id: Letter
    row: Annotated[int, Field(ge=0)] | None
    name: Short
    kind: Literal["ride", "video", "view"]
    costs: Annotated[dict[Short, float], Field(max_length=100)]
    duration: Annotated[float, Field(gt=0)]


class ParticipantPart(StrictObject):
    """JSON form of :class:`hpop.study.Participant`."""

    id: Id
    order: Annotated[list[Letter], Field(min_length=2, max_length=MOST_STIMULI)]
    strata: Annotated[dict[Short, Short], Field(max_length=10)]


class ProtocolPart(StrictObject):
    """JSON form of :class:`hpop.study.Protocol`."""

    rest_s: float
    stop_rule: str


class DesignFile(StrictObject):
    """Schema of design.json."""

    schema_: Annotated[Literal["hpop-study"], Field(alias="schema")]
    version: Literal[1]
    front: FrontPart
    seed: Annotated[int, Field(ge=0)]
    order: Literal["permutations", "williams", "latin", "random"]
    language: Short
    conditions: Annotated[list[ConditionPart], Field(min_length=2, max_length=MOST_STIMULI)]
    participants: Annotated[list[ParticipantPart], Field(min_length=1, max_length=MOST)]
    protocol: ProtocolPart
    consent: str
    forms: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=50)]


class DeparturePart(StrictObject):
    """JSON form of :class:`hpop.study.Departure`."""

    participant: Id
    successor: Id
    withdrawn: bool


class PeopleFile(StrictObject):
    """Schema of people.json."""

    schema_: Annotated[Literal["hpop-study-people"], Field(alias="schema")]
    version: Literal[1]
    left: Annotated[list[DeparturePart], Field(max_length=MOST)]


MOST_TEXT = 20_000
"""Largest number of characters in a text for participants."""
LONGEST = 3600
"""Longest rest, s."""
STOP_RULE = (
    "You may stop at any time, without a reason and without disadvantage. Stop at once if you feel unwell: you need "
    "not wait for the end of a ride."
)


@checked_arguments
@dataclass(frozen=True)
class Protocol:
    """Rules of a session between the stimuli.

    rest_s     s, least rest after each stimulus; longer if the participant does not yet feel as before
    stop_rule  text about stopping; the default is translated to the language of the pages
    """

    rest_s: float = 180.0
    stop_rule: str = STOP_RULE

    def __post_init__(self) -> None:
        rest = real("rest_s", self.rest_s, 0, LONGEST, "a time in s", error=StudyError)
        object.__setattr__(self, "rest_s", float(rest))
        checked_text("the stop rule", self.stop_rule)


def checked_text(what: str, text: object) -> str:
    """Return a text for participants; raise StudyError if it is empty, too long, or has control characters."""
    if not isinstance(text, str) or not text.strip():
        raise StudyError(f"{what} is empty: write what participants read, and agree to, before they begin")
    if len(text) > MOST_TEXT:
        raise StudyError(f"{what} has {len(text):,} characters; expected at most {MOST_TEXT:,}")
    if harmful := HARMFUL.search(text.replace("\n", " ").replace("\t", " ")):
        raise StudyError(f"{what} has a control character, {harmful[0]!a}; write plain text")
    return text


def departures(path: Path) -> tuple[Departure, ...]:
    """Read the participants who left a study from people.json; () if there is no such file."""
    if not path.exists():
        return ()
    stored = read(path, PeopleFile, "the list of participants who left", MOST_BYTES)
    return tuple(Departure(one.participant, one.successor, one.withdrawn) for one in stored.left)
