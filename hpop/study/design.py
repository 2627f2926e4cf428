"""Design of a study: stimuli under letters, participants with orders of the stimuli, and questionnaires."""

from __future__ import annotations

import os
import string
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from hashlib import sha256
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import MOST_SEED, one_of, whole
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.frontier.strict_json import pieces
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow
from hpop.study import documents
from hpop.study.conditions import (
    FILE,
    FRONT,
    KINDS,
    MOST_BYTES,
    OWN_KINDS,
    PEOPLE,
    SCHEDULE,
    Baseline,
    Condition,
    DesignFile,
    departures,
    lettered_conditions,
    unlike,
)
from hpop.study.documents import front_digest
from hpop.study.factors import Level
from hpop.study.forms import Form, form_file
from hpop.study.participants import (
    MOST,
    Departure,
    Participant,
    checked_departures,
    checked_id,
    checked_strata,
    enrolled,
    participant_id,
    schedule_csv,
    sequences,
    uneven,
)
from hpop.study.protocol import Protocol, check_fits, checked_text, schedule

SCHEMA, VERSION = "hpop-study", 1
FORM_SCHEMA = "hpop-form"
PEOPLE_SCHEMA = "hpop-study-people"
MOST_COMPARED = 8
"""Largest number of stimuli that are compared in pairs: 28 comparisons."""
PAIRS = "preference"
"""Id of the questionnaire that compares two stimuli."""


