"""Live sessions of a study: what each participant did in a session of ``hpop study live``, from its record."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.text import printable, some
from hpop.errors import StudyError
from hpop.live.record import read_record
from hpop.study.conditions import LIVE
from hpop.study.design import Design
from hpop.study.documents import ANSWERS

Cell = str | int | float
MOST_BYTES = 2**30
"""Largest size of a record, bytes."""


def record_name(design: Design, participant: str) -> str:
    """Return the name of a new record of a participant's live session; StudyError if the study has none for them."""
    person = design.participant(participant)
    if person not in design.expected:
        raise StudyError(
            f"{participant} has left the study; give one of {some([other.id for other in design.expected])}"
        )
    if not any(condition.kind == LIVE for condition in design.conditions):
        raise StudyError(
            "this study has no live session among its stimuli; name it when the study begins: "
            "`hpop study init DIR --rows knee,live`"
        )
    return f"{participant}-live-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}.jsonl"


def live_table(folder: Path, design: Design) -> tuple[dict[str, Cell], ...]:
    """Return a row for each live session that was recorded in a study's folder, in the order of participants.

    Raises StudyError for a record that is too large, or whose participant is unknown or has withdrawn; OutputError for
    a file that is no record.
    """
    rows = []
    for path in sorted((folder / ANSWERS).glob("*-live-*.jsonl")):
        participant = path.name.partition("-")[0]
        design.participant(participant)
        if participant in design.withdrawn:
            raise StudyError(f"{path}: {participant} withdrew; `hpop study withdraw` removes this record as well")
        if path.stat().st_size > MOST_BYTES:
            raise StudyError(f"{path} has over {MOST_BYTES:,} bytes; move it out of the study's folder")
        rows.append({"participant": participant, **summary(read_record(path))})
    return tuple(rows)


def summary(events: Sequence[Mapping[str, Any]]) -> dict[str, Cell]:
    """Return what a viewer did in a live session, from its events (:func:`hpop.live.record.read_record`).

    seconds       from the beginning to the last event
    driving       seconds in which the robot moved
    metres        driven, between recorded positions
    destinations, pushes, questions, wishes, stops  how often the driver asked for each
    offers        how often other paths to the destination were offered
    ways          mean number of paths in an offer
    choices       paths that the driver chose, without pushes; `chosen` counts them by the names of their cards
    followed      pushes for which a path was found that follows the push
    head          degrees that the driver's head turned left or right, per second; NaN without samples
    """
    count = Counter(event["event"] for event in events)
    told = [event["message"] for event in events if event["event"] == "told"]
    offers = [message for message in told if message["type"] == "options"]
    states = [event for event in events if event["event"] == "state"]
    places = np.array([(state["t"], state["x"], state["y"]) for state in states], dtype=np.float64).reshape(-1, 3)
    steps = np.hypot(*np.diff(places[:, 1:], axis=0).T)
    moving = np.array([state["moving"] for state in states], dtype=bool)[1:]
    chosen = _chosen(events)
    return {
        "scenario": printable(Path(str(events[0]["scenario"])).name),
        "seconds": float(events[-1]["t"]),
        "driving": float(np.diff(places[:, 0])[moving].sum()),
        "metres": float(steps.sum()),
        "destinations": count["destination"],
        "offers": len(offers),
        "ways": float(np.mean([len(offer["all"]) for offer in offers])) if offers else 0.0,
        "choices": sum(chosen.values()),
        "chosen": ", ".join(f"{name} {number}" for name, number in chosen.most_common()) or "none",
        "pushes": count["push"],
        "followed": sum(message["type"] == "pushed" and message["followed"] for message in told),
        "questions": count["why"],
        "wishes": count["wish"],
        "stops": count["stop"],
        "head": _head_turning(events),
    }


def _chosen(events: Sequence[Mapping[str, Any]]) -> Counter[str]:
    """Count the paths that the driver chose, by the name of the card; "another way" for a path without a card."""
    offers: dict[Any, dict[int, str]] = {}
    names: dict[int, str] = {}
    chosen = Counter[str]()
    for event in events:
        message = event.get("message", {})
        if message.get("type") == "options":
            names = {card["option"]: str(card["name"]) for card in reversed(message["cards"])}
            offers[message.get("asked")] = names
        elif event["event"] == "take":
            names = offers.get(event.get("asked"), names)
        elif message.get("type") == "taken" and message["by"] == "choice":
            chosen[printable(names.get(message["option"], "another way"))] += 1
    return chosen


def _head_turning(events: Sequence[Mapping[str, Any]]) -> float:
    """Return the mean turning of the heads of those who drive, degrees per second; NaN with fewer than two samples."""
    by_viewer: dict[int, list[list[float]]] = {}
    driver = None
    for event in events:
        if event["event"] == "drives":
            driver = event["viewer"]
        elif event["event"] == "head" and event["viewer"] == driver:
            by_viewer.setdefault(event["viewer"], []).extend(event["samples"])
    turned = lasted = 0.0
    for samples in by_viewer.values():
        at, yaw, _ = np.array(samples, dtype=np.float64).reshape(-1, 3).T
        turned += float(np.abs(np.diff(np.unwrap(yaw))).sum())
        lasted += float(at[-1] - at[0]) / 1000.0 if at.size else 0.0
    return float(np.degrees(turned) / lasted) if lasted > 0.0 else float("nan")
