"""What planners need of a model, checked before anything runs, and which planners serve a model that lacks it."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, cast

from hpop.base.registry import graphs, planners
from hpop.errors import QueryError, UnsupportedModel
from hpop.models.base import PlanarModel
from hpop.motions import Model, Wheeled
from hpop.planners.base import UNDECLARED, Planner

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


def refuse_unsupported(planner: Planner, model: Model) -> None:
    """Raise UnsupportedModel where a planner needs what a model does not provide; names planners that can."""
    lacking = planner.needs - model.provides
    if not lacking:
        return
    able = [name for name, known in planners.items() if known.needs <= model.provides]
    undeclared = (
        ""
        if planner.needs is not UNDECLARED
        else " It does not say what it needs; give it needs = frozenset() if it can."
    )
    families = [name for name, family in graphs.items() if family.needs <= model.provides]
    on = f" On another graph it can: {{{planner.name}: {{on: {families[0]}}}}}." if families else ""
    hints = f"{undeclared}{on if takes_graphs(planner) else ''}"
    raise UnsupportedModel(
        f"{planner.name} needs a model with {', '.join(sorted(lacking))}, which {model.name} does not provide (it "
        f"has {', '.join(sorted(model.provides))}).{hints} Planners that can: {', '.join(able)}."
    )


def takes_graphs(planner: Planner) -> bool:
    """Return whether a planner has an option ``on`` that takes any graph family."""
    return any(field.name == "on" for field in fields(planner)) if is_dataclass(planner) else False


def people_move(problem: Problem) -> bool:
    """Return whether any person moves, so that a planner needs a clock."""
    return any(person.moves for person in problem.world.content.people)


def refuse_moving(problem: Problem, what: str) -> None:
    """Raise QueryError where people move, for what has no time."""
    people = problem.world.content.people
    moving = [person.name or f"number {i}" for i, person in enumerate(people) if person.moves]
    if moving:
        raise QueryError(
            f"{what} has no time, so it cannot tell where people who move will be: {', '.join(moving)}. "
            "The planners exact, lattice, roadmap and any-angle have a clock, for a robot that moves in the plane. Or "
            "give people no velocity to plan round where they are now, or leave them out and evaluate the criteria on "
            "the front's trajectories, in the world with them."
        )


def in_plane(model: Model) -> PlanarModel:
    """The model as one that provides "plane", as planners that need it know; UnsupportedModel for others."""
    return cast(PlanarModel, _having(model, "plane"))


def on_wheels(model: Model) -> Wheeled:
    """The model as one that provides "wheels", and has the law of curves; UnsupportedModel for others."""
    if "drive" not in _having(model, "wheels").laws:
        raise UnsupportedModel(
            f"curves are planned by the law 'drive', hpop.models.driven.Drive(), which {model.name} does not have: its "
            f"laws are {', '.join(model.laws)}"
        )
    return cast(Wheeled, model)


def _having(model: Model, what: str) -> Model:
    if what not in model.provides:
        raise UnsupportedModel(f"this needs a model with {what}, which {model.name} does not provide")
    return model
