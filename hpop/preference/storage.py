"""Preference file: strict JSON, read without running code.

The file is written completely or not at all. It holds the costs by name and unit with their scale, equally weighted
draws of the posterior, and the answers, so that asking can continue. The reader checks every key, type and number.
"""

from __future__ import annotations

import dataclasses
import errno
import os
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.files import read_regular, replacing
from hpop.base.options import MOST_SEED
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.frontier.strict_json import Kinds, numbers, parse, parts, pieces
from hpop.preference.answers import MOST_ANSWERS, CostScale, Measure, PairAnswer, checked_question
from hpop.preference.prior import Prior

SCHEMA = "hpop-preference"
VERSION = 1
SIZE_LIMIT = 16 * 1024**2
"""Largest size of a file, in bytes."""
DRAWS = 2_000
"""Number of draws in a file."""
MOST_CRITERIA = 100
MOST_COST, MOST_DRAWN = 1e100, 1e50
"""Greatest cost, and greatest sharpness and nu that are drawn; the least range and nu are one by these. No product of
such numbers overflows."""
_TOP: Kinds = {
    "schema": str, "version": int, "question": str, "n": int, "front": str, "criteria": list, "features": dict,
    "prior": dict, "ties": bool, "seed": int, "answers": list, "draws": dict,
}  # fmt: skip
_CRITERION: Kinds = {"name": str, "unit": str, "ideal": (int, float), "range": (int, float)}
_PRIOR: Kinds = {
    "concentration": list, "about": list,
    **dict.fromkeys(("sharpness", "spread", "random", "ties", "ties_spread", "selective"), (int, float)),
}  # fmt: skip
_MEASURE: Kinds = {"name": str, "unit": str, "size": (int, float)}
_ANSWER: Kinds = {"first": int, "second": int, "chosen": (int, type(None)), "costs": list, "weight": (int, float)}
_DRAWS: Kinds = {"shares": dict, "sharpness": list, "ties": list}


class Stored(NamedTuple):
    """Content of a preference file.

    Its D draws of shares (D, f), sharpness (D,) and Davidson's nu (D,) have equal weight. ``ties`` is True if "no
    difference" was a possible answer; ``front`` is the SHA-256 of the front's costs.
    """

    scale: CostScale
    question: str
    answers: tuple[PairAnswer, ...]
    prior: Prior
    ties: bool
    seed: int
    front: str
    shares: FloatArray
    sharpness: FloatArray
    ties_nu: FloatArray


def write(path: str | os.PathLike[str], stored: Stored) -> None:
    """Write a preference to a file, replacing an existing one; OSError if it cannot be written."""
    target = Path(path)
    if not target.parent.exists():
        raise FileNotFoundError(errno.ENOENT, "the folder for the preference does not exist; create it", str(path))
    with replacing(target) as file:
        for piece in pieces(_document(stored)):
            file.write(piece.encode())


def read(path: str | os.PathLike[str]) -> Stored:
    """Read and check a preference file; StudyError for another kind of file, OSError for one that cannot be opened."""
    try:
        data = read_regular(path, SIZE_LIMIT)
    except OSError as error:
        if error.errno != errno.EFBIG:
            raise
        _refuse(path, f"a file of at most {SIZE_LIMIT} bytes", "a larger one")
    try:
        return _parse_stored(parse(data))
    except RecursionError:
        _refuse(path, "a preference", "brackets nested too deeply")
    except (StudyError, ValueError) as error:
        _refuse(path, "a preference as `hpop prefer` writes it", str(error))


def _refuse(path: str | os.PathLike[str], expected: str, found: str) -> NoReturn:
    """Raise StudyError for a file: what was expected, and what was found."""
    raise StudyError(
        f"{os.fspath(path)}: expected {expected}; found: {found:.600}; ask again with `hpop prefer`"
    ) from None


def _document(stored: Stored) -> dict[str, Any]:
    """Return the content of a file as a dict for JSON."""
    scale, prior = stored.scale, dataclasses.asdict(stored.prior)
    del prior["_stretch"]  # follows from ``about`` and the scale
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "question": stored.question,
        "n": len(stored.answers),
        "front": stored.front,
        "criteria": [
            {"name": name, "unit": unit, "ideal": ideal, "range": span}
            for name, unit, ideal, span in zip(
                scale.names, scale.units, scale.ideal.tolist(), scale.span.tolist(), strict=True
            )
        ],
        "features": dict(scale.features),
        "prior": prior
        | {
            "concentration": list(stored.prior.concentration),
            "about": [one._asdict() for one in stored.prior.about],
        },
        "ties": stored.ties,
        "seed": stored.seed,
        "answers": [answer._asdict() for answer in stored.answers],
        "draws": {
            "shares": {name: _six_digits(stored.shares[:, j]) for j, name in enumerate(scale.columns)},
            "sharpness": _six_digits(stored.sharpness),
            "ties": _six_digits(stored.ties_nu),
        },
    }


def _six_digits(column: FloatArray) -> list[float]:
    """Return numbers rounded to six significant digits, far more than the precision of the draws."""
    return [float(f"{value:.6g}") for value in column.tolist()]


