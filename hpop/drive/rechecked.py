"""Ways that are known, looked at again in a world that has just changed: an answer while another is being made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.criteria.costs import trajectory_costs
from hpop.drive.closings import Closing
from hpop.drive.cuts import closed_ways
from hpop.drive.plan import SAME, joined, part
from hpop.motions import States
from hpop.planners.base import Candidates
from hpop.planners.objectives import Objectives
from hpop.runtime.status import Status
from hpop.trajectories.contacts import first_contact
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

CLAIM = (
    "incomplete: known ways, looked at again among people and closings as they are told to be now; points need not be "
    "optimal, others are missing, and nothing is proven of these before the graph on the clock is made anew: ask again"
)


def rests_from(ways: Iterable[Trajectory], state: States) -> Iterator[Trajectory]:
    """What is still to go of ways, from where each is in a state (1,) for the last time."""
    for way in ways:
        there = np.ones(len(way) + 1, dtype=np.bool_)
        space = way.model.space
        for off in space.differences(state.take(np.zeros(len(way) + 1, np.int64)), way.states).values():
            there &= np.abs(off) <= SAME
        last = np.flatnonzero(there)
        if last.size and last[-1] < len(way):
            yield part(way, int(last[-1]), len(way))


def clear_ways(
    ways: Iterable[Trajectory],
    problem: Problem,
    before: Trajectory,
    closings: Sequence[Closing],
    margin: float,
    latest: float | None,
    enough: Callable[[], bool],
) -> Iterator[Trajectory]:
    """Those of some ways that nothing and nobody is in the way of, as plans and as they are executed.

    problem  asked from where and when they begin
    before   what is driven until then: a robot that comes along is not at rest there
    margin   m, to people who move
    latest   s, from then on, by which they arrive; None for whenever
    enough   whether no more of them are looked at
    """
    parts, people = problem.model.platform, problem.world.content.people
    for way in ways:
        if enough():
            return
        if (latest is not None and way.duration > latest) or closed_ways([way], closings).any():
            continue
        whole = joined(before, way)
        each = product((whole, whole.execution()), {0.0, margin})
        if not any(first_contact(parts, people, one, least, begin=before.duration) for one, least in each):
            yield way


def rechecked(name: str, problem: Problem, objectives: Objectives, ways: Sequence[Trajectory]) -> Candidates:
    """Ways that are open and clear as candidates of the planner ``name``, of which nothing is claimed but that."""
    criteria = objectives.optimised
    costs = trajectory_costs(criteria, ways, problem.world) if ways else np.zeros((0, len(criteria)))
    origin: dict[str, Any] = {"planner": name, "known": True}
    return Candidates(
        objectives=criteria,
        trajectories=tuple(ways),
        planned=costs,
        tolerance=np.zeros(costs.shape),
        status=Status.TIME_LIMIT,
        certificate=f"{name}: {CLAIM}{objectives.certificate}",
        provenance=(origin,) * len(ways),
        notes=objectives.notes,
        filters=objectives.filters,
        stats={"planner": name, "labels_generated": 0, "gap": None},
    )
