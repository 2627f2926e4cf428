"""Records of the tasks during a stimulus: which events are valid, tables of them, and what they measure.

The tasks are ratings, head orientation, counting of tones and reactions; :mod:`hpop.study.protocol` has their options.
Their measures are analysed like scores of questionnaires.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import one_of, real
from hpop.base.text import shown
from hpop.criteria.visits import landmark_seen
from hpop.errors import StudyError
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.study.documents import Contents, TableColumn, csv_bytes, write, write_bytes
from hpop.study.protocol import MEASURED, TASKS, Options
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.study.answers import Answers
    from hpop.study.design import Design
    from hpop.study.session import Session, SessionEvent


ITEMS = ("rating", "slider", "head", "tone", "signal", "press", "count", "cue", "watched")
"""Items of "task" events; "tone" and "count" belong to counting, "signal" and "press" to reaction."""
SAMPLES = "samples"
MOST_SAMPLES = 500
"""Most samples of one event."""


def check_event(tasks: Options, event: SessionEvent) -> None:
    """Raise StudyError unless a "task" event belongs to a task of the design, and has numbers or samples of numbers."""
    owners = {"tone": "counting", "count": "counting", "signal": "reaction", "press": "reaction"}
    item, value = one_of("the item of a task", event.item, ITEMS, error=StudyError), event.value
    if (owner := owners.get(item, item)) in TASKS and owner not in tasks:
        raise StudyError(f"the study has no task {owner}; it has {', '.join(tasks) or 'none'}")
    samples = value.get(SAMPLES, []) if isinstance(value, dict) else None
    if not isinstance(value, dict) or len(value) > 10 or not isinstance(samples, list) or len(samples) > MOST_SAMPLES:
        raise StudyError(f"expected numbers by name for the task {item}, got {shown(value)}")
    numbers = [number for name, number in value.items() if name != SAMPLES]
    for sample in samples:
        numbers += sample if isinstance(sample, list) and 2 <= len(sample) <= 3 else ["no sample"]
    if not all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers):
        raise StudyError(f"expected numbers for the task {item}, got {shown(value)}")


class TaskRow(NamedTuple):
    """Row of tasks.csv: an event of a task.

    task   item of the event, such as "rating" or "signal" (`ITEMS`)
    at     date and time, UTC, ISO, to the millisecond
    due    s from the beginning of the stimulus, by the schedule; NaN if the event has no such time
    came   s from the beginning of the stimulus, as measured; NaN if the event has no such time
    value  rating, count, or another number that ``COLUMNS`` describes; NaN for none
    """

    participant: str
    place: int
    condition: str
    task: str
    at: str
    due: float
    came: float
    value: float


class TaskMeasure(NamedTuple):
    """Row of measures.csv: a measure (a name in :data:`MEASURES`) of the stimulus at one place of a session."""

    participant: str
    place: int
    condition: str
    measure: str
    value: float


def last_showings(session: Session) -> dict[int, list[SessionEvent]]:
    """Return the "task" events of each place, only those of the last showing of the stimulus there."""
    found: dict[int, list[SessionEvent]] = {}
    for event in session.events:
        if event.kind == "stimulus" and event.value == "begin":
            found[event.place or 0] = []
        elif event.kind == "task":
            found.setdefault(event.place or 0, []).append(event)
    return {place: events for place, events in found.items() if events}


def measures(session: Session) -> list[TaskMeasure]:
    """Return the measures of a session: of each place, what was rated, counted, reacted to, looked at and watched."""
    made = []
    for place, events in last_showings(session).items():
        letter = session.person.order[place - 1]
        for name, value in _measured(events).items():
            made.append(TaskMeasure(session.person.id, place, letter, name, round(float(value), 6)))
    return made


def _measured(events: Sequence[SessionEvent]) -> dict[str, float]:
    """Return the measures of one showing of a stimulus, by name; those of tasks without events are left out."""
    by_item = {item: [event.value for event in events if event.item == item] for item in ITEMS}
    found: dict[str, float] = {}
    if asked := by_item["rating"]:
        rated = [value["value"] for value in asked if "value" in value]
        found |= {"ratings_missed": len(asked) - len(rated)}
        if rated:
            found |= {"rating_mean": np.mean(rated), "rating_max": max(rated), "rating_last": rated[-1]}
    if by_item["slider"]:
        slid = samples_of(by_item["slider"])[:, 1]
        found |= {"slider_mean": slid.mean(), "slider_max": slid.max()}
    if by_item["head"]:
        head = samples_of(by_item["head"])
        lasted = head[-1, 0] - head[0, 0]
        turned = np.abs(np.diff(np.unwrap(head[:, 1], period=360.0))).sum()
        found |= {"head_speed": 1000.0 * turned / lasted if lasted else np.nan, "head_samples": len(head)}
    if by_item["tone"] or by_item["count"]:
        found["tones"] = len(by_item["tone"])
        if by_item["count"]:
            counted = by_item["count"][-1]["value"]
            error = counted - len(by_item["tone"])
            found |= {"counted": counted, "count_error": error, "count_error_size": abs(error)}
    if signals := by_item["signal"]:
        times = [value["seconds"] for value in signals if "seconds" in value]
        found |= {"signals": len(signals), "signals_missed": len(signals) - len(times)}
        found |= {"reaction_median": np.median(times)} if times else {}
        found["false_presses"] = len(by_item["press"])
    if by_item["watched"]:
        watched = by_item["watched"][-1]
        found |= {"watched": watched["share"], "pauses": watched["pauses"], "skips": watched["skips"]}
    return found


def samples_of(values: Iterable[Mapping[str, Any]]) -> FloatArray:
    """Return all samples of some events (n, 2 or 3): ms from the beginning of the stimulus, and the sampled numbers."""
    rows = [sample for value in values for sample in value[SAMPLES]]
    return np.array(rows, dtype=np.float64).reshape(len(rows), -1)


def check_watched(session: Session, design: Design) -> None:
    """Raise StudyError if the last event is an answer about a video of which too little was watched.

    Enough was watched if the page played the protocol's share of the video. If another player showed it, the
    participant reports when the video begins and ends: the time between must be at least that share of the video's
    duration, less 1 s.
    """
    last, least = session.events[-1], design.protocol.watched
    letter = last.condition
    if session.stopped or last.kind != "answer" or letter is None or design.condition(letter).kind != "video":
        return
    seen = next((video for video in session.videos(design) if video.condition == letter), None)
    if seen is None or not (seen.played or seen.took >= least * seen.lasts - 1.0):
        raise StudyError(f"video {letter} must be watched for {least:.0%} of its time before answers are accepted")


TABLES = ("tasks.csv", "samples.csv", "measures.csv")
COLUMNS = {
    "participant": "Id of the participant",
    "place": "Number of the stimulus in the participant's order",
    "condition": "Letter of the stimulus",
    "task": "Task, or its event: rating, tone, count, signal, press, cue, watched; of samples, slider or head",
    "at": "Time, UTC, to the millisecond",
    "due": "Time by the schedule, s from the beginning of the stimulus",
    "came": "Time as measured, s from the beginning of the stimulus",
    "value": "Rating or count; of a signal, s until the reaction; of a cue, 1 for left and -1 for right; "
    "watched share; of samples, the rating, or degrees to the left; of a measure, its value",
    "t": "Time of the sample, s from the beginning of the stimulus",
    "pitch": "Degrees upwards; of the head only",
    "measure": "Measure of the last showing of the stimulus",
}
VIDEO = "video"
MEASURES = {
    "rating_mean": "Mean of the ratings that were asked for",
    "rating_max": "Largest of these ratings",
    "rating_last": "Last of these ratings",
    "ratings_missed": "Number of these questions without an answer",
    "slider_mean": "Mean of the slider's samples",
    "slider_max": "Largest of the slider's samples",
    "head_speed": "Degrees per second by which the head turned left or right",
    "head_samples": "Number of samples of the head's orientation",
    "tones": "Number of tones",
    "counted": "Number of tones that the participant counted",
    "count_error": "Counted tones minus tones",
    "count_error_size": "Counted tones minus tones, without its sign",
    "signals": "Number of signals to react to",
    "signals_missed": "Number of signals without a reaction in time",
    "reaction_median": "Median time from a signal to the reaction, s",
    "false_presses": "Number of reactions without a signal",
    "watched": "Share of the video that was played",
    "pauses": "Number of pauses of the video",
    "skips": "Number of jumps in the video",
}
"""Measures of :func:`measures`, by name."""
SCORES = {
    "rating": {"rating_mean": "low", "rating_max": "low", "rating_last": "low", "ratings_missed": "low"},
    "slider": {"slider_mean": "low", "slider_max": "low"},
    "head": {"head_speed": ""},
    "counting": {"count_error_size": "low", "count_error": ""},
    "reaction": {"reaction_median": "low", "signals_missed": "low", "false_presses": "low"},
    VIDEO: {"watched": "", "pauses": "", "skips": ""},
}
"""Measures of each task, and of videos, that can be analysed; better end "low" or "high", "" for neither."""


class Variable(NamedTuple):
    """Quantity that a study analyses: a score or item of a questionnaire, or a measure of a task.

    form    id of the questionnaire, or "tasks"
    name    name of the score, item or measure
    title   of the questionnaire, or what the measure is, in English
    source  authors and publication of the questionnaire, or the task
    better  its better end, "low" or "high"; "" for neither
    when    moments at which it is obtained: "before" the first stimulus, "after_each", "after_all"
    """

    form: str
    name: str
    title: str
    source: str
    better: str
    when: tuple[str, ...]

    @property
    def better_words(self) -> str:
        """Return the better end in words; "" for neither."""
        return f"{self.better}er is better" if self.better else ""


def task_scores(design: Design) -> dict[str, str]:
    """Return the measures of a design's tasks and videos that can be analysed, with their better end."""
    videos = [VIDEO] if any(condition.kind == VIDEO for condition in design.conditions) else []
    return {name: better for task in [*design.protocol.options, *videos] for name, better in SCORES[task].items()}


