"""Tables of the search "general": nodes and arcs, paths of labels, and the sets of vectors for dominance tests.

A label is a partial path. Each node has a set: the cost vectors, called members, of labels closed there. All members
are in one array of numbers, the pool; a row of the table of sets says where those of a set begin (START), how many
there are (SIZE), and for how many there is room (ROOM).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean


@kernel
def build_tables(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    order: IntArray,
    left_out: NDArray[np.bool_],
    is_target: NDArray[np.uint8],
    turn: int,
    group: NDArray[np.int32],
    arcs: NDArray[Any],
    origin: NDArray[np.int32],
) -> tuple[IntArray, IntArray]:
    """Fill the table of the arcs of one layer that a search reads, with costs in its order.

    Loops and arcs to nodes that are left out are left out. The arcs of each node begin with its turns, except turns to
    targets, which come among the other arcs.

    indptr, heads, costs  arcs of a layer of the graph, see :class:`.Graph`
    order      (k,)       columns of the graph's costs, in the order of the search
    left_out   (n,)       mask of nodes
    is_target  (n,)       mask of nodes that are targets in some layer
    turn                  column of the cost that turns raise; -1: no arc counts as a turn
    group      (n,)       group of each node; turns are arcs within a group
    arcs       (m, 1 + k) output: head and costs of each arc
    origin     (m,)       output: index of each arc in the layer

    Returns the offsets (n + 1,) of the arcs of each node, and the offsets (n,) of its first arc that is no turn.
    """
    n = len(indptr) - 1
    start = np.zeros(n + 1, np.int64)
    plain = np.zeros(n, np.int64)
    m = 0
    for u in range(n):
        start[u] = m
        for at_once in (True, False):
            if not at_once:
                plain[u] = m
            for a in range(indptr[u], indptr[u + 1]):
                v = heads[a]
                if v == u or left_out[v]:
                    continue
                if at_once != (turn >= 0 and costs[a, turn] > 0 and group[u] == group[v] and not is_target[v]):
                    continue
                arcs[m, 0] = v
                for j in range(len(order)):
                    arcs[m, j + 1] = costs[a, order[j]]
                origin[m] = a
                m += 1
    start[n] = m
    return start, plain


@kernel
def trace_paths(closed: IntArray, labels: IntArray) -> tuple[IntArray, IntArray]:
    """Follow labels (partial paths, (n,)) back to the source, to find the arcs of their paths.

    closed  closed labels, to which labels refer as parents

    Returns the end (n,) of each path in the second array, and this array (N,): the arcs of all paths, path after path,
    each from its last arc to its first, by the numbers that labels have.
    """
    ends = np.empty(len(labels), np.int64)
    steps = np.empty(1024, np.int64)
    size = 0
    for i in range(len(labels)):
        label = labels[i]
        while label != 0:
            if size == len(steps):
                steps = np.concatenate((steps, np.empty_like(steps)))
            steps[size] = (label & 0xFFFFFFFF) - 1
            size += 1
            label = closed[(label >> 32) - 1]
        ends[i] = size
    return ends, steps[:size]


# A set holds the cost vectors of labels closed at a node. Its members are stored cost by cost: cost j of its members is
# pool[start + j * room :][:size]. So a dominance test is a loop without branches over neighbouring numbers, which the
# compiler vectorises. This is about twenty times as fast as comparing member by member up to the first larger cost,
# with a wrong branch prediction at each (measured: 512 members of three costs in 46 ns instead of 1340). The newest
# members are tested first, as they dominate most often.
#
# The first cost is not stored, as labels leave the heap in its order. So with two costs a set is one number. With three
# costs, the other two form a staircase: members are sorted, and a binary search finds the one that may dominate.


START, SIZE, ROOM, SET_COLUMNS = range(4)  # columns of the table of sets
PIECE = 64  # number of members that are compared at a time

# Indices below are unsigned: numba then leaves out the check for negative ones, so that loops are vectorised.
_0, _1, _PIECE = np.uint64(0), np.uint64(1), np.uint64(PIECE)


@lean
def covers(pool: NDArray[Any], start: int, room: int, size: int, f: tuple[Any, ...]) -> bool:
    """Return whether some member of a set is at most f in every cost; f has the integer type of the pool.

    start, room, size  place of the set in the pool: index of its first number, numbers reserved for each cost, and
                       number of members
    """
    begin, stride, end = np.uint64(start), np.uint64(room), np.uint64(size)
    while end > _0:
        piece = (end - _1) // _PIECE * _PIECE
        least = pool.dtype.type(1)  # over the members, the largest excess of a cost over f
        for i in range(begin + piece, begin + end):
            worst = pool.dtype.type(pool[i] - f[0])
            for j in range(_1, np.uint64(len(f))):
                worst = max(worst, pool.dtype.type(pool[i + j * stride] - f[j]))
            least = min(least, worst)
        if least <= 0:
            return True
        end = piece
    return False


@lean
def drop_covered(pool: NDArray[Any], start: int, room: int, size: int, f: tuple[Any, ...]) -> int:
    """Remove the members of a set that are nowhere smaller than f; return the number of remaining members.

    start, room, size and f are those of :func:`covers`; the pool is changed.
    """
    begin, stride, end = np.uint64(start), np.uint64(room), np.uint64(size)
    left = end
    while end > _0:
        piece = (end - _1) // _PIECE * _PIECE
        most = pool.dtype.type(-1)  # over the members, the least excess of a cost over f
        for i in range(begin + piece, begin + end):
            best = pool.dtype.type(pool[i] - f[0])
            for j in range(_1, np.uint64(len(f))):
                best = min(best, pool.dtype.type(pool[i + j * stride] - f[j]))
            most = max(most, best)
        if most >= 0:
            while end > piece:
                end -= _1
                covered = True
                for j in range(np.uint64(len(f))):
                    covered &= pool[begin + end + j * stride] >= f[j]
                if covered:  # the last member, already tested, takes its place
                    left -= _1
                    for j in range(np.uint64(len(f))):
                        pool[begin + end + j * stride] = pool[begin + left + j * stride]
        end = piece
    return np.int64(left)  # type: ignore[return-value]  # signed, as all other numbers of a kernel


@lean
def smaller(pool: NDArray[Any], start: int, size: int, value: int) -> int:
    """Return how many of the sorted numbers pool[start:][:size] are smaller than a value, by a binary search."""
    low, left = np.uint64(start), np.uint64(size)
    while left > _1:
        half = left >> _1
        low = low + half if pool[low + half - _1] < value else low
        left -= half
    if left == _1 and pool[low] < value:
        low += _1
    return int(np.int64(low)) - start


@lean
def is_covered(sets: IntArray, pool: NDArray[Any], s: int, f: NDArray[Any]) -> bool:
    """Return whether some member of set s is at most f (k,) in every cost but the first.

    sets, pool  the sets of all nodes, see the module; set s has the cost vectors of labels (partial paths) at node s

    The first cost needs no test, as labels leave the heap in its order.
    """
    start, size, room = sets[s, START], sets[s, SIZE], sets[s, ROOM]
    if len(f) == 1:
        return bool(size > 0)
    if len(f) == 2:
        return bool(size > 0 and pool[start] <= f[1])
    if len(f) == 3:
        before = smaller(pool, start, size, np.int64(f[1]) + 1)
        return bool(before > 0 and pool[start + room + before - 1] <= f[2])
    if len(f) == 4:
        return bool(covers(pool, start, room, size, (f[1], f[2], f[3])))
    if len(f) == 5:
        return bool(covers(pool, start, room, size, (f[1], f[2], f[3], f[4])))
    return bool(covers(pool, start, room, size, (f[1], f[2], f[3], f[4], f[5])))


@kernel
def add_all_to_sets(
    sets: IntArray,
    pool: NDArray[Any],
    where: NDArray[np.int32],
    vectors: NDArray[Any],
    tested: NDArray[Any],
    begin: int,
    counters: IntArray,
    used: int,
) -> int:
    """Add saved vectors (n, k), from index `begin` on, each to its set.

    sets, pool        table of the sets, and numbers of their members
    where     (n,)    set of each vector
    tested    (n, k)  vectors that no member of the set may cover yet; (0, k) for no test
    counters, used    counters of the search; `used` is the index of the one that holds how many numbers of the pool are
                      used

    Returns n, or i if the pool has too little room for vector i, or -1 - i if vector i of `tested` is covered.
    """
    for i in range(begin, len(where)):
        s = np.int64(where[i])
        if len(tested) > 0 and is_covered(sets, pool, s, tested[i]):
            return -1 - i
        if counters[used] + numbers_needed(sets, s, vectors.shape[1]) > len(pool):
            return i
        counters[used] = add_to_set(sets, pool, s, vectors[i], counters[used])
    return len(where)


@kernel
def checksum_of_sets(sets: IntArray, pool: NDArray[Any], width: int) -> int:
    """Return a checksum of all sets (rows of `sets`, with members in `pool`), whatever the members' order.

    width  number of costs of each member
    """
    total = np.int64(0)
    for s in range(len(sets)):
        start, size, room = sets[s, START], sets[s, SIZE], sets[s, ROOM]
        total += (s + 1) * size
        for j in range(width):
            for i in range(size):
                total += (s + 1) * (2 * j + 3) * np.int64(pool[start + j * room + i])
    return int(total)


@lean
def numbers_needed(sets: IntArray, s: int, k: int) -> int:
    """Return how many more numbers of the pool are used at most when :func:`add_to_set` adds a vector to set s.

    k  number of costs of the vector, of which a member stores k - 1
    """
    return int(max(1, 2 * sets[s, ROOM]) * (k - 1))


@lean
def add_to_set(sets: IntArray, pool: NDArray[Any], s: int, f: NDArray[Any], used: int) -> int:
    """Add an uncovered vector f (k,) to set s, which stores it without its first cost; remove the members it covers.

    `sets` is the table of sets, and `pool` has their members. A full set moves to the end of the pool. `used` is how
    many numbers of the pool are used; the new count is returned.
    """
    width = len(f) - 1
    if width == 2:
        return int(enter_sorted(sets, pool, s, f, used))
    start, size, room = sets[s, START], sets[s, SIZE], sets[s, ROOM]
    if width < 2:
        size = 0
    elif width == 3:
        size = drop_covered(pool, start, room, size, (f[1], f[2], f[3]))
    elif width == 4:
        size = drop_covered(pool, start, room, size, (f[1], f[2], f[3], f[4]))
    else:
        size = drop_covered(pool, start, room, size, (f[1], f[2], f[3], f[4], f[5]))
    if size == room:
        used = move(sets, pool, s, width, used)
        start, room = sets[s, START], sets[s, ROOM]
    for j in range(width):
        pool[start + j * room + size] = f[j + 1]
    sets[s, SIZE] = size + 1
    return used


@lean
def move(sets: IntArray, pool: NDArray[Any], s: int, width: int, used: int) -> int:
    """Move the full set s, with members of `width` costs, to the end of the used part of the pool, with twice the room.

    `used` is how many numbers of the pool are used; the new count is returned. The row of `sets` is updated.
    """
    start, size = sets[s, START], sets[s, SIZE]
    twice = max(1, 2 * size)
    for j in range(width):
        for i in range(size):
            pool[used + j * twice + i] = pool[start + j * size + i]
    sets[s, START], sets[s, ROOM] = used, twice
    return int(used + width * twice)


@lean
def enter_sorted(sets: IntArray, pool: NDArray[Any], s: int, f: NDArray[Any], used: int) -> int:
    """Add f (3,) like :func:`add_to_set`, but to a sorted set: the second cost of members rises, the third falls.

    Nothing changes if a member covers f. Arguments and result are those of :func:`add_to_set`.
    """
    start, size, room = sets[s, START], sets[s, SIZE], sets[s, ROOM]
    at = smaller(pool, start, size, np.int64(f[1]))
    if at > 0 and pool[start + room + at - 1] <= f[2]:
        return used
    end = at
    while end < size and pool[start + room + end] >= f[2]:
        end += 1
    if end == at and size == room:
        used = move(sets, pool, s, 2, used)
        start, room = sets[s, START], sets[s, ROOM]
    for j in range(2):
        begin = np.uint64(start + j * room)
        first, last = begin + np.uint64(at), begin + np.uint64(size)
        if end == at:
            for i in range(last - first):
                pool[last - i] = pool[last - i - _1]
        elif end > at + 1:
            rest = begin + np.uint64(end)
            for i in range(last - rest):
                pool[first + _1 + i] = pool[rest + i]
        pool[first] = f[j + 1]
    sets[s, SIZE] = size + at + 1 - end
    return used
