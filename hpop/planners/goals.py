"""Start and goals of a problem in the plane, for planners that know positions and headings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, cast

from hpop.base.registry import planners
from hpop.errors import QueryError

if TYPE_CHECKING:
    from hpop.motions.states import Values
    from hpop.planners.base import Planner
    from hpop.problems.problem import Problem

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
        able = _able(problem, "goal_sets")
        raise QueryError(f"{what} takes one goal, got a set of {len(goals)}; planners that take a set are {able}")
    return goals[0]


def check_goal(problem: Problem, planner: Planner) -> None:
    """Raise QueryError where the problem's goal is none that the planner takes; it names planners that do."""
    if problem.target.listed and not planner.goal_sets:
        one_goal(problem, planner.name)
    if not problem.target.listed and not planner.any_goal:
        raise QueryError(
            f"{planner.name} needs a goal that is a state, or a list of states, got {problem.target}; planners that "
            f"take any goal are {_able(problem, 'any_goal')}"
        )


def _able(problem: Problem, kind: Literal["goal_sets", "any_goal"]) -> str:
    """Names of the planners that take goals of a kind, and the problem's model."""
    provided = problem.model.provides
    able = [name for name, one in planners.items() if one.needs <= provided]
    return ", ".join(name for name in able if getattr(planners[name], kind))


def _in_plane(problem: Problem, values: Values) -> End:
    by_name = dict(zip(problem.model.space.names, values, strict=True))
    return cast(End, tuple(by_name[name] for name in ("x", "y", "yaw")))
