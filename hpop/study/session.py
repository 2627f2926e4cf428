"""Session of one participant: the events that the page records, each checked against the design.

Events are only ever appended. A later answer to an item replaces an earlier one; both stay in the file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, StringConstraints

from hpop.base.text import HARMFUL, counted, shown
from hpop.errors import StudyError
from hpop.study.conditions import OWN_KINDS
from hpop.study.design import Design
from hpop.study.documents import StrictObject, read
from hpop.study.forms import Form
from hpop.study.participants import Participant
from hpop.study.tasks import check_event

SCHEMA, VERSION = "hpop-answers", 1
MOST_BYTES = 64 * 1024**2
"""Largest size of a participant's file of answers, bytes."""
MOST_EVENTS = 20_000
MOST_REMARK = 2000
"""Largest number of characters of a remark."""
MOST_KEYS = 20
MOST_SLOW = 0.05
"""Share of time with fewer than 60 frames per second from which a ride counts as jerky."""
PLAYED = "played"
"""Value of a stimulus event: the page played the whole video."""
NONE = "none"
"""Value of a comparison: neither stimulus of the pair was chosen."""
WORD = re.compile(r"[a-z][a-z_]{0,39}")

Kind = Literal[
    "consent", "start", "stimulus", "answer", "compare", "remark", "pause", "stop", "resume", "end", "frames", "task"
]
Key = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Letter = Annotated[str, StringConstraints(pattern=r"^[A-Z]$")]
When = Annotated[
    str, StringConstraints(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}(\.[0-9]{1,6})?Z$")
]


class SessionEvent(StrictObject):
    """Event of a session, as the page records it.

    t          s since the session's start, rising
    at         date and time, ISO, UTC
    place      0 before the first stimulus, then the number of the stimulus in this participant's order, one more
               after the last; None for events that belong to no place
    condition  letter of the stimulus at this place
    kind       what happened, such as "answer" or "pause"
    value      depends on the kind:
               "answer"   a number, or None if taken back
               "compare"  {"question", "pair", "chosen"}
               "remark"   text
               "frames"   numbers by name
               "task"     numbers by name, and a list "samples" of 2 or 3 numbers each
               others     None, true or false, a number or a word
    """

    t: Annotated[float, Field(ge=0, le=1e7)]
    at: When
    kind: Kind
    place: Annotated[int, Field(ge=0)] | None = None
    condition: Letter | None = None
    form: Key | None = None
    item: Key | None = None
    value: Any = None


class PairValue(StrictObject):
    """Value of a "compare" event: the question, the pair, and the choice."""

    question: Key
    pair: Annotated[list[Letter], Field(min_length=2, max_length=2)]
    chosen: str


class AnswersFile(StrictObject):
    """Schema of a participant's file of answers, such as answers/p01.json."""

    schema_: Annotated[Literal["hpop-answers"], Field(alias="schema")]
    version: Literal[1]
    design: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    participant: str
    device: Annotated[dict[Key, str | float | bool | None], Field(default_factory=dict, max_length=MOST_KEYS)]
    events: Annotated[list[SessionEvent], Field(max_length=MOST_EVENTS)]


class Slot(NamedTuple):
    """Key of an answer: place in the session, form and item."""

    place: int
    form: str
    item: str


class ItemAnswer(NamedTuple):
    """Last answer to an item at a place: its value, seconds since the previous event, and since the session's start."""

    value: float
    seconds: float
    t: float


class PairChoice(NamedTuple):
    """Last choice of a participant about a pair of stimuli, given by their letters; ``chosen`` is None for neither.

    ``first`` was shown on the left. ``seconds`` is the time since the previous event, ``t`` since the session's start.
    """

    question: str
    first: str
    second: str
    chosen: str | None
    seconds: float
    t: float


class Video(NamedTuple):
    """Last showing of a video that a participant reported as ended.

    condition  letter of the video
    played     whether the page played as much of it as the protocol asks for
    took       s, from its reported beginning to its reported end
    lasts      s, duration of the video
    """

    condition: str
    played: bool
    took: float
    lasts: float


class Remark(NamedTuple):
    """Text that a participant wrote, with its place in the session."""

    place: int | None
    text: str


