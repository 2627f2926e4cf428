"""What a front gives out: one of its points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Point(Generic[T]):
    """One point of a front, with everything that is known of it.

    index       row in the front
    costs       value by criterion, in the front's units
    reported    further values by name, not optimised
    item        what the costs are of
    provenance  how the point was found
    """

    index: int
    costs: dict[str, float]
    reported: dict[str, float]
    item: T
    provenance: dict[str, Any]
