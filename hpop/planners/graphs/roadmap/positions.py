"""Positions of a roadmap: where it begins and may end, and samples of the free space."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.errors import QueryError
from hpop.motions import States
from hpop.planners.goals import End, goals_of, start_of
from hpop.planners.graphs.arcs import blocks
from hpop.planners.needs import in_plane
from hpop.planners.spending import Spending
from hpop.planners.usable import elsewhere

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

DRAWS = 1000  # positions drawn for each that is wanted, before the free space is called too small
SAMPLE = 64  # bytes that drawing a position takes
SAME = 1e-9  # m: two positions no further apart are one


class PositionedEnds(NamedTuple):
    """Where a roadmap begins and may end.

    positions  (E, 2)  m; the first is the start's
    goals      position of each goal, and its yaw, rad, None where it is free
    """

    positions: FloatArray
    goals: tuple[tuple[int, float | None], ...]


def checked_ends(problem: Problem) -> PositionedEnds:
    """Positions of the start and of the goals that are not blocked; QueryError where the start or all goals are."""
    collision = in_plane(problem.model).collision(problem.world)

    def refusal(what: str, end: End) -> str:
        x, y, yaw = end
        if yaw is None and collision.yaw_matters:  # some heading may do
            return ""
        state = States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw or 0.0]))
        reason = collision.why_blocked(state)
        hint = reason and elsewhere(problem.model, problem.world, state)
        return reason and f"the {what} ({x:.3f}, {y:.3f}) is not usable: {reason}.{hint}"

    start, goals = start_of(problem), goals_of(problem)
    refusals = [refusal(f"goal {i}" if len(goals) > 1 else "goal", goal) for i, goal in enumerate(goals)]
    if refused := refusal("start", start) or (all(refusals) and " ".join(refusals)):
        raise QueryError(refused)
    positions, at = [start[:2]], list[tuple[int, float | None]]()
    for x, y, yaw in (goal for goal, refused in zip(goals, refusals, strict=True) if not refused):
        near = [i for i, position in enumerate(positions) if math.dist(position, (x, y)) <= SAME]
        at.append((near[0] if near else len(positions), yaw))
        positions += [] if near else [(x, y)]
    return PositionedEnds(np.array(positions), tuple(at))


def pairs(count: int) -> IntArray:
    """All pairs (L, 2) of the first positions."""
    return np.stack(np.triu_indices(count, 1), axis=1)


def drawn_positions(problem: Problem, samples: int, seed: int, spending: Spending) -> FloatArray:
    """Free positions (n, 2), m, drawn uniformly; fewer than samples where next to nothing is free.

    A position is taken if the robot is free there at a random heading.
    """
    rng = np.random.default_rng(seed)
    collision = problem.model.collision(problem.world)
    x_min, y_min, x_max, y_max = problem.world.bounds
    drawn = np.zeros((0, 2))
    for _ in range(DRAWS):
        spending.check("positions were drawn", samples * SAMPLE)
        at = rng.uniform((x_min, y_min, 0.0), (x_max, y_max, 2 * math.pi), (samples, 3))

        def found(part: slice, at: FloatArray = at) -> FloatArray:
            x, y, yaw = at[part].T
            return at[part][collision.states_free(States(x=x, y=y, yaw=yaw)), :2]

        drawn = np.concatenate([drawn, *spending.each(found, blocks(samples), "positions were drawn")])
        if len(drawn) >= samples:
            break
    return drawn[:samples]
