"""What a goal is, and the registry of goals by name, as scenarios and descriptions of problems give them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from hpop.arguments import checked_arguments
from hpop.arrays import BoolArray
from hpop.errors import QueryError
from hpop.motions import Model, States
from hpop.registry import goals

if TYPE_CHECKING:
    from hpop.problem import Problem

T = TypeVar("T", bound=type)

REACHED = 1e-6  # m or rad: no column of a state that reaches a goal is off by more


@runtime_checkable
class Goal(Protocol):
    """States of which any will do.

    It may have ``requires``, what a model must provide for it, and ``places``, (x, y, z) in m, that pictures mark.
    """

    def states(self, problem: Problem, rng: np.random.Generator, count: int) -> States:
        """At most so many of them (n,); where there are more, drawn at random."""

    def reached(self, model: Model, states: States) -> BoolArray:
        """Which states (M,) are among them."""

    def describe(self) -> Any:
        """JSON-able description, from which a problem makes the same goal."""


@checked_arguments
def goal(name: str) -> Callable[[T], T]:
    """Register a goal under a name: a frozen dataclass, whose fields are its parameters."""

    def declare(cls: T) -> T:
        if not is_dataclass(cls) or not all(hasattr(cls, method) for method in ("states", "reached", "describe")):
            raise QueryError(f"goal {name!r} must be a dataclass that follows hpop.goals.Goal, such as a Region")
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        goals.add(name, cls)
        return checked_arguments(cls)

    return declare


@checked_arguments
def places_of(goal: Goal) -> tuple[tuple[float, float, float], ...]:
    """Places (x, y, z), m, that a goal is about, if it says which."""
    return tuple(getattr(goal, "places", ()))


@checked_arguments
def required_by(goal: object) -> frozenset[str]:
    """What a model must provide for a goal."""
    return frozenset(getattr(goal, "requires", ()))
