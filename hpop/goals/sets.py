"""Goals of which any will do: a few states, whose angles may be free, or a few goals of any kind."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import chain, cycle, islice
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray
from hpop.base.randomness import RNG
from hpop.errors import HpopWarning, QueryError
from hpop.goals.base import REACHED, Goal, GoalDefaults, checked_count
from hpop.motions import Model, States
from hpop.motions.space import Values

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


@checked_arguments
@dataclass(frozen=True)
class GoalSet(GoalDefaults):
    """A few states of which any will do; a value of None is free.

    >>> GoalSet([(3, 1, None), (5, 2, 0.0)]).describe()
    [[3, 1, None], [5, 2, 0.0]]
    """

    members: tuple[Values, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(self.members))

    @property
    def listed(self) -> tuple[Values, ...]:
        """The states."""
        return self.members

    def __str__(self) -> str:
        """The states in few characters."""
        if len(self.members) > 1:
            return f"any of {len(self.members)}"
        return f"({', '.join('any' if value is None else f'{value:.4g}' for value in self.members[0])})"

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Members without anything free once, then the others in turn, each with angles drawn at random."""
        count = checked_count(count)
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


@checked_arguments
@dataclass(frozen=True, init=False)
class AnyOf(GoalDefaults):
    """Goals of which any will do: to look at any of several cans, or else to be at a state.

    States, and names of states and goals, are understood by the problem that has them among its goals.

    >>> AnyOf("ready", [0, 0, 0]).members, AnyOf(["ready", "home"]).members
    (('ready', [0, 0, 0]), ('ready', 'home'))
    """

    members: tuple[Any, ...]

    def __init__(self, *members: Any) -> None:
        (several,) = members if len(members) == 1 and isinstance(members[0], list | tuple) else (members,)
        object.__setattr__(self, "members", tuple(several))

    def __str__(self) -> str:
        return f"any of {len(self.members)}: {'; '.join(map(str, self.members))}"

    @property
    def requires(self) -> frozenset[str]:
        """What any of them does."""
        return frozenset().union(*(member.requires for member in self.members))

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """Those of all members."""
        return tuple(place for member in self.members for place in member.places)

    def alternatives(self) -> tuple[Goal, ...]:
        """Those of all members."""
        return tuple(goal for member in self.members for goal in member.alternatives())

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """As many of each member, as far as there are; QueryError where none can be reached, a warning where some."""
        count = checked_count(count)
        rng = np.random.default_rng(rng)  # one for all members
        shares = [count // len(self.members) + (i < count % len(self.members)) for i in range(len(self.members))]
        parts, refusals = list[States](), list[str]()
        for member, share in zip(self.members, shares, strict=True):
            try:
                parts += [member.states(problem, rng, share)] if share else []
            except QueryError as error:
                refusals.append(str(error))
        if not parts:
            raise QueryError("\n".join(refusals))
        for refusal in refusals:
            warnings.warn(f"left out of the goals of which any will do: {refusal}", HpopWarning, stacklevel=2)
        return States(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in problem.model.space.names}
        )

    def reached(self, model: Model, states: States) -> BoolArray:
        """Which states (M,) reach a member."""
        return np.asarray(np.any([member.reached(model, states) for member in self.members], axis=0))

    def describe(self) -> list[Any]:
        """A list of goals, each state by itself."""
        rows: list[Any] = []
        for member in self.members:
            rows += [list(state) for state in member.listed] or [member.describe()]
        return rows
