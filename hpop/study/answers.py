"""Answers of a study: each participant's file of events, and tables, matrices and choices of all participants.

Nothing here changes or removes answers on the disk; :mod:`.leaving` deletes those of a participant who withdraws.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import one_of
from hpop.base.text import counted, shown
from hpop.errors import StudyError
from hpop.study import documents, tasks
from hpop.study.design import Design
from hpop.study.documents import Contents, TableColumn, csv_bytes, sqlite_bytes, write_bytes
from hpop.study.forms import Form, score
from hpop.study.live import live_table
from hpop.study.participants import unequal
from hpop.study.protocol import MEASURED
from hpop.study.session import MOST_BYTES, MOST_EVENTS, SCHEMA, VERSION, AnswersFile, Session, asked_at, questions_of
from hpop.study.sharing import sidecars, wide_table

MOST_FILES = 2000
CSV = ("answers.csv", "scores.csv", "choices.csv", "wide.csv")
SQLITE, REMARKS = "answers.sqlite", "remarks.csv"
SHORT = 1.0
"""Tolerance, s, by which a video may be reported as ended before its real end."""


class Row(NamedTuple):
    """Answer of one participant to one item at one place of the session.

    The place is 0 before the first of K stimuli, 1 to K after each in the order of the session, and K + 1 after all.
    ``condition`` is the letter of the stimulus, or None at places 0 and K + 1. Only the last answer to an item at a
    place counts. ``seconds`` is the time since the previous event, ``t`` since the session's start.
    """

    participant: str
    place: int
    condition: str | None
    form: str
    item: str
    value: float
    seconds: float
    t: float


class ScoreRow(NamedTuple):
    """Score of a questionnaire at one place of a session, as in :class:`Row`; NaN if an answer is missing."""

    participant: str
    place: int
    condition: str | None
    form: str
    score: str
    value: float


class Choice(NamedTuple):
    """Choice of a participant between two rows of the front; ``chosen_row`` is None for neither.

    ``first_row`` was shown on the left.
    """

    participant: str
    first_row: int
    second_row: int
    chosen_row: int | None


class Matrix(NamedTuple):
    """Scores after each stimulus, for n people and K stimuli.

    people      (n,)    ids
    conditions  (K,)    letters
    values      (n, K)  NaN if an answer is missing
    places      (n, K)  place in the session at which each person saw each stimulus, from 1
    """

    people: tuple[str, ...]
    conditions: tuple[str, ...]
    values: FloatArray
    places: IntArray


@checked_arguments
@dataclass(frozen=True, eq=False)
class Answers:
    """Answers of all participants in a study, read by :meth:`load`; ``live`` has a row for each live session."""

    design: Design
    sessions: tuple[Session, ...]
    live: tuple[Mapping[str, str | int | float], ...] = ()

    @classmethod
    def load(cls, folder: str | os.PathLike[str], design: Design | None = None) -> Answers:
        """Read all answers in a study's folder.

        Raises StudyError if a file is invalid, belongs to no participant of this design or to one who withdrew, or has
        answers that the design does not ask for.
        """
        known = Design.load(folder) if design is None else design
        sessions, refused = read_sessions(Path(folder), known)
        if refused:
            more = f"; and {len(refused) - 1:,} more, which `hpop study check` lists" if len(refused) > 1 else ""
            raise StudyError(refused[0] + more)
        return cls(known, tuple(sessions), live_table(Path(folder), known))

    @property
    def people(self) -> tuple[str, ...]:
        """Return the ids of the participants with answers, in ascending order."""
        return tuple(session.person.id for session in self.sessions)

    @cached_property
    def table(self) -> tuple[Row, ...]:
        """Return one row for each item that a participant answered, at each place of the session where it was asked."""
        return tuple(
            Row(session.person.id, slot.place, _letter(session, slot.place), slot.form, slot.item, *answer)
            for session in self.sessions
            for slot, answer in sorted(session.answers.items())
        )

    @cached_property
    def scores(self) -> tuple[ScoreRow, ...]:
        """Return all scores of each questionnaire with scales, at each place of a session where it has an answer."""
        found, rated = [], [form for form in self.design.questionnaires if form.kind == "ratings"]
        for session in self.sessions:
            for form in rated:
                for place in range(len(self.design.letters) + 2):
                    if values := session.values(place, form):
                        about = (session.person.id, place, _letter(session, place), form.id)
                        found += [ScoreRow(*about, name, value) for name, value in score(form, values).items()]
        return tuple(found)

    def matrix(self, form: str, score: str) -> Matrix:
        """Return a score, or an item, of a questionnaire asked after each stimulus, for all people and stimuli.

        The form "tasks" has the measures of tasks during the stimuli. Values are NaN if the questionnaire is not asked
        after stimuli, or if the task has no record. Raises StudyError for an unknown form, score, item or measure.
        """
        tasks.variable(self.design, form, score)
        letters = self.design.letters
        if form == MEASURED:
            return self._measured(score)
        asked = self.design.form(form)
        values = np.full((len(self.sessions), len(letters)), np.nan)
        places = np.zeros(values.shape, dtype=np.int64)
        for i, session in enumerate(self.sessions):
            for j, letter in enumerate(letters):
                places[i, j] = session.person.order.index(letter) + 1
                if places[i, j] in asked_at(self.design, asked):
                    values[i, j] = self._value(session, places[i, j], asked, score)
        return Matrix(self.people, letters, values, places)

    def before(self, form: str, score: str) -> FloatArray:
        """Return a score or item (n,) before the first stimulus, in the order of :attr:`people`; NaN if missing."""
        tasks.variable(self.design, form, score)
        if form == MEASURED:
            return np.full(len(self.sessions), np.nan)
        asked = self.design.form(form)
        return np.array([self._value(session, 0, asked, score) for session in self.sessions], dtype=np.float64)

    def choices(self, participant: str | None = None, question: str = "prefer") -> list[Choice]:
        """Return the choices of one participant, or of all, as rows of the front, without pairs with a baseline.

        Pairs whose factors differ are left out too.

        ``question`` is the id of the question about pairs, such as "prefer" or "comfort". Raises StudyError for an
        unknown question, or a participant without answers.
        """
        one_of("question", question, questions_of(self.design), error=StudyError)
        if participant is not None and participant not in self.people:
            raise StudyError(
                f"there are no answers of {shown(participant)}; participants with answers: "
                f"{', '.join(self.people) or 'none'}"
            )
        rows = {one.id: one.row for one in self.design.conditions if one.row is not None}
        levels = {one.id: one.factors for one in self.design.conditions}
        return [
            Choice(
                session.person.id, rows[one.first], rows[one.second], None if one.chosen is None else rows[one.chosen]
            )
            for session in self.sessions
            if participant in (None, session.person.id)
            for one in session.comparisons
            if one.question == question and {one.first, one.second} <= rows.keys()
            if levels[one.first] == levels[one.second]
        ]

    @property
    def faults(self) -> tuple[str, ...]:
        """Return faults of the answers as text: incomplete sessions, missing items, faulty stimuli.

        Faulty stimuli are videos that were not watched to their end, and rides that were not drawn smoothly. A session
        that its participant stopped is not a fault; see :attr:`noted`.
        """
        said = []
        for session in self.sessions:
            name = session.person.id
            if not (session.stopped or session.ended):
                said.append(f"the session of {name} is incomplete: {_how_far(session)}, and it has no end")
            elif session.ended:
                said += [f"{name}: {lacking}" for lacking in session.lacking(self.design)]
            said += [
                f"{name} did not watch video {video.condition} to its end: it lasts {video.lasts:.1f} s, but was "
                f"reported as ended after {video.took:.1f} s"
                for video in session.videos(self.design)
                if not video.played and video.took < video.lasts - SHORT
            ]
            if slow := ", ".join(f"{letter} ({part:.0%})" for letter, part in session.jerky):
                said.append(f"{name} saw fewer than 60 frames per second for a share of some rides: {slow}")
        return tuple(said)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes for the researcher: numbers of sessions, unbalanced orders, stopped sessions, devices."""
        return tuple(self.noted.values())

    @property
    def noted(self) -> dict[str, str]:
        """Return the same notes as :attr:`notes`, by topic."""
        expected = {person.id for person in self.design.expected}
        ended = [session.person for session in self.sessions if session.ended and session.person.id in expected]
        said = {"Complete sessions": f"{len(ended):,} of {counted(len(expected), 'session')} are complete"}
        if short := unequal([person.order for person in ended], self.design.orders):
            said["Orders of complete sessions"] = (
                f"some orders have fewer complete sessions than others: {'; '.join(short)}"
            )
        if stopped := [f"{one.person.id}: {_how_far(one)}" for one in self.sessions if one.stopped]:
            said["Stopped sessions"] = f"{counted(len(stopped), 'participant')} stopped, as anybody may: " + "; ".join(
                stopped
            )
        unseen = [
            f"{session.person.id} ({', '.join(letters)})"
            for session in self.sessions
            if (letters := [video.condition for video in session.videos(self.design) if not video.played])
        ]
        if unseen:
            said["Videos"] = (
                f"the page did not play these videos; participants report that they watched them in another player: "
                f"{', '.join(unseen)}"
            )
        worn = sum(session.device.get("headset") is True for session in self.sessions)
        if 0 < worn < len(self.sessions):
            said["Devices"] = (
                f"{worn} of {len(self.sessions)} participants used a headset, the others a screen: analyse them "
                "separately"
            )
        return said

    def save_tables(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write answers.csv, scores.csv, choices.csv, wide.csv, answers.sqlite, and separately remarks.csv.

        Returns their paths. The tables hold ids, letters, names of items and numbers, but no text written by
        participants. A JSON file beside each CSV file describes its columns.
        A study with tasks or videos also has tasks.csv, samples.csv and measures.csv (:mod:`hpop.study.tasks`).
        """
        target = Path(folder)
        tables = dict(zip(("answers", "scores", "choices"), self._contents(), strict=True))
        wide, described = wide_table(self)
        for name, table in zip(CSV, (*tables.values(), wide), strict=True):
            write_bytes(target / name, csv_bytes(table))
        for stem, sidecar in (sidecars(self.design) | {"wide": described}).items():
            documents.write(target / f"{stem}.json", sidecar)
        write_bytes(target / SQLITE, sqlite_bytes(tables))
        remarks = [(session.person.id, *remark) for session in self.sessions for remark in session.remarks]
        columns = [TableColumn("participant", "TEXT"), TableColumn("place", "INTEGER"), TableColumn("remark", "TEXT")]
        write_bytes(target / REMARKS, csv_bytes(Contents(columns, remarks)))
        return [*(target / name for name in (*CSV, SQLITE, REMARKS)), *tasks.save_tables(self, target)]

    def _contents(self) -> tuple[Contents, Contents, Contents]:
        """Return the tables of answers, scores and choices."""
        who = [TableColumn("participant", "TEXT"), TableColumn("place", "INTEGER"), TableColumn("condition", "TEXT")]
        times = [TableColumn("seconds", "REAL"), TableColumn("t", "REAL")]
        of_item = [TableColumn("form", "TEXT"), TableColumn("item", "TEXT"), TableColumn("value", "REAL")]
        of_score = [TableColumn("form", "TEXT"), TableColumn("score", "TEXT"), TableColumn("value", "REAL")]
        pair = [TableColumn(name, "TEXT") for name in ("participant", "question", "first", "second", "chosen")]
        chosen = [(session.person.id, *one[:4], *one[4:]) for session in self.sessions for one in session.comparisons]
        return (
            Contents([*who, *of_item, *times], self.table),
            Contents([*who, *of_score], self.scores),
            Contents([*pair, *times], chosen),
        )

    def _measured(self, name: str) -> Matrix:
        """Return a measure of a task, for all people and stimuli."""
        letters = self.design.letters
        found = [
            {one.condition: one.value for one in tasks.measures(session) if one.measure == name}
            for session in self.sessions
        ]
        values = np.array([[of.get(letter, np.nan) for letter in letters] for of in found])
        places = np.array([[one.person.order.index(letter) + 1 for letter in letters] for one in self.sessions])
        shape = (len(self.sessions), len(letters))
        return Matrix(self.people, letters, values.reshape(shape), places.reshape(shape).astype(np.int64))

    def _value(self, session: Session, place: int, form: Form, name: str) -> float:
        """Return a score or item of a form after stimulus number ``place`` of a session; NaN if an answer is missing.

        Place 0 is before the first stimulus.
        """
        values = session.values(place, form)
        return score(form, values)[name] if name in form.score_names else values.get(name, np.nan)


def read_sessions(folder: Path, design: Design) -> tuple[list[Session], list[str]]:
    """Return the usable sessions in a study's folder, sorted by id, and messages about the unusable files."""
    files = sorted(path for path in (folder / documents.ANSWERS).glob("*.json") if not path.name.startswith("."))
    if len(files) > MOST_FILES:
        raise StudyError(
            f"{folder / documents.ANSWERS} has {len(files):,} .json files; expected at most {MOST_FILES:,}, "
            "one for each session; move other files out of this folder"
        )
    sessions: dict[str, Session] = {}
    refused = []
    for path in files:
        try:
            session = Session.load(path, design)
            _check_file(path, session.person.id, design, sessions)
            sessions[session.person.id] = session
        except StudyError as error:
            refused.append(str(error))
    return sorted(sessions.values(), key=lambda session: int(session.person.id[1:])), refused


def _check_file(path: Path, participant: str, design: Design, known: dict[str, Session]) -> None:
    """Raise StudyError for a file of answers of a withdrawn participant, a second file of one, or a wrong file name."""
    if participant in design.withdrawn:
        raise StudyError(f"{path}: {participant} withdrew; `hpop study withdraw` removes these answers as well")
    own = path.with_name(f"{participant}.json")
    if path != own and own.exists():
        raise StudyError(
            f"{path}: a second file of participant {participant}, beside {own.name}; keep the complete one, and move "
            "the other one out of the folder"
        )
    if path != own:
        raise StudyError(f"{path}: these are the answers of {participant}; rename the file to {own.name}")


def _how_far(session: Session) -> str:
    """Describe how far a session came: the last stimulus that began."""
    if not session.reached:
        return "no stimulus had begun"
    return f"stimulus {_letter(session, session.reached)}, {session.reached} of {len(session.person.order)}, had begun"


def _letter(session: Session, place: int) -> str | None:
    """Return the letter of the stimulus at a place of a session; None before the first and after the last."""
    return session.person.order[place - 1] if 1 <= place <= len(session.person.order) else None


WHAT = "the answers of a participant"
MARGIN = 64 * 1024  # bytes, of an event that is written with indents, and of the other entries of a file


@dataclass(frozen=True)
class Ledger:
    """File of one participant's answers, to which a server appends; it need not exist yet.

    After every call the file is complete and readable.

    path         path of the file
    design       design of the study to which the answers belong
    participant  id of the participant, such as "p07"
    """

    path: Path
    design: Design
    participant: str

    @property
    def events(self) -> list[dict[str, Any]]:
        """Return all events so far, none if there is no file yet.

        Raises StudyError if the file is invalid, or belongs to another design or participant.
        """
        return list(self._read()["events"])

    def add(self, event: Mapping[str, Any], device: Mapping[str, Any]) -> bool:
        """Append an event; return False if it equals the last event, which a page sends again without a confirmation.

        ``device`` describes the participant's device, and replaces the earlier description in the file.
        Raises StudyError for an event that the design does not ask for or that is not later than the last one, for an
        answer about a video of which too little was watched, and if it cannot be written; the file is then unchanged.
        """
        stored = self._read()
        events = stored["events"]
        if events and dict(event) == events[-1]:
            return False
        if len(events) >= MOST_EVENTS:
            raise StudyError(f"a session has at most {MOST_EVENTS:,} events, and this one is full")
        longer = {**stored, "device": dict(device), "events": [*events, dict(event)]}
        checked = documents.validated("what was sent", longer, AnswersFile, WHAT)
        tasks.check_watched(Session.of(checked, self.design), self.design)
        if len(checked.events) > 1 and checked.events[-1].t <= checked.events[-2].t:
            raise StudyError(
                f"events must rise in time, got {checked.events[-1].t:g} s after {checked.events[-2].t:g} s"
            )
        if self.path.exists() and self.path.stat().st_size + len(json.dumps(event)) + MARGIN > MOST_BYTES:
            raise StudyError(f"a session has at most {MOST_BYTES:,} bytes, and this one is full; take fewer samples")
        documents.write(self.path, longer)
        return True

    def _read(self) -> dict[str, Any]:
        """Return the checked contents of the file, or the contents of a new file."""
        if not self.path.exists():
            known = {"schema": SCHEMA, "version": VERSION, "design": self.design.digest}
            return {**known, "participant": self.participant, "device": {}, "events": []}
        data = documents.parse_json(self.path, documents.read_bytes(self.path, MOST_BYTES), WHAT)
        session = Session.of(documents.validated(self.path, data, AnswersFile, WHAT), self.design)
        if session.person.id != self.participant:
            raise StudyError(
                f"{self.path} holds the answers of {session.person.id}; rename it to {session.person.id}.json"
            )
        found: dict[str, Any] = data
        return found
