"""Checks that a planner can solve a problem: its robot model, start, goal, tour and people.

The checks raise errors that name suitable planners, or the nearest free position to a blocked start or goal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.registry import graphs, planners
from hpop.base.text import some
from hpop.errors import QueryError, UnsupportedModel
from hpop.models.base import PlanarModel
from hpop.motions import Model, States, Wheeled
from hpop.planners.base import UNDECLARED, Planner

if TYPE_CHECKING:
    from hpop.motions.states import Values
    from hpop.problems.problem import Problem
    from hpop.world import World
    from hpop.world.ground import Heights


def refuse_unsupported(planner: Planner, model: Model) -> None:
    """Raise UnsupportedModel if the robot model lacks capabilities that a planner needs, or has too many speeds for it.

    The error names planners that can use the model.
    """
    lacking = planner.needs - model.provides
    if not lacking:
        if (model.speed_classes or model.paces) and not planner.speeds:
            able = [name for name, other in planners.items() if other.speeds and other.needs <= model.provides]
            raise UnsupportedModel(
                f"{planner.name} plans for one speed, but the robot has the speeds {_speeds_text(model)}; give the "
                f"model one {'speed and one turn rate' if model.paces and model.speed_classes else 'speed'}. "
                f"Planners that choose among speeds are {', '.join(able)}."
            )
        return
    able = [name for name, candidate in planners.items() if candidate.needs <= model.provides]
    undeclared = (
        ""
        if planner.needs is not UNDECLARED
        else " This planner does not declare its needs, so these are assumed; if it works with any model, set needs = "
        "frozenset() in its class."
    )
    families = [name for name, family in graphs.items() if family.needs <= model.provides]
    on = f" It can use this model on another graph: {{{planner.name}: {{on: {families[0]}}}}}." if families else ""
    hints = f"{undeclared}{on if takes_graphs(planner) else ''}"
    raise UnsupportedModel(
        f"{planner.name} needs a model with {', '.join(sorted(lacking))}, which {model.name} does not provide (it "
        f"has {', '.join(sorted(model.provides))}).{hints} Planners that can use this model: {', '.join(able)}."
    )


def takes_graphs(planner: Planner) -> bool:
    """Return whether a planner has the option ``on``, which selects the graph family that it searches."""
    return any(field.name == "on" for field in fields(planner)) if is_dataclass(planner) else False


def people_move(problem: Problem) -> bool:
    """Return whether any person of the problem's world moves, so that a planner has to consider time."""
    return any(person.moves for person in problem.world.content.people)


def _speeds_text(model: Model) -> str:
    speeds = [f"{', '.join(f'{speed:g}' for speed in model.speed_classes)} m/s"] if model.speed_classes else []
    kinds = ", ".join(dict.fromkeys(kind for pace in model.paces for kind in pace.values()))
    return " and ".join([*speeds, *filter(None, [kinds])])


def refuse_moving(problem: Problem, what: str) -> None:
    """Raise QueryError if people move; ``what`` names, for the error, a planner that does not consider time."""
    people = problem.world.content.people
    moving = [person.name or f"number {i}" for i, person in enumerate(people) if person.moves]
    if moving:
        raise QueryError(
            f"{what} does not consider time, so it cannot avoid people who move: {some(moving)}. "
            f"{_timed(problem.model)} Or give people no velocity, to plan around their present positions. Or plan "
            "without people, and evaluate the criteria on the front's trajectories in the world with people."
        )


def _timed(model: Model) -> str:
    """Return which planners consider time for a model, or what it lacks, as a sentence for an error."""
    if "steering" not in model.provides:
        return "Use a planner that does, for a robot that moves in the plane: exact, lattice, roadmap or any-angle."
    return (
        f"No planner does for {model.name}: this needs motions straight ahead and turns in place (turn-move), as of "
        "differential_drive, and a car moves on curves."
    )


def in_plane(model: Model) -> PlanarModel:
    """Return the model as a PlanarModel; raise UnsupportedModel unless it provides "plane"."""
    return cast(PlanarModel, _with_capability(model, "plane"))


def on_wheels(model: Model) -> Wheeled:
    """Return the model as a Wheeled one; raise UnsupportedModel unless it has wheels and can drive curves."""
    if "drive" not in _with_capability(model, "wheels").laws:
        raise UnsupportedModel(
            f"a path of curves needs a model with the kind of motion 'drive' (hpop.models.driven.Drive()), but "
            f"{model.name} has only {', '.join(model.laws)}; add it to the model's laws, or use another planner"
        )
    return cast(Wheeled, model)


def reaches(model: PlanarModel, world: World) -> tuple[tuple[Heights, float], ...]:
    """Return the height ranges (z_min, z_max) in m of the robot's parts, each with the radius in m of the robot there.

    The radius is the largest distance of a part from the robot's vertical axis. Height ranges in which the map has the
    same obstacles become one.
    """
    by_space: dict[int, tuple[Heights, float]] = {}
    for part in model.platform:
        z = (part.z_min, part.z_max)
        key = id(world.free_space(z))
        by_space[key] = max(by_space.get(key, (z, 0.0)), (z, part.reach), key=lambda item: item[1])
    return tuple(by_space.values())


def _with_capability(model: Model, what: str) -> Model:
    if what not in model.provides:
        raise UnsupportedModel(
            f"this function needs a model that provides {what!r}, but {model.name} provides only "
            f"{', '.join(sorted(model.provides))}; use another model"
        )
    return model


End = tuple[float, float, float | None]
"""A start or goal in the plane: x m, y m, and yaw rad, or None if any heading will do."""


