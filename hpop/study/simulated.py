"""Simulated answers of a whole study: ratings, choices, and the records of tasks and videos.

They rehearse an analysis, and serve examples. They are marked: ``device["simulated"]`` is true in every session, and
reports carry a warning on every page and figure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST_SEED, real, whole
from hpop.errors import StudyError
from hpop.study.answers import Answers
from hpop.study.design import Design
from hpop.study.forms import Form, Item
from hpop.study.participants import Participant
from hpop.study.results import BEFORE
from hpop.study.session import PLAYED, Session, SessionEvent, asked_at, questions_of, standing_after
from hpop.study.tasks import MOST_SAMPLES, SAMPLES

DEVICE: Mapping[str, str | float | bool | None] = {"simulated": True, "browser": "none"}
WIDTH = 6.0
"""Width of a rating scale, in standard deviations of how people feel; its low end is at 0."""
SPREAD = 2.0
"""Standard deviations by which typical ratings of comfort and the like lie below the best value."""
NOISE = 0.8
"""Standard deviation of the noise of each item."""
UNDECIDED = 0.4
"""Difference between two stimuli below which simulated people say "neither"."""
REACTION = 0.35, 0.25, 0.05
"""Median of reaction times, s; standard deviation of their logarithm; what one unit of discomfort adds to it."""
MISSED = 0.03
"""Share of ratings and signals that remain without an answer; also the number of pauses and of presses by mistake."""
Told = tuple[float, str, dict[str, Any]]
"""Event of a session: s since the event before, its kind, and its other fields."""


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

    Tasks and videos have their records, at the times of their schedules. Discomfort grows during a stimulus; with it,
    ratings rise, tones are miscounted and reactions are slower. Heads turn slowly to and fro, whatever people feel.
    Turns are not announced.

    Parameters
    ----------
    discomfort : by letter, and "before" for the answers before the first stimulus (default 0), in standard deviations
        of how people feel; the larger it is, the further an item's answer is, apart from noise, from the better end of
        its scale
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
        said = [*_answers(design, person, feelings, rng, seed), *_choices(design, person, felt, liked, rng)]
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
    design: Design, person: Participant, feelings: FloatArray, rng: np.random.Generator, seed: int
) -> Iterator[Told]:
    """Yield the events of the stimuli and all ratings, in the order of the session."""
    last = len(person.order) + 1
    for place in range(last + 1):
        where: dict[str, Any] = {"place": place}
        if 1 <= place < last:
            where["condition"] = person.order[place - 1]
            for seconds, kind, more in _stimulus(design, person, place, feelings[place], seed):
                yield seconds, kind, where | more
        for form in design.questionnaires:
            if form.kind == "ratings" and place in asked_at(design, form):
                for item in form.items:
                    value = _simulated_rating(form, item, feelings[place] + NOISE * rng.standard_normal())
                    yield 1.0, "answer", {**where, "form": form.id, "item": item.id, "value": value}


def _simulated_rating(form: Form, item: Item, felt: float) -> float:
    """Return the value on an item's scale for a simulated discomfort ``felt``: more is further from the better end.

    On scales whose high end is the better one, such as comfort, :data:`SPREAD` is added to the discomfort, so that
    no discomfort is not yet a perfect rating.
    """
    values = form.scale_of(item).values
    felt += SPREAD if form.better == "high" else 0.0
    step = int(np.clip(np.floor(felt / WIDTH * (len(values) + 1)), 0, len(values) - 1))
    return values[-1 - step] if (form.better == "high") != item.reverse else values[step]


def _choices(
    design: Design, person: Participant, felt: Mapping[str, float], liked: Mapping[str, float], rng: np.random.Generator
) -> Iterator[Told]:
    """Yield the events of all comparisons."""
    for question in questions_of(design):
        for first, second in design.pairs(person.id):
            better = felt[second] - felt[first] if question == "comfort" else liked[first] - liked[second]
            better += rng.logistic(scale=0.5)
            chosen = "none" if abs(better) < UNDECIDED else first if better > 0 else second
            yield 1.0, "compare", {"value": {"question": question, "pair": [first, second], "chosen": chosen}}


def _stimulus(design: Design, person: Participant, place: int, felt: float, seed: int) -> Iterator[Told]:
    """Yield the events of one stimulus: its beginning and end, and those of tasks and of a video.

    Their random numbers are their own, so that the answers to questionnaires do not depend on the tasks.
    """
    condition = design.condition(person.order[place - 1])
    lasts = round(condition.duration, 3)
    rng = np.random.default_rng([seed, int(person.id[1:]), place])
    tasks = design.scheduled(person.id, place).get("tasks", {})
    during = sorted(_events_of_tasks(tasks, lasts, felt, rng), key=lambda one: one[0])
    ends: list[tuple[str, dict[str, Any]]] = []
    if condition.kind == "video":
        pauses = int(rng.poisson(MISSED))
        watched = {"share": 1.0, "seconds": lasts, "pauses": pauses, "skips": 0, SAMPLES: [[0, lasts]]}
        ends += [("task", {"item": "watched", "value": watched}), ("stimulus", {"value": PLAYED})]
    ends.append(("stimulus", {"value": "end"}))
    yield 1.0, "stimulus", {"value": "begin"}
    t = 0.0
    for at, item, value in during:
        yield at - t, "task", {"item": item, "value": value}
        t = at
    for kind, more in ends:
        yield lasts - t, kind, more
        t = lasts
    if "counting" in tasks:
        tones = len(tasks["counting"]["times"])
        wrong = round((0.5 + 0.5 * max(felt, 0.0)) * rng.standard_normal())
        yield 3.0, "task", {"item": "count", "value": {"value": max(tones + wrong, 0)}}


def _events_of_tasks(
    tasks: Mapping[str, Mapping[str, Any]], lasts: float, felt: float, rng: np.random.Generator
) -> Iterator[tuple[float, str, dict[str, Any]]]:
    """Yield the events of tasks during a stimulus: time from its beginning, s, item and value; not in order.

    felt  discomfort at the end of the stimulus; at the beginning it is 0
    """
    if rating := tasks.get("rating"):
        for due in rating["times"]:
            said = {"due": due, "came": due}
            if rng.random() >= MISSED:
                level = _level(felt * due / lasts + NOISE / 2 * rng.standard_normal(), rating["high"])
                said |= {"value": round(level), "seconds": round(float(rng.uniform(0.2, 0.9)) * rating["shown"], 3)}
            yield due + said.get("seconds", rating["shown"]), "rating", said
    if slider := tasks.get("slider"):
        t = np.arange(0.0, lasts, 1.0 / slider["rate"])
        own = NOISE / 2 * rng.standard_normal()
        levels = [round(_level((felt + own) * share, slider["high"]), 2) for share in t / lasts]
        yield from _batches("slider", np.column_stack([1000.0 * t, levels]), lasts)
    if head := tasks.get("head"):
        t = np.arange(0.0, lasts, 1.0 / head["rate"])
        sizes, periods, phases = rng.uniform(5.0, 40.0, 2), rng.uniform(4.0, 12.0, 2), rng.uniform(0.0, 2 * np.pi, 2)
        turns = sizes * np.sin(2 * np.pi * t[:, None] / periods + phases) * (1.0, 0.3)  # (n, 2) yaw and pitch, degrees
        yield from _batches("head", np.column_stack([1000.0 * t, turns]), lasts)
    for due in tasks.get("counting", {}).get("times", ()):
        yield due, "tone", {"due": due, "came": due}
    if reaction := tasks.get("reaction"):
        median, spread, slower = REACTION
        for due in reaction["times"]:
            said = {"due": due, "came": due}
            took = median * float(np.exp(spread * rng.standard_normal() + slower * max(felt * due / lasts, 0.0)))
            if took <= reaction["wait"] and rng.random() >= MISSED:
                said["seconds"] = round(took, 3)
            yield due + said.get("seconds", reaction["wait"]), "signal", said
        for came in rng.uniform(0.0, lasts, rng.poisson(MISSED)).round(3).tolist():
            yield came, "press", {"came": came}


def _level(felt: float, high: float) -> float:
    """Return a rating of discomfort from 0 to ``high``; the scale is :data:`WIDTH` wide."""
    return min(max(felt / WIDTH * high, 0.0), high)


def _batches(item: str, samples: FloatArray, lasts: float) -> Iterator[tuple[float, str, dict[str, Any]]]:
    """Yield the events of samples (n, 2 or 3), whose first column is ms; each event has at most MOST_SAMPLES."""
    for begin in range(0, len(samples), MOST_SAMPLES):
        some = samples[begin : begin + MOST_SAMPLES]
        rows = [[round(row[0]), *(round(number, 2) for number in row[1:])] for row in some.tolist()]
        yield min(rows[-1][0] / 1000.0, lasts), item, {SAMPLES: rows}


def _session(design: Design, person: Participant, said: list[Told]) -> Session:
    """Return a complete session with these events, as the page would record it."""
    t, events = 0.0, []
    for seconds, kind, more in [(0.0, "consent", {"value": True}), (1.0, "start", {}), *said, (1.0, "end", {})]:
        t = round(t + max(seconds, 0.0), 3)
        at = datetime(2000, 1, 1, tzinfo=UTC) + timedelta(seconds=t)
        when = f"{at:%Y-%m-%dT%H:%M:%S}.{at.microsecond // 1000:03d}Z"
        events.append(SessionEvent(t=t, at=when, kind=kind, **more))  # type: ignore[arg-type]
    standing_after(design, person, events)
    return Session(person, DEVICE, tuple(events))