def _parse_stored(given: Any) -> Stored:
    """Check the content of a file, and return it; ValueError or StudyError for invalid content."""
    schema, version, question, n, front, criteria, features, prior, ties, seed, answers, draws = parts(
        given, "the file", _TOP
    )
    if (schema, version) != (SCHEMA, VERSION):
        raise ValueError(f"the schema {shown(schema)} of version {version}, not {SCHEMA} {VERSION}")
    if not 0 < len(criteria) <= MOST_CRITERIA:
        raise ValueError(f"{len(criteria)} criteria, not from 1 to {MOST_CRITERIA}")
    if not 0 <= seed <= MOST_SEED:
        raise ValueError(f"the seed {seed}")
    scale = _parse_scale(criteria, features)
    k = len(scale.names)
    if not len(answers) == n <= MOST_ANSWERS:
        raise ValueError(f"{len(answers)} answers, but n = {n}; n must be their number, at most {MOST_ANSWERS:,}")
    return Stored(
        scale,
        checked_question(question),
        tuple(_parse_answer(one, k) for one in answers),
        _parse_prior(prior, scale),
        ties,
        seed,
        front,
        *_parse_draws(draws, scale),
    )


def _parse_scale(criteria: list[Any], features: dict[str, Any]) -> CostScale:
    """Check and return the scale of the costs."""
    rows = [parts(one, "a criterion", _CRITERION) for one in criteria]
    names, units, ideal, span = zip(*rows, strict=True)
    if len(set(names)) < len(names):
        raise ValueError(f"a criterion twice among {', '.join(names)}")
    low = _bounded_column(list(ideal), "ideal", len(names), -MOST_COST, MOST_COST)
    size = _bounded_column(list(span), "range", len(names), 0, MOST_COST)
    if ((size > 0) & (size < 1 / MOST_COST)).any():
        raise ValueError(f"a range below {1 / MOST_COST:g}")
    return CostScale(names, units, low, size, features)


def _parse_prior(given: dict[str, Any], scale: CostScale) -> Prior:
    """Check the prior of a file, and return it for the ranges of the scale."""
    # Earlier files had neither key; then all people cared for all costs.
    concentration, about, *rest = parts({"about": [], "selective": 0.0, **given}, "the prior", _PRIOR)
    values = tuple(numbers(concentration, "concentration", len(concentration)).tolist())
    measures = [parts(one, "what the prior is about", _MEASURE) for one in about]
    if measures and len(measures) != len(values):
        raise ValueError(f"{len(values)} concentrations for {len(measures)} costs in the prior, not one for each")
    sizes = _bounded_column(
        [size for *_, size in measures], "the ranges of the prior", len(measures), 0, MOST_COST
    ).tolist()
    names = tuple(Measure(name, unit, size) for (name, unit, _), size in zip(measures, sizes, strict=True))
    sharpness, spread, random, ties, ties_spread, selective = map(float, rest)
    prior = Prior(values, sharpness, spread, random, ties, ties_spread, selective, names).on(scale.measures)
    prior.concentrations(len(scale.columns))
    return prior


def _parse_answer(given: Any, k: int) -> PairAnswer:
    """Check and return an answer about two points with k costs."""
    first, second, chosen, costs, weight = parts(given, "an answer", _ANSWER)
    if len(costs) != 2 or not all(isinstance(one, list) for one in costs):
        raise ValueError("costs of an answer that are not two lists of numbers")
    pair = tuple(
        tuple(_bounded_column(one, "the costs of an answer", k, -MOST_COST, MOST_COST).tolist()) for one in costs
    )
    if min(first, second) < 0 or first == second or chosen not in (first, second, None) or not 0 < weight <= 1:
        raise ValueError(f"an invalid answer: {shown(given)}")
    return PairAnswer(first, second, chosen, (pair[0], pair[1]), float(weight))


def _parse_draws(given: dict[str, Any], scale: CostScale) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Check and return the draws: shares, sharpness and ties."""
    shares, sharpness, ties = parts(given, "draws", _DRAWS)
    columns = parts(shares, "the shares", dict.fromkeys(scale.columns, list))
    size = len(ties)
    if not 0 < size <= 1_000_000:
        raise ValueError(f"{size} draws")
    table = np.column_stack([_bounded_column(c, n, size, 0, 1) for c, n in zip(columns, scale.columns, strict=True)])
    if (table.sum(axis=1) <= 0).any():
        raise ValueError("draws without any share")
    sharp = _bounded_column(sharpness, "sharpness", size, 0, MOST_DRAWN)
    nu = _bounded_column(ties, "ties", size, 1 / MOST_DRAWN, MOST_DRAWN)
    return table / table.sum(axis=1, keepdims=True), sharp, nu


def _bounded_column(values: list[Any], name: str, size: int, least: float, most: float) -> FloatArray:
    """Return a column of ``size`` numbers, each between ``least`` and ``most``; ValueError otherwise."""
    column = numbers(values, name, size)
    if size and not least <= column.min() <= column.max() <= most:
        raise ValueError(f"numbers from {column.min():g} to {column.max():g} in {name}, not from {least:g} to {most:g}")
    return column
