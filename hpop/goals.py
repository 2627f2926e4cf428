"""Where a trajectory shall end: at a state, whose angles may be free, or at any of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, cycle, islice
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from hpop.arrays import BoolArray
from hpop.errors import QueryError
from hpop.motions import Model, States, StateSpace
from hpop.motions.space import StateSpec, Values
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.problem import Problem

ROWS = (list, tuple, np.ndarray)
REACHED = 1e-6  # m or rad: no column of a state that reaches a goal is off by more


@runtime_checkable
class Goal(Protocol):
    """States of which any will do."""

    def states(self, problem: Problem, rng: np.random.Generator, count: int) -> States:
        """At most so many of them (n,); where there are more, drawn at random."""

    def reached(self, model: Model, states: States) -> BoolArray:
        """Which states (M,) are among them."""

    def describe(self) -> Any:
        """JSON-able description, from which a problem makes the same goal."""


@dataclass(frozen=True)
class GoalSet:
    """A few states of which any will do; a value of None is free.

    >>> GoalSet([(3, 1, None), (5, 2, 0.0)]).describe()
    [[3, 1, None], [5, 2, 0.0]]
    """

    members: tuple[Values, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(self.members))

    def states(self, problem: Problem, rng: np.random.Generator, count: int) -> States:
        """Members without anything free once, then the others in turn, each with angles drawn at random."""
        whole, others = ([m for m in self.members if (None in m) is free] for free in (False, True))
        rows = list(islice(chain(whole, cycle(others)), count))
        drawn = problem.model.space.sample(rng, len(rows))
        given = np.array(rows, float).reshape(len(rows), -1).T
        return States(
            **{
                name: np.where(np.isnan(column), getattr(drawn, name), column)
                for name, column in zip(drawn.names, given, strict=True)
            }
        )

    def reached(self, model: Model, states: States) -> BoolArray:
        """Which states (M,) are a member, within 1e-6 m or rad."""
        space, found = model.space, np.zeros(states.size, dtype=bool)
        for member in self.members:
            differences = space.differences(space.state(member, free=space.angles), states).values()
            found |= ~np.any([np.abs(off) > REACHED for off in differences], axis=0)  # what is free is never off
        return found

    def describe(self) -> list[Any]:
        """The one member as a list, or a list of several."""
        rows = [list(member) for member in self.members]
        return rows[0] if len(rows) == 1 else rows


GoalSpec = StateSpec | Sequence[StateSpec] | Goal


def checked_goal(given: Any, space: StateSpace) -> Values | Goal:
    """A goal, checked: the values of a state, where one is given, a set of several, or a goal of another kind.

    Raises QueryError for what is no state of the space.
    """
    if isinstance(given, Goal) and not isinstance(given, GoalSet):
        return given
    several = several_states(given)
    if not several:
        raise QueryError(f"a goal is {space}, or a list of such states of which any will do, got {shown(given)}")
    members = dict.fromkeys(
        space.values(space.state(one, free=space.angles, what=f"goal {place}" if len(several) > 1 else "goal"))
        for place, one in enumerate(several)
    )
    return next(iter(members)) if len(members) == 1 else GoalSet(tuple(members))


def several_states(given: Any) -> list[Any]:
    """The states that are given: the members of a set, the entries of a list of states, or the one that it is."""
    if isinstance(given, GoalSet):
        return list(given.members)
    several = isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim > 0)
    if not several or not all(isinstance(entry, (*ROWS, Mapping)) for entry in given):
        return [given]
    return list(given)
