"""Questionnaires as data: the items of a form, its scales, and the scores that its authors define.

A form is a YAML file. Forms of hpop are named by their id; :func:`shipped` lists them. Your own files are checked as
strictly as scenario files. If an answer is missing, the scores that use it are missing too;
they are not computed as if it were 0.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping
from importlib import resources
from math import isclose, isnan, nan
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, Strict, StringConstraints, ValidationError, model_validator

from hpop.base.arguments import checked_arguments
from hpop.base.text import is_number, python_value, shown
from hpop.errors import HpopError, StudyError, did_you_mean
from hpop.scenario.faults import Faults
from hpop.scenario.yaml_lines import Document
from hpop.study.documents import in_words
from hpop.study.protocol import MEASURED

MOST_ITEMS = 200
MOST_STEPS = 1000
"""Largest number of steps of a scale."""
IDS = re.compile(r"[a-z][a-z0-9_]{0,39}")
"""Pattern for ids of forms and items, which become file names and columns of tables."""

Id = Annotated[str, StringConstraints(pattern=f"^{IDS.pattern}$")]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
Language = Annotated[str, StringConstraints(pattern=r"^[a-z]{2,3}(-[A-Z]{2})?$")]
Words = Annotated[str, StringConstraints(min_length=1, max_length=1000)]
Text = Annotated[dict[Language, Words], Field(min_length=1, max_length=100)]
"""Text in several languages, by code: "en", "de", "pt-BR"."""
Names = Annotated[tuple[Name, ...], Strict(False)]  # lists of JSON are accepted
When = Literal["before", "after_each", "after_all"]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class Absent(_Part):
    """Additional answer that says that the item does not apply: its value and its text."""

    value: float
    text: Text


class AnswerScale(_Part):
    """Values from which an answer is chosen: low, low + step, ..., high.

    labels  by language: one for each value, or two for the ends
    absent  an additional answer: that the item does not apply
    """

    low: float
    high: float
    step: Annotated[float, Field(gt=0)] = 1
    labels: dict[Language, Annotated[tuple[Words, ...], Strict(False)]] = {}
    absent: Absent | None = None

    @property
    def values(self) -> tuple[float, ...]:
        """Return all values low, low + step, ..., high in rising order; the value of ``absent`` is not among them."""
        return tuple(self.low + i * self.step for i in range(round((self.high - self.low) / self.step) + 1))

    def __contains__(self, value: object) -> bool:
        if not is_number(value):
            return False
        value = cast(float, python_value(value))
        if not self.low <= value <= self.high:  # a whole number of 400 digits is no float
            return self.is_absent(value)
        steps = (value - self.low) / self.step
        return isclose(steps, round(steps), abs_tol=1e-6) or self.is_absent(value)

    def is_absent(self, value: float) -> bool:
        """Return whether a value means that the item does not apply."""
        return self.absent is not None and value == self.absent.value

    def __str__(self) -> str:
        beside = f", or {self.absent.value:g} where it does not apply" if self.absent else ""
        return f"{self.low:g} to {self.high:g} in steps of {self.step:g}{beside}"

    @model_validator(mode="after")
    def _sound(self) -> AnswerScale:
        """Check that the scale is consistent."""
        steps = (self.high - self.low) / self.step
        _require(self.high > self.low, f"low must be below high, got {self.low:g} and {self.high:g}")
        _require(steps <= MOST_STEPS, f"a scale has at most {MOST_STEPS:,} steps; take a larger step")
        _require(isclose(steps, round(steps), abs_tol=1e-6), "high must be a whole number of steps above low")
        for language, labels in self.labels.items():
            wanted = round(steps) + 1
            said = f"expected {wanted} labels in {language}, one a value, or 2 for both ends, got {len(labels)}"
            _require(len(labels) in (2, wanted), said)
        if self.absent:
            outside = not self.low <= self.absent.value <= self.high
            _require(outside, "the value of absent must lie outside the scale")
        return self


class Item(_Part):
    """Question of a form.

    subscales  names of the raw sums to which its answer is added
    reverse    whether a high answer counts as a low one: low + high - value
    scale      its own scale; by default the form's
    """

    id: Id
    text: Text
    subscales: Names = ()
    reverse: bool = False
    scale: AnswerScale | None = None


class Score(_Part):
    """Number that a form computes from answers. Exactly one of subscale, of, mean_of and sum_of is given.

    To what it gives, ``plus`` is added; the result is multiplied by ``times`` and divided by ``out_of``.

    subscale  the raw sum of the items in this subscale
    at_least  with ``subscale``: the number of its items that are answered with this value or more, not their sum
    of        the sum of the raw sums of several subscale scores (the total of the SSQ)
    mean_of   the mean of several scores
    sum_of    the sum of several scores
    plus      number that is added
    times     factor
    out_of    divisor
    """

    name: Name
    subscale: Name | None = None
    at_least: float | None = None
    of: Names = ()
    mean_of: Names = ()
    sum_of: Names = ()
    plus: float = 0
    times: float = 1
    out_of: Annotated[float, Field(gt=0)] = 1

    @property
    def parts(self) -> tuple[str, ...]:
        """Return the names of the scores from which this one is computed."""
        return self.of + self.mean_of + self.sum_of

    @model_validator(mode="after")
    def _sound(self) -> Score:
        """Check that exactly one source of the score is given."""
        given = [bool(self.subscale), bool(self.of), bool(self.mean_of), bool(self.sum_of)]
        _require(sum(given) == 1, "give exactly one of subscale, of, mean_of, sum_of")
        _require(self.at_least is None or bool(self.subscale), "at_least counts answers of a subscale; give subscale")
        return self


@checked_arguments
class Form(_Part):
    """Questionnaire: items, scales and scores.

    id      its name in designs and answers
    source  authors and publication
    rights  who may use the texts, and who translated them
    template  whether the questions are missing, because their rights are not clear: only the structure is known
    when    asked before the first stimulus, after each, or after all: one or more of these
    kind    "ratings" on scales; "pairs": each item compares two stimuli, and the answer is one of them, or none
    better  the better end of its scores, "low" (sickness) or "high" (comfort)
    ask     question above the items
    scale   of all items without their own
    """

    id: Id
    title: Text
    source: Words
    rights: Annotated[str, StringConstraints(max_length=1000)] = ""
    template: bool = False
    when: Annotated[tuple[When, ...], Strict(False), Field(min_length=1)]
    kind: Literal["ratings", "pairs"] = "ratings"
    better: Literal["low", "high"] = "low"
    ask: Text
    scale: AnswerScale | None = None
    items: Annotated[tuple[Item, ...], Strict(False), Field(min_length=1, max_length=MOST_ITEMS)]
    scores: Annotated[tuple[Score, ...], Strict(False), Field(max_length=MOST_ITEMS)] = ()

    @classmethod
    def load(cls, form: str | os.PathLike[str]) -> Form:
        """Read a form: one of hpop's by its id, or a file by a path that ends in .yaml.

        Raises StudyError, with the line and the key, for an invalid form.

        >>> ssq = Form.load("ssq")
        >>> len(ssq.items), ssq.score_names
        (16, ('N', 'O', 'D', 'total'))
        """
        path = Path(form)
        if path.suffix.lower() not in (".yaml", ".yml"):
            known = shipped()
            if str(form) not in known:
                near = did_you_mean(str(form), known)
                raise StudyError(
                    f"unknown form {shown(str(form))}.{near} hpop has {', '.join(known)}; give a form of your own as a "
                    "path that ends in .yaml"
                )
            path = form_file(str(form))
        try:
            if not path.exists():
                raise StudyError(f"{path}: no such file; give the path of a form, a YAML file")
            document = Document(path)
            faults = Faults(document)
            made = faults.validated(cls, document.values, ())
            faults.raise_all()
        except (HpopError, ValueError) as error:
            raise StudyError(str(error)) from None
        read: Form = made
        return read

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Form:
        """Create a form from the values that :meth:`to_dict` returned; StudyError for an invalid form."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise StudyError(f"expected a valid form, got {in_words(error)}") from None

    def to_dict(self) -> dict[str, Any]:
        """Return the form as values for JSON."""
        return self.model_dump(mode="json", exclude_defaults=True)

    @property
    def languages(self) -> tuple[str, ...]:
        """Return the languages in which every text of the form is available."""
        return tuple(sorted(set.intersection(*(set(text) for text in self._texts()))))

    @property
    def score_names(self) -> tuple[str, ...]:
        """Return the names of the scores, in order."""
        return tuple(score.name for score in self.scores)

    def item(self, name: str) -> Item:
        """Return an item by its id; StudyError if there is none."""
        for item in self.items:
            if item.id == name:
                return item
        known = [item.id for item in self.items]
        raise StudyError(
            f"form {self.id} has no item {shown(name)}.{did_you_mean(name, known)} It has {', '.join(known)}"
        )

    def scale_of(self, item: Item) -> AnswerScale:
        """Return the scale of an item; StudyError for an item that compares pairs, which has no scale."""
        if (scale := item.scale or self.scale) is None:
            raise StudyError(f"form {self.id} compares pairs: its item {item.id!r} has no scale")
        return scale

    def _texts(self) -> list[Mapping[str, Any]]:
        """Return all texts of the form, each by language."""
        texts: list[Mapping[str, Any]] = [self.title, self.ask, *(item.text for item in self.items)]
        for scale in (self.scale, *(item.scale for item in self.items)):
            if scale is not None:
                texts += [scale.labels] * bool(scale.labels)
                texts += [scale.absent.text] if scale.absent else []
        return texts

    @model_validator(mode="after")
    def _sound(self) -> Form:
        """Check that the parts of the form fit together."""
        _require(self.id != MEASURED, f"the id {MEASURED} is that of measures of tasks; choose another one")
        _once(f"item of form {self.id}", [item.id for item in self.items])
        _once(f"score of form {self.id}", self.score_names)
        _once("time in when", self.when)
        _require(bool(self.languages), "no language has all texts of the form; write the same languages everywhere")
        if self.kind == "pairs":
            rated = self.scale or self.scores or any(item.scale or item.subscales for item in self.items)
            _require(not rated, "a form that compares pairs has no scales, subscales and scores")
            _require(self.when == ("after_all",), "a form that compares pairs is asked after all stimuli")
            return self
        bare = [item.id for item in self.items if (item.scale or self.scale) is None]
        _require(not bare, f"give the form a scale, or each item its own; {', '.join(bare)} has none")
        subscales = {name for item in self.items for name in item.subscales}
        used = {score.subscale for score in self.scores} - {None}
        _require(used <= subscales, f"no item is in the subscale {', '.join(sorted(map(str, used - subscales)))}")
        idle = sorted(subscales - used)
        _require(not idle, f"no score is made of the subscale {', '.join(idle)}; add one, or leave it out")
        before: dict[str, Score] = {}
        for score in self.scores:
            later = [part for part in score.parts if part not in before]
            _require(not later, f"score {score.name} needs {', '.join(later)}, which must stand before it")
            made = [part for part in score.of if before[part].subscale is None or before[part].at_least is not None]
            _require(not made, f"score {score.name}: of adds raw sums of subscales, and {', '.join(made)} is none")
            before[score.name] = score
        return self


