"""Start and goals of a problem in the plane, for planners that know positions and headings."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

from hpop.errors import QueryError
from hpop.goals import GoalSet
from hpop.planners.needs import needs_of
from hpop.registry import planners

if TYPE_CHECKING:
    from hpop.motions.space import Values
    from hpop.planners.base import Planner
    from hpop.problem import Problem

End = tuple[float, float, float | None]
"""x m, y m, yaw rad, or None where the heading is free."""


def start_of(problem: Problem) -> tuple[float, float, float]:
    """Where the problem starts."""
    return cast(tuple[float, float, float], _in_plane(problem, problem.start))


def goals_of(problem: Problem) -> tuple[End, ...]:
    """Where it may end; QueryError for a goal that is no set of states."""
    return tuple(_in_plane(problem, goal) for goal in problem.goals)


def one_goal(problem: Problem, what: str) -> End:
    """Where it ends; QueryError, which names the planners that can, where ``what`` is given a set of states."""
    goals = goals_of(problem)
    if len(goals) > 1:
        able = _able(problem, takes_sets)
        raise QueryError(f"{what} takes one goal, got a set of {len(goals)}; planners that take a set are {able}")
    return goals[0]


def check_goal(problem: Problem, planner: Planner) -> None:
    """Raise QueryError where the problem's goal is none that the planner takes; it names planners that do."""
    if isinstance(problem.goal, GoalSet) and not takes_sets(planner):
        one_goal(problem, planner.name)
    if not isinstance(problem.target, GoalSet) and not takes_any(planner):
        raise QueryError(
            f"{planner.name} needs a goal that is a state, or a list of states, got {problem.target}; planners that "
            f"take any goal are {_able(problem, takes_any)}"
        )


def takes_sets(planner: object) -> bool:
    """Whether a planner, or a class of planners, says that its goal may be a set of states."""
    return bool(getattr(planner, "goal_sets", False))


def takes_any(planner: object) -> bool:
    """Whether a planner, or a class of planners, says that it takes any goal, of which it asks for states."""
    return bool(getattr(planner, "any_goal", False))


def _able(problem: Problem, takes: Callable[[object], bool]) -> str:
    """Planners that take such goals, and the problem's model."""
    provided = problem.model.provides
    return ", ".join(name for name, one in planners.items() if takes(one) and needs_of(one) <= provided)


def _in_plane(problem: Problem, values: Values) -> End:
    by_name = dict(zip(problem.model.space.names, values, strict=True))
    return cast(End, tuple(by_name[name] for name in ("x", "y", "yaw")))
