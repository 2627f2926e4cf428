"""What a change of the world makes of a drive, and how it is written down."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from shapely.geometry import mapping

from hpop.drive.closings import polygon_of
from hpop.world import Person
from hpop.world.content.people import described_person


@dataclass(frozen=True)
class Change:
    """What a change of the world makes of a drive.

    now         s, of the drive
    safe_until  s, of the drive, until when the present plan may be driven; None for all the way
    stops_at    s, of the drive, when the robot stands if nothing else is taken; None where it arrives
    brakes      whether it cannot come to where it might take another way
    invalid     of the last options, by number, those that are closed now, or whose beginning is not driven to any more
    notes       what was made of that: people within obstacles, predictions that were cut, whom the robot touches
    """

    now: float
    safe_until: float | None
    stops_at: float | None
    brakes: bool
    invalid: tuple[int, ...]
    notes: tuple[str, ...] = ()


def written(
    close: Any,
    open_: Any,
    people: Iterable[Person] | None,
    groups: Iterable[Iterable[int]],
    stop: Any,
    name: str,
) -> dict[str, Any]:
    """What a change was told by, as JSON."""
    if close is not None or open_ is not None:
        area = open_ if close is None else close
        return {"area": area if isinstance(area, str) else mapping(polygon_of(area, "an area")), "name": name}
    if people is not None:
        return {"people": [described_person(person) for person in people], "groups": [list(group) for group in groups]}
    return {"person": stop.name if isinstance(stop, Person) else stop}
