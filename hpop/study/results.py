"""Tables of a study's results: scores, tests of stimuli and of their order, and choices between pairs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from itertools import combinations
from typing import Any, Literal

import numpy as np
from scipy.stats import norm

from hpop.base.arrays import FloatArray
from hpop.base.registry import criteria
from hpop.errors import StudyError
from hpop.study import statistics
from hpop.study.answers import Answers, Matrix
from hpop.study.design import Design
from hpop.study.participants import places
from hpop.study.session import PairChoice, questions_of
from hpop.study.statistics.scores import LEAST_STIMULI, Correction

Method = Literal["default", "paper", "mixed"]
Cell = str | int | float
Row = Mapping[str, Cell]
Tables = dict[str, Sequence[Row]]
Asked = Sequence[tuple[str, PairChoice]]
"""Comparisons that participants made for one question, each with the participant's id."""
BEFORE = "before"


def score_tables(
    design: Design, matrix: Matrix, before: FloatArray | None, method: Method, correction: Correction
) -> tuple[Tables, list[str]]:
    """Return all tables of one score by name, and notes on those for which there are too few answers."""
    labels, values = [label(design, letter) for letter in matrix.conditions], matrix.values
    wanted: dict[str, Callable[[], Sequence[Row]]] = {"scores": lambda: _quartile_rows(labels, values, before)}
    if method == "mixed":
        wanted |= _mixed(labels, matrix, correction, design)
        wanted["balance"] = lambda: _balance(labels, matrix, design)
        return _made(wanted)
    if len(labels) >= LEAST_STIMULI or method == "paper":
        wanted["test"] = lambda: [_omnibus(values, method)]
    wanted["pairs"] = lambda: _pairs(labels, values, method, correction)
    if before is not None:
        wanted["against before"] = lambda: _against(labels, values, before, method, correction)
    wanted["places"] = lambda: _by_place(matrix)
    wanted["carry-over"] = lambda: _carried_over(matrix)
    wanted["balance"] = lambda: _balance(labels, matrix, design)
    return _made(wanted)


def choice_tables(design: Design, answers: Answers) -> tuple[Tables, list[str]]:
    """Return all tables of the choices between pairs by name, and notes on those that are missing, with the reason."""
    made = [(session.person.id, one) for session in answers.sessions for one in session.comparisons]
    tables: Tables = {}
    notes = []
    for question in questions_of(design):
        asked = [(person, one) for person, one in made if one.question == question]
        if not asked:
            notes.append(f"choices: no participant answered the question {question!r}")
            continue
        tables_of_one, lacking = _made(_of_question(design, question, asked))
        notes += [f"{question}, {what}" for what in lacking]
        for name, rows in tables_of_one.items():
            tables[name] = [*tables.get(name, ()), *rows]
    return tables, notes


def stimuli_table(design: Design) -> Sequence[Row]:
    """Return the table of the stimuli: letter with description, duration in s, and costs."""
    return [
        {
            "stimulus": label(design, one.id),
            "seconds": one.duration,
            **{_with_unit(name): cost for name, cost in one.costs.items()},
        }
        for one in design.conditions
    ]


def _with_unit(name: str) -> str:
    """Return a criterion's name with its unit, if the criterion is registered."""
    criterion: Any = criteria.get(name)
    unit = "1" if criterion is None else criterion.unit
    return name if unit == "1" else f"{name} ({unit})"


def scores_by_position(matrix: Matrix) -> FloatArray:
    """Return the scores (n, k) with columns by place in the session (k places), instead of by stimulus."""
    by_place: FloatArray = np.take_along_axis(matrix.values, np.argsort(matrix.places, axis=1), axis=1)
    return by_place


def label(design: Design, letter: str) -> str:
    """Return the name of a stimulus for the researcher, such as "A: knee (row 70)"."""
    return f"{letter}: {design.condition(letter)}"


def _made(wanted: Mapping[str, Callable[[], Sequence[Row]]]) -> tuple[Tables, list[str]]:
    """Compute tables; return those that have rows, by name, and a note for each that raised StudyError."""
    tables: Tables = {}
    notes = []
    for name, make in wanted.items():
        try:
            if rows := make():
                tables[name] = rows
        except StudyError as error:
            notes.append(f"{name}: {error}")
    return tables, notes


