"""Simulated answers of participants, to rehearse a study's analysis, and for examples.

They are marked: ``device["simulated"]`` is true in every session, and reports carry a warning on every page and figure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import MOST_SEED, real, whole
from hpop.errors import StudyError
from hpop.study.answers import Answers
from hpop.study.design import Design
from hpop.study.forms import Form, Item
from hpop.study.participants import Participant
from hpop.study.session import Session, SessionEvent, asked_at, questions_of, standing_after

DEVICE: Mapping[str, str | float | bool | None] = {"simulated": True, "browser": "none"}
BEFORE = "before"
WIDTH = 6.0
"""Width of a rating scale, in standard deviations of how people feel; its low end is at 0."""
SPREAD = 2.0
"""Standard deviations by which typical ratings of comfort and the like lie below the best value."""
NOISE = 0.8
"""Standard deviation of the noise of each item."""
UNDECIDED = 0.4
"""Difference between two stimuli below which simulated people say "neither"."""


@checked_arguments
def simulate(
    design: Design,
    discomfort: Mapping[str, float],
    *,
    liking: Mapping[str, float] | None = None,
    correlation: float = 0.6,
    tiring: float = 0.0,
    seed: int = 0,
) -> Answers:
    """Return simulated answers of all expected participants. Each stimulus shifts how they feel.

    Parameters
    ----------
    discomfort : by letter, and "before" for the answers before the first stimulus (default 0), in standard deviations
        of how people feel; an item's answer is this value, with noise, on its scale: about 0 without discomfort
    liking : by letter, for comparisons other than "comfort"; by default the opposite of discomfort
    correlation : between a person's feelings at two moments of the session
    tiring : discomfort added with each stimulus
    seed : seed of the random numbers

    Raises StudyError if a letter has no number.
    """
    own = float(np.sqrt(real("correlation", correlation, 0.0, 0.999, "a correlation", error=StudyError)))
    rng = np.random.default_rng(whole("seed", seed, 0, MOST_SEED, "a seed", error=StudyError))
    felt = {letter: _of(design, discomfort, letter, "discomfort") for letter in design.letters}
    liked = {letter: -felt[letter] if liking is None else _of(design, liking, letter, "liking") for letter in felt}
    sessions = []
    for person in design.expected:
        general = own * rng.standard_normal()
        levels = [discomfort.get(BEFORE, 0.0), *(felt[letter] for letter in person.order), 0.0]
        shifts = np.array(levels) + tiring * np.arange(len(levels))
        feelings = general + shifts + np.sqrt(1 - own**2) * rng.standard_normal(len(levels))
        said = [*_answers(design, person, feelings, rng), *_choices(design, person, felt, liked, rng)]
        sessions.append(_session(design, person, said))
    return Answers(design, tuple(sessions))


def _of(design: Design, given: Mapping[str, float], letter: str, what: str) -> float:
    """Return the number for a letter; StudyError if it is missing or out of range."""
    if letter not in given:
        raise StudyError(
            f"{what} must have a number for each stimulus ({', '.join(design.letters)}), but lacks {letter}"
        )
    return real(f"{what} of {letter}", given[letter], -100, 100, error=StudyError)


def _answers(
    design: Design, person: Participant, feelings: Any, rng: np.random.Generator
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the events of the stimuli and all ratings, as (kind, other fields), in the order of the session."""
    last = len(person.order) + 1
    for place in range(last + 1):
        where: dict[str, Any] = {"place": place}
        if 1 <= place < last:
            where["condition"] = person.order[place - 1]
            yield "stimulus", {**where, "value": "begin"}
            yield "stimulus", {**where, "value": "end"}
        for form in design.questionnaires:
            if form.kind == "ratings" and place in asked_at(design, form):
                for item in form.items:
                    value = _simulated_rating(form, item, feelings[place] + NOISE * rng.standard_normal())
                    yield "answer", {**where, "form": form.id, "item": item.id, "value": value}


def _simulated_rating(form: Form, item: Item, felt: float) -> float:
    """Return the value on an item's scale for a simulated discomfort: the larger, the further from the better end.

    On scales whose high end is the better one, such as comfort, :data:`SPREAD` is added to the discomfort ``felt``, so
    that no discomfort is not yet a perfect rating.
    """
    values = form.scale_of(item).values
    felt += SPREAD if form.better == "high" else 0.0
    step = int(np.clip(np.floor(felt / WIDTH * (len(values) + 1)), 0, len(values) - 1))
    return values[-1 - step] if (form.better == "high") != item.reverse else values[step]


def _choices(
    design: Design, person: Participant, felt: Mapping[str, float], liked: Mapping[str, float], rng: np.random.Generator
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the events of all comparisons, as (kind, other fields)."""
    for question in questions_of(design):
        for first, second in design.pairs(person.id):
            better = felt[second] - felt[first] if question == "comfort" else liked[first] - liked[second]
            better += rng.logistic(scale=0.5)
            chosen = "none" if abs(better) < UNDECIDED else first if better > 0 else second
            yield "compare", {"value": {"question": question, "pair": [first, second], "chosen": chosen}}


def _session(design: Design, person: Participant, said: list[tuple[str, dict[str, Any]]]) -> Session:
    """Return a complete session with these events, as the page would record it, one event per second."""
    told = [("consent", {"value": True}), ("start", {}), *said, ("end", {})]
    events = tuple(
        SessionEvent(t=float(t), at=f"2000-01-01T{t // 3600:02d}:{t // 60 % 60:02d}:{t % 60:02d}Z", kind=kind, **more)  # type: ignore[arg-type]
        for t, (kind, more) in enumerate(told)
    )
    standing_after(design, person, events)
    return Session(person, DEVICE, events)