def form_file(name: str) -> Path:
    """Return the path of the file of a form that comes with hpop."""
    return Path(str(resources.files("hpop.study").joinpath("forms", f"{name}.yaml")))


def shipped() -> tuple[str, ...]:
    """Return the ids of the forms that come with hpop."""
    files = resources.files("hpop.study").joinpath("forms").iterdir()
    return tuple(sorted(file.name.removesuffix(".yaml") for file in files if file.name.endswith(".yaml")))


def _require(condition: bool, otherwise: str) -> None:
    """Raise ValueError with a message unless a condition holds."""
    if not condition:
        raise ValueError(otherwise)


def _once(what: str, names: tuple[str, ...] | list[str]) -> None:
    """Raise ValueError if a name occurs twice."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    _require(not twice, f"{what} {', '.join(twice)} is given twice; keep one")


DIGITS = 9
"""Decimals to which scores are rounded, so that statistical tests see equal scores as ties."""
MOST_PRORATED = 1 / 7
"""Largest share of a subscale's items that may be missing with ``prorate``: one of seven in the SSQ."""

Answers = Mapping[str, float | None]
"""Answers by the id of the item; None, NaN or no entry for a missing answer."""
Raw = dict[tuple[str | None, float | None], float]
"""Sums of answers, or numbers of answers that are at least a value, by subscale and that value; None for sums."""


