"""Draw collision-free configurations for a roadmap, and choose which of them to link."""

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

# "Nearest" refers to the metric of the space. With links to nearest states only, a path of a robot with many joints
# needs many links. So there are far links too: each leads to the nearest state within a random subset of all states.
# The smaller the subset, the farther that state usually is.


MAX_LINKS = 60_000_000
LINK = 64  # bytes needed for finding a link
PIECES = 64  # work of a nearest-neighbour query, as a multiple of the work for a motion
LEAF = 32  # points in a leaf of the k-d tree: for seven joints, large leaves without balancing save a third of the time
START = 0  # node number of the start
LINKED = "configurations were linked"


def links_between(
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
    """Choose the links of a roadmap; return them as pairs of nodes (L, 2), first and last, sorted by first node.

    Node 0 is the start; the samples follow, then the goals. Samples are linked in both directions. The start is linked
    to samples and to each goal, and samples are linked to goals; no link leads to the start or from a goal.

    Parameters
    ----------
    count : number of nearest samples to which each sample is linked; if ``far`` is 0, also for start and goals
    far : number of far links of each sample; if it is not 0, the start is linked to all samples, and each of G goals to
        the nearest 1 / G of the samples, or to ``count`` if that is more
    chosen : (C, 2) further links, from the first node to the second; between samples in both directions
    """
    number, places = samples.size, np.arange(goals.size)
    if number * (count + far) > MAX_LINKS:
        raise OptionError(
            f"a roadmap must have at most {MAX_LINKS:,} links, got {number:,} samples with {count + far} links each; "
            "take fewer samples, or fewer neighbours or far links"
        )
    spending.check(LINKED, number * (count + far) * LINK)
    ids, neighbours = np.arange(number), nearest(space, samples, samples, count + 1, spending)  # itself included
    between = (chosen > START).all(axis=1) & (chosen <= number).all(axis=1)
    away = nearest_in_random_subsets(space, samples, far, rng, spending)
    ends = [
        np.stack([np.repeat(ids, neighbours.shape[1]), neighbours.ravel()], axis=1),
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
    """Find the ``count`` states nearest to each state of ``of`` (N,); return their indices (N, c) in ``states``.

    The number c of columns is ``count``, or that of the states if they are fewer. Distances are those of the space's
    metric, in which angles are periodic. Coordinates that are NaN in the first state of ``of`` are ignored.
    """
    count = min(count, states.size)
    if not count or not of.size:
        return np.zeros((of.size, count), np.int64)
    names = [name for name in space.names if not np.isnan(getattr(of, name)[:1]).any()]
    points, queries = (_tree_points(space, names, rows) for rows in (states, of))
    return _nearest(points, queries, _periods(space, names), count, spending)


def nearest_in_random_subsets(
    space: StateSpace, states: States, count: int, rng: np.random.Generator, spending: Spending
) -> IntArray:
    """Choose the far links of each state (N,): the nearest state in each of ``count`` random subsets of all states.

    Returns indices (count, N), one row for each size of subsets; no row for a single state. The sizes are random,
    log-uniform from 1 to half of the states, with one in each of ``count`` equal intervals of the logarithm. For each
    size, the states are divided at random into groups of this size, and each state is linked to the nearest state of
    the next group. One k-d tree answers all queries: an additional coordinate separates the groups so far that no state
    of another group is nearer.
    """
    number = states.size
    far_states = np.zeros((count if number > 1 else 0, number), np.int64)
    if not far_states.size:
        return far_states
    rows, periods = _tree_points(space, space.names, states), _periods(space, space.names)
    apart = 1.0 + math.sqrt(rows.shape[1]) * 2 * max(float(np.ptp(rows, axis=0).max()), float(periods.max()))
    for level, share in enumerate((np.arange(count) + rng.random(count)) / count):
        groups = number // max(1, math.floor(math.exp(share * math.log(number / 2))))
        group = rng.permutation(number) % groups
        points, queries = (np.column_stack([rows, apart * place]) for place in (group, (group + 1) % groups))
        far_states[level] = _nearest(points, queries, np.append(periods, 0.0), 1, spending)[:, 0]
    return far_states


def _tree_points(space: StateSpace, names: tuple[str, ...] | list[str], states: States) -> FloatArray:
    """Return states as points (N, d) for a k-d tree: named coordinates times their weights, angles in one period."""
    rows = [np.zeros(states.size)]
    for name, weight in zip(space.names, space.weights, strict=True):
        if weight and name in names:
            value, circle = weight * np.asarray(getattr(states, name), float), 2 * math.pi * weight
            if name in space.turning:
                value = np.mod(value, circle)
                value = np.where(value >= circle, 0.0, value)
            rows.append(value)
    return np.stack(rows, axis=1)


def _periods(space: StateSpace, names: tuple[str, ...] | list[str]) -> FloatArray:
    """Return the period (d,) of each coordinate of :func:`_tree_points`: a weighted full turn for angles, else 0."""
    columns = [(name, weight) for name, weight in zip(space.names, space.weights, strict=True) if weight]
    return np.array(
        [0.0, *(2 * math.pi * weight * (name in space.turning) for name, weight in columns if name in names)]
    )


def _nearest(points: FloatArray, queries: FloatArray, periods: FloatArray, count: int, spending: Spending) -> IntArray:
    """Return the indices (N, count) of the ``points`` (M, d) nearest to each of the ``queries`` (N, d).

    periods  (d,)  period of each coordinate, 0 if it is not periodic
    """
    from scipy.spatial import KDTree  # on first use

    box = periods if periods.any() else None  # without periods a query is faster
    tree = KDTree(points, leafsize=LEAF, balanced_tree=False, boxsize=box)
    indices = np.zeros((len(queries), count), np.int64)

    def near(part: slice) -> tuple[slice, IntArray]:
        return part, np.asarray(tree.query(queries[part], [*range(1, count + 1)])[1], np.int64)

    for part, places in spending.each(near, blocks(len(queries), PIECES), LINKED):
        indices[part] = places
    return indices


DRAWN_AT_ONCE = 1 << 16
DRAWS = 1000  # largest number of states that are drawn for each sample wanted
NEAR = 0.3  # share of the samples that lie near guides
FARTHEST = 0.2  # largest spread of samples around a guide, as a share of the shortest guide's length
CLOSEST = 0.01  # smallest spread; the spread of a sample is log-uniform in between
LONGER = 1.6  # largest length of a path through any other sample, as a multiple of the shortest guide's length

Rows = Callable[[int], FloatArray]


def uniform_samples(connections: Connections, number: int, rng: np.random.Generator, spending: Spending) -> FloatArray:
    """Draw ``number`` collision-free states (n, k) from the space; fewer if nearly all draws collide.

    They are uniform but for rest positions, which half of them have (:meth:`hpop.motions.StateSpace.sample`).
    """
    space = connections.space
    return _free_draws(connections, lambda count: connections.rows(space.sample(rng, count)), number, spending)


def guided_samples(
    connections: Connections,
    start: FloatArray,
    goals: FloatArray,
    guides: list[Guide],
    number: int,
    rng: np.random.Generator,
    spending: Spending,
) -> FloatArray:
    """Draw collision-free states (n, k): three of ten near guides, the others uniformly from an informed set.

    The informed set consists of the states from which the distances to the start (k,) and to a goal (G, k) add up to at
    most 1.6 times the length of the shortest guide (informed RRT*, Gammell et al. 2014, doi
    10.1109/IROS.2014.6942976).

    Some coordinates of the space may have a rest position, such as the joints of an arm on a mobile base. Then half of
    the samples of both kinds have these coordinates at rest, and inner states of guides, put at rest, are samples too.
    In the other samples, the coordinates without a rest position are copied from a guide, the start or a goal.
    """
    shortest, near = length(guides[0], connections), round(NEAR * number)
    longest, space = LONGER * shortest, connections.space
    box, ends = replace(_box(connections, start, goals, longest), rest={}), np.vstack([start, goals])
    begin, end = (np.concatenate([guide.rows[side] for guide in guides]) for side in (slice(-1), slice(1, None)))
    sizes = connections.distances(begin, end)
    metre = np.divide(1.0, connections.weights, out=np.zeros_like(begin[0]), where=connections.weights > 0)
    limits = [
        (-np.inf, np.inf) if name in space.turning else bounds
        for name, *bounds in zip(space.names, space.low, space.high, strict=True)
    ]

    def half_at_rest(rows: FloatArray, sources: FloatArray) -> FloatArray:
        """Return rows (n, k) with the coordinates that have a rest position at rest in about half of them.

        In the other rows, the coordinates without a rest position are copied from ``sources`` (n, k). If the space has
        no rest positions, the rows are returned unchanged.
        """
        if not space.rest:
            return rows
        moved = np.where([name in space.rest for name in space.names], rows, sources)
        return np.where(rng.random((len(rows), 1)) < 0.5, with_rest_positions(space, rows), moved)

    def near_guides(count: int) -> FloatArray:
        """Draw at most ``count`` rows from normal distributions around points of guides, within the joint limits."""
        piece = rng.choice(len(begin), count, p=sizes / sizes.sum())
        share = rng.random((count, 1))
        spread = shortest * CLOSEST * (FARTHEST / CLOSEST) ** rng.random((count, 1))
        rows = begin[piece] + share * connections.differences(begin[piece], end[piece])
        rows += spread * metre * rng.standard_normal(rows.shape) / math.sqrt(max(1, int((metre > 0).sum())))
        rows = half_at_rest(rows, np.where(share < 0.5, begin[piece], end[piece]))
        return rows[((rows >= [low for low, _ in limits]) & (rows <= [high for _, high in limits])).all(axis=1)]

    def in_ellipsoids(count: int) -> FloatArray:
        """Draw ``count`` rows from a box around the informed set; return those that lie in the set."""
        rows = connections.rows(box.sample(rng, count))
        rows = half_at_rest(rows, ends[rng.integers(len(ends), size=count)] if space.rest else rows)
        return rows[in_informed_set(connections, start, goals, longest, rows)]

    inner = with_rest_positions(space, np.concatenate([guide.rows[1:-1] for guide in guides]))[
        : near if space.rest else 0
    ]
    inner = inner[connections.collision.states_free(connections.states(inner))]
    near -= len(inner)
    drawn = _free_draws(connections, near_guides, near, spending)
    return np.concatenate([inner, drawn, _free_draws(connections, in_ellipsoids, number - len(inner) - near, spending)])


def with_rest_positions(space: StateSpace, rows: FloatArray) -> FloatArray:
    """Return rows of states (n, k) in which each coordinate with a rest position is replaced by that position."""
    rest = [space.rest.get(name, np.nan) for name in space.names]
    return np.where(np.isnan(rest), rows, rest)


def in_informed_set(
    connections: Connections, start: FloatArray, goals: FloatArray, longest: float, rows: FloatArray
) -> BoolArray:
    """Return which rows (n, k) lie on a short enough detour: at most ``longest`` from the start to a goal through them.

    The lengths are distances from the start (k,) to the row, plus from there to the nearest goal (G, k).
    """
    onward = np.min([connections.distances(rows, goal) for goal in goals], axis=0)
    return np.asarray(connections.distances(start, rows) + onward <= longest)


def _box(connections: Connections, start: FloatArray, goals: FloatArray, longest: float) -> StateSpace:
    """Return the space with its coordinates bounded to a box around the informed set.

    The informed set is an ellipsoid for each goal, with start and goal as foci and ``longest`` as its longest diameter.
    """
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


def _free_draws(connections: Connections, draw: Rows, number: int, spending: Spending) -> FloatArray:
    """Call ``draw`` until ``number`` of the drawn rows are free of collisions, and return these (n, k).

    Fewer rows are returned if nearly all draws collide.
    """
    at_once = min(max(1, number), DRAWN_AT_ONCE)
    parts, count = [np.zeros((0, len(connections.weights)))], 0
    for _ in range(DRAWS * math.ceil(number / at_once)):
        spending.check("configurations were drawn")
        rows = connections.projected(draw(at_once))
        parts.append(rows[connections.collision.states_free(connections.states(rows))])
        count += len(parts[-1])
        if count >= number:
            break
    return np.concatenate(parts)[:number]
