"""What planners need of a model, checked before anything runs, and which planners serve a model that lacks it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from hpop.errors import QueryError, UnsupportedModel
from hpop.models import DifferentialDrive
from hpop.models.base import PlanarModel
from hpop.motions import Model
from hpop.registry import planners

if TYPE_CHECKING:
    from hpop.problem import Problem

UNDECLARED = frozenset({"plane", "turn-move", "rigid", "wheels"})
"""What a planner that says nothing of its needs is taken to need: it was written when all robots had these."""


def needs_of(planner: Any) -> frozenset[str]:
    """What a planner, or a class of planners, needs of a model: its ``needs``, none for any model."""
    return frozenset(getattr(planner, "needs", UNDECLARED))


def refuse_unsupported(planner: Any, model: Model) -> None:
    """Raise UnsupportedModel where a planner needs what a model does not provide; names planners that can."""
    lacking = needs_of(planner) - model.provides
    if not lacking:
        return
    able = [name for name, known in planners.items() if needs_of(known) <= model.provides]
    undeclared = (
        "" if hasattr(planner, "needs") else " It does not say what it needs; give it needs = frozenset() if it can."
    )
    graphs = [name for name in able if hasattr(planners[name], "graph_query")]
    on = f" On the graph of another it can: {{{planner.name}: {{on: {graphs[0]}}}}}." if graphs else ""
    raise UnsupportedModel(
        f"{planner.name} needs a model with {', '.join(sorted(lacking))}, which {_called(model)} does not provide (it "
        f"has {', '.join(sorted(model.provides))}).{undeclared}{on * hasattr(planner, 'on')} Planners that can: "
        f"{', '.join(able)}."
    )


def refuse_moving(problem: Problem, what: str) -> None:
    """Raise QueryError where people move, for what has no time."""
    people = problem.world.content.people
    moving = [person.name or f"number {i}" for i, person in enumerate(people) if person.moves]
    if moving:
        raise QueryError(
            f"the {what} has no time, so it cannot tell where people who move will be: {', '.join(moving)}. "
            "The planners lattice and roadmap themselves have a clock, for a robot that moves in the plane. Else give "
            "people no velocity to plan round where they are now, or leave them out and evaluate the criteria on the "
            "front's trajectories, in the world with them."
        )


def in_plane(model: Model) -> PlanarModel:
    """The model as one that provides "plane", as planners that need it know; UnsupportedModel for others."""
    return cast(PlanarModel, _having(model, "plane"))


def on_wheels(model: Model) -> DifferentialDrive:
    """The model as one that provides "wheels": curves are planned for two wheels at either side of an axis.

    Raises UnsupportedModel for others.
    """
    return cast(DifferentialDrive, _having(model, "wheels"))


def _having(model: Model, what: str) -> Model:
    if what not in model.provides:
        raise UnsupportedModel(f"this needs a model with {what}, which {_called(model)} does not provide")
    return model


def _called(model: Model) -> str:
    return str(getattr(model, "name", type(model).__name__))