@dataclass(frozen=True, eq=False)
class Session:
    """Session of one participant, checked against the design; read by :meth:`load`."""

    person: Participant
    device: Mapping[str, str | float | bool | None]
    events: tuple[SessionEvent, ...]

    @classmethod
    def load(cls, path: str | os.PathLike[str], design: Design) -> Session:
        """Read a participant's file of answers; StudyError if it is missing or invalid, or does not fit the design."""
        stored = read(path, AnswersFile, "the answers of a participant", MOST_BYTES)
        try:
            return cls.of(stored, design)
        except StudyError as error:
            raise StudyError(f"{path}: {error}") from None

    @classmethod
    def of(cls, stored: AnswersFile, design: Design) -> Session:
        """Check the contents of a file of answers against the design, and return the session."""
        if stored.design != design.digest:
            raise StudyError(
                f"these are answers to another design (its SHA-256 begins with {stored.design[:12]}, that of this one "
                f"with {design.digest[:12]}); put them back into the folder of their own study"
            )
        person = design.participant(stored.participant)
        for key, value in stored.device.items():
            if isinstance(value, str) and (len(value) > 400 or HARMFUL.search(value)):
                raise StudyError(f"device.{key} must be at most 400 plain characters, got {shown(value)}")
        standing_after(design, person, stored.events)
        return cls(person, stored.device, tuple(stored.events))

    @property
    def ended(self) -> bool:
        """Return whether the participant completed the session."""
        return self._has("end") and not self.stopped

    @property
    def stopped(self) -> bool:
        """Return whether the participant stopped the session."""
        return self._has("stop")

    @property
    def reached(self) -> int:
        """Return the place of the last stimulus that began; 0 if none has begun."""
        return max((event.place or 0 for event in self.events if event.kind == "stimulus"), default=0)

    @cached_property
    def answers(self) -> dict[Slot, ItemAnswer]:
        """Return the last answer to each item at each place, without answers that were taken back."""
        answers: dict[Slot, ItemAnswer] = {}
        for event, seconds in self._events_with_gaps("answer"):
            slot = Slot(event.place or 0, event.form or "", event.item or "")
            answers.pop(slot, None)
            if event.value is not None:
                answers[slot] = ItemAnswer(event.value, seconds, event.t)
        return answers

    @cached_property
    def comparisons(self) -> tuple[PairChoice, ...]:
        """Return the last choice for each question and each pair."""
        found: dict[tuple[str, frozenset[str]], PairChoice] = {}
        for event, seconds in self._events_with_gaps("compare"):
            value = PairValue.model_validate(event.value)
            first, second = value.pair
            chosen = None if value.chosen == NONE else value.chosen
            key = (value.question, frozenset(value.pair))
            found.pop(key, None)
            found[key] = PairChoice(value.question, first, second, chosen, seconds, event.t)
        return tuple(found.values())

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Return the last remark at each place."""
        texts = {event.place: event.value for event in self.events if event.kind == "remark"}
        return tuple(Remark(place, text) for place, text in texts.items() if text)

    def values(self, place: int, form: Form) -> dict[str, float]:
        """Return the answers to a form at a place, by item; missing answers are left out."""
        slots = {item.id: Slot(place, form.id, item.id) for item in form.items}
        return {item: self.answers[slot].value for item, slot in slots.items() if slot in self.answers}

    def lacking(self, design: Design) -> list[str]:
        """Describe which answers and comparisons are missing."""
        said = []
        for form in (form for form in design.questionnaires if form.kind == "ratings"):
            for place in asked_at(design, form):
                given = self.values(place, form)
                items = [item.id for item in form.items if item.id not in given]
                if items:
                    what = "all" if len(items) == len(form.items) else ", ".join(items)
                    said.append(f"{form.id} at place {place} lacks {counted(len(items), 'answer')}: {what}")
        known = {(one.question, frozenset((one.first, one.second))) for one in self.comparisons}
        asked = product(questions_of(design), map(frozenset, design.pairs(self.person.id)))
        if several := sum(one not in known for one in asked):
            said.append(f"{counted(several, 'comparison')} not answered")
        return said

    @property
    def jerky(self) -> list[tuple[str, float]]:
        """Return letter and share of time below 60 frames per second, for each stimulus with a share of 5 % or more."""
        told = {event.condition: event.value.get("slow", 0.0) for event in self.events if event.kind == "frames"}
        return [(letter, slow) for letter, slow in told.items() if letter and slow >= MOST_SLOW]

    def videos(self, design: Design) -> list[Video]:
        """Return the videos that the participant reported as ended."""
        lasts = {one.id: one.duration for one in design.conditions if one.kind == "video"}
        least, begun = design.protocol.watched, dict[str, float]()
        shares = dict[str, float]()
        played: set[str] = set()
        found: dict[str, Video] = {}
        for event in self.events:
            if event.condition is None or event.condition not in lasts:
                continue
            letter = event.condition
            if event.kind == "task" and event.item == "watched":
                shares[letter] = event.value["share"]
            if event.kind != "stimulus":
                continue
            if event.value == "begin":
                begun[letter] = event.t
                shares.pop(letter, None)
                played.discard(letter)
            elif event.value == PLAYED:
                played.add(letter)
            elif event.value == "end":
                took = event.t - begun.get(letter, event.t)
                is_played = letter in played and shares.get(letter, 1.0) >= least
                found[letter] = Video(letter, is_played, took, lasts[letter])
        return list(found.values())

    def _has(self, kind: str) -> bool:
        """Return whether an event of a kind has happened."""
        return any(event.kind == kind for event in self.events)

    def _events_with_gaps(self, kind: str) -> Iterator[tuple[SessionEvent, float]]:
        """Yield the events of a kind, each with the seconds since the event before it, of any kind."""
        first = self.events[:1]
        for before, event in pairwise((*first, *self.events)):
            if event.kind == kind:
                yield event, round(event.t - before.t, 6)


def asked_at(design: Design, form: Form) -> list[int]:
    """Return the places of a session at which a form is asked, for K stimuli.

    Place 0 is before the first stimulus, 1 to K after each stimulus, and K + 1 after all.
    """
    count = len(design.letters)
    places = {"before": [0], "after_each": list(range(1, count + 1)), "after_all": [count + 1]}
    return sorted(place for when in form.when for place in places[when])


def questions_of(design: Design) -> tuple[str, ...]:
    """Return the ids of the questions that are asked about pairs."""
    return tuple(item.id for form in design.questionnaires if form.kind == "pairs" for item in form.items)


class SessionState(NamedTuple):
    """State of a session after some events: seconds since its start, whether consent was given, whether it stopped."""

    t: float = 0.0
    consented: bool = False
    stopped: bool = False

    def then(self, design: Design, person: Participant, event: SessionEvent) -> SessionState:
        """Return the state after one more event; StudyError for an event that the design does not expect there."""
        if event.t < self.t:
            raise StudyError(f"events must be in order of time, got {event.t:g} s after {self.t:g} s")
        if event.kind in ("answer", "compare", "remark") and not self.consented:
            raise StudyError(f"{event.kind} before consent was given")
        _check_place(person, event)
        _check_value(design, event, stopped=self.stopped)
        agreed = event.kind == "consent" and event.value is True
        return SessionState(event.t, self.consented or agreed, self.stopped or event.kind == "stop")


def standing_after(design: Design, person: Participant, events: Iterable[SessionEvent]) -> SessionState:
    """Check all events of a session, and return its state after them; StudyError for an unexpected event."""
    standing = SessionState()
    for number, event in enumerate(events):
        try:
            standing = standing.then(design, person, event)
        except StudyError as error:
            raise StudyError(f"events[{number}]: {error}") from None
    return standing


def _check_value(design: Design, event: SessionEvent, *, stopped: bool) -> None:
    """Check the value of an event, and the item to which it belongs."""
    value = event.value
    match event.kind:
        case "answer":
            _check_answer(design, event, stopped=stopped)
        case "compare":
            _check_comparison(design, value)
        case "remark":
            if not isinstance(value, str) or len(value) > MOST_REMARK or HARMFUL.search(value.replace("\n", " ")):
                raise StudyError(
                    f"a remark must be plain text of at most {MOST_REMARK:,} characters, got {shown(value)}"
                )
        case "frames":
            named = isinstance(value, dict) and len(value) <= MOST_KEYS and all(map(WORD.fullmatch, value))
            if not named or not all(map(_is_number, value.values())):
                raise StudyError(f"expected numbers of frames by name, got {shown(value)}")
        case "task":
            check_event(design.protocol.options, event)
        case kind:
            word = isinstance(value, str) and WORD.fullmatch(value)
            if not (value is None or word or isinstance(value, bool) or _is_number(value)):
                raise StudyError(f"the value of {kind} must be a number, a word or nothing, got {shown(value)}")


def _check_place(person: Participant, event: SessionEvent) -> None:
    """Check that an event's place exists, and that its stimulus is the one that this participant sees there."""
    last = len(person.order) + 1
    if event.place is None:
        if event.condition is not None:
            raise StudyError(f"expected the place of stimulus {event.condition}, got none")
        return
    if event.place > last:
        raise StudyError(f"place must be from 0 to {last}, got {event.place}")
    letter = person.order[event.place - 1] if 1 <= event.place < last else None
    if event.condition != letter:
        raise StudyError(
            f"{person.id} sees {letter or 'no stimulus'} at place {event.place} of the session, but the answers "
            f"say {event.condition or 'none'}; use the answers that the page of {person.id} in this study has saved"
        )


