"""Goals: the protocol that each goal follows, the registry of goals by name, sets of states, and alternative goals.

A user gives a goal as a state, as the name of a goal with its parameters, or as a list of these.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from itertools import chain, cycle, islice
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray
from hpop.base.options import whole
from hpop.base.randomness import RNG
from hpop.base.registry import goals, plugin_from_spec, with_optional_members
from hpop.base.text import python_value, shown
from hpop.errors import HpopWarning, QueryError
from hpop.motions import Model, States
from hpop.motions.states import StateSpace, StateSpec, Values

if TYPE_CHECKING:
    from hpop.goals.approach import Approach
    from hpop.problems.problem import Problem

    Place = tuple[float, float, float]

T = TypeVar("T", bound=type)

MOST_STATES = 10_000  # states of a goal that can be drawn at once
REACHED = 1e-6  # m or rad: no column of a state that reaches a goal is off by more


@runtime_checkable
class Goal(Protocol):
    """Protocol of goals: a goal is one or more states, and a trajectory must reach any one of them.

    These attributes are optional; their defaults follow after the semicolon:

    requires      capabilities that a model must provide; frozenset()
    places        positions (x, y, z), m, that pictures mark; ()
    listed        values of the goal's states, if the goal is a list of states; ()
    looked_at     position (x, y, z), m, at which the camera looks in the goal's states; None
    visible       whether the position in ``looked_at`` must be visible; False
    straight      straight approach with which a trajectory must end (:mod:`hpop.goals.approach`); None
    alternatives  method that returns the alternative goals; the goal itself
    """

    def states(self, problem: Problem, rng: np.random.Generator, count: int) -> States:
        """Return at most ``count`` states (n,) of the goal, drawn at random if there are more."""

    def reached(self, model: Model, states: States) -> BoolArray:
        """Return which of the states (M,) reach the goal, whether or not a target is ``visible`` from them."""

    def describe(self) -> Any:
        """Return a JSON-able description, from which a problem builds an equal goal."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def requires(self) -> frozenset[str]: ...

        @property
        def places(self) -> tuple[Place, ...]: ...

        @property
        def listed(self) -> tuple[Values, ...]: ...

        @property
        def looked_at(self) -> Place | None: ...

        @property
        def visible(self) -> bool: ...

        @property
        def straight(self) -> Approach | None: ...

        def alternatives(self) -> tuple[Goal, ...]: ...


class GoalDefaults:
    """Defaults of the optional attributes of a `Goal`; goals may inherit from this class."""

    requires: Any = frozenset[str]()
    places: Any = ()
    listed: Any = ()
    looked_at: Any = None
    visible: Any = False
    straight: Any = None

    def alternatives(self) -> tuple[Goal, ...]:
        """Return the alternative goals: the goal itself."""
        return (cast(Goal, self),)


def checked_count(count: int) -> int:
    """Return the number of states to draw as an int; raise QueryError if it is invalid."""
    return whole("count", count, 0, MOST_STATES, "a number of states", error=QueryError)


@checked_arguments
def goal(name: str) -> Callable[[T], T]:
    """Return a decorator that registers a class of goals under a name: a frozen dataclass, its parameters as fields."""

    def declare(cls: T) -> T:
        if not is_dataclass(cls) or not all(hasattr(cls, method) for method in ("states", "reached", "describe")):
            raise QueryError(
                f"goal {name!r} must be a dataclass with the methods of hpop.goals.Goal: states, reached and describe"
            )
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        goals.add(name, with_optional_members(cls, vars(GoalDefaults)))
        return checked_arguments(cls)

    return declare