@checked_arguments
def score(form: Form, values: Answers, prorate: bool = False) -> dict[str, float]:
    """Compute the scores of a form from answers by item; a score is NaN if one of its answers is missing.

    With ``prorate`` a missing answer is replaced by the mean of the others, if at most one in seven of a subscale is
    missing; :func:`prorated` names these scores. Items that do not apply (``absent``) are left out and the sum is
    scaled up to all items; a score without applicable items is NaN.

    Raises StudyError for an item that the form does not have and for a value off its scale.

    >>> ssq = Form.load("ssq")
    >>> answers = {item.id: 0.0 for item in ssq.items} | {"nausea": 1, "general_discomfort": 1, "fatigue": 2}
    >>> {name: round(value, 2) for name, value in score(ssq, answers).items()}
    {'N': 19.08, 'O': 22.74, 'D': 13.92, 'total': 22.44}
    """
    answered = _checked_answers(form, values)
    raw: Raw = {(one.subscale, one.at_least): _raw(form, one, answered, prorate) for one in form.scores if one.subscale}
    made: dict[str, float] = {}
    for one in form.scores:
        made[one.name] = round((_sum_of(form, one, raw, made) + one.plus) * one.times / one.out_of, DIGITS)
    return made


def missing(form: Form, values: Answers) -> tuple[str, ...]:
    """Return the ids of the items without an answer."""
    answered = _checked_answers(form, values)
    return tuple(item.id for item in form.items if item.id not in answered)


