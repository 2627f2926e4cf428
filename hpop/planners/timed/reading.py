"""Which criteria read the time, found by asking what some arcs cost at several times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hpop.criteria.base import Criterion, motion_costs
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import Motions
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.timed.legs import motions_of

TRIED = 64  # arcs that are asked about


def reading_time(criteria: Sequence[Criterion], space: StateGraph | JoinedEnds) -> list[int]:
    """Which of some criteria read the time, among the people of a graph's world."""
    inner = space.inner if isinstance(space, JoinedEnds) else space
    return [j for j, criterion in enumerate(criteria) if _reads_time(criterion, inner)]


def _reads_time(criterion: Criterion, space: StateGraph) -> bool:
    """Whether costs depend on when a motion begins: none can be had without, or they differ."""
    some = np.unique(np.linspace(0, space.arcs.heads.size - 1, TRIED).astype(np.int64))
    for _, _, motions in motions_of(space, some):
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
