"""Goals as they are given: a state, a goal by name with its parameters, or a list of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.registry import completed, goals, made
from hpop.base.scalars import python_value
from hpop.base.text import shown
from hpop.errors import QueryError
from hpop.goals.base import Goal, GoalDefaults
from hpop.goals.sets import AnyOf, GoalSet
from hpop.motions.space import StateSpace, StateSpec, Values

ENTRIES = (list, tuple, np.ndarray, Mapping, Goal)  # of a list of goals; names as well, where states have any

GoalSpec = StateSpec | Goal | Mapping[str, Mapping[str, Any]] | Sequence[StateSpec | Goal | Mapping[str, Any]]


@checked_arguments
def checked_goal(given: Any, space: StateSpace) -> Values | Goal:
    """A goal, checked: the values of a state, where one is given, a set of several, or a goal of another kind.

    Raises QueryError for what is no state of the space, UnknownName for a goal of an unknown name.
    """
    several = _several(given, (*ENTRIES, str) if space.named or space.unnamed else ENTRIES)
    if not several:
        raise QueryError(f"a goal is {space}, or a list of such states of which any will do, got {shown(given)}")
    states, others = dict[Values, None](), list[Any]()
    for place, one in enumerate(several):
        if isinstance(one, Goal) or is_named(one):
            others.append(completed(one, vars(GoalDefaults)) if isinstance(one, Goal) else made(goals, one))
        else:
            what = f"goal {place}" if len(several) > 1 else "goal"
            states[space.values(space.state(one, free=space.angles, what=what))] = None
    if not others:
        return next(iter(states)) if len(states) == 1 else GoalSet(tuple(states))
    members = [*([GoalSet(tuple(states))] if states else []), *others]
    return members[0] if len(members) == 1 else AnyOf(tuple(members))


@checked_arguments
def is_named(given: Any) -> bool:
    """Whether something is the name of a goal with its parameters, as no state is: ``{name: {parameter: value}}``.

    >>> is_named({"look_at": {"target": [1, 0, 0.5], "distance": [0.2, 0.4]}}), is_named({"x": 1.0})
    (True, False)
    """
    if not isinstance(given, Mapping) or len(given) != 1:
        return False
    ((name, parameters),) = given.items()
    return isinstance(parameters, Mapping) or (isinstance(name, str) and name in goals)


def _several(given: Any, kinds: tuple[type, ...]) -> list[Any]:
    """What is given one by one: the members of a set, the entries of a list of goals, or the one that it is."""
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
