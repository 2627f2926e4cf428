"""Criteria of other people near the robot, and functions that several of them use: radius, velocity, time."""

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
    """Return the robot's radius about its axis, m: the given one, or for None the largest reach of its parts."""
    if radius is not None:
        return radius
    return max((float(part.reach) for part in model.platform), default=0.0)


def checked_radius(radius: float | None) -> float | None:
    """Check a criterion's option ``robot_radius``, m or None, and return it; CriterionError for anything else."""
    if radius is None:
        return None
    return real("robot_radius", radius, 0, MOST, "None for the model's, or a length in m", error=CriterionError)


def base_velocity(m: Motions, s: Instants) -> tuple[Column, Column]:
    """Return the velocity (x, y) of the base, m/s, in the world frame; zeros, not computed, if it does not move."""
    if m.base.stays:
        still = 0.0 * s.base.x
        return still, still
    return s.twist("base").velocity[:2]


def clock(s: Instants, people: Iterable[Person]) -> Column | None:
    """Return the times of moments within motions, s, or None if no person moves.

    A cost that does not read the time can be computed for graphs without time.
    """
    return s.t if any_moves(people) else None


def check_one_future(name: str, people: Iterable[Person]) -> None:
    """Raise CriterionError if a person in a group has several predicted futures; ``name`` is the criterion."""
    for person in people:
        if person.futures:
            raise CriterionError(
                f"{name!r} needs one predicted future of each person in a group, but {named_as('person', person.name)} "
                f"has {len(person.futures)}, and it is unknown which of them the group follows. Give people in groups "
                "one prediction each, or leave the group out"
            )
