"""A criterion learnt from ratings of trajectories: a sum of other criteria, with weights from a file.

The file is ``hpop-learnt`` version 1, strict JSON: the criteria with their parameters and weights, and the source of
the weights. :func:`hpop.study.fit_criterion` writes it.
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
"""Largest length of the question and of the source's description."""
LEAST_WEIGHT = 1e-9
_TOP: Kinds = {"schema": str, "version": int, "parts": list, "learnt": dict}
_PART: Kinds = {"criterion": dict, "weight": (int, float)}
_LEARNT: Kinds = {
    "question": str, "source": str, "ratings": int, "people": int, "trajectories": int,
    "error": (int, float), "error_of_mean": (int, float),
}  # fmt: skip


class Source(NamedTuple):
    """Ratings from which the weights were learnt.

    question       that was rated
    source         participants, time and place, in the words of the study's author
    ratings        count
    people         count
    trajectories   count, distinct
    error          cross-validated: root of the mean square, in the unit of the ratings, on trajectories left out
    error_of_mean  likewise, of each person's mean
    """

    question: str
    source: str
    ratings: int
    people: int
    trajectories: int
    error: float
    error_of_mean: float

    def __str__(self) -> str:
        """Return the source in words."""
        people = "1 person" if self.people == 1 else f"{self.people} people"
        asked = f"{self.ratings} ratings ({self.question}) of {self.trajectories} trajectories by {people}"
        off = f"{self.error:.3g}, of each person's mean {self.error_of_mean:.3g}"
        return printable(f"learnt from {asked}; error on trajectories left out {off}; source: {self.source}")


class LearntFile(dict[str, Any]):
    """File of a learnt criterion as a saved front names it: its path and SHA-256."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((self["path"], *self["sha256"]))


@criterion("learnt", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Learnt:
    """Weighted sum of other criteria, Σ w_j J_j, with weights w_j >= 0 learnt from ratings of trajectories.

    file  written by :meth:`hpop.study.Fitted.save`; relative to the scenario

    The unit is that of the ratings (more is worse), up to a constant. All parts are sums, so the criterion adds up over
    motions and every planner of sums takes it; weighted-sum-corridor needs convex parts. It requires what its parts
    require, and has a gradient if all parts have one. Weights are never negative, since every part is a cost.

    ``source`` has the study behind the weights, and the error on trajectories from which they were not learnt. A saved
    front names the file by its SHA-256.
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
                f"learnt: {shown(str(path), 400)} has changed since this was saved: its SHA-256 differs. Restore the "
                "file, or plan again"
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
        """Return the weighted sum (M,) of the parts' costs."""
        costs = [weight * part.cost(m) for weight, part in self.parts]
        return sum(costs[1:], costs[0])

    def __str__(self) -> str:
        """Return the sum and its source in words."""
        terms = " + ".join(f"{weight:.4g} {part.name}" for weight, part in self.parts)
        return f"{terms}, {self.source}"


def checked_parts(weighted: Any) -> tuple[tuple[float, Criterion], ...]:
    """Return pairs (weight, criterion); raise CriterionError for criteria that are no sums or occur twice."""
    checked: list[tuple[float, Criterion]] = []
    for weight, spec in weighted:
        if isinstance(spec, Learnt) or spec == "learnt" or (isinstance(spec, Mapping) and "learnt" in spec):
            raise CriterionError(
                "learnt: a part of a learnt criterion may not be learnt itself; list its parts instead"
            )
        part = make_criterion(spec)
        if part.aggregate != "sum":
            hint = "leave it out" if part.integral is None else f"take {part.integral.name!r}, which does"
            raise CriterionError(f"learnt: {part.name!r} ({part.aggregate}) does not add up along a trajectory; {hint}")
        if part.name in [earlier.name for _, earlier in checked]:
            raise CriterionError(f"learnt: each criterion may be part of it once, got {part.name!r} twice")
        checked.append((float(real(f"the weight of {part.name}", weight, 0, MOST, error=CriterionError)), part))
    if not 0 < len(checked) <= MOST_PARTS:
        raise CriterionError(f"learnt: expected 1 to {MOST_PARTS} criteria, got {len(checked)}")
    return tuple(checked)


def _path(file: Any) -> Any:
    """Return the path of a file that is named by its path or by the record of a saved front."""
    if files.is_record(file):
        try:
            return files.path_of(file, "file of the learnt criterion")
        except ModelError as error:
            raise CriterionError(str(error)) from None
    if isinstance(file, str | os.PathLike) and str(file):
        return file
    raise CriterionError(f"learnt: file must be the path of a file from hpop.study.fit_criterion, got {shown(file)}")


def _read(data: bytes, path: Any) -> tuple[tuple[tuple[float, Criterion], ...], Source]:
    """Return the parts and the source in a file's bytes."""
    try:
        schema, version, pieces, learnt = parts(parse(data), "the file", _TOP)
        if (schema, version) != (SCHEMA, VERSION):
            raise ValueError(f"the schema {shown(schema)} of version {version}, not {SCHEMA} {VERSION}")
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
    question, source, *numbers = values
    if max(len(question), len(source)) > MOST_LETTERS:
        raise ValueError(f"words about the source of more than {MOST_LETTERS} letters")
    *counts, error, of_mean = numbers
    whole_counts = [whole("a count", count, 0, 10**9, error=CriterionError) for count in counts]
    errors = [float(real("an error", value, 0, MOST, error=CriterionError)) for value in (error, of_mean)]
    return Source(question, source, *whole_counts, *errors)


def _refuse(path: Any, fault: str) -> NoReturn:
    raise CriterionError(
        f"learnt: {shown(str(path), 400)}: expected a file from hpop.study.fit_criterion(...).save(file); found: "
        f"{fault:.600}; learn it again"
    ) from None


def document(pieces: tuple[tuple[float, Mapping[str, Any]], ...], source: Source) -> dict[str, Any]:
    """Return the content of a file, ready for JSON, from weights, described criteria, and the source."""
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "parts": [{"criterion": dict(described), "weight": weight} for weight, described in pieces],
        "learnt": source._asdict(),
    }
