"""Find the states of a graph at which each stop of a tour can be visited, and add states for stops without any."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray
from hpop.criteria.visits import in_stop
from hpop.errors import QueryError
from hpop.goals.tour import MOST_LAYERS, Tour
from hpop.goals.tour_stop import TourStop
from hpop.motions import States
from hpop.planners.graphs.arcs import BLOCK
from hpop.planners.graphs.joined_ends import Ends, JoinedEnds
from hpop.planners.graphs.run_speeds import with_run_speeds
from hpop.planners.graphs.speeds import with_speeds
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.needs import elsewhere, people_move

if TYPE_CHECKING:
    from hpop.criteria.base import Criterion
    from hpop.problems.problem import Problem
    from hpop.world import World

DRAWN = 16  # most states that are added to a graph for a stop at which it has no state
TRIED = 64  # random states among which these are chosen


def with_tour(ends: Ends, problem: Problem, tour: Tour, criteria: Sequence[Criterion]) -> Ends:
    """Return the graph of a tour, made from a graph that contains start and goals.

    A search on it decides at which state each stop is visited. For the parameters see :func:`tour_graph`.

    Raises QueryError for a stop that cannot be visited, and for a tour with too many layers.
    """
    refuse_many_layers(
        tour, "this planner", "use lattice, roadmap, any-angle or exact, which then fix each stop to one state"
    )
    layered, start = tour_graph(ends, problem, tour, criteria)
    return Ends(layered, start, layered.targets)


def refuse_many_layers(tour: Tour, what: str, remedy: str) -> None:
    """Raise QueryError if a tour has too many layers for a search over all states of each stop.

    what    planner that searches, for the error
    remedy  advice, as a clause
    """
    if tour.has_many_layers:
        raise QueryError(
            f"{what} takes at most {MOST_LAYERS} sets of visited stops, which are six stops in any order; these "
            f"{len(tour.stops)} stops have {len(tour.layers):,}. Keep some stops in order, or {remedy}"
        )


def tour_graph(ends: Ends, problem: Problem, tour: Tour, criteria: Sequence[Criterion]) -> tuple[TourGraph, int]:
    """Return the graph of a tour, whose arcs are not computed yet, and the node of the start.

    If the robot can visit a stop at no state of the graph, random states of the stop are added first and connected to
    states nearby. Then come the layers of the model's speeds, if it has several. Raises QueryError for a stop that
    cannot be visited.

    ends      graph without layers; start and goals are among its nodes
    criteria  costs that the search minimises
    """
    space = ends.space
    members = tour_members(space, tour, problem.world)
    if empty := [i for i in tour.remaining if not members[i].size]:
        space = with_drawn_states(space, problem, [tour.stops[i] for i in empty])
    plain = ends.space
    whole = ends._replace(space=space)
    if people_move(problem):
        space, start, goals = with_run_speeds(whole, problem.model)
    else:
        space, start, goals = with_speeds(whole, problem.model, criteria)
    if space is not plain:
        members = tour_members(space, tour, problem.world)
    layered = TourGraph(
        space.model, space.world, space, tour, members, tuple(dict.fromkeys(goals)), spending=space.spending
    )
    return layered, start


def tour_members(space: TrajectoryGraph, tour: Tour, world: World) -> tuple[IntArray, ...]:
    """Return for each stop the nodes of a graph at which the robot visits it; none for a stop that is done."""
    none = np.zeros(0, np.int64)
    return tuple(none if i in tour.done else _members(space, stop, world) for i, stop in enumerate(tour.stops))


def _members(space: TrajectoryGraph, stop: TourStop, world: World) -> IntArray:
    """Return the nodes of a graph at which the robot visits a stop, free of collision.

    If the stop has a dwell time, only nodes at rest count, and no node with an undetermined angle (NaN), such as a goal
    with any heading: the cost of standing there may depend on the angle.
    """
    found = [np.zeros(0, np.int64)]
    for begin in range(0, space.size, BLOCK):
        ids = np.arange(begin, min(begin + BLOCK, space.size))
        space.spending.check(f"the graph was searched for states of stop {stop.name!r}")
        ids = ids[~space.is_marker(ids)]
        ids = ids if not stop.dwell else ids[space.at_rest(ids)]
        ids = ids[in_stop(stop, world, space.model, space.states(ids))]
        states = space.states(ids)
        known = ~np.any([np.isnan(column) for column in states.__dict__.values()], axis=0)
        free = np.full(ids.size, not stop.dwell)
        free[known] = space.collision.states_free(states.take(np.flatnonzero(known)))
        found.append(ids[free])
    return np.concatenate(found)


def with_stop_states(space: TrajectoryGraph, problem: Problem, like: TrajectoryGraph | None = None) -> TrajectoryGraph:
    """Return a graph with states added for the stops of the problem's tour at which it has none.

    With ``like``, add those that were added to this other graph of the same states.
    """
    if like is not None:
        return like.with_stops_joined(space)
    if problem.tour is None:
        return space
    members = tour_members(space, problem.tour, problem.world)
    empty = [problem.tour.stops[i] for i in problem.tour.remaining if not members[i].size]
    return with_drawn_states(space, problem, empty) if empty else space


def with_drawn_states(space: TrajectoryGraph, problem: Problem, stops: Sequence[TourStop]) -> TrajectoryGraph:
    """Return the graph with random states of the given stops added, connected to and from states nearby.

    Raises QueryError if this is no graph in the plane, or for a stop without a free state, or whose states cannot be
    connected.
    """
    alone = space.states_alone
    if alone is None:
        raise QueryError(" ".join(_reason(problem, stop) for stop in stops))
    ends, added = dict(space.added_states), dict[str, list[str]]()
    for stop in stops:
        states = drawn_states(problem, stop)
        if not states.size:
            raise QueryError(_reason(problem, stop))
        added[stop.name] = [f"state {i} of stop {stop.name}" for i in range(states.size)]
        ends |= {what: states.take(slice(i, i + 1)) for i, what in enumerate(added[stop.name])}
    reach = alone.reach(problem)
    names = tuple(what for each in added.values() for what in each)
    joined = JoinedEnds(alone.model, alone.world, alone, ends, reach, names, spending=alone.spending)
    entered, left = set(joined.joins.heads.tolist()), set(joined.joins.tails.tolist())
    for stop in stops:
        nodes = {joined.node(what) for what in added[stop.name]}
        if not nodes & entered & left:
            raise QueryError(
                f"stop {stop.name!r} cannot be visited: {len(nodes)} free robot states at this stop were tried, but "
                f"none can be connected to {space.words} within {reach:.3g} m by {joined.join_words} without a "
                "collision; take a smaller step or more samples, or a stop with more room"
            )
    return joined


def drawn_states(problem: Problem, stop: TourStop) -> States:
    """Return at most `DRAWN` random states, free of collision, in which the robot visits a stop.

    The seed is fixed, so the states are equal in each run. Raises QueryError if the stop's goal gives no states.
    """
    model, world, rng = problem.model, problem.world, np.random.default_rng(0)
    if stop.at is not None:
        states = _about(problem, stop, rng)
    elif stop.landmark is not None:
        states = _looking(problem, stop, rng)
    else:
        assert stop.target is not None
        try:
            states = stop.target.states(problem, rng, TRIED)
        except QueryError as error:
            raise QueryError(f"stop {stop.name!r} cannot be visited: {error}") from None
    usable = in_stop(stop, world, model, states) & model.collision(world).states_free(states)
    return states.take(np.flatnonzero(usable)[:DRAWN])


def reasons_not_visited(problem: Problem) -> dict[int, str]:
    """Return, by index, why stops of the problem's tour may be impossible to visit: no random state of theirs is free.

    A planner may still have a free state at such a stop.
    """
    reasons = dict[int, str]()
    for i, stop in enumerate(() if problem.tour is None else problem.tour.stops):
        try:
            if not drawn_states(problem, stop).size:
                reasons[i] = _reason(problem, stop)
        except QueryError as error:
            reasons[i] = str(error)
    return reasons


def _about(problem: Problem, stop: TourStop, rng: np.random.Generator) -> States:
    """Return random states for a stop at a position, not yet checked for collision.

    The first ones are at the centre of the stop's disc, the others anywhere in it. Headings are spread evenly over all
    directions.
    """
    assert stop.at is not None
    assert stop.within is not None
    states = problem.model.space.sample(rng, TRIED)
    angle, radius = rng.uniform(0.0, 2 * np.pi, TRIED), stop.within * np.sqrt(rng.uniform(0.0, 1.0, TRIED))
    radius[: DRAWN // 2] = 0.0
    columns = states.__dict__ | {"x": stop.at[0] + radius * np.cos(angle), "y": stop.at[1] + radius * np.sin(angle)}
    if "yaw" in columns:
        columns["yaw"] = np.arange(TRIED) * 4 * np.pi / DRAWN
    return States(**columns)


def _looking(problem: Problem, stop: TourStop, rng: np.random.Generator) -> States:
    """Return random states for a stop at a landmark, not yet checked for distance, collision or visibility.

    A base with a heading is within the stop's distance of the landmark, and faces it. States of other models are drawn
    from the whole space.
    """
    mark = next(mark for mark in problem.world.content.landmarks if mark.name == stop.landmark)
    assert stop.within is not None
    states = problem.model.space.sample(rng, 16 * TRIED)
    if {"x", "y", "yaw"} <= set(states.names):
        angle, radius = (rng.uniform(0.0, most, states.size) for most in (2 * np.pi, stop.within))
        columns = states.__dict__ | {"x": mark.x + radius * np.cos(angle), "y": mark.y + radius * np.sin(angle)}
        states = States(**columns | {"yaw": angle + np.pi})
    return states


def _reason(problem: Problem, stop: TourStop) -> str:
    """Return the error message for a stop at which the robot has no free state, with the reason."""
    said, model, world = f"stop {stop.name!r} cannot be visited", problem.model, problem.world
    if stop.at is not None:
        (x, y), columns = stop.at, dict.fromkeys(model.space.names, np.zeros(1))
        centre = States(**columns | {"x": np.array([x]), "y": np.array([y])})
        blocked = model.collision(world).why_blocked(centre)
        said += f": no free robot state was found within {stop.within:g} m of its position ({x:g}, {y:g})"
        if not blocked:
            return f"{said}. Move the stop, or give a larger within."
        return f"{said}: {blocked}, or give a larger within.{elsewhere(model, world, centre)}"
    if stop.landmark is not None:
        return (
            f"{said}: no free robot state within {stop.within:g} m of landmark {stop.landmark!r} was found from which "
            "the camera sees it. The landmark may be behind obstacles, or outside the camera's field of view. Move the "
            "landmark, or give a larger within."
        )
    return (
        f"{said}: no free robot state was found that reaches {stop.target} with its target in view. The target may "
        "be inside or behind an obstacle: give a point in front of it, or make the goal larger."
    )