@checked_arguments
@dataclass(frozen=True, eq=False)
class Design:
    """Design of a study, fixed before it begins; made by :meth:`of`, or read by :meth:`load`.

    front_sha256  SHA-256 of the front (:func:`hpop.study.front_digest`)
    conditions    in the order of their letters
    enrolled      the participants, as planned
    questionnaires  forms, in the order in which they are asked
    order         "permutations", "williams", "latin" or "random"
    left          participants who dropped out or withdrew; not part of the design's digest
    """

    front_sha256: str
    conditions: tuple[Condition, ...]
    enrolled: tuple[Participant, ...]
    questionnaires: tuple[Form, ...]
    protocol: Protocol
    consent: str
    language: str
    seed: int
    order: str
    left: tuple[Departure, ...] = ()

    @classmethod
    def of(
        cls,
        front: Front,
        rows: Sequence[int | str | NamedRow],
        *,
        participants: int,
        consent: str,
        order: str = "permutations",
        strata: Mapping[str, Sequence[str]] | None = None,
        forms: Sequence[str | os.PathLike[str]] = ("ssq", "comfort"),
        comparisons: bool = True,
        baselines: Sequence[Baseline] = (),
        kind: str = "ride",
        factors: Mapping[str, Sequence[Level]] | None = None,
        protocol: Protocol | None = None,
        language: str = "en",
        seed: int = 0,
    ) -> Design:
        """Create a design that shows some rows of a front.

        Parameters
        ----------
        rows : numbers, "knee", "least NAME", or the result of :func:`hpop.study.pick`; "view" is the still view from
            the start, a baseline with the mean duration of the others; "live" is a live session, in which the
            participant drives (`hpop study live`). With the baselines these are two to 26 stimuli, at least one of
            them a row of the front
        participants : number of participants, a multiple of the number of orders, so that these are equally frequent;
            for "permutations" other numbers are refused, for "williams" and "latin" a note says so
        consent : text that a participant reads and agrees to before anything else
        order : "permutations" (all orders, up to four rows), "williams" (each stimulus follows each other equally
            often), "latin" (each at each position equally often) or "random" (drawn for each participant)
        strata : levels by stratum, such as {"sex": ("f", "m")}, balanced within the orders
        forms : ids of questionnaires that hpop has, or paths of your own files
        comparisons : whether pairs of stimuli are compared at the end of the session
        baselines : trajectories that are not on the front; give :func:`hpop.study.prepare` the same ones
        kind : "ride" (pages) or "video" (360 degrees, played around the viewer on a page, or by a headset's own player)
        factors : levels by factor, such as {"latency": (0, 0.5)}; each combination is shown with each row and baseline.
            Factors are "cue", "latency", "restrictor" and "setting"; None is a level without cue or restrictor
        seed : seed of the random letters, orders, pairs and schedules of tasks

        Raises StudyError for an impossible design, UnknownName for an unknown name of a row.
        """
        participants = whole("participants", participants, 1, MOST, error=StudyError)
        seed = whole("seed", seed, 0, MOST_SEED, "a seed", error=StudyError)
        one_of("kind", kind, KINDS, error=StudyError)
        if isinstance(forms, str):
            raise StudyError(f"forms must be a list of ids, such as ['ssq', 'comfort'], got {shown(forms)}")
        questionnaires = [Form.load(form) for form in forms]
        if comparisons and not any(form.kind == "pairs" for form in questionnaires):
            questionnaires.append(Form.load(PAIRS))
        rng = np.random.default_rng(seed)
        conditions = lettered_conditions(front, rows, kind, rng, baselines, factors)
        letters = [condition.id for condition in conditions]
        dealt = sequences(order, letters, participants, rng)
        return cls(
            front_sha256=front_digest(front),
            conditions=conditions,
            enrolled=enrolled(dealt, participants, checked_strata(strata or {}), rng),
            questionnaires=tuple(questionnaires),
            protocol=protocol or Protocol(),
            consent=consent,
            language=language,
            seed=seed,
            order=order,
        )

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Design:
        """Read the design in a study's folder; StudyError if it is missing, or was changed since it was written."""
        path = Path(folder) / FILE
        what = "the design of a study, as `hpop study init` writes it"
        if not path.exists():
            raise StudyError(
                f"{folder} is not the folder of a study: expected {FILE} in it; give the folder that `hpop study init` "
                "made, or begin a study"
            )
        data = documents.read_bytes(path, MOST_BYTES)
        stored = documents.validated(path, documents.parse_json(path, data, what), DesignFile, what)
        try:
            made = cls(
                front_sha256=stored.front.sha256,
                conditions=tuple(Condition(**dict(each)) for each in stored.conditions),
                enrolled=tuple(Participant(each.id, tuple(each.order), each.strata) for each in stored.participants),
                questionnaires=tuple(Form.from_dict(each) for each in stored.forms),
                protocol=Protocol(**dict(stored.protocol)),
                consent=stored.consent,
                language=stored.language,
                seed=stored.seed,
                order=stored.order,
                left=departures(Path(folder) / PEOPLE),
            )
        except StudyError as error:
            raise StudyError(f"{path}: {error}") from None
        if made.document != data:
            raise StudyError(
                f"{path} was rewritten by another program: its content is the same, but answers refer to the SHA-256 "
                "of the file as hpop wrote it; restore that file, or begin a new study with `hpop study init`"
            )
        return made

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write design.json, schedule.csv and, if a participant left, people.json to an existing folder.

        :func:`hpop.study.prepare` writes everything that a study needs. Raises StudyError if a file cannot be written.
        """
        target = Path(folder)
        documents.write_bytes(target / FILE, self.document)
        if self.left:
            left = [asdict(departure) for departure in self.left]
            documents.write(target / PEOPLE, {"schema": PEOPLE_SCHEMA, "version": VERSION, "left": left})
        documents.write_bytes(target / SCHEDULE, schedule_csv(self.participants, self.left).encode())

    def __post_init__(self) -> None:
        checked_text("the consent text", self.consent)
        if self.letters != tuple(string.ascii_uppercase[: len(self.letters)]):
            raise StudyError(
                f"stimuli must be called A, B, ..., each once and in this order, got {', '.join(self.letters)}"
            )
        check_fits(self.protocol.options, self.conditions)
        for person in self.enrolled:
            if sorted(person.order) != sorted(self.letters):
                raise StudyError(f"{person.id} must see each stimulus once, got {' '.join(person.order)}")
        if [person.id for person in self.enrolled] != [participant_id(i) for i in range(1, len(self.enrolled) + 1)]:
            raise StudyError("participants must be called p01, p02, ..., each once and in this order")
        checked_departures(self.enrolled, self.left)
        names = [form.id for form in self.questionnaires]
        if not names or len(set(names)) < len(names):
            raise StudyError(f"a study must have one form or more, each once, got {', '.join(names) or 'none'}")
        if bare := [form.id for form in self.questionnaires if form.template]:
            raise StudyError(
                f"expected forms with questions, got {', '.join(bare)}, whose text is not part of hpop: copy "
                f"{form_file(bare[0])}, write the authors' questions into it, remove `template`, and give its path"
            )
        if foreign := [form for form in self.questionnaires if self.language not in form.languages]:
            said = ", ".join(f"{form.id} (but in {', '.join(form.languages)})" for form in foreign)
            raise StudyError(
                f"forms without texts in {shown(self.language)}: {said}; translate the file of each, and give the "
                "path of the translation"
            )
        if self.comparisons and len(self.letters) > MOST_COMPARED:
            raise StudyError(
                f"{len(self.letters)} stimuli have {len(self.letters) * (len(self.letters) - 1) // 2} pairs: expected "
                f"at most {MOST_COMPARED} stimuli if pairs are compared; leave comparisons out, or take fewer rows"
            )

    @property
    def forms(self) -> tuple[str, ...]:
        """Return the ids of the questionnaires."""
        return tuple(form.id for form in self.questionnaires)

    @property
    def comparisons(self) -> bool:
        """Return whether pairs of stimuli are compared."""
        return any(form.kind == "pairs" for form in self.questionnaires)

    @property
    def letters(self) -> tuple[str, ...]:
        """Return the letters of the conditions, in order."""
        return tuple(condition.id for condition in self.conditions)

    @cached_property
    def participants(self) -> tuple[Participant, ...]:
        """Return all participants: the planned ones, then successors of those who left, with their order and strata."""
        known = {person.id: person for person in self.enrolled}
        for departure in self.left:
            before = known[departure.participant]
            known[departure.successor] = Participant(departure.successor, before.order, before.strata)
        return tuple(known.values())

    def after(self, participant: str, *, withdrawn: bool) -> Design:
        """Return the design after a participant left. A successor with the next free id gets the order and the strata.

        Answers of a participant who dropped out stay part of the study. Those of a withdrawn participant do not.
        """
        self.participant(participant)
        earlier = next((one for one in self.left if one.participant == participant), None)
        if earlier is not None and (earlier.withdrawn or not withdrawn):
            how = "withdrew" if earlier.withdrawn else "dropped out"
            raise StudyError(f"{participant} {how} already; {earlier.successor} has the place")
        successor = participant_id(self.size + 1) if earlier is None else earlier.successor
        left = {one.participant: one for one in self.left}
        left[participant] = Departure(participant, successor, withdrawn)
        return replace(self, left=tuple(left.values()))

    @property
    def withdrawn(self) -> frozenset[str]:
        """Return the ids of the participants who withdrew; `hpop.study.withdraw` has deleted their data."""
        return frozenset(departure.participant for departure in self.left if departure.withdrawn)

    @property
    def expected(self) -> tuple[Participant, ...]:
        """Return all participants except those who left, whether their session is done or not."""
        departed = {departure.participant for departure in self.left}
        return tuple(person for person in self.participants if person.id not in departed)

    @cached_property
    def orders(self) -> tuple[tuple[str, ...], ...]:
        """Return the distinct orders of stimuli that participants see; for "random" those that were drawn."""
        if self.order == "random":
            return tuple(sorted({person.order for person in self.enrolled}))
        return sequences(self.order, self.letters, len(self.enrolled), np.random.default_rng(self.seed))

    def form(self, name: str) -> Form:
        """Return a questionnaire by its id; StudyError if there is none."""
        for form in self.questionnaires:
            if form.id == name:
                return form
        raise StudyError(f"the study has no form {shown(name)}; it has {', '.join(self.forms)}")

    def condition(self, letter: str) -> Condition:
        """Return a condition by its letter; StudyError if there is none."""
        for condition in self.conditions:
            if condition.id == letter:
                return condition
        raise StudyError(f"the study has no stimulus {shown(letter)}; it has {', '.join(self.letters)}")

    def participant(self, name: str) -> Participant:
        """Return a participant by id; StudyError if there is none."""
        checked_id(name)
        for person in self.participants:
            if person.id == name:
                return person
        last = participant_id(self.size)
        raise StudyError(f"the study has no participant {name}; it has {self.participants[0].id} to {last}")

    @property
    def size(self) -> int:
        """Return the number of participants, including successors."""
        return len(self.participants)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes for the researcher before the study: unbalanced orders, and stimuli of unequal duration."""
        lasting = unlike(self.conditions)
        said = (
            [f"{lasting}. `hpop study init --count N --share 0.1` chooses rows of similar duration"] if lasting else []
        )
        return (*self.uneven, *said)

    @property
    def uneven(self) -> tuple[str, ...]:
        """Return notes on orders that are planned less often than others, in all or within a stratum."""
        return () if self.order == "random" else uneven(self.enrolled, self.orders, self.order)

    def pairs(self, participant: str) -> list[tuple[str, str]]:
        """Return the pairs of stimuli that a participant compares, in random order and with random sides.

        Each participant has an order of their own, which the seed determines. The still view and a live session are
        never compared.
        """
        if not self.comparisons:
            return []
        rides = [condition.id for condition in self.conditions if condition.kind not in OWN_KINDS]
        rng = np.random.default_rng([self.seed, int(checked_id(participant)[1:])])
        pairs = list(combinations(rides, 2))
        turned = rng.random(len(pairs)) < 0.5
        return [pairs[i][::-1] if turned[i] else pairs[i] for i in rng.permutation(len(pairs)).tolist()]

    def public(self, participant: str) -> dict[str, Any]:
        """Return the part of the design that a participant's page may contain, as JSON.

        It has no rows, names of rows, costs or other participants.
        """
        person = self.participant(participant)
        seen = [self.condition(letter) for letter in person.order]
        return {
            "schema": FORM_SCHEMA,
            "version": VERSION,
            "design": self.digest,
            "participant": person.id,
            "language": self.language,
            "consent": self.consent,
            "protocol": {**self.protocol.to_dict(), "watched": self.protocol.watched},
            "forms": {form.id: form.to_dict() for form in self.questionnaires},
            "places": [
                {
                    "place": place,
                    "condition": condition.id,
                    "stimulus": condition.stimulus,
                    "kind": condition.kind,
                    "seconds": round(condition.duration, 1),
                    **self.scheduled(participant, place),
                }
                for place, condition in enumerate(seen, 1)
            ],
            "comparisons": [list(pair) for pair in self.pairs(person.id)],
        }

    def scheduled(self, participant: str, place: int) -> dict[str, Any]:
        """Return the tasks at a place of a participant's session as {"tasks": ...}, with their times.

        Times are s from the beginning of the stimulus. Those of tones and signals are drawn from the seed, anew for
        each participant and place.
        The result is {} without tasks, and for live stimuli.
        """
        condition = self.condition(self.participant(participant).order[place - 1])
        if not self.protocol.options or not condition.stimulus:
            return {}
        rng = np.random.default_rng([self.seed, int(participant[1:]), place])
        return {"tasks": schedule(self.protocol.options, condition.duration, rng)}

    def describe(self) -> dict[str, Any]:
        """Return the contents of design.json, as a dict for JSON."""
        return {
            "schema": SCHEMA,
            "version": VERSION,
            "front": {"file": FRONT, "sha256": self.front_sha256},
            "seed": self.seed,
            "order": self.order,
            "language": self.language,
            "conditions": [condition.to_dict() for condition in self.conditions],
            "participants": [asdict(person) for person in self.enrolled],
            "protocol": self.protocol.to_dict(),
            "consent": self.consent,
            "forms": [form.to_dict() for form in self.questionnaires],
        }

    @cached_property
    def document(self) -> bytes:
        """Return the bytes of design.json."""
        return ("".join(pieces(self.describe())) + "\n").encode()

    @property
    def digest(self) -> str:
        """Return the SHA-256 of design.json. Answers contain it, so that they are never read with another design."""
        return sha256(self.document).hexdigest()
