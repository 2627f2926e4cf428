"""One participant's session: the events that the page records, each checked against the design.

Events are only ever appended. A later answer to the same item takes the place of an earlier one; both stay in the file.
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
from hpop.study.conditions import VIEW
from hpop.study.design import Design
from hpop.study.documents import StrictObject, read
from hpop.study.forms import Form
from hpop.study.participants import Participant

SCHEMA, VERSION = "hpop-answers", 1
MOST_BYTES = 8 * 1024**2
"""Largest size of a participant's file of answers."""
MOST_EVENTS = 20_000
MOST_REMARK = 2000
"""Most characters of a remark."""
MOST_KEYS = 20
MOST_SLOW = 0.05
"""Share of time with fewer than 60 pictures a second from which a ride counts as jerky."""
PLAYED = "played"
"""Value of a stimulus event: the page played the whole video."""
NONE = "none"
"""Value of a comparison: neither stimulus of the pair was chosen."""
WORD = re.compile(r"[a-z][a-z_]{0,39}")

Kind = Literal[
    "consent", "start", "stimulus", "answer", "compare", "remark", "pause", "stop", "resume", "end", "frames"
]
Key = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Letter = Annotated[str, StringConstraints(pattern=r"^[A-Z]$")]
When = Annotated[
    str, StringConstraints(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}(\.[0-9]{1,6})?Z$")
]


