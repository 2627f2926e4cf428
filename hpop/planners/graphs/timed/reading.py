"""Which criteria read the time, found by asking what some arcs cost at several times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import HOLD, Motions, States
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.legs import motions_of

TRIED = 64  # arcs that are asked about


def reading_time(criteria: Sequence[Criterion], space: StateGraph | JoinedEnds) -> list[int]:
    """Return the columns of the criteria that read the time, among the people of a graph's world."""
    tried = list(_tried(space))
    return [j for j, criterion in enumerate(criteria) if any(_reads_time(criterion, motions) for motions in tried)]


def _tried(space: StateGraph | JoinedEnds) -> Iterator[Motions]:
    """Yield motions of some arcs; of a graph that has none, those of joined ends and a hold."""
    inner = space.states_alone
    size = inner.arcs.heads.size
    if size:
        some = np.unique(np.linspace(0, size - 1, TRIED).astype(np.int64))
        yield from (motions for _, _, motions in motions_of(inner, some))
        return
    if space.joins is not None:
        yield from (motions for _, motions in space.joins.motions() if len(motions))
    states = space.states(np.zeros(1, np.int64))
    columns = {name: np.nan_to_num(column) for name, column in states.__dict__.items()}
    start, end = (States(**columns, **{CLOCK: np.array([clock])}) for clock in (0.0, 1.0))
    yield Motions(space.world, space.model, HOLD, start, end)


def _reads_time(criterion: Criterion, motions: Motions) -> bool:
    """Return whether costs depend on when a motion begins: none can be had without, or they differ."""
    try:
        plain = motion_costs(criterion, motions)
    except (CriterionError, UnsupportedCriterion):
        return True
    world, model, law = motions.world, motions.model, motions.law
    for t0 in (0.0, 1.0, 5.0):
        then = Motions(world, model, law, motions.start, motions.end, t0=np.full(len(motions), t0))
        if (motion_costs(criterion, then) != plain).any():
            return True
    return False
