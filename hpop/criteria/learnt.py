"""Criterion "learnt": a weighted sum of other criteria, with weights that were learnt from ratings of trajectories.

The weights are in a file, ``hpop-learnt`` version 1. It is strict JSON: criteria with their parameters and weights, and
the source of the weights. :func:`hpop.study.fit_criterion` writes it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple, NoReturn

from hpop.base.arrays import Column
from hpop.base.files import read_regular
from hpop.base.options import MOST, BesideScenario, real, whole
from hpop.base.text import printable, shown
from hpop.criteria.base import Criterion, criterion, make_criterion
from hpop.errors import CriterionError, HpopError, ModelError
from hpop.frontier.strict_json import Kinds, parse, parts
from hpop.models import files
from hpop.motions import Motions

SCHEMA, VERSION = "hpop-learnt", 1
SIZE_LIMIT = 1024**2
"""Largest size of the file, in bytes."""
MOST_PARTS = 50
MOST_LETTERS = 2_000
"""Largest number of characters of the question, and of the description of the source."""
LEAST_WEIGHT = 1e-9
_TOP: Kinds = {"schema": str, "version": int, "parts": list, "learnt": dict}
_PART: Kinds = {"criterion": dict, "weight": (int, float)}
_LEARNT: Kinds = {
    "question": str, "source": str, "ratings": int, "people": int, "trajectories": int,
    "error": (int, float), "error_of_mean": (int, float),
}  # fmt: skip


class Source(NamedTuple):
    """Ratings from which the weights were learnt.

    question       question that the participants answered
    source         participants, time and place, in the words of the study's author
    ratings        number of ratings
    people         number of participants
    trajectories   number of distinct trajectories
    error          cross-validation error, in the unit of the ratings: root mean square on trajectories that were left
                   out of the fit
    error_of_mean  error, computed likewise, if each rating is predicted to be the mean of the participant's others
    """

    question: str
    source: str
    ratings: int
    people: int
    trajectories: int
    error: float
    error_of_mean: float

    def __str__(self) -> str:
        """Return a sentence that describes the ratings."""
        people = "1 person" if self.people == 1 else f"{self.people} people"
        asked = f"{self.ratings} ratings ({self.question}) of {self.trajectories} trajectories by {people}"
        off = f"{self.error:.3g}, of each person's mean {self.error_of_mean:.3g}"
        return printable(f"learnt from {asked}; error on trajectories left out {off}; source: {self.source}")


class LearntFile(dict[str, Any]):
    """Reference to the file of a learnt criterion, as in a saved front: path and SHA-256, hashable."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((self["path"], *self["sha256"]))


