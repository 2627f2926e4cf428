"""Weights that are asked for: how many, or rows of one number a cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.errors import OptionError
from hpop.search.supported.weights import checked_divisions, integer_weights

Weights = tuple[tuple[float, ...], ...]


def asked_weights(divisions: int | None, weights: Any) -> Weights | None:
    """Rows of weights as they are kept; raises OptionError for what makes no sense whatever the costs are."""
    if divisions is not None:
        divisions = checked_divisions(divisions)
    if weights is None:
        return None
    if divisions is not None:
        raise OptionError(f"give divisions or weights, not both; got {shown(divisions)} and {shown(weights)}")
    if not isinstance(weights, list | tuple) or not weights:
        raise OptionError(f"weights is a list of lists of numbers, one number a cost, got {shown(weights)}")
    for row in weights:
        integer_weights(row)
    return tuple(tuple(float(w) for w in row) for row in weights)


def check_count(weights: Weights | None, criteria: Sequence[Criterion]) -> None:
    """Raise OptionError where a row has not one weight for each of the criteria."""
    for row in weights or ():
        if len(row) != len(criteria):
            names = ", ".join(criterion.name for criterion in criteria)
            raise OptionError(
                f"weights has one number for each of {names}, in this order; got {len(row)} numbers: {list(row)}"
            )