def variable(design: Design, form: str, name: str) -> Variable:
    """Return what a form and a name of an analysis mean; the form "tasks" has the measures of tasks.

    Raises StudyError if the study has no such form, score, item or measure.
    """
    if form != MEASURED:
        asked = design.form(form)
        one_of("score", name, dict.fromkeys([*asked.score_names, *(item.id for item in asked.items)]), error=StudyError)
        title, source = asked.title.get("en", asked.id), " ".join(asked.source.split())
        return Variable(form, name, title, source, asked.better, asked.when)
    known = task_scores(design)
    if not known:
        raise StudyError(
            "the study has no tasks and no videos, so it has no measures of them; give a score of a form: "
            f"{', '.join(design.forms)}, or add tasks to the protocol of a new study"
        )
    one_of("measure", name, known, error=StudyError)
    task = next(task for task, names in SCORES.items() if name in names)
    options = ", ".join(f"{option} {value:g}" for option, value in design.protocol.options.get(task, {}).items())
    source = f"Task {task} ({options})" if options else "Videos that the page of the session played"
    return Variable(form, name, MEASURES[name], source, known[name], ("after_each",))


def tables(answers: Answers) -> tuple[Contents, Contents, Contents]:
    """Return the contents of :data:`TABLES`: events, samples of slider and head, and measures."""
    rows: list[TaskRow] = []
    samples: list[tuple[str, int, str, str, float, float, float | None]] = []
    for session in answers.sessions:
        for place, events in last_showings(session).items():
            about = (session.person.id, place, session.person.order[place - 1])
            for event in events:
                value, item = event.value, event.item or ""
                for t, number, *more in value.get(SAMPLES, []) if item != "watched" else []:
                    samples.append((*about, item, t / 1000.0, number, more[0] if more else None))
                if SAMPLES not in value or item == "watched":
                    told = value.get("value", value.get("seconds", value.get("share", np.nan)))
                    rows.append(
                        TaskRow(*about, item, event.at, value.get("due", np.nan), value.get("came", np.nan), told)
                    )
    who = [TableColumn("participant", "TEXT"), TableColumn("place", "INTEGER"), TableColumn("condition", "TEXT")]
    times = [TableColumn("at", "TEXT"), TableColumn("due", "REAL"), TableColumn("came", "REAL")]
    return (
        Contents([*who, TableColumn("task", "TEXT"), *times, TableColumn("value", "REAL")], rows),
        Contents(
            [*who, TableColumn("task", "TEXT"), *(TableColumn(name, "REAL") for name in ("t", "value", "pitch"))],
            samples,
        ),
        Contents(
            [*who, TableColumn("measure", "TEXT"), TableColumn("value", "REAL")],
            [row for session in answers.sessions for row in measures(session)],
        ),
    )


