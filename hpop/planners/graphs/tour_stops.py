"""Stops of a tour on a graph: its states in their sets, and further states for stops that have none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray
from hpop.criteria.visits import in_stop
from hpop.errors import QueryError
from hpop.goals.tour import Tour, TourStop
from hpop.motions import States
from hpop.planners.graphs.arcs import BLOCK
from hpop.planners.graphs.joined_ends import Ends, JoinedEnds
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.needs import elsewhere

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world import World

DRAWN = 16  # states of a stop that are joined to a graph without a state in the stop's set
TRIED = 64  # states that are drawn for them


def with_tour(ends: Ends, problem: Problem, tour: Tour) -> Ends:
    """Return a graph with the layers of a tour; stops without a state of the graph get some, joined to near states.

    Raises QueryError for a stop that cannot be visited.
    """
    space, start, goals = ends
    members = [_members(space, stop, problem.world) for stop in tour.stops]
    if empty := [i for i, found in enumerate(members) if not found.size]:
        space = _with_states(space, problem, [tour.stops[i] for i in empty])
        members = [_members(space, stop, problem.world) for stop in tour.stops]
    layered = TourGraph(
        space.model, space.world, space, tour, tuple(members), tuple(dict.fromkeys(goals)), spending=space.spending
    )
    return Ends(layered, start, layered.targets)


def _members(space: TrajectoryGraph, stop: TourStop, world: World) -> IntArray:
    """Return the nodes of a graph that are free and in the set of a stop; with a dwell only those without free angles.

    The cost of a hold may depend on the angle.
    """
    found = [np.zeros(0, np.int64)]
    for begin in range(0, space.size, BLOCK):
        ids = np.arange(begin, min(begin + BLOCK, space.size))
        space.spending.check(f"states of stop {stop.name!r} were looked for")
        ids = ids[in_stop(stop, world, space.model, space.states(ids))]
        states = space.states(ids)
        known = ~np.any([np.isnan(column) for column in states.__dict__.values()], axis=0)
        free = np.full(ids.size, not stop.dwell)
        free[known] = space.collision.states_free(states.take(np.flatnonzero(known)))
        found.append(ids[free])
    return np.concatenate(found)


def _with_states(space: TrajectoryGraph, problem: Problem, stops: Sequence[TourStop]) -> TrajectoryGraph:
    """Return a graph with additional states for stops, joined to near states in both directions."""
    alone = space.states_alone
    if alone is None:
        raise QueryError(" ".join(_reason(space, problem, stop) for stop in stops))
    ends, added = dict(space.ends if isinstance(space, JoinedEnds) else {}), dict[str, list[str]]()
    for stop in stops:
        states = drawn_states(problem, stop)
        if not states.size:
            raise QueryError(_reason(space, problem, stop))
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
                f"stop {stop.name!r} cannot be visited: {len(nodes)} free states of it were found, but none of them is "
                f"joined to {space.words} within {reach:.3g} m by a free turn, straight move and turn; take a smaller "
                "step or more samples, or a stop with more room"
            )
    return joined


def drawn_states(problem: Problem, stop: TourStop) -> States:
    """Return at most `DRAWN` free states of a stop, drawn at random with a fixed seed."""
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


def _about(problem: Problem, stop: TourStop, rng: np.random.Generator) -> States:
    """Return states at positions of a stop's disc, the centre first, with headings all round."""
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
    """Return states near a landmark from which the camera may see it."""
    mark = next(mark for mark in problem.world.content.landmarks if mark.name == stop.landmark)
    assert stop.within is not None
    states = problem.model.space.sample(rng, 16 * TRIED)
    if {"x", "y", "yaw"} <= set(states.names):
        angle, radius = (rng.uniform(0.0, most, states.size) for most in (2 * np.pi, stop.within))
        columns = states.__dict__ | {"x": mark.x + radius * np.cos(angle), "y": mark.y + radius * np.sin(angle)}
        states = States(**columns | {"yaw": angle + np.pi})
    return states


def _reason(space: TrajectoryGraph, problem: Problem, stop: TourStop) -> str:
    """Return why a stop has no free state, as text."""
    said, model, world = f"stop {stop.name!r} cannot be visited", problem.model, problem.world
    if stop.at is not None:
        (x, y), columns = stop.at, dict.fromkeys(model.space.names, np.zeros(1))
        centre = States(**columns | {"x": np.array([x]), "y": np.array([y])})
        blocked = model.collision(world).why_blocked(centre)
        why = f": at ({x:g}, {y:g}) {blocked}.{elsewhere(model, world, centre)}" if blocked else "."
        return (
            f"{said}: the robot is free at no position within {stop.within:g} m{why} Move it, or give a larger within."
        )
    if stop.landmark is not None:
        return (
            f"{said}: the camera sees landmark {stop.landmark!r} from no free state within {stop.within:g} m. It may "
            "be behind obstacles, or out of the camera's view. Move it, or give a larger within."
        )
    return f"{said}: no free state of the robot reaches {stop.target} with its target in view. Move or widen the goal."