def prorated(form: Form, values: Answers) -> tuple[str, ...]:
    """Return the names of the scores that could be computed only with ``prorate``, because answers are missing."""
    strict, mended = score(form, values), score(form, values, prorate=True)
    return tuple(name for name in strict if isnan(strict[name]) and not isnan(mended[name]))


def _checked_answers(form: Form, values: Answers) -> dict[str, float]:
    """Return the answers by item, without missing ones; StudyError for an unknown item or a value off its scale."""
    answered = {}
    for name, given in values.items():
        item, value = form.item(name), python_value(given)
        if value is None or (isinstance(value, float) and isnan(value)):
            continue
        if value not in (scale := form.scale_of(item)):
            raise StudyError(f"item {name!r} of form {form.id}: expected {scale}, got {shown(value)}")
        answered[name] = float(value)
    return answered


def _raw(form: Form, one: Score, answered: Mapping[str, float], prorate: bool) -> float:
    """Return the sum of the answers in a score's subscale, or how many are ``at_least``; NaN if too many are missing.

    It is scaled up if items do not apply, or are missing and may be prorated.
    """
    items = [item for item in form.items if one.subscale in item.subscales]
    given = [item for item in items if item.id in answered]
    lacking = len(items) - len(given)
    if lacking > (MOST_PRORATED * len(items) if prorate else 0):
        return nan
    applying = [item for item in given if not form.scale_of(item).is_absent(answered[item.id])]
    counted = [_summand(form, item, answered[item.id]) for item in applying]
    if one.at_least is not None:
        counted = [float(value >= one.at_least) for value in counted]
    if not counted:
        return nan
    return sum(counted) if len(counted) == len(items) else sum(counted) * len(items) / len(counted)


def _summand(form: Form, item: Item, value: float) -> float:
    """Return what an answer adds to a sum: its value, or for a reversed item its mirror image on the scale."""
    scale = form.scale_of(item)
    return scale.low + scale.high - value if item.reverse else value


def _sum_of(form: Form, one: Score, raw: Raw, made: Mapping[str, float]) -> float:
    """Return a score before ``plus``, ``times`` and ``out_of``.

    made  scores so far
    """
    if one.subscale is not None:
        return raw[one.subscale, one.at_least]
    if one.of:
        subscales = {score.name: score.subscale for score in form.scores}
        return sum(raw[subscales[part], None] for part in one.of)
    total = sum(made[part] for part in one.parts)
    return total / len(one.mean_of) if one.mean_of else total