class SessionEvent(StrictObject):
    """Event of a session.

    t          s since the session's start, rising
    at         date and time, ISO, UTC
    place      0 before the first stimulus, then the number of the stimulus in this participant's order, one more
               after the last; None for events that belong to no place
    condition  letter of the stimulus at this place
    value      of "answer" a number, or None if taken back; of "compare" {"question", "pair", "chosen"};
               of "remark" text; of "frames" numbers by name; of others None, true, a number or a word
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
    """Value of a comparison."""

    question: Key
    pair: Annotated[list[Letter], Field(min_length=2, max_length=2)]
    chosen: str


class AnswersFile(StrictObject):
    """Contents of answers/p01.json."""

    schema_: Annotated[Literal["hpop-answers"], Field(alias="schema")]
    version: Literal[1]
    design: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    participant: str
    device: Annotated[dict[Key, str | float | bool | None], Field(default_factory=dict, max_length=MOST_KEYS)]
    events: Annotated[list[SessionEvent], Field(max_length=MOST_EVENTS)]


class Slot(NamedTuple):
    """Position of an answer: place, form and item."""

    place: int
    form: str
    item: str


class ItemAnswer(NamedTuple):
    """Last answer of a slot: its value, s since the previous event, s since the start."""

    value: float
    seconds: float
    t: float


class PairChoice(NamedTuple):
    """Last answer about a pair; chosen is None for neither."""

    question: str
    first: str
    second: str
    chosen: str | None
    seconds: float
    t: float


class Video(NamedTuple):
    """Last showing of a video that was reported as ended.

    condition  its letter
    played     whether the page played all of it
    took       s, from its reported beginning to its reported end
    lasts      s, duration of the video
    """

    condition: str
    played: bool
    took: float
    lasts: float


class Remark(NamedTuple):
    """Text written by a participant, with its place."""

    place: int | None
    text: str


@dataclass(frozen=True, eq=False)
class Session:
    """Checked session of one participant, read by :meth:`load`."""

    person: Participant
    device: Mapping[str, str | float | bool | None]
    events: tuple[SessionEvent, ...]

    @classmethod
    def load(cls, path: str | os.PathLike[str], design: Design) -> Session:
        """Read answers/p01.json; StudyError for an invalid file, or one that does not fit the design."""
        stored = read(path, AnswersFile, "the answers of a participant", MOST_BYTES)
        try:
            return cls.of(stored, design)
        except StudyError as error:
            raise StudyError(f"{path}: {error}") from None

    @classmethod
    def of(cls, stored: AnswersFile, design: Design) -> Session:
        """Return the session in a file of answers; StudyError if it does not fit the design."""
        if stored.design != design.digest:
            raise StudyError(
                f"these are answers to another design (it begins {stored.design[:12]}, this one "
                f"{design.digest[:12]}); put them back into the folder of their own study"
            )
        person = design.participant(stored.participant)
        for key, value in stored.device.items():
            if isinstance(value, str) and (len(value) > 400 or HARMFUL.search(value)):
                raise StudyError(f"device.{key} must be at most 400 plain characters, got {shown(value)}")
        standing_after(design, person, stored.events)
        return cls(person, stored.device, tuple(stored.events))

    @property
    def ended(self) -> bool:
        """Return whether the session was completed."""
        return self._has("end") and not self.stopped

    @property
    def stopped(self) -> bool:
        """Return whether the participant stopped the session."""
        return self._has("stop")

    @property
    def reached(self) -> int:
        """Return the last place with a begun stimulus; 0 before the first."""
        return max((event.place or 0 for event in self.events if event.kind == "stimulus"), default=0)

    @cached_property
    def answers(self) -> dict[Slot, ItemAnswer]:
        """Return the last answer of each item at each place, without answers that were taken back."""
        answers: dict[Slot, ItemAnswer] = {}
        for event, seconds in self._events_with_gaps("answer"):
            slot = Slot(event.place or 0, event.form or "", event.item or "")
            answers.pop(slot, None)
            if event.value is not None:
                answers[slot] = ItemAnswer(event.value, seconds, event.t)
        return answers

    @cached_property
    def comparisons(self) -> tuple[PairChoice, ...]:
        """Return the last answer to each question on each pair."""
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
        """Return the answers to a form at a place, by item, without missing ones."""
        slots = {item.id: Slot(place, form.id, item.id) for item in form.items}
        return {item: self.answers[slot].value for item, slot in slots.items() if slot in self.answers}

    def lacking(self, design: Design) -> list[str]:
        """Describe the items without an answer."""
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
        """Return rides that were not smooth: the letter, and the share of time below 60 pictures per second."""
        told = {event.condition: event.value.get("slow", 0.0) for event in self.events if event.kind == "frames"}
        return [(letter, slow) for letter, slow in told.items() if letter and slow >= MOST_SLOW]

    def videos(self, design: Design) -> list[Video]:
        """Return the videos that were reported as ended."""
        lasts = {one.id: one.duration for one in design.conditions if one.kind == "video"}
        begun: dict[str, float] = {}
        played: set[str] = set()
        found: dict[str, Video] = {}
        for event in self.events:
            if event.kind != "stimulus" or event.condition is None or event.condition not in lasts:
                continue
            letter = event.condition
            if event.value == "begin":
                begun[letter] = event.t
                played.discard(letter)
            elif event.value == PLAYED:
                played.add(letter)
            elif event.value == "end":
                took = event.t - begun.get(letter, event.t)
                found[letter] = Video(letter, letter in played, took, lasts[letter])
        return list(found.values())

    def _has(self, kind: str) -> bool:
        return any(event.kind == kind for event in self.events)

    def _events_with_gaps(self, kind: str) -> Iterator[tuple[SessionEvent, float]]:
        """Yield events of a kind, each with the seconds since the previous event."""
        first = self.events[:1]
        for before, event in pairwise((*first, *self.events)):
            if event.kind == kind:
                yield event, round(event.t - before.t, 6)


def asked_at(design: Design, form: Form) -> list[int]:
    """Return the places at which a form is asked: 0 before, 1 to K after each of K stimuli, K + 1 after all."""
    count = len(design.letters)
    places = {"before": [0], "after_each": list(range(1, count + 1)), "after_all": [count + 1]}
    return sorted(place for when in form.when for place in places[when])


def questions_of(design: Design) -> tuple[str, ...]:
    """Return the questions about pairs."""
    return tuple(item.id for form in design.questionnaires if form.kind == "pairs" for item in form.items)


class SessionState(NamedTuple):
    """State of a session after some events: s since its start, whether there was consent, and a stop."""

    t: float = 0.0
    consented: bool = False
    stopped: bool = False

    def then(self, design: Design, person: Participant, event: SessionEvent) -> SessionState:
        """Return the state after a further event; StudyError for an event that the design does not expect."""
        if event.t < self.t:
            raise StudyError(f"time goes back, from {self.t:g} to {event.t:g} s")
        if event.kind in ("answer", "compare", "remark") and not self.consented:
            raise StudyError(f"{event.kind} before consent was given")
        _check_place(person, event)
        _check_value(design, event, stopped=self.stopped)
        agreed = event.kind == "consent" and event.value is True
        return SessionState(event.t, self.consented or agreed, self.stopped or event.kind == "stop")


def standing_after(design: Design, person: Participant, events: Iterable[SessionEvent]) -> SessionState:
    """Return the state of a session after all its events; StudyError for an event that the design does not expect."""
    standing = SessionState()
    for number, event in enumerate(events):
        try:
            standing = standing.then(design, person, event)
        except StudyError as error:
            raise StudyError(f"events[{number}]: {error}") from None
    return standing


def _check_value(design: Design, event: SessionEvent, *, stopped: bool) -> None:
    """Check an event's item and its value."""
    value = event.value
    match event.kind:
        case "answer":
            _check_answer(design, event, stopped=stopped)
        case "compare":
            _check_comparison(design, value)
        case "remark":
            if not isinstance(value, str) or len(value) > MOST_REMARK or HARMFUL.search(value.replace("\n", " ")):
                raise StudyError(f"a remark is plain text of at most {MOST_REMARK:,} characters, got {shown(value)}")
        case "frames":
            named = isinstance(value, dict) and len(value) <= MOST_KEYS and all(map(WORD.fullmatch, value))
            if not named or not all(map(_is_number, value.values())):
                raise StudyError(f"expected numbers of frames by name, got {shown(value)}")
        case kind:
            word = isinstance(value, str) and WORD.fullmatch(value)
            if not (value is None or word or isinstance(value, bool) or _is_number(value)):
                raise StudyError(f"{kind} has a number, a word or nothing as its value, got {shown(value)}")