def _of_question(design: Design, question: str, asked: Asked) -> dict[str, Callable[[], Sequence[Row]]]:
    """Return the functions that compute the tables of one question about pairs, by name."""
    compared = sorted({letter for _, one in asked for letter in (one.first, one.second)})
    return {
        "choices": lambda: _choice_counts(design, question, asked),
        "favourites": lambda: _favourites(design, question, asked, compared),
        "strengths": lambda: _strengths(design, question, asked, compared),
    }


def _quartile_rows(labels: Sequence[str], values: FloatArray, before: FloatArray | None) -> list[Row]:
    """Return medians and quartiles of each column of scores; with scores before, also of the changes since then."""
    columns = list(zip(labels, values.T, strict=True))
    if before is not None:
        columns = [(BEFORE, before), *columns]
        columns += [(f"{label}, change since before", column - before) for label, column in columns[1:]]
    return [{"stimulus": label, **asdict(statistics.describe(column))} for label, column in columns]


def _omnibus(values: FloatArray, method: Method) -> Row:
    """Return the row of the test whether any stimulus differs from the others."""
    if method == "default":
        related = statistics.friedman(values)
        return {
            "test": "Friedman",
            "chi-square": related.statistic,
            "df": related.freedom,
            "p": related.p,
            "Kendall's W": related.agreement,
            "people": related.people,
            "left out": related.left_out,
        }
    test = statistics.kruskal(list(values.T))
    return {
        "test": "Kruskal-Wallis",
        "chi-square": test.statistic,
        "df": test.freedom,
        "p": test.p,
        "epsilon squared": test.epsilon2,
        "eta squared (H)": test.eta2,
        "scores": sum(test.sizes),
    }


def _pairs(labels: Sequence[str], values: FloatArray, method: Method, correction: Correction) -> list[Row]:
    """Compare every two stimuli; effects are positive if the second scores higher."""
    if method == "default":
        pairs = list(combinations(range(len(labels)), 2))
        found = [statistics.wilcoxon(values[:, i], values[:, j]) for i, j in pairs]
        names = [(labels[i], labels[j]) for i, j in pairs]
        return _signed_rank_rows(names, found, correction)
    compared = statistics.dunn(list(values.T))
    p = statistics.adjusted([one.p for one in compared], correction)
    return [
        {
            "first": labels[one.first],
            "second": labels[one.second],
            "z": one.z,
            "p": one.p,
            "adjusted p": float(corrected),
        }
        for one, corrected in zip(compared, p, strict=True)
    ]


def _against(
    labels: Sequence[str], values: FloatArray, before: FloatArray, method: Method, correction: Correction
) -> list[Row]:
    """Compare every stimulus with the scores before the first one."""
    how: dict[str, Any] = {"zeros": "wilcox", "exact": False} if method == "paper" else {}
    found = [statistics.wilcoxon(before, column, **how) for column in values.T]
    return _signed_rank_rows([(BEFORE, label) for label in labels], found, correction)


def _signed_rank_rows(
    names: Sequence[tuple[str, str]], found: Sequence[statistics.Pair], correction: Correction
) -> list[Row]:
    """Return a row for each comparison by Wilcoxon's test, with corrected p values."""
    p = statistics.adjusted([pair.p for pair in found], correction)
    return [
        {
            "first": first,
            "second": second,
            "people": pair.people,
            "zeros": pair.zeros,
            "z": pair.z,
            "p": pair.p,
            "adjusted p": float(corrected),
            "p by": "exact" if pair.exact else "normal approximation",
            "rank-biserial": pair.biserial,
            "|z|/sqrt(n)": pair.r,
            "shift": pair.shift,
            "low": pair.low,
            "high": pair.high,
        }
        for (first, second), pair, corrected in zip(names, found, p, strict=True)
    ]