def save_tables(answers: Answers, folder: Path) -> list[Path]:
    """Write :data:`TABLES` if the study has tasks or videos, and return their paths.

    A JSON file beside each describes its columns, as those of the other tables do.
    """
    design = answers.design
    if not design.protocol.options and all(condition.kind != "video" for condition in design.conditions):
        return []
    for name, table in zip(TABLES, tables(answers), strict=True):
        write_bytes(folder / name, csv_bytes(table))
        described: dict[str, dict[str, Any]] = {
            column.name: {"Description": COLUMNS[column.name]} for column in table.columns
        }
        if "measure" in described:
            described["measure"]["Levels"] = MEASURES
        write((folder / name).with_suffix(".json"), described)
    return [folder / name for name in TABLES]


class Dwell(NamedTuple):
    """Time for which a participant looked at a landmark during a stimulus.

    seconds  in all
    glances  number of periods without a break, each of at least one sample
    """

    participant: str
    condition: str
    landmark: str
    seconds: float
    glances: int


@checked_arguments
def dwell(answers: Answers, front: Front, *, within: float = 10.0, far: float = 1000.0) -> list[Dwell]:
    """Return for how long each participant looked at each landmark, from the samples of the head's orientation.

    A participant looks at a landmark while the direction of the head is at most ``within`` degrees from it, and nothing
    hides it. Eyes move without the head, so this is not where people look exactly. Conditions that are not rows of the
    front are left out.

    Parameters
    ----------
    within : degrees
    far : largest distance, m, from which a landmark is seen
    """
    within = real("within", within, 0.1, 180.0, "an angle in degrees", error=StudyError)
    problem = Problem.from_description(front.problem or {})
    found = []
    for session in answers.sessions:
        for place, events in last_showings(session).items():
            condition = answers.design.condition(session.person.order[place - 1])
            heads = [event.value for event in events if event.item == "head"]
            if condition.row is None or not heads:
                continue
            late = float(condition.factors.get("latency") or 0.0)
            run = front.trajectories[condition.row].execution()
            for name, looked, step in _looks(problem, run, samples_of(heads), late, (float(within), far)):
                glances = sum(is_looked for is_looked, _ in groupby(looked))
                seconds = round(sum(looked) * step, 6)
                found.append(Dwell(session.person.id, condition.id, name, seconds, glances))
    return found


