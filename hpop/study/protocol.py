"""Protocol of a study: rests, the stop rule, and tasks during a stimulus with their options and schedules.

A design has the options of each task. Times of tones and signals are drawn from the design's seed, anew for each
participant and place in the order of stimuli, so that no stimulus has an easier schedule than another. All times count
from the moment at which the stimulus begins.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import one_of, real
from hpop.base.text import HARMFUL, shown
from hpop.errors import StudyError

if TYPE_CHECKING:
    from hpop.study.conditions import Condition


class TaskOption(NamedTuple):
    """Option of a task: its default, its least and largest value, and what it is, such as "a time in s"."""

    default: float
    least: float
    most: float
    kind: str


SECONDS, PER_SECOND, LARGEST = "a time in s", "samples per second", "the largest rating"
TASKS: dict[str, dict[str, TaskOption]] = {
    "rating": {
        "every": TaskOption(60.0, 1.0, 3600.0, SECONDS),
        "shown": TaskOption(10.0, 1.0, 600.0, SECONDS),
        "high": TaskOption(20.0, 1.0, 20.0, LARGEST),
    },
    "slider": {"rate": TaskOption(10.0, 0.1, 60.0, PER_SECOND), "high": TaskOption(20.0, 1.0, 100.0, LARGEST)},
    "head": {"rate": TaskOption(30.0, 1.0, 60.0, PER_SECOND)},
    "counting": {
        "least": TaskOption(2.0, 0.5, 600.0, SECONDS),
        "most": TaskOption(5.0, 0.5, 600.0, SECONDS),
    },
    "reaction": {
        "least": TaskOption(8.0, 0.5, 600.0, SECONDS),
        "most": TaskOption(15.0, 0.5, 600.0, SECONDS),
        "wait": TaskOption(2.0, 0.2, 60.0, SECONDS),
    },
}
"""Tasks and their options:

rating    asked ``every`` s, from 0 to ``high``; the question is shown for at most ``shown`` s (FMS)
slider    always in view, from 0 to ``high``; sampled ``rate`` times per second
head      orientation of the head in the robot's camera, sampled ``rate`` times per second
counting  tones, ``least`` to ``most`` s apart; their number is asked after the stimulus
reaction  signals, ``least`` to ``most`` s apart, to which participants react within ``wait`` s
"""
MEASURED = "tasks"
"""Name in place of a form for scores that are measures of tasks, as in ("tasks", "reaction_median")."""
FIRST = 1.0
"""s from the beginning in which nothing sounds, because browsers then open the sound card."""
LAST = 0.5
"""s before the end of a stimulus after which no tone begins."""
Options = dict[str, dict[str, float]]


def checked_tasks(given: object) -> Options:
    """Return all options of the given tasks, with defaults; StudyError for unknown tasks or options.

    >>> checked_tasks({"head": None, "slider": {"rate": 5}})
    {'head': {'rate': 30.0}, 'slider': {'rate': 5.0, 'high': 20.0}}
    """
    if isinstance(given, Sequence) and not isinstance(given, str):
        given = dict.fromkeys(given)
    if not isinstance(given, Mapping):
        raise StudyError(f"tasks must be options by task, such as {{'head': {{'rate': 30}}}}, got {shown(given)}")
    found: Options = {}
    for name, options in given.items():
        known = TASKS[one_of("each task", name, TASKS, error=StudyError)]
        if not isinstance(options, Mapping | None):
            raise StudyError(f"tasks.{name} must be options by name, such as {{'rate': 10}}, got {shown(options)}")
        for option in options or {}:
            one_of(f"each option of tasks.{name}", option, known, error=StudyError)
        values = {option: (options or {}).get(option, limits.default) for option, limits in known.items()}
        for option, limits in known.items():
            where = f"tasks.{name}.{option}"
            values[option] = float(
                real(where, values[option], limits.least, limits.most, limits.kind, error=StudyError)
            )
        found[name] = values
    for name, low, high in (
        ("rating", "shown", "every"),
        ("counting", "least", "most"),
        ("reaction", "least", "most"),
        ("reaction", "wait", "least"),
    ):
        if name in found and found[name][low] > found[name][high]:
            raise StudyError(
                f"tasks.{name}.{low} must be at most tasks.{name}.{high}, got {found[name][low]:g} and "
                f"{found[name][high]:g} s"
            )
    return found


def check_fits(tasks: Options, conditions: Iterable[Condition]) -> None:
    """Raise StudyError if a stimulus is too short for the first rating, tone or signal of a task and its answer."""
    for condition in conditions:
        for name, option in (("rating", "every"), ("counting", "most"), ("reaction", "most")):
            if name not in tasks or not condition.stimulus:
                continue
            waits = {"rating": "shown", "reaction": "wait"}.get(name)
            seconds = (
                tasks[name][option] + (tasks[name][waits] if waits else LAST) + (0.0 if name == "rating" else FIRST)
            )
            if seconds > condition.duration:
                how = f"{option} is {tasks[name][option]:g} s" + (
                    f", {waits} {tasks[name][waits]:g} s" if waits else ""
                )
                raise StudyError(
                    f"tasks.{name} needs {seconds:g} s until its first answer ({how}), but stimulus {condition.id} "
                    f"lasts {condition.duration:.1f} s: take a smaller {option}, or longer stimuli"
                )


def schedule(tasks: Options, duration: float, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return the options of each task with its ``times``, s from the begin of the stimulus.

    At these times a rating is asked, a tone sounds (counting) or a signal appears (reaction). Ratings come at regular
    times; times of tones and signals are drawn by ``rng``.

    duration  length of the stimulus, s; the last time leaves room for an answer

    >>> schedule(checked_tasks({"rating": {"every": 10, "shown": 5}}), 29.0, np.random.default_rng(1))
    {'rating': {'every': 10.0, 'shown': 5.0, 'high': 20.0, 'times': [10.0, 20.0]}}
    """
    made: dict[str, dict[str, Any]] = {name: dict(options) for name, options in tasks.items()}
    if "rating" in made:
        every, shown_for = made["rating"]["every"], made["rating"]["shown"]
        count = int((duration - shown_for) / every + 1e-9)
        made["rating"]["times"] = [round(every * k, 3) for k in range(1, count + 1)]
    for name in ("counting", "reaction"):
        if name in made:
            last = duration - made[name].get("wait", LAST)
            made[name]["times"] = list(_drawn(made[name]["least"], made[name]["most"], last, rng))
    return made


