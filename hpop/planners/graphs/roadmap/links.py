"""Configurations of a roadmap: free samples, and which of them are linked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, distinct
from hpop.errors import OptionError
from hpop.motions import States, StateSpace
from hpop.planners.graphs.arcs import blocks
from hpop.planners.graphs.roadmap.guides import Connections, Guide, length
from hpop.planners.spending import Spending

# Near is what the metric of the space calls so. With its nearest ones alone a state of many joints is some steps from
# any other; a far link leads to the nearest within a random subset, and the smaller that is, the farther away.


MAX_LINKS = 60_000_000
LINK = 64  # bytes that finding a link takes
PIECES = 64  # to find the nearest is as much work as so many arcs of one motion
LEAF = 32  # points: of seven joints in a tree so flat, not balanced, the nearest are found in two thirds of the time
START = 0  # its node
LINKED = "configurations were linked"


def linked(
    space: StateSpace,
    start: States,
    samples: States,
    goals: States,
    *,
    count: int,
    far: int,
    chosen: IntArray,
    rng: np.random.Generator,
    spending: Spending,
) -> IntArray:
    """Tails and heads (L, 2), by tails: of each sample and some others, either way, from the start, to the goals.

    The nodes are the start, the samples, the goals. The start is linked to all goals as well; nothing leads back from
    these, nor to the start.

    Parameters
    ----------
    count : of the nearest samples to which each is linked; so are start and goals, if there are no far links
    far : of the samples farther away; with them start and goals share as many nearest ones as there are samples
    chosen : (C, 2) nodes that are linked anyway, first to second, and back between samples
    """
    number, places = samples.size, np.arange(goals.size)
    if number * (count + far) > MAX_LINKS:
        raise OptionError(
            f"{number:,} samples with {count + far} neighbours each make more than {MAX_LINKS:,} links; take fewer "
            "samples, or fewer neighbours"
        )
    spending.check(LINKED, number * (count + far) * LINK)
    ids, others = np.arange(number), nearest(space, samples, samples, count + 1, spending)  # each is near to itself
    between = (chosen > START).all(axis=1) & (chosen <= number).all(axis=1)
    away = farther(space, samples, far, rng, spending)
    ends = [
        np.stack([np.repeat(ids, others.shape[1]), others.ravel()], axis=1),
        np.stack([np.tile(ids, len(away)), away.ravel()], axis=1),
        chosen[between] - 1,
    ]
    low, high = np.sort(np.concatenate(ends), axis=1).T
    pairs = distinct((low * number + high)[low < high])
    low, high = (1 + side for side in np.divmod(pairs, max(1, number)))
    of_ends = [max(count, number // several) if far else count for several in (1, max(1, goals.size))]
    leaving = 1 + nearest(space, samples, start, of_ends[0], spending).ravel()
    arriving = [1 + nearest(space, samples, goals.take([place]), of_ends[1], spending).ravel() for place in places]
    goal = 1 + number + places
    tails = [low, high, np.full(leaving.size, START), *arriving, np.full(goal.size, START), chosen[~between, 0]]
    heads = [high, low, leaving, np.repeat(goal, [near.size for near in arriving]), goal, chosen[~between, 1]]
    size = 1 + number + goals.size
    links = np.stack(np.divmod(distinct(np.concatenate(tails) * size + np.concatenate(heads)), size), axis=1)
    spending.hold(links.nbytes, LINKED)
    return links


def nearest(space: StateSpace, states: States, of: States, count: int, spending: Spending) -> IntArray:
    """Places (N, c) of the nearest among states to each ``of`` (N,), by the metric of the space.

    What is NaN in the first of these is left out of the metric. A column that turns is a circle of the tree.
    """
    count = min(count, states.size)
    if not count or not of.size:
        return np.zeros((of.size, count), np.int64)
    names = [name for name in space.names if not np.isnan(getattr(of, name)[:1]).any()]
    points, asked = (_placed(space, names, some) for some in (states, of))
    return _nearest(points, asked, _circles(space, names), count, spending)


def farther(space: StateSpace, states: States, count: int, rng: np.random.Generator, spending: Spending) -> IntArray:
    """Places (c, N) of the nearest to each of the states within each of c random subsets of them.

    The sizes of the subsets are log-uniform, from 1 to half of the states, one draw in each of c parts of equal width.
    All states are dealt into groups of such a size; a state looks for its nearest in the group after its own. One tree
    finds all: the groups are farther apart than any states.
    """
    number = states.size
    found = np.zeros((count if number > 1 else 0, number), np.int64)
    if not found.size:
        return found
    rows, circles = _placed(space, space.names, states), _circles(space, space.names)
    apart = 1.0 + math.sqrt(rows.shape[1]) * 2 * max(float(np.ptp(rows, axis=0).max()), float(circles.max()))
    for level, share in enumerate((np.arange(count) + rng.random(count)) / count):
        groups = number // max(1, math.floor(math.exp(share * math.log(number / 2))))
        group = rng.permutation(number) % groups
        inside, asked = (np.column_stack([rows, apart * place]) for place in (group, (group + 1) % groups))
        found[level] = _nearest(inside, asked, np.append(circles, 0.0), 1, spending)[:, 0]
    return found


def _placed(space: StateSpace, names: tuple[str, ...] | list[str], states: States) -> FloatArray:
    """States as points (N, d) of a tree: columns weighted, within a circle where they turn."""
    rows = [np.zeros(states.size)]
    for name, weight in zip(space.names, space.weights, strict=True):
        if weight and name in names:
            value, circle = weight * np.asarray(getattr(states, name), float), 2 * math.pi * weight
            if name in space.turning:
                value = np.mod(value, circle)
                value = np.where(value >= circle, 0.0, value)
            rows.append(value)
    return np.stack(rows, axis=1)


def _circles(space: StateSpace, names: tuple[str, ...] | list[str]) -> FloatArray:
    """How long (d,) the circle of each of these columns is, 0 where it has none."""
    columns = [(name, weight) for name, weight in zip(space.names, space.weights, strict=True) if weight]
    return np.array(
        [0.0, *(2 * math.pi * weight * (name in space.turning) for name, weight in columns if name in names)]
    )


def _nearest(points: FloatArray, asked: FloatArray, circles: FloatArray, count: int, spending: Spending) -> IntArray:
    """Places (N, c) of the nearest among points to those asked (N, d)."""
    from scipy.spatial import KDTree  # on first use

    box = circles if circles.any() else None  # without circles a tree is searched sooner
    tree = KDTree(points, leafsize=LEAF, balanced_tree=False, boxsize=box)
    found = np.zeros((len(asked), count), np.int64)

    def near(part: slice) -> tuple[slice, IntArray]:
        return part, np.asarray(tree.query(asked[part], [*range(1, count + 1)])[1], np.int64)

    for part, places in spending.each(near, blocks(len(asked), PIECES), LINKED):
        found[part] = places
    return found


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
