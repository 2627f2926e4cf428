"""A stand-in of a participant's page: the events that it records in a whole session, answered by a rule."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from hpop.study import Design
from hpop.study.session import asked_at, questions_of

Rule = Callable[[str, int, str, str], float]
"""From participant, place, form and item to the value that is answered."""


def least(participant: str, place: int, form: str, item: str) -> float:
    """Return the least value of every scale in hpop's forms."""
    return 0.0


def events_of(design: Design, participant: str, rule: Rule = least, *, remark: str = "") -> list[dict[str, Any]]:
    """Return the events that the page records, a second apart; pairs are answered by the alphabet's first letter."""
    person = design.participant(participant)
    found: list[dict[str, Any]] = []

    def add(kind: str, **more: Any) -> None:
        t = float(len(found))
        found.append(
            {"t": t, "at": f"2026-11-23T10:{int(t) // 60 % 60:02d}:{int(t) % 60:02d}.000Z", "kind": kind, **more}
        )

    def ask(place: int, condition: str | None) -> None:
        for form in design.questionnaires:
            if form.kind == "ratings" and place in asked_at(design, form):
                for item in form.items:
                    value = rule(participant, place, form.id, item.id)
                    where = {} if condition is None else {"condition": condition}
                    add("answer", place=place, **where, form=form.id, item=item.id, value=value)

    add("consent", value=True)
    add("start")
    ask(0, None)
    for place, letter in enumerate(person.order, 1):
        add("stimulus", place=place, condition=letter, value="begin")
        frames = {"count": 900, "seconds": 15.0, "slow": 0.01, "longest": 20.1}
        add("frames", place=place, condition=letter, value=frames)
        add("stimulus", place=place, condition=letter, value="end")
        ask(place, letter)
        add("pause", place=place, condition=letter, value="begin")
        add("pause", place=place, condition=letter, value="end")
    ask(len(person.order) + 1, None)
    for question in questions_of(design):
        for pair in design.pairs(participant):
            add("compare", value={"question": question, "pair": list(pair), "chosen": min(pair)})
    add("remark", place=len(person.order) + 1, value=remark)
    add("end")
    return found


def session(
    design: Design, participant: str, events: list[dict[str, Any]] | None = None, **more: Any
) -> dict[str, Any]:
    """Return the content of answers/p01.json."""
    device = {"browser": "Firefox", "touch": False, "width": 1280, "height": 720, "headset": True, "refresh_hz": 72}
    return {
        "schema": "hpop-answers",
        "version": 1,
        "design": design.digest,
        "participant": participant,
        "device": device,
        "events": events_of(design, participant) if events is None else events,
        **more,
    }


def put(folder: Path, contents: dict[str, Any], name: str | None = None) -> Path:
    """Write answers into a study's folder."""
    path = folder / "answers" / f"{name or contents['participant']}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(contents))
    return path


def answered(design: Design, folder: Path, people: Iterable[str], rule: Rule = least) -> None:
    """Whole sessions of several people."""
    for participant in people:
        put(folder, session(design, participant, events_of(design, participant, rule)))
