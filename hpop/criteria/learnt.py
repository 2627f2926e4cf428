"""A criterion learnt from what people said of trajectories: a sum of other criteria, with weights from a file.

The file is ``hpop-learnt`` version 1, strict JSON: the criteria with their parameters and weights, and where the
weights are from. :func:`hpop.study.fit_criterion` writes it.
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
"""Bytes."""
MOST_PARTS = 50
MOST_LETTERS = 2_000
"""Of what is said about the source."""
LEAST_WEIGHT = 1e-9
_TOP: Kinds = {"schema": str, "version": int, "parts": list, "learnt": dict}
_PART: Kinds = {"criterion": dict, "weight": (int, float)}
_LEARNT: Kinds = {
    "question": str, "source": str, "ratings": int, "people": int, "trajectories": int,
    "error": (int, float), "error_of_mean": (int, float),
}  # fmt: skip


class Source(NamedTuple):
    """Ratings from which the weights were learnt.

    question       what was rated
    source         who was asked, when, where, in the words of whoever asked
    ratings        count
    people         count
    trajectories   count, distinct
    error          cross-validated: root of the mean square, in the unit of the ratings, on trajectories left out
    error_of_mean  the same of each person's mean
    """

    question: str
    source: str
    ratings: int
    people: int
    trajectories: int
    error: float
    error_of_mean: float

    def __str__(self) -> str:
        """In words."""
        people = "1 person" if self.people == 1 else f"{self.people} people"
        asked = f"{self.ratings} ratings ({self.question}) of {self.trajectories} trajectories by {people}"
        off = f"{self.error:.3g}, of each person's mean {self.error_of_mean:.3g}"
        return printable(f"learnt from {asked}; error on trajectories left out {off}; source: {self.source}")


class LearntFile(dict[str, Any]):
    """A file as a saved front names it: its path and SHA-256."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((self["path"], *self["sha256"]))


@criterion("learnt", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Learnt:
    """Σ w_j J_j: other criteria that are sums, with weights w_j >= 0 learnt from ratings of trajectories.

    file  what :meth:`hpop.study.Fitted.save` wrote, relative to the scenario

    In the unit of the ratings, of which more is worse, but for a constant. It adds up along a trajectory as its parts
    do, so every planner of sums takes it (weighted-sum-corridor needs convex ones); it requires what they require, and
    has a gradient where all of them have one. Weights are never negative: a criterion is a cost, of which nobody wants
    more. ``source`` says where they are from, and how far the criterion is off on trajectories that it was not learnt
    from. A saved front names the file by its SHA-256.
    """

    file: Annotated[Any, BesideScenario]
    parts: tuple[tuple[float, Criterion], ...] = field(init=False, repr=False, compare=False)
    source: Source = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        given = self.file
        path = _path(given)
        try:
            data = read_regular(path, SIZE_LIMIT)
        except OSError as error:
            raise CriterionError(
                f"learnt: cannot read {shown(str(path), 400)}: {error.strerror or error}; give the file that "
                "hpop.study.fit_criterion(...).save(file) wrote"
            ) from None
        found = files.record(path, hashlib.sha256(data).hexdigest())
        if files.is_record(given) and list(given["sha256"]) != found["sha256"]:
            raise CriterionError(
                f"learnt: {shown(str(path), 400)} has changed since this was saved: its SHA-256 differs. Restore the "
                "file, or plan again"
            )
        pieces, source = _read(data, path)
        made = [criterion for _, criterion in pieces]
        declared = {
            "file": LearntFile(found),
            "parts": pieces,
            "source": source,
            "requires": tuple(dict.fromkeys(name for one in made for name in one.requires)),
            "smooth": all(one.smooth for one in made),
            "world_frame": any(one.world_frame for one in made),
            "__doc__": f"{type(self).__doc__}\n    {source}.\n",
        }
        for name, value in declared.items():
            object.__setattr__(self, name, value)

    def cost(self, m: Motions) -> Column:
        """Weighted sum (M,) of what the parts cost."""
        costs = [weight * part.cost(m) for weight, part in self.parts]
        return sum(costs[1:], costs[0])

    def __str__(self) -> str:
        """The sum, and where it is from."""
        terms = " + ".join(f"{weight:.4g} {part.name}" for weight, part in self.parts)
        return f"{terms}, {self.source}"


def checked_parts(given: Any) -> tuple[tuple[float, Criterion], ...]:
    """Weights and criteria of (weight, criterion), refused where they are no sums or twice the same."""
    found: list[tuple[float, Criterion]] = []
    for weight, spec in given:
        if isinstance(spec, Learnt) or spec == "learnt" or (isinstance(spec, Mapping) and "learnt" in spec):
            raise CriterionError("learnt: a learnt criterion is made of others, not of one that is learnt itself")
        made = make_criterion(spec)
        if made.aggregate != "sum":
            hint = "leave it out" if made.integral is None else f"take {made.integral.name!r}, which does"
            raise CriterionError(f"learnt: {made.name!r} ({made.aggregate}) does not add up along a trajectory; {hint}")
        if made.name in [one.name for _, one in found]:
            raise CriterionError(f"learnt: each criterion may be part of it once, got {made.name!r} twice")
        found.append((float(real(f"the weight of {made.name}", weight, 0, MOST, error=CriterionError)), made))
    if not 0 < len(found) <= MOST_PARTS:
        raise CriterionError(f"learnt: expected 1 to {MOST_PARTS} criteria, got {len(found)}")
    return tuple(found)


def _path(given: Any) -> Any:
    """The path of a file that is named by it, or by a saved front."""
    if files.is_record(given):
        try:
            return files.path_of(given, "file of the learnt criterion")
        except ModelError as error:
            raise CriterionError(str(error)) from None
    if isinstance(given, str | os.PathLike) and str(given):
        return given
    raise CriterionError(f"learnt: file is the path of what hpop.study.fit_criterion wrote, got {shown(given)}")


def _read(data: bytes, path: Any) -> tuple[tuple[tuple[float, Criterion], ...], Source]:
    """Parts and source of a file's bytes."""
    try:
        schema, version, pieces, learnt = parts(parse(data), "the file", _TOP)
        if (schema, version) != (SCHEMA, VERSION):
            raise ValueError(f"the schema {shown(schema)} of version {version}, not {SCHEMA} {VERSION}")
        given = [parts(one, "a part", _PART) for one in pieces[: MOST_PARTS + 1]]
        made = checked_parts([(weight, spec) for spec, weight in given])
        if not any(weight >= LEAST_WEIGHT for weight, _ in made):
            raise ValueError("no weight above 0")
        return made, _source(parts(learnt, "learnt", _LEARNT))
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


def _refuse(path: Any, found: str) -> NoReturn:
    raise CriterionError(
        f"learnt: {shown(str(path), 400)}: expected what hpop.study.fit_criterion(...).save(file) wrote; found: "
        f"{found:.600}; learn it again"
    ) from None


def document(pieces: tuple[tuple[float, Mapping[str, Any]], ...], source: Source) -> dict[str, Any]:
    """What a file holds: weights of described criteria, and where they are from."""
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "parts": [{"criterion": dict(described), "weight": weight} for weight, described in pieces],
        "learnt": source._asdict(),
    }