@checked_arguments
@dataclass(frozen=True)
class GoalSet(GoalDefaults):
    """Set of states; a trajectory must reach any one of them. None stands for a free angle.

    >>> GoalSet([(3, 1, None), (5, 2, 0.0)]).describe()
    [[3, 1, None], [5, 2, 0.0]]
    """

    members: tuple[Values, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(self.members))

    @property
    def listed(self) -> tuple[Values, ...]:
        """Return the states."""
        return self.members

    def __str__(self) -> str:
        """Return the states as short text for messages."""
        if len(self.members) > 1:
            return f"any of {len(self.members)}"
        return f"({', '.join('any' if value is None else f'{value:.4g}' for value in self.members[0])})"

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Return ``count`` states: first members without free angles, once each, then others with random angles.

        Members with free angles are repeated as often as needed. Without any, there may be fewer states.
        """
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
        """Return which states (M,) equal a member, within 1e-6 m or rad."""
        space, found = model.space, np.zeros(states.size, dtype=bool)
        for member in self.members:
            differences = space.differences(space.state(member, free=space.angles), states).values()
            found |= ~np.any([np.abs(off) > REACHED for off in differences], axis=0)  # what is free is never off
        return found

    def describe(self) -> list[Any]:
        """Return a single member as a list, several as a list of lists."""
        rows = [list(member) for member in self.members]
        return rows[0] if len(rows) == 1 else rows


@goal("anywhere")
@dataclass(frozen=True)
class Anywhere(GoalDefaults):
    """Goal of a robot whose states have a time (two_arms): any state, at the end of the working arm's motion."""

    name: ClassVar[str]

    @property
    def requires(self) -> frozenset[str]:
        """Return the capability that a model must provide: states with a time."""
        return frozenset({"time"})

    def __str__(self) -> str:
        """Return the goal as short text for messages."""
        return "anywhere"

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Return ``count`` random states (n,) at the last time, not checked for collisions."""
        space = problem.model.space
        drawn = space.sample(rng, checked_count(count))
        last = np.full(drawn.size, space.high[-1])
        return States(**{**{name: getattr(drawn, name) for name in space.names[:-1]}, space.names[-1]: last})

    def reached(self, model: Model, states: States) -> BoolArray:
        """Return which states (M,) are at the last time, within 1e-6 s."""
        space = model.space
        return np.asarray(getattr(states, space.names[-1]) >= space.high[-1] - REACHED)

    def describe(self) -> dict[str, Any]:
        """Return the name as JSON."""
        return {self.name: {}}


@checked_arguments
@dataclass(frozen=True, init=False)
class AnyOf(GoalDefaults):
    """Alternative goals; a trajectory must reach any one of them, such as a view of one of several cans.

    Members may be goals, ``{name of a goal: its parameters}``, states, or names of states. The problem looks them up;
    the properties and methods below need members that are goals.

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
        """Return all capabilities of a model that any of the members requires."""
        return frozenset().union(*(member.requires for member in self.members))

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """Return the positions (x, y, z), m, that pictures mark, of all members."""
        return tuple(place for member in self.members for place in member.places)

    def alternatives(self) -> tuple[Goal, ...]:
        """Return the alternatives of all members."""
        return tuple(goal for member in self.members for goal in member.alternatives())

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Return at most ``count`` states in all, about equally many of each member.

        Warn of members that cannot be reached; raise QueryError if no member can be reached.
        """
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
            warnings.warn(f"one of several goals is left out: {refusal}", HpopWarning, stacklevel=2)
        return States(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in problem.model.space.names}
        )

    def reached(self, model: Model, states: States) -> BoolArray:
        """Return which states (M,) reach a member."""
        return np.asarray(np.any([member.reached(model, states) for member in self.members], axis=0))

    def describe(self) -> list[Any]:
        """Return a list of goals, with a separate entry for each state."""
        rows: list[Any] = []
        for member in self.members:
            rows += [list(state) for state in member.listed] or [member.describe()]
        return rows


ENTRIES = (list, tuple, np.ndarray, Mapping, Goal, States)  # types in a list of goals; str as well if states have names

GoalSpec = StateSpec | Goal | Mapping[str, Mapping[str, Any]] | Sequence[StateSpec | Goal | Mapping[str, Any]]


@checked_arguments
def checked_goal(given: Any, space: StateSpace) -> Values | Goal:
    """Check a goal, given in any form of ``GoalSpec``, and return it.

    The result is the values of a single state, a set of states, or a goal of another kind.

    Raises QueryError for a value that is no state of the space, UnknownName for an unknown name of a goal.
    """
    several = _several(given, (*ENTRIES, str) if space.named or space.unnamed else ENTRIES)
    if not several:
        raise QueryError(f"a goal must be {space}, or a list of such states, got {shown(given)}")
    states, others = dict[Values, None](), list[Any]()
    for place, one in enumerate(several):
        if isinstance(one, Goal) or is_named(one):
            others.append(
                with_optional_members(one, vars(GoalDefaults))
                if isinstance(one, Goal)
                else plugin_from_spec(goals, one)
            )
        else:
            what = f"goal {place}" if len(several) > 1 else "goal"
            states[space.values(space.state(one, free=space.angles, what=what))] = None
    if not others:
        return next(iter(states)) if len(states) == 1 else GoalSet(tuple(states))
    members = [*([GoalSet(tuple(states))] if states else []), *others]
    return members[0] if len(members) == 1 else AnyOf(tuple(members))


@checked_arguments
def is_named(given: Any) -> bool:
    """Return whether a value has the form of a goal by name, ``{name: {parameter: value}}``, even of an unknown name.

    ``{name: anything}`` has it too if the name is that of a registered goal.

    >>> is_named({"look_at": {"target": [1, 0, 0.5], "distance": [0.2, 0.4]}}), is_named({"x": 1.0})
    (True, False)
    """
    if not isinstance(given, Mapping) or len(given) != 1:
        return False
    ((name, parameters),) = given.items()
    return isinstance(parameters, Mapping) or (isinstance(name, str) and name in goals)


def _several(given: Any, kinds: tuple[type, ...]) -> list[Any]:
    """Return a list of goals: the members of a set, the entries of a list, or the single goal that was given.

    kinds  types of the entries of a list of goals; a list with any other entry, such as a number, is one goal
    """
    if isinstance(given, GoalSet | AnyOf):
        return [
            entry for member in given.members for entry in (_several(member, kinds) if _is_set(member) else [member])
        ]
    several = isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim > 0)
    if not several or not all(isinstance(python_value(entry), kinds) for entry in given):
        return [given]
    return [entry for one in given for entry in (_several(one, kinds) if _is_set(one) else [one])]


def _is_set(given: Any) -> bool:
    return isinstance(given, GoalSet | AnyOf)
