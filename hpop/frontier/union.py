"""The union of two fronts of one problem."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from hpop.frontier.errors import FrontError

if TYPE_CHECKING:
    from hpop.frontier.front import Front

F = TypeVar("F", bound="Front[Any]")

# What joins the statuses and the certificates of the fronts that a union was made of.
JOINT = " | "


def join(first: F, second: F) -> F:
    """Join two fronts of the same problem: the non-dominated points of both together.

    In costs the union is commutative, associative and idempotent. The status is "complete" if both are,
    else it lists the distinct ones. The certificate lists the distinct ones of its sources, joined by
    " | ": each still holds for the search space it speaks of, because every cost vector of a source is
    matched or dominated by a point of the union, but none speaks of the points that came from elsewhere.

    Raises
    ------
    FrontError
        If the criteria, their units, groups or quanta, the reported values or the problems differ.
    """
    for name in ("names", "units", "groups"):
        _require_same(name, getattr(first, name), getattr(second, name))
    _require_same("quanta", first.quanta.tolist(), second.quanta.tolist())
    mine = dict(zip(first.reported_names, first.reported_units, strict=True))
    theirs = dict(zip(second.reported_names, second.reported_units, strict=True))
    _require_same("reported values", sorted(mine.items()), sorted(theirs.items()))
    asked, other = first.question, second.question
    if asked is not None and other is not None:
        differing = [k for k in sorted(asked.keys() | other.keys()) if asked.get(k, ...) != other.get(k, ...)]
        _require_same("problems", *({k: p.get(k) for k in differing} for p in (asked, other)))
    columns = [second.reported_names.index(name) for name in first.reported_names]
    runs = first.runs + second.runs
    return type(first).of(
        np.concatenate([first.costs, second.costs]),
        first.items + second.items,
        names=first.names,
        units=first.units,
        quanta=first.quanta,
        groups=first.groups,
        reported=np.concatenate([first.reported, second.reported[:, columns]]),
        reported_names=first.reported_names,
        reported_units=first.reported_units,
        status=_joined(first.status, second.status),
        certificate=_joined(first.certificate, second.certificate),
        provenance=first.provenance + second.provenance,
        problem=second.problem if first.problem is None else first.problem,
        runs=[run for i, run in enumerate(runs) if run not in runs[:i]],
    )


def each_claim(certificate: str, words: str) -> str:
    """A certificate of which each statement is put into ``words``, at their braces.

    >>> each_claim("exact | supported", "of 9 points: {}")
    'of 9 points: exact | of 9 points: supported'
    """
    return JOINT.join(words.replace("{}", part) for part in certificate.split(JOINT))


def _require_same(what: str, mine: object, theirs: object) -> None:
    """Refuse a union of fronts that cannot be compared."""
    if mine != theirs:
        raise FrontError(f"a union needs the same {what} on both sides, got {mine!s:.400} and {theirs!s:.400}")


def _joined(first: str, second: str) -> str:
    """List distinct statements once, in alphabetical order."""
    return JOINT.join(sorted({*first.split(JOINT), *second.split(JOINT)}))
