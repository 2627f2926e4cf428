"""Free configurations for a roadmap: uniform ones, or near guides and where a way may be not much longer than these."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.motions import StateSpace
from hpop.planners.graphs.roadmap.guides import Connections, Guide, length
from hpop.planners.spending import Spending

DRAWN_AT_ONCE = 1 << 16
DRAWS = 1000  # states drawn for each that is wanted, before the free space is called too small
NEAR = 0.3  # of the samples lie near guides
FARTHEST = 0.2  # of the shortest guide's length: no sample near a guide is meant to lie farther from it
CLOSEST = 0.01  # of the same: how far others are from a guide is log-uniform
LONGER = 1.6  # all other samples lie on ways at most so many times as long as the shortest guide

Rows = Callable[[int], FloatArray]


def uniform(connections: Connections, number: int, rng: np.random.Generator, spending: Spending) -> FloatArray:
    """Free states (n, k), drawn uniformly from the space; fewer where next to nothing is free."""
    space = connections.space
    return _drawn(connections, lambda count: connections.rows(space.sample(rng, count)), number, spending)


def guided(
    connections: Connections,
    start: FloatArray,
    goals: FloatArray,
    found: list[Guide],
    number: int,
    rng: np.random.Generator,
    spending: Spending,
) -> FloatArray:
    """Free states (n, k): three of ten near guides, the others uniform where a way through them may be short.

    That is where the distances from the start (k,) and to a goal (G, k) add up to at most 1.6 times the length of the
    shortest guide: what informed RRT* (Gammell et al. 2014, doi 10.1109/IROS.2014.6942976) calls its informed set.

    Of a space with a rest half of either are at rest, the inner states of guides among them; others are where a guide,
    the start or a goal is, but for what rests.
    """
    shortest, near = length(found[0], connections), round(NEAR * number)
    longest, space = LONGER * shortest, connections.space
    box, ends = replace(_box(connections, start, goals, longest), rest={}), np.vstack([start, goals])
    begin, end = (np.concatenate([guide.rows[side] for guide in found]) for side in (slice(-1), slice(1, None)))
    sizes = connections.apart(begin, end)
    metre = np.divide(1.0, connections.weights, out=np.zeros_like(begin[0]), where=connections.weights > 0)
    limits = [
        (-np.inf, np.inf) if name in space.turning else bounds
        for name, *bounds in zip(space.names, space.low, space.high, strict=True)
    ]

    def settled(rows: FloatArray, places: FloatArray) -> FloatArray:
        """Rows (n, k), some of them at rest, and those that are not but for that at one of places (n, k)."""
        if not space.rest:
            return rows
        moved = np.where([name in space.rest for name in space.names], rows, places)
        return np.where(rng.random((len(rows), 1)) < 0.5, rested(space, rows), moved)

    def beside(count: int) -> FloatArray:
        piece = rng.choice(len(begin), count, p=sizes / sizes.sum())
        share = rng.random((count, 1))
        spread = shortest * CLOSEST * (FARTHEST / CLOSEST) ** rng.random((count, 1))
        rows = begin[piece] + share * connections.differences(begin[piece], end[piece])
        rows += spread * metre * rng.standard_normal(rows.shape) / math.sqrt(max(1, int((metre > 0).sum())))
        rows = settled(rows, np.where(share < 0.5, begin[piece], end[piece]))
        return rows[((rows >= [low for low, _ in limits]) & (rows <= [high for _, high in limits])).all(axis=1)]

    def within(count: int) -> FloatArray:
        rows = connections.rows(box.sample(rng, count))
        rows = settled(rows, ends[rng.integers(len(ends), size=count)] if space.rest else rows)
        return rows[informed(connections, start, goals, longest, rows)]

    inner = rested(space, np.concatenate([guide.rows[1:-1] for guide in found]))[: near if space.rest else 0]
    inner = inner[connections.collision.states_free(connections.states(inner))]
    near -= len(inner)
    drawn = _drawn(connections, beside, near, spending)
    return np.concatenate([inner, drawn, _drawn(connections, within, number - len(inner) - near, spending)])


def rested(space: StateSpace, rows: FloatArray) -> FloatArray:
    """Rows (n, k), what rests in them at rest."""
    rest = [space.rest.get(name, np.nan) for name in space.names]
    return np.where(np.isnan(rest), rows, rest)


def informed(
    connections: Connections, start: FloatArray, goals: FloatArray, longest: float, rows: FloatArray
) -> BoolArray:
    """Which rows (n, k) lie on a way from the start (k,) to a goal (G, k) no longer than that, as the crow flies."""
    onward = np.min([connections.apart(rows, goal) for goal in goals], axis=0)
    return np.asarray(connections.apart(start, rows) + onward <= longest)


def _box(connections: Connections, start: FloatArray, goals: FloatArray, longest: float) -> StateSpace:
    """The space as far as such rows may lie, goal by goal an ellipsoid between two foci."""
    space, weights = connections.space, connections.weights
    apart = connections.differences(np.broadcast_to(start, goals.shape), goals)
    room = np.maximum(0.0, longest**2 - ((weights * apart) ** 2).sum(axis=1))[:, None]
    half = 0.5 * np.sqrt(np.divide(room, weights**2, out=np.full(apart.shape, np.inf), where=weights > 0) + apart**2)
    low, high = (start + 0.5 * apart - half).min(axis=0), (start + 0.5 * apart + half).max(axis=0)
    bounds = {}
    for j, name in enumerate(space.names):
        if name not in space.turning:
            bounds[name] = max(low[j], space.low[j]), min(high[j], space.high[j])
        elif high[j] - low[j] < 2 * math.pi:
            bounds[name] = low[j], high[j]
    return space.bounded(**bounds)


def _drawn(connections: Connections, draw: Rows, number: int, spending: Spending) -> FloatArray:
    """Free ones (n, k) of what is drawn, so many at once; fewer where next to nothing is free."""
    at_once = min(max(1, number), DRAWN_AT_ONCE)
    parts, found = [np.zeros((0, len(connections.weights)))], 0
    for _ in range(DRAWS * math.ceil(number / at_once)):
        spending.check("configurations were drawn")
        rows = draw(at_once)
        parts.append(rows[connections.collision.states_free(connections.states(rows))])
        found += len(parts[-1])
        if found >= number:
            break
    return np.concatenate(parts)[:number]
