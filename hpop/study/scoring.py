"""Scores of a questionnaire: from the answers to its items to the numbers that its authors define.

An item without an answer makes the scores that it enters missing, not smaller.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isnan, nan

from hpop.base.arguments import checked_arguments
from hpop.base.scalars import python_value
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.study.forms import Form, Item, Score

DIGITS = 9
"""Of scores after the point: equal scores shall be equal numbers, else tests elsewhere see no ties."""
MOST_PRORATED = 1 / 7
"""Share of a subscale's items that may lack where the others stand for them: one of the seven of the SSQ."""

Answers = Mapping[str, float | None]
"""Values by the id of the item; None, NaN or no entry where there is no answer."""


@checked_arguments
def score(form: Form, values: Answers, prorate: bool = False) -> dict[str, float]:
    """The scores of a form, by name, from answers by item; NaN where an answer lacks.

    With ``prorate`` the mean of the others stands for a missing answer where at most one in seven of a subscale lacks;
    :func:`prorated` names the scores concerned. Items that do not apply (``absent``) are left out and the sum is scaled
    up to all items; a score to which no item applies is NaN.

    Raises StudyError for an item that the form does not have and for a value off its scale.

    >>> ssq = Form.load("ssq")
    >>> answers = {item.id: 0.0 for item in ssq.items} | {"nausea": 1, "general_discomfort": 1, "fatigue": 2}
    >>> {name: round(value, 2) for name, value in score(ssq, answers).items()}
    {'N': 19.08, 'O': 22.74, 'D': 13.92, 'total': 22.44}
    """
    answered = _answered(form, values)
    raw = {name: _raw(form, name, answered, prorate) for name in _subscales(form)}
    made: dict[str, float] = {}
    for one in form.scores:
        made[one.name] = round(_sum_of(form, one, raw, made) * one.times / one.out_of, DIGITS)
    return made


def missing(form: Form, values: Answers) -> tuple[str, ...]:
    """Ids of the items without an answer."""
    answered = _answered(form, values)
    return tuple(item.id for item in form.items if item.id not in answered)


def prorated(form: Form, values: Answers) -> tuple[str, ...]:
    """Names of the scores that ``prorate`` makes though an answer lacks."""
    strict, mended = score(form, values), score(form, values, prorate=True)
    return tuple(name for name in strict if isnan(strict[name]) and not isnan(mended[name]))


def _answered(form: Form, values: Answers) -> dict[str, float]:
    """What was answered, by item, checked."""
    answered = {}
    for name, given in values.items():
        item, value = form.item(name), python_value(given)
        if value is None or (isinstance(value, float) and isnan(value)):
            continue
        if value not in (scale := form.scale_of(item)):
            raise StudyError(f"item {name!r} of form {form.id}: expected {scale}, got {shown(value)}")
        answered[name] = float(value)
    return answered


def _raw(form: Form, subscale: str, answered: Mapping[str, float], prorate: bool) -> float:
    """The raw sum of a subscale, scaled up to all its items where some do not apply, or lack and may be prorated."""
    items = [item for item in form.items if subscale in item.subscales]
    given = [item for item in items if item.id in answered]
    lacking = len(items) - len(given)
    if lacking > (MOST_PRORATED * len(items) if prorate else 0):
        return nan
    counted = [_counted(form, item, answered[item.id]) for item in given if _applies(form, item, answered[item.id])]
    if not counted:
        return nan
    return sum(counted) if len(counted) == len(items) else sum(counted) * len(items) / len(counted)


def _counted(form: Form, item: Item, value: float) -> float:
    """What an answer counts in a sum."""
    scale = form.scale_of(item)
    return scale.low + scale.high - value if item.reverse else value


def _applies(form: Form, item: Item, value: float) -> bool:
    return not form.scale_of(item).is_absent(value)


def _sum_of(form: Form, one: Score, raw: Mapping[str, float], made: Mapping[str, float]) -> float:
    """What a score is made of, before it is scaled."""
    if one.subscale is not None:
        return raw[one.subscale]
    if one.of:
        subscales = {score.name: score.subscale for score in form.scores}
        return sum(raw[str(subscales[part])] for part in one.of)
    total = sum(made[part] for part in one.parts)
    return total / len(one.mean_of) if one.mean_of else total


def _subscales(form: Form) -> Iterable[str]:
    return dict.fromkeys(name for item in form.items for name in item.subscales)
