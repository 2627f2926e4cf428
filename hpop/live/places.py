"""Destinations of a live session: where the robot can stand, what is in the way, and the goals that follow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.math import wrap
from hpop.base.text import printable
from hpop.drive.closings import Closing, reach_of
from hpop.errors import HpopError, QueryError
from hpop.goals import Tour
from hpop.motions import Model, States
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.needs import nearest_free
from hpop.problems.problem import Problem
from hpop.world.content.content import Landmark

FARTHEST = 5.0
"""Distance, m, from a blocked place to the nearest free one, above which the place counts as blocked."""
SIGHT = (0.8, 2.5)
"""Distances, m, from which a landmark is looked at."""
WITHIN = 0.75
"""Distance, m, from a point at which a stop of a tour counts as visited."""
SNAPPED = 0.36
"""Distance, m, up to which a place that was clicked is moved to a state of the graph, from where searches are quick."""
NEAR, TURNED = 0.05, 0.1
"""Distances, m and rad, up to which a robot counts as being at a state of the graph."""
NEAREST = "the nearest free place is {:.1f} m away"
HEADINGS = 8
"""Headings that are tried at a place."""


class Destination(NamedTuple):
    """A destination as checked.

    place   the message "place" for the page
    target  goal of the problem; None if it is blocked
    tour    stops on the way; None without any
    """

    place: dict[str, Any]
    target: Any
    tour: Tour | None = None


def destination_of(goal: Mapping[str, Any], problem: Problem, closed: Sequence[Closing]) -> Destination:
    """Check a destination: {x, y}, {landmark}, or {stops} with several of these; the last stop is the goal.

    problem  gives the present world; its start gives the state variables other than x, y and yaw
    closed   closed areas, which are named if they are in the way
    """
    try:
        *stops, last = goal.get("stops", [goal])
        found = _single(last, problem, closed)
        if stops and found.target is not None:
            found = found._replace(tour=Tour.of({"stops": [_stop(stop, problem, closed) for stop in stops]}))
    except HpopError as error:
        return Destination(_place(goal, "blocked", printable(str(error)), None), None)
    return found


def on_graph(found: Destination, graph: StateGraph | None, problem: Problem) -> Destination:
    """Move a destination to the nearest free state of a graph within `SNAPPED` m; return the new destination.

    It is returned unchanged if it prescribes a heading, or if no such state is near.
    """
    goal = found.place["goal"]
    ids = np.zeros(0, np.int64) if graph is None else graph.near(goal["x"], goal["y"], SNAPPED)
    if graph is None or not ids.size or None not in found.target:
        return found
    states = graph.states(ids)
    off = np.hypot(states.x - goal["x"], states.y - goal["y"])
    off[~problem.model.collision(problem.world).states_free(states)] = np.inf
    if not np.isfinite(off.min()):
        return found
    x, y = (float(column[np.argmin(off)]) for column in (states.x, states.y))
    words = found.place["words"]
    if found.place["status"] == "nearest":
        away = math.dist((x, y), (found.place["x"], found.place["y"]))
        words = f"{words.partition(';')[0]}; {NEAREST.format(away)}"
    place = {**found.place, "words": words, "goal": {"x": x, "y": y, "theta": None}}
    return found._replace(target=_state(problem, x, y), place=place)


def start_on_graph(pose: tuple[float, ...], graph: StateGraph | None, model: Model) -> States:
    """Return the state (1,) of a robot at ``pose``, or a graph's state that differs by at most `NEAR` and `TURNED`."""
    here = model.space.state(pose)
    ids = np.zeros(0, np.int64) if graph is None else graph.near(float(here.x[0]), float(here.y[0]), NEAR)
    if graph is None or not ids.size:
        return here
    states = graph.states(ids)
    turned = np.abs(wrap(states.yaw - here.yaw[0]))
    nearest = int(np.argmin(turned))
    return states.take(slice(nearest, nearest + 1)) if turned[nearest] <= TURNED else here


def _single(goal: Mapping[str, Any], problem: Problem, closed: Sequence[Closing]) -> Destination:
    """Check a destination without stops: {x, y} or {landmark}."""
    model, world = problem.model, problem.world
    if "landmark" in goal:
        mark = next((m for m in world.content.landmarks if m.name == goal["landmark"]), None)
        if mark is None:
            raise QueryError(f"the map has no landmark called {goal['landmark']!r}; choose one of the map")
        spot, name, target = {"x": mark.x, "y": mark.y}, printable(mark.name), _before(mark, problem)
        if target is None:
            words = f"blocked: there is no free place within {SIGHT[1]:g} m from which the robot sees {name}"
            return Destination(_place(spot, "blocked", words, None), None)
        own = dict(zip(model.space.names, target, strict=True))
        return Destination(_place(spot, "reachable", f"to see {name}", (own["x"], own["y"])), target)
    x, y = float(goal["x"]), float(goal["y"])
    if model.collision(world).states_free(_states(problem, x, y, HEADINGS)).any():
        return Destination(_place(goal, "reachable", "reachable", (x, y)), _state(problem, x, y))
    reason = ", ".join(_in_the_way(x, y, problem, closed))
    free = nearest_free(model, world, _states(problem, x, y, 0))
    near = None if free is None else (float(free.x[0]), float(free.y[0]))
    if near is None or (away := math.dist(near, (x, y))) > FARTHEST:
        return Destination(_place(goal, "blocked", f"blocked by {reason}", None), None)
    words = f"blocked by {reason}; {NEAREST.format(away)}"
    return Destination(_place(goal, "nearest", words, near), _state(problem, *near))