def _looks(
    problem: Problem, run: Trajectory, head: FloatArray, late: float, limits: tuple[float, float]
) -> Iterator[tuple[str, list[bool], float]]:
    """Yield each landmark's name, whether each sample looks at it, and the time between samples, s.

    head    samples (n, 3): ms, yaw to the left and pitch upwards in the camera, degrees
    late    s by which the view lags
    limits  angle in degrees, and distance in m
    """
    within, far = limits
    times = np.clip(head[:, 0] / 1000.0 - late, 0.0, run.duration)
    pose = run.model.pose("camera", run.at(times))
    yaw, pitch = np.radians(head[:, 1]), np.radians(head[:, 2])
    parts = (np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch))
    axes = (pose.ahead, pose.left, pose.up)
    gaze = [sum(part * axis[i] for part, axis in zip(parts, axes, strict=True)) for i in range(3)]
    everywhere = (2.0 * np.pi, 2.0 * np.pi)
    step = float(np.median(np.diff(head[:, 0]))) / 1000.0 if len(head) > 1 else 0.0
    for mark in problem.world.content.landmarks:
        to = (mark.x - pose.x, mark.y - pose.y, mark.z - pose.z)
        cosine = sum(a * b for a, b in zip(gaze, to, strict=True)) / np.sqrt(sum(a * a for a in to) + 1e-18)
        near = cosine >= np.cos(np.radians(within))
        seen = landmark_seen(problem.world, run.model, pose, times.size, mark, far=far, view=everywhere)
        yield mark.name, np.broadcast_to(near & seen, times.shape).tolist(), step