def _check_place(person: Participant, event: SessionEvent) -> None:
    last = len(person.order) + 1
    if event.place is None:
        if event.condition is not None:
            raise StudyError(f"stimulus {event.condition} without its place")
        return
    if event.place > last:
        raise StudyError(f"places are 0 to {last}, got {event.place}")
    letter = person.order[event.place - 1] if 1 <= event.place < last else None
    if event.condition != letter:
        raise StudyError(
            f"{person.id} sees {letter or 'no stimulus'} at place {event.place}, but the answers say "
            f"{event.condition or 'none'}"
        )


def _check_answer(design: Design, event: SessionEvent, *, stopped: bool) -> None:
    form = design.form(event.form or "")
    item = form.item(event.item or "")
    places = asked_at(design, form) + [len(design.letters) + 1] * stopped  # also after a stop
    if form.kind != "ratings" or event.place not in places:
        raise StudyError(f"form {form.id} is not asked at place {event.place}")
    if event.value is not None and event.value not in (scale := form.scale_of(item)):
        raise StudyError(f"item {item.id} of form {form.id} is answered by {scale}, got {shown(event.value)}")


def _check_comparison(design: Design, value: Any) -> None:
    try:
        compared = PairValue.model_validate(value)
    except ValueError:
        raise StudyError(f"a comparison is an object of question, pair and chosen, got {shown(value)}") from None
    known = questions_of(design)
    if compared.question not in known:
        raise StudyError(f"the study asks {', '.join(known) or 'nothing'} of pairs, got {shown(compared.question)}")
    first, second = compared.pair
    if VIEW in {design.condition(first).kind, design.condition(second).kind} or first == second:
        raise StudyError(f"two rides are compared, got {first} and {second}")
    if compared.chosen not in (first, second, NONE):
        raise StudyError(f"of {first} and {second} one is chosen, or {NONE!r}, got {shown(compared.chosen)}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
