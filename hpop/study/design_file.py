"""The files of a design: design.json, which never changes, and people.json, which says who left."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from hpop.study.documents import Part
from hpop.study.orders import MOST_STIMULI
from hpop.study.participants import ID, MOST

FILE, PEOPLE, FRONT, SCHEDULE = "design.json", "people.json", "front.json", "schedule.csv"
MOST_BYTES = 8 * 1024**2

Letter = Annotated[str, StringConstraints(pattern="^[A-Z]$")]
Id = Annotated[str, StringConstraints(pattern=f"^{ID.pattern}$")]
Digest = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
Short = Annotated[str, StringConstraints(max_length=200)]


class FrontPart(Part):
    """Which front the rows are of."""

    file: Literal["front.json"]
    sha256: Digest


class ConditionPart(Part):
    """A :class:`hpop.study.Condition`."""

    id: Letter
    row: Annotated[int, Field(ge=0)] | None
    name: Short
    kind: Literal["ride", "video", "view"]
    costs: Annotated[dict[Short, float], Field(max_length=100)]
    duration: Annotated[float, Field(gt=0)]


class ParticipantPart(Part):
    """A :class:`hpop.study.Participant`."""

    id: Id
    order: Annotated[list[Letter], Field(min_length=2, max_length=MOST_STIMULI)]
    strata: Annotated[dict[Short, Short], Field(max_length=10)]


class ProtocolPart(Part):
    """A :class:`hpop.study.Protocol`."""

    rest_s: float
    stop_rule: str


class DesignFile(Part):
    """What design.json holds."""

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


class DeparturePart(Part):
    """A :class:`hpop.study.Departure`."""

    participant: Id
    successor: Id
    withdrawn: bool


class PeopleFile(Part):
    """What people.json holds."""

    schema_: Annotated[Literal["hpop-study-people"], Field(alias="schema")]
    version: Literal[1]
    left: Annotated[list[DeparturePart], Field(max_length=MOST)]
