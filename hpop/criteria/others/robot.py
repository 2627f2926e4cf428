"""What people see of a robot: how far it reaches, and how fast its base moves."""

from __future__ import annotations

from collections.abc import Iterable

from hpop.base.arrays import Column
from hpop.base.options import MOST, real
from hpop.errors import CriterionError
from hpop.motions import Instants, Model, Motions
from hpop.world.content.content import Person
from hpop.world.content.futures import named_as
from hpop.world.content.proxemics import any_moves


def reach(model: Model, radius: float | None) -> float:
    """Radius, m, of the robot about its axis: as given, or as far as its upright parts reach (0 without parts)."""
    if radius is not None:
        return radius
    return max((float(part.reach) for part in model.platform), default=0.0)


def checked_radius(radius: float | None) -> float | None:
    """Return a robot's radius; CriterionError unless it is None or a length."""
    if radius is None:
        return None
    return real("robot_radius", radius, 0, MOST, "None for the model's, or a length in m", error=CriterionError)


def base_velocity(m: Motions, s: Instants) -> tuple[Column, Column]:
    """Velocity (x, y) of the base, m/s, world frame; a base that stays in its place is not asked how fast it is."""
    if m.base.stays:
        still = 0.0 * s.base.x
        return still, still
    return s.twist("base").velocity[:2]


def clock(s: Instants, people: Iterable[Person]) -> Column | None:
    """Times of moments, s, if somebody moves; else None, so that who stands may be on graphs without time."""
    return s.t if any_moves(people) else None


def check_one_future(name: str, people: Iterable[Person]) -> None:
    """Raise CriterionError where somebody who talks may do several things: which together is not known."""
    for person in people:
        if person.futures:
            raise CriterionError(
                f"{name!r} needs one future of each who talks; {named_as('person', person.name)} has "
                f"{len(person.futures)}, and whom the others would follow is not said. Give one prediction to those "
                "who are in a group, or leave the group out"
            )