def _drawn(least: float, most: float, last: float, rng: np.random.Generator) -> Iterator[float]:
    """Yield times, s, up to ``last``; gaps, the first one from FIRST, are drawn evenly from ``least`` to ``most``."""
    t = FIRST
    while (t := t + float(rng.uniform(least, most))) <= last:
        yield round(t, 3)


WATCHED = 0.95
"""Share of a video that must be played, unless the protocol says otherwise."""
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
    watched    least share of a video that must be played before the questions about it can be answered
    tasks      options of each task during a stimulus, or names of tasks (:data:`hpop.study.protocol.TASKS`)
    """

    rest_s: float = 180.0
    stop_rule: str = STOP_RULE
    watched: float = WATCHED
    tasks: Mapping[str, Any] | Sequence[str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rest = real("rest_s", self.rest_s, 0, LONGEST, "a time in s", error=StudyError)
        watched = real("watched", self.watched, 0.1, 1, "a share of a video", error=StudyError)
        object.__setattr__(self, "rest_s", float(rest))
        object.__setattr__(self, "watched", float(watched))
        object.__setattr__(self, "tasks", checked_tasks(self.tasks))
        checked_text("the stop rule", self.stop_rule)

    @property
    def options(self) -> Options:
        """Return all options of each task, by task."""
        return checked_tasks(self.tasks)

    def to_dict(self) -> dict[str, Any]:
        """Return the protocol as a dict for JSON, without ``watched`` if it is the default, and ``tasks`` if empty."""
        more = {"watched": self.watched} if self.watched != WATCHED else {}
        return {
            "rest_s": self.rest_s,
            "stop_rule": self.stop_rule,
            **more,
            **({"tasks": self.options} if self.options else {}),
        }


def checked_text(what: str, text: object) -> str:
    """Return a text for participants; raise StudyError if it is empty, too long, or has control characters."""
    if not isinstance(text, str) or not text.strip():
        raise StudyError(f"{what} is empty: write what participants read, and agree to, before they begin")
    if len(text) > MOST_TEXT:
        raise StudyError(f"{what} has {len(text):,} characters; expected at most {MOST_TEXT:,}")
    if harmful := HARMFUL.search(text.replace("\n", " ").replace("\t", " ")):
        raise StudyError(f"{what} has a control character, {harmful[0]!a}; write plain text")
    return text
