"""What a front gives out: one of its points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from hpop.base.text import shown

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        costs, reported = (
            ", ".join(f"{name} {value:.6g}" for name, value in values.items()) for values in (self.costs, self.reported)
        )
        return f"<Point {self.index}: {costs}{f' (reported: {reported})' if reported else ''}; {shown(self.item)}>"
