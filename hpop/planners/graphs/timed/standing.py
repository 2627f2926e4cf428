"""What standing costs whom it does not matter when: by the second, at every state, and whether the heading matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import HOLD, Law, Motions, States
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.arcs import blocks
from hpop.planners.graphs.timed.legs import TimedArcs, motions_of
from hpop.planners.graphs.timed.presence import Presence
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph

ALIKE = 1e-9  # relative: what standing costs at two headings is the same
IN_PLACE = 1e-2  # relative: turning costs what standing meanwhile does, but for the quadrature
TRIED = 200  # turns of which that is tried
DOING = "what standing costs was reckoned"


def hold_costs(
    criteria: Sequence[Criterion],
    space: TrajectoryGraph,
    states: States,
    lasts: FloatArray,
    presence: Presence | None = None,
    seconds: FloatArray | None = None,
) -> FloatArray:
    """Costs (N, k) of holds in states (N,), which last so long, s; from some times on, s, if these are given."""
    world = space.world if presence is None else presence.company.world
    columns = {name: np.nan_to_num(column) for name, column in states.__dict__.items()}
    start, end = States(**columns, **{CLOCK: 0.0 * lasts}), States(**columns, **{CLOCK: lasts})
    motions = Motions(world, space.model, HOLD, start, end, t0=seconds)
    return np.stack([motion_costs(criterion, motions) for criterion in criteria], axis=1)


def standing_rates(criteria: Sequence[Criterion], space: TrajectoryGraph, tick: float) -> FloatArray:
    """What standing for a tick costs in each state (n, k) of a graph, by criteria that read no time."""
    rates = np.zeros((space.size, len(criteria)))
    if not criteria:
        return rates

    def found(part: slice) -> tuple[slice, FloatArray]:
        states = space.states(np.arange(part.start, part.stop))
        return part, hold_costs(criteria, space, states, np.ones(states.size))

    for part, costs in space.spending.each(found, blocks(space.size), DOING):
        rates[part] = costs
    adds_up = np.array([criterion.aggregate != "max" for criterion in criteria], dtype=bool)
    rates[:, adds_up] *= tick
    return rates


def alike_at_places(rates: FloatArray, place: IntArray) -> BoolArray:
    """Whether (k,) each column of rates (n, k) is the same, but for rounding, at all nodes of each place."""
    size = int(place.max(initial=-1)) + 1
    low, high = np.full((size, rates.shape[1]), np.inf), np.full((size, rates.shape[1]), -np.inf)
    np.minimum.at(low, place, rates)
    np.maximum.at(high, place, rates)
    found: BoolArray = (high - low <= ALIKE * np.maximum(1.0, high)).all(axis=0)
    return found


def turn_as_they_stand(criteria: Sequence[Criterion], arcs: TimedArcs, presence: Presence) -> BoolArray:
    """Whether (k,) a motion in place costs by each criterion what standing at the place does meanwhile.

    Tried where somebody is noticed, at all headings: of a criterion that reads where the base is, and when, it holds.
    """
    places, ticks = np.nonzero(presence.masks(0.0, presence.clock.tick))
    in_place = np.flatnonzero(arcs.inner.arcs.kinds > 0)
    at = arcs.place[arcs.tails[arcs.own[in_place]]]
    order = np.argsort(at, kind="stable")
    rng = np.random.default_rng(0)
    if not (places.size and in_place.size and criteria):
        return np.ones(len(criteria), dtype=bool)
    tried = rng.choice(places.size, min(TRIED, places.size), replace=False)
    begin, end = (np.searchsorted(at[order], places[tried], side=side) for side in ("left", "right"))
    there = np.flatnonzero(end > begin)
    picked = order[(begin + (rng.random(tried.size) * (end - begin)).astype(np.int64))[there]]
    chosen, seconds = in_place[picked], presence.clock.seconds(ticks[tried[there]])
    unique, which = np.unique(chosen, return_inverse=True)
    worst, largest = np.zeros(len(criteria)), np.zeros(len(criteria))
    for _, rows, motions in motions_of(arcs.inner, unique):
        number = np.searchsorted(rows, unique)
        own = np.flatnonzero(rows[np.minimum(number[which], rows.size - 1)] == chosen)
        one = number[which[own]]
        moved = _at(motions, motions.law, one, seconds[own])
        lasts = np.asarray(np.broadcast_to(motions.duration, len(motions)))[one]
        here = arcs.states.take(arcs.place[arcs.tails[arcs.own[chosen[own]]]])
        for states in (motions.start.take(one), here):
            stood = hold_costs(criteria, arcs.inner, states, lasts, presence, seconds[own])
            turned = np.stack([motion_costs(criterion, moved) for criterion in criteria], axis=1)
            worst = np.maximum(worst, np.abs(turned - stood).max(axis=0, initial=0.0))
            largest = np.maximum(largest, np.maximum(turned, stood).max(axis=0, initial=0.0))
    found: BoolArray = worst <= IN_PLACE * largest
    return found


def _at(motions: Motions, law: Law, rows: IntArray, seconds: FloatArray) -> Motions:
    start, end = motions.start.take(rows), motions.end.take(rows)
    return Motions(motions.world, motions.model, law, start, end, t0=seconds)
