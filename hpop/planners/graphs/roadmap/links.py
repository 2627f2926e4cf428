"""Which configurations of a roadmap are linked: the nearest ones, and ones farther away.

Near is what the metric of the space calls so. With its nearest ones alone a state of many joints is some steps from
any other; a far link leads to the nearest within a random subset, and the smaller that is, the farther away.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray, distinct
from hpop.errors import OptionError
from hpop.motions import States, StateSpace
from hpop.planners.graphs.arcs import blocks
from hpop.planners.spending import Spending

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