def start_of(problem: Problem) -> tuple[float, float, float]:
    """Return the start of the problem in the plane: x and y in m, and yaw in rad."""
    return cast(tuple[float, float, float], _end_in_plane(problem, problem.start))


def goals_of(problem: Problem) -> tuple[End, ...]:
    """Return the goal states of the problem in the plane; raise QueryError if the goal is not a list of states."""
    return tuple(_end_in_plane(problem, goal) for goal in problem.goals)


def one_goal(problem: Problem, what: str) -> End:
    """Return the goal of a problem with a single goal state in the plane.

    Raises QueryError for several goals; ``what`` names the planner, and the error names planners that accept several.
    """
    goals = goals_of(problem)
    if len(goals) > 1:
        able = _capable_planners(problem, "goal_sets")
        raise QueryError(f"{what} needs a single goal, got a list of {len(goals)}; planners that accept a list: {able}")
    return goals[0]


def check_goal(problem: Problem, planner: Planner) -> None:
    """Raise QueryError if a planner cannot plan to the problem's goal or tour; the error names planners that can."""
    if problem.tour is not None and not planner.tours:
        raise QueryError(
            f"{planner.name} cannot plan a tour, so the stops {', '.join(problem.tour.names)} would not be visited; "
            f"planners that visit stops: {_capable_planners(problem, 'tours')}"
        )
    if problem.target.listed and not planner.goal_sets:
        one_goal(problem, planner.name)
    if not problem.target.listed and not planner.any_goal:
        raise QueryError(
            f"{planner.name} needs a goal that is a state, or a list of states, got {problem.target}; planners that "
            f"accept any goal: {_capable_planners(problem, 'any_goal')}"
        )


def _capable_planners(problem: Problem, kind: Literal["goal_sets", "any_goal", "tours"]) -> str:
    """Return the names, as text, of the planners that have a capability and can use the problem's model.

    kind  attribute of :class:`hpop.planners.base.Planner` that states the capability
    """
    provided = problem.model.provides
    able = [name for name, planner in planners.items() if planner.needs <= provided]
    return ", ".join(name for name in able if getattr(planners[name], kind))


def _end_in_plane(problem: Problem, values: Values) -> End:
    by_name = dict(zip(problem.model.space.names, values, strict=True))
    return cast(End, tuple(by_name[name] for name in ("x", "y", "yaw")))


RINGS = ((0.05, 1.0), (0.1, 3.0), (0.5, 15.0), (2.0, 60.0), (10.0, 300.0))
"""Grids of positions that are tried near a blocked state: spacing, m, and largest distance from the state, m."""
HEADINGS = 8
"""Headings that are tried at each position if any heading will do."""
BLOCK = 512
"""Positions that are checked together; the first block usually contains a free position."""


def nearest_free(model: Model, world: World, state: States) -> States | None:
    """Return a state (1,) moved to the nearest grid position at which the robot collides with nothing.

    A heading of NaN, which stands for any heading, becomes one of eight headings; other NaN angles become 0. Returns
    None if no position within 300 m is free, or if the robot's states have no x and y.
    """
    if not {"x", "y"} <= set(model.space.names):
        return None
    collision = model.collision(world)
    for positions in _positions(world, float(state.x[0]), float(state.y[0])):
        tried = _states_at(state, positions)
        free = np.flatnonzero(collision.states_free(tried))
        if free.size:
            return tried.take(free[:1])
    return None


def elsewhere(model: Model, world: World, state: States) -> str:
    """Return a sentence for error messages that names the nearest free position to a blocked state (1,).

    Returns "" if no position nearby is free.
    """
    free = nearest_free(model, world, state)
    if free is None:
        return ""
    x, y = float(free.x[0]), float(free.y[0])
    away = float(np.hypot(x - state.x[0], y - state.y[0]))
    return f" The nearest place where the robot is free is ({x:.4g}, {y:.4g}), {away:.2f} m away."


def _positions(world: World, x: float, y: float) -> Iterator[FloatArray]:
    """Yield positions around (x, y), m, within the bounds of the world, nearest first, as blocks (N, 2)."""
    x0, y0, x1, y1 = world.bounds
    nearest = np.array([np.clip(x, x0, x1), np.clip(y, y0, y1)])  # the point of the map that is nearest to (x, y)
    inner = -1.0
    for spacing, reach in RINGS:
        low = np.ceil(np.maximum(nearest - reach, (x0, y0)) / spacing)
        high = np.floor(np.minimum(nearest + reach, (x1, y1)) / spacing)
        grid = np.meshgrid(*(np.arange(a, b + 1) * spacing for a, b in zip(low, high, strict=True)))
        positions = np.stack([axis.ravel() for axis in grid], axis=1).round(2)
        distance = np.hypot(*(positions - nearest).T)
        positions = positions[(distance > inner) & (distance <= reach)]
        positions = positions[np.argsort(np.hypot(*(positions - (x, y)).T), kind="stable")]
        yield from (positions[i : i + BLOCK] for i in range(0, len(positions), BLOCK))
        inner = reach


def _states_at(state: States, positions: FloatArray) -> States:
    """Return a state moved to each position (N, 2), m; if its heading is NaN, with eight headings at each position."""
    headings = np.arange(HEADINGS) * 2 * np.pi / HEADINGS if np.isnan(getattr(state, "yaw", np.zeros(1))[0]) else None
    count = 1 if headings is None else headings.size
    columns = {name: np.full(len(positions) * count, np.nan_to_num(getattr(state, name)[0])) for name in state.names}
    columns |= {"x": np.repeat(positions[:, 0], count), "y": np.repeat(positions[:, 1], count)}
    if headings is not None:
        columns["yaw"] = np.tile(headings, len(positions))
    return States(**columns)