def _before(mark: Landmark, problem: Problem) -> tuple[Any, ...] | None:
    """Return a free goal state from which a landmark is seen; None if there is none.

    It lies at a distance within `SIGHT`, is turned to the landmark, and is at most 60 degrees off its facing side.
    """
    away, side = (a.ravel() for a in np.meshgrid(np.linspace(*SIGHT, 6), np.arange(24) * np.pi / 12))
    turned = np.abs(wrap(side - (0.0 if mark.facing is None else mark.facing)))
    x, y = mark.x + away * np.cos(side), mark.y + away * np.sin(side)
    columns = {n: np.full(len(x), v) for n, v in zip(problem.model.space.names, problem.start, strict=True)}
    states = States(**columns | {"x": x, "y": y, "yaw": wrap(side + np.pi)})
    free = problem.model.collision(problem.world).states_free(states)
    if mark.facing is not None:
        free &= turned < np.pi / 3
    high = shapely.union_all([o.polygon for o in problem.world.obstacles if o.z_max >= mark.z])
    near = np.stack([mark.x + 0.2 * np.cos(side), mark.y + 0.2 * np.sin(side)], axis=1)
    free &= ~shapely.intersects(shapely.linestrings(np.stack([np.stack([x, y], axis=1), near], axis=1)), high)
    if not free.any():
        return None
    best = int(np.argmin(np.where(free, np.abs(away - np.mean(SIGHT)) + 0.2 * turned, np.inf)))
    return tuple(problem.model.space.values(states.take(slice(best, best + 1))))


def _stop(stop: Mapping[str, Any], problem: Problem, closed: Sequence[Closing]) -> dict[str, Any]:
    """Return a stop of a tour, a point or a landmark, as a parameter of :class:`hpop.Tour`."""
    if "landmark" in stop:
        return {"landmark": stop["landmark"]}
    found = _single(stop, problem, closed)
    if found.target is None:
        raise QueryError(f"a stop cannot be reached: {found.place['words']}")
    return {"at": [found.place["goal"]["x"], found.place["goal"]["y"]], "within": WITHIN}


def _place(spot: Mapping[str, Any], status: str, words: str, goal: tuple[float, float] | None) -> dict[str, Any]:
    at = None if goal is None else {"x": goal[0], "y": goal[1], "theta": None}
    return {"type": "place", "x": spot.get("x"), "y": spot.get("y"), "status": status, "words": words, "goal": at}


def _state(problem: Problem, x: float, y: float) -> tuple[float | None, ...]:
    """Return a goal state at a point, with any heading; other variables as at the start."""
    own: dict[str, float | None] = {"x": x, "y": y, "yaw": None}
    return tuple(own.get(n, value) for n, value in zip(problem.model.space.names, problem.start, strict=True))


def _states(problem: Problem, x: float, y: float, headings: int) -> States:
    """Return states at a point with ``headings`` equally spaced yaws; for 0, one state with yaw NaN (any heading)."""
    count = max(headings, 1)
    yaw = np.arange(count) * 2 * np.pi / count if headings else np.full(1, np.nan)
    columns = {n: np.full(count, v) for n, v in zip(problem.model.space.names, problem.start, strict=True)}
    return States(**columns | {"x": np.full(count, x), "y": np.full(count, y), "yaw": yaw})


def _in_the_way(x: float, y: float, problem: Problem, closed: Sequence[Closing]) -> Iterator[str]:
    """Yield what blocks a place, in words: the first cause that is found."""
    world, point, reach = problem.world, shapely.Point(x, y), reach_of(problem.model)  # type: ignore[arg-type]
    if not world.extent.covers(point):
        yield "the border of the map"
        return
    for closing in closed:
        if closing.area.distance(point) <= reach:
            yield printable(closing.person or closing.name) or "a closed area"
            return
    near = min(((o.polygon.distance(point), o.name) for o in world.obstacles), default=(math.inf, ""))
    yield (printable(near[1]) if near[0] <= reach else "") or "a wall"