def _mixed(
    labels: Sequence[str], matrix: Matrix, correction: Correction, design: Design
) -> dict[str, Callable[[], Sequence[Row]]]:
    """Return the functions that compute the tables of an ordinal mixed model, by name."""
    k, values, places = len(labels), matrix.values, matrix.places
    known = ~np.isnan(values)
    plain = cache(lambda: statistics.crossover(values, places))
    carried = cache(lambda: statistics.crossover(values, places, before=True))

    def ratio(name: str, test: statistics.Ratio) -> Row:
        return {"test": name, **_chi2(test)}

    def pairs() -> Sequence[Row]:
        sides = list(combinations(range(k), 2))
        weights = [np.eye(2 * k - 1)[j] - np.eye(2 * k - 1)[i] for i, j in sides]  # the first column: 0, the reference
        found = [_odds(*plain().contrast(weight[1:])) for weight in weights]
        p = statistics.adjusted([row["p"] for row in found], correction)
        return [
            {"first": labels[i], "second": labels[j], **row, "adjusted p": float(corrected)}
            for (i, j), row, corrected in zip(sides, found, p, strict=True)
        ]

    def before() -> Sequence[Row]:
        weights = np.zeros((k, 3 * k - 3))
        weights[:, 2 * k - 2 :] = np.vstack([np.eye(k - 1), -np.ones(k - 1)])  # effects of all stimuli add up to 0
        return [{"stimulus before": labels[i], **_odds(*carried().contrast(weights[i]))} for i in range(k)]

    levels = {"trajectory": [f"{one.row} {one.name}" for one in design.conditions]}
    for name in sorted({name for one in design.conditions for name in one.factors}):
        levels[name] = [str(one.factors.get(name)) for one in design.conditions]

    factors = {"factors": lambda: [ratio(*one) for one in statistics.factorial(values, places, levels).without.items()]}
    return {
        "test": lambda: [
            {**ratio("Ordinal mixed model", plain().without["stimulus"]), "deviation of people": plain().fit.deviation}
            | {"people": int(known.any(axis=1).sum()), "scores": int(known.sum())}
        ],
        **(factors if len(levels) > 1 else {}),
        "pairs": pairs,
        "places": lambda: _by_place(matrix),
        "carry-over": lambda: [
            ratio("the place matters", plain().without["place"]),
            ratio("the stimulus before matters", carried().without["before"]),
            ratio("stimuli differ, given the stimulus before", carried().without["stimulus"]),
        ],
        "stimulus before": before,
    }


def _odds(effect: float, error: float) -> dict[str, float]:
    """Return the columns of an effect on the logarithm of odds: the ratio of odds, interval, z and p (Wald)."""
    low, high = np.exp(effect + norm.ppf(0.975) * np.array([-error, error])).tolist()
    z = effect / error
    return {"odds ratio": float(np.exp(effect)), "low": low, "high": high, "z": z, "p": float(2 * norm.sf(abs(z)))}


def _by_place(matrix: Matrix) -> list[Row]:
    """Return medians and quartiles of the scores at each place in the session, whatever the stimulus."""
    return [
        {"place": place, **asdict(statistics.describe(column))}
        for place, column in enumerate(scores_by_position(matrix).T, 1)
    ]


def _carried_over(matrix: Matrix) -> list[Row]:
    """Test whether scores depend on the place in the session, and whether stimuli differ at the first place alone."""
    by_place = scores_by_position(matrix)
    rows: list[Row] = []
    if by_place.shape[1] >= LEAST_STIMULI:
        test = statistics.friedman(by_place)
        what = "the place matters (Friedman, by chi-square)"
        rows.append({"check": what, **_chi2(test), "people": test.people})
    else:
        pair = statistics.wilcoxon(by_place[:, 0], by_place[:, 1])
        what = f"the place matters (Wilcoxon, {'exact p' if pair.exact else 'by z'})"
        rows.append({"check": what, "z": pair.z, "p": pair.p, "people": pair.people})
    first = [column[places == 1] for column, places in zip(matrix.values.T, matrix.places.T, strict=True)]
    sizes = [int((~np.isnan(one)).sum()) for one in first]
    if min(sizes) > 0 and sum(sizes) > len(sizes):
        alone = statistics.kruskal(first)
        what = "stimuli differ at the first place alone (Kruskal-Wallis, by chi-square)"
        rows.append({"check": what, **_chi2(alone), "people": sum(sizes)})
    return rows