@criterion("learnt", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Learnt:
    """Weighted sum of other criteria, Σ w_j J_j, with weights w_j >= 0 learnt from ratings of trajectories.

    file  path of a file written by :meth:`hpop.study.Fitted.save`; relative to the scenario

    The unit is that of the ratings (higher is worse), up to a constant. All parts are sums over motions, so the
    criterion is one too, and every planner that minimises sums can minimise it; weighted-sum-corridor also needs convex
    parts. It requires all that its parts require, and has a gradient if all parts have one. Weights are never negative,
    since every part is a cost.

    ``source`` describes the study behind the weights, and the error on trajectories that were not used to learn them. A
    saved front identifies the file by its SHA-256.
    """

    file: Annotated[Any, BesideScenario]
    parts: tuple[tuple[float, Criterion], ...] = field(init=False, repr=False, compare=False)
    source: Source = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        file = self.file
        path = _path(file)
        try:
            data = read_regular(path, SIZE_LIMIT)
        except OSError as error:
            raise CriterionError(
                f"learnt: cannot read {shown(str(path), 400)}: {error.strerror or error}; give the file that "
                "hpop.study.fit_criterion(...).save(file) wrote"
            ) from None
        record = files.record(path, hashlib.sha256(data).hexdigest())
        if files.is_record(file) and list(file["sha256"]) != record["sha256"]:
            raise CriterionError(
                f"learnt: {shown(str(path), 400)} has changed since the front was saved: its SHA-256 differs. Restore "
                "the file, or plan again"
            )
        weighted, source = _read(data, path)
        parts = [criterion for _, criterion in weighted]
        declared = {
            "file": LearntFile(record),
            "parts": weighted,
            "source": source,
            "requires": tuple(dict.fromkeys(name for part in parts for name in part.requires)),
            "smooth": all(part.smooth for part in parts),
            "world_frame": any(part.world_frame for part in parts),
            "__doc__": f"{type(self).__doc__}\n    {source}.\n",
        }
        for name, value in declared.items():
            object.__setattr__(self, name, value)

    def cost(self, m: Motions) -> Column:
        """Return the weighted sum (M,) of the costs of all parts."""
        costs = [weight * part.cost(m) for weight, part in self.parts]
        return sum(costs[1:], costs[0])

    def __str__(self) -> str:
        """Return the weighted sum as a formula, and a sentence on its source."""
        terms = " + ".join(f"{weight:.4g} {part.name}" for weight, part in self.parts)
        return f"{terms}, {self.source}"


def checked_parts(weighted: Any) -> tuple[tuple[float, Criterion], ...]:
    """Check the parts of a learnt criterion, pairs of weight and criterion, and return them.

    Raises CriterionError for criteria that are not sums over motions, that occur twice or are learnt themselves.
    """
    checked: list[tuple[float, Criterion]] = []
    for weight, spec in weighted:
        if isinstance(spec, Learnt) or spec == "learnt" or (isinstance(spec, Mapping) and "learnt" in spec):
            raise CriterionError(
                "learnt: a part of a learnt criterion must not be learnt itself; list its parts instead"
            )
        part = make_criterion(spec)
        if part.aggregate != "sum":
            hint = "leave it out" if part.integral is None else f"use {part.integral.name!r}, which is one"
            raise CriterionError(
                f"learnt: each part must be a sum over motions, but {part.name!r} has the aggregate "
                f"{part.aggregate!r}; {hint}"
            )
        if part.name in [earlier.name for _, earlier in checked]:
            raise CriterionError(f"learnt: each criterion must occur once, got {part.name!r} twice; remove one")
        checked.append((float(real(f"the weight of {part.name}", weight, 0, MOST, error=CriterionError)), part))
    if not 0 < len(checked) <= MOST_PARTS:
        raise CriterionError(f"learnt: expected 1 to {MOST_PARTS} criteria, got {len(checked)}")
    return tuple(checked)


def _path(file: Any) -> Any:
    """Check the option ``file``, a path or the record of a file in a saved front, and return the path."""
    if files.is_record(file):
        try:
            return files.path_of(file, "file of the learnt criterion")
        except ModelError as error:
            raise CriterionError(str(error)) from None
    if isinstance(file, str | os.PathLike) and str(file):
        return file
    raise CriterionError(f"learnt: file must be the path of a file from hpop.study.fit_criterion, got {shown(file)}")


def _read(data: bytes, path: Any) -> tuple[tuple[tuple[float, Criterion], ...], Source]:
    """Read the parts and the source from the bytes of a learnt criterion's file; CriterionError if it is invalid."""
    try:
        schema, version, pieces, learnt = parts(parse(data), "the file", _TOP)
        if (schema, version) != (SCHEMA, VERSION):
            raise ValueError(f"schema {shown(schema)}, version {version}, instead of {SCHEMA}, version {VERSION}")
        entries = [parts(entry, "a part", _PART) for entry in pieces[: MOST_PARTS + 1]]
        weighted = checked_parts([(weight, spec) for spec, weight in entries])
        if not any(weight >= LEAST_WEIGHT for weight, _ in weighted):
            raise ValueError("no weight above 0")
        return weighted, _source(parts(learnt, "learnt", _LEARNT))
    except RecursionError:
        _refuse(path, "brackets nested too deeply")
    except (HpopError, ValueError, TypeError) as error:
        _refuse(path, str(error))


def _source(values: list[Any]) -> Source:
    """Check the values of the entry "learnt" of a file and return them as a source."""
    question, source, *numbers = values
    if max(len(question), len(source)) > MOST_LETTERS:
        raise ValueError(f"a question or source of more than {MOST_LETTERS} characters")
    *counts, error, of_mean = numbers
    whole_counts = [whole("a count", count, 0, 10**9, error=CriterionError) for count in counts]
    errors = [float(real("an error", value, 0, MOST, error=CriterionError)) for value in (error, of_mean)]
    return Source(question, source, *whole_counts, *errors)


def _refuse(path: Any, fault: str) -> NoReturn:
    """Raise CriterionError for an invalid file of a learnt criterion; ``fault`` says what is wrong with it."""
    raise CriterionError(
        f"learnt: {shown(str(path), 400)}: expected a file from hpop.study.fit_criterion(...).save(file); found: "
        f"{fault:.600}; learn it again"
    ) from None


def document(pieces: tuple[tuple[float, Mapping[str, Any]], ...], source: Source) -> dict[str, Any]:
    """Return the content of a learnt criterion's file, ready for JSON.

    pieces  pairs of weight and criterion, as described by :func:`describe_criterion`
    """
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "parts": [{"criterion": dict(described), "weight": weight} for weight, described in pieces],
        "learnt": source._asdict(),
    }
