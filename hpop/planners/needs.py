"""Checks that a planner can solve a problem, and a grid map of where its robot is free of collisions.

The checks raise errors that name suitable planners, or the nearest free position to a blocked start or goal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
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
    return "For a robot that steers, use one that does: exact on the graph primitives (exact: {on: primitives})."


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


ACROSS = 500  # grid positions along the longer side of the map
ACROSS_TURNED = 200  # grid positions for a robot that is not round, which is checked at each heading
ROOM = 0.5  # m: additional clearance of chosen starts and goals, if possible
INDOORS = 0.1  # share of the largest part's area: an indoor part of at least this area is preferred


@dataclass(frozen=True, eq=False)
class FreeMap:
    """Grid of positions, each marked free if the robot collides with nothing there at one heading at least.

    x, y   (w,), (h,)  m  of the columns from left to right, and of the rows from bottom to top
    free   (h, w)      whether the robot is free at the position
    world  world of the map
    """

    x: FloatArray
    y: FloatArray
    free: BoolArray
    world: World

    @classmethod
    def of(cls, model: Model, world: World) -> FreeMap | None:
        """Return the map of a robot model in a world, or None if the model does not drive in the plane.

        Joints are at 0.
        """
        if "plane" not in model.provides or set(model.space.names) < {"x", "y", "yaw"}:
            return None
        x0, y0, x1, y1 = world.bounds
        collision: Any = model.collision(world)
        pitch = max(x1 - x0, y1 - y0) / (ACROSS_TURNED if collision.yaw_matters else ACROSS)
        x, y = (np.arange(low + pitch / 2, high, pitch) for low, high in ((x0, x1), (y0, y1)))
        positions = [axis.ravel() for axis in np.meshgrid(x, y)]
        free = collision.clear(*positions)
        if collision.yaw_matters:
            left = np.flatnonzero(~free)
            for heading in np.arange(HEADINGS) * 2 * math.pi / HEADINGS:
                columns = {name: np.zeros(left.size) for name in model.space.names}
                columns |= {"x": positions[0][left], "y": positions[1][left], "yaw": np.full(left.size, heading)}
                free[left] |= collision.states_free(States(**columns))
        return cls(x, y, free.reshape(y.size, x.size), world)

    @property
    def pitch(self) -> float:
        """Spacing of the grid, m."""
        x0, _, x1, _ = self.world.bounds
        return float(self.x[1] - self.x[0]) if self.x.size > 1 else x1 - x0

    @cached_property
    def parts(self) -> IntArray:
        """Number (h, w) of the connected part of free space at each position: 1, 2, ...; 0 where it is not free."""
        from scipy import ndimage  # slow to import

        labels, _ = ndimage.label(self.free)
        return np.asarray(labels, dtype=np.int64)

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each connected part, m², indexed by its number; 0 for number 0, which is no part."""
        areas = np.bincount(self.parts.ravel()).astype(np.float64) * self.pitch**2
        areas[0] = 0.0
        return areas

    def part_at(self, x: float, y: float) -> int:
        """Return the number of the connected part at the grid position nearest to (x, y).

        If that is not free, a part at one of its eight neighbours counts; 0 if there is none.
        """
        row, column = (int(np.abs(axis - value).argmin()) for axis, value in ((self.y, y), (self.x, x)))
        near = self.parts[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        part = int(self.parts[row, column])
        return part or int(near.max(initial=0))

    @property
    def main(self) -> int:
        """Number of the largest connected part, or 0 if nothing is free.

        In a world read from an image, it is the largest part indoors, unless that is tiny (INDOORS).
        """
        areas, indoors = self.areas, self.areas.copy()
        indoors[self._open_parts()] = 0.0
        if indoors.max() >= INDOORS * areas.max():
            areas = indoors
        return int(areas.argmax()) if areas.max() > 0.0 else 0

    def _open_parts(self) -> IntArray:
        """Return the numbers of the parts outside the building on a map image: those that reach the image's edge.

        The result is empty if the world is no image, or if walls run along the whole edge.
        """
        raster = self.world.raster
        if raster is None or not self.free.any():
            return np.zeros(0, dtype=np.int64)
        cells = raster.cells
        if cells[[0, -1]].all() and cells[:, [0, -1]].all():
            return np.zeros(0, dtype=np.int64)
        sides = [np.minimum(np.arange(n), np.arange(n)[::-1]) for n in self.free.shape]
        steps = np.minimum(sides[0][:, None], sides[1])
        return np.unique(self.parts[self.free & (steps <= steps[self.free].min() + 1)])

    def far_apart(self, part: int = 0) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return two positions (x, y) in a part, by default the main part, with a long shortest path between them.

        One is the position farthest from an arbitrary one, and the other is the position farthest from that. Both have
        additional clearance if possible. Some position of the map must be free.
        """
        from scipy import ndimage  # slow to import

        inside = self.parts == (part or self.main)
        roomy = ndimage.distance_transform_edt(inside) * self.pitch >= ROOM
        roomy_nodes = np.flatnonzero((roomy if roomy.any() else inside)[inside])
        graph, cells = _neighbour_graph(inside)
        first = int(roomy_nodes[_steps(graph, int(roomy_nodes[0]))[roomy_nodes].argmax()])
        second = int(roomy_nodes[_steps(graph, first)[roomy_nodes].argmax()])
        ends = sorted((float(self.x[column]), float(self.y[row])) for row, column in cells[[first, second]])
        return ends[0], ends[1]


def _neighbour_graph(inside: BoolArray) -> tuple[Any, IntArray]:
    """Return a graph that joins True positions side by side in a grid, and the row and column (n, 2) of each node."""
    from scipy import sparse  # slow to import

    cells = np.argwhere(inside)
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(len(cells))
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    tails, heads = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
    are_nodes = (tails >= 0) & (heads >= 0)
    ones = np.ones(int(are_nodes.sum()))
    size = len(cells)
    return sparse.coo_array((ones, (tails[are_nodes], heads[are_nodes])), shape=(size, size)).tocsr(), cells


def _steps(graph: Any, source: int) -> FloatArray:
    """Return the number of edges (n,) on the shortest path from node ``source`` to each node; -1 without a path."""
    from scipy.sparse.csgraph import dijkstra  # slow to import

    steps = dijkstra(graph, directed=False, indices=np.array([source]), unweighted=True)[0]
    return np.where(np.isfinite(steps), steps, -1.0)