def _check_answer(design: Design, event: SessionEvent, *, stopped: bool) -> None:
    """Check that the item of an answer is asked at this place, and that the value is on its scale."""
    form = design.form(event.form or "")
    item = form.item(event.item or "")
    places = asked_at(design, form) + [len(design.letters) + 1] * stopped  # also after a stop
    if form.kind != "ratings" or event.place not in places:
        raise StudyError(f"form {form.id} is not asked at place {event.place}")
    if event.value is not None and event.value not in (scale := form.scale_of(item)):
        raise StudyError(f"item {item.id} of form {form.id}: expected {scale}, got {shown(event.value)}")


def _check_comparison(design: Design, value: Any) -> None:
    """Check the value of a comparison: its question, its pair and the choice."""
    try:
        compared = PairValue.model_validate(value)
    except ValueError:
        raise StudyError(f"a comparison must be an object of question, pair and chosen, got {shown(value)}") from None
    known = questions_of(design)
    if compared.question not in known:
        raise StudyError(f"question must be one of {', '.join(known) or 'none'}, got {shown(compared.question)}")
    first, second = compared.pair
    if first == second or not {design.condition(first).kind, design.condition(second).kind}.isdisjoint(OWN_KINDS):
        raise StudyError(f"pair must be two different rides, got {first} and {second}")
    if compared.chosen not in (first, second, NONE):
        raise StudyError(f"chosen must be {first}, {second} or {NONE!r}, got {shown(compared.chosen)}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