def _chi2(test: statistics.Related | statistics.Independent | statistics.Ratio) -> Row:
    """Return the columns of a chi-square test."""
    return {"chi-square": test.statistic, "df": test.freedom, "p": test.p}


def _balance(labels: Sequence[str], matrix: Matrix, design: Design) -> list[Row]:
    """Count how often each stimulus was at each place of the order, over sessions with complete scores."""
    seen = places(
        [
            tuple(matrix.conditions[i] for i in np.argsort(row))
            for row, values in zip(matrix.places, matrix.values, strict=True)
            if not np.isnan(values).any()
        ],
        design.letters,
    )
    return [
        {"stimulus": label, **{f"place {place}": int(count) for place, count in enumerate(row, 1)}}
        for label, row in zip(labels, seen, strict=True)
    ]


def _choice_counts(design: Design, question: str, asked: Asked) -> list[Row]:
    """Return the number of choices for each pair, with p of an exact binomial test that leaves out "neither".

    A pair for which all people answered "neither" has no row.
    """
    rows: list[Row] = []
    for pair in combinations(sorted({letter for _, one in asked for letter in (one.first, one.second)}), 2):
        chosen = [one.chosen for _, one in asked if {one.first, one.second} == set(pair)]
        if decided := len(chosen) - chosen.count(None):
            part = statistics.share(chosen.count(pair[0]), decided)
            rows.append(
                {
                    "question": question,
                    "first": label(design, pair[0]),
                    "second": label(design, pair[1]),
                    "first chosen": part.count,
                    "second chosen": decided - part.count,
                    "neither": chosen.count(None),
                    "share of the first": part.share,
                    "low": part.low,
                    "high": part.high,
                    "p": part.p,
                }
            )
    return rows


def _favourites(design: Design, question: str, asked: Asked, compared: Sequence[str]) -> list[Row]:
    """Return how many people preferred each stimulus to all others, with tests whether all are equally popular.

    Only people who compared all pairs count; there are no rows if there are none, or if none has a favourite.
    """
    pairs = Counter(person for person, _ in asked)
    every = len(compared) * (len(compared) - 1) // 2
    people = sorted(person for person, several in pairs.items() if several == every)
    if not people:
        return []
    won = np.array(
        [[sum(one.chosen == c for who, one in asked if who == person) for c in compared] for person in people]
    )
    best = (won == len(compared) - 1).astype(int)  # (people, stimuli)
    counts = best.sum(axis=0).tolist()
    if len(compared) < 2 or not sum(counts):
        return []
    exact = statistics.multinomial(counts)
    q = statistics.cochran(best).p if len(compared) >= LEAST_STIMULI and len(people) > 1 else float("nan")
    rows: list[Row] = []
    names = [*(label(design, letter) for letter in compared), "none over each other one"]
    for name, count in zip(names, [*counts, len(people) - sum(counts)], strict=True):
        part = statistics.share(count, len(people))
        share = {"share": part.share, "low": part.low, "high": part.high}
        who = {"question": question, "favourite": name, "people": count, "of": len(people)}
        tests = {} if name == names[-1] else {"p of all alike (multinomial)": exact.p, "p (Cochran's Q)": q}
        rows.append({**who, **share, **tests})
    return rows


def _strengths(design: Design, question: str, asked: Asked, compared: Sequence[str]) -> list[Row]:
    """Return the strength of preference for each stimulus (Bradley and Terry), with intervals.

    The intervals account for repeated choices of one person.
    """
    number = {letter: i for i, letter in enumerate(compared)}
    fit = statistics.bradley_terry(
        [number[one.first] for _, one in asked],
        [number[one.second] for _, one in asked],
        [None if one.chosen is None else number[one.chosen] for _, one in asked],
        stimuli=len(compared),
        people=[person for person, _ in asked],
        names=compared,
    )
    return [
        {
            "question": question,
            "stimulus": label(design, letter),
            "strength": float(strength),
            "low": float(low),
            "high": float(high),
            "ties (nu)": fit.ties,
        }
        for letter, strength, (low, high) in zip(compared, fit.strengths, fit.interval(), strict=True)
    ]
