"""What a goal is, and the registry of goals by name, as scenarios and descriptions of problems give them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray
from hpop.base.options import whole
from hpop.base.registry import completed, goals
from hpop.errors import QueryError
from hpop.motions import Model, States

if TYPE_CHECKING:
    from hpop.motions.space import Values
    from hpop.problems.problem import Problem

    Place = tuple[float, float, float]

T = TypeVar("T", bound=type)

MOST_STATES = 10_000  # of a goal that are looked for at once
REACHED = 1e-6  # m or rad: no column of a state that reaches a goal is off by more


@runtime_checkable
class Goal(Protocol):
    """States of which any will do.

    These may be left out, and have defaults:

    requires      what a model must provide for it; frozenset()
    places        (x, y, z) m, that pictures mark; ()
    listed        its states, as a space has their values, where it is a list of them; ()
    looked_at     (x, y, z) m, at which the camera looks where it is reached; None
    alternatives  method: the goals of which it is any; itself
    """

    def states(self, problem: Problem, rng: np.random.Generator, count: int) -> States:
        """At most so many of them (n,); where there are more, drawn at random."""

    def reached(self, model: Model, states: States) -> BoolArray:
        """Which states (M,) are among them."""

    def describe(self) -> Any:
        """JSON-able description, from which a problem makes the same goal."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def requires(self) -> frozenset[str]: ...

        @property
        def places(self) -> tuple[Place, ...]: ...

        @property
        def listed(self) -> tuple[Values, ...]: ...

        @property
        def looked_at(self) -> Place | None: ...

        def alternatives(self) -> tuple[Goal, ...]: ...


class GoalDefaults:
    """What a goal has of the contract without saying so."""

    requires: Any = frozenset[str]()
    places: Any = ()
    listed: Any = ()
    looked_at: Any = None

    def alternatives(self) -> tuple[Goal, ...]:
        """Return the goals of which this one is any."""
        return (cast(Goal, self),)


def checked_count(count: int) -> int:
    """Return how many states of a goal are asked for, or raise a QueryError."""
    return whole("count", count, 0, MOST_STATES, "a number of states", error=QueryError)


@checked_arguments
def goal(name: str) -> Callable[[T], T]:
    """Register a goal under a name: a frozen dataclass, whose fields are its parameters."""

    def declare(cls: T) -> T:
        if not is_dataclass(cls) or not all(hasattr(cls, method) for method in ("states", "reached", "describe")):
            raise QueryError(f"goal {name!r} must be a dataclass that follows hpop.goals.Goal, such as a Region")
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        goals.add(name, completed(cls, vars(GoalDefaults)))
        return checked_arguments(cls)

    return declare
