"""The inner loop of the search on time-dependent graphs: tick after tick, labels (partial paths) arrive and leave.

At each tick, arriving labels that others make superfluous are dropped first (:mod:`.sets`). Then each of the others
leaves by every open arc. Then, at nodes where waiting may be useful, labels that have held long enough leave by the
arcs for which it is useful. A label that arrives at a target is a solution and ends there.

**Useful holds.** Let a label that arrived at v at tick b leave by arc a = (v, u) at tick t >= b + hold. Suppose that it
could also have left at an earlier tick s, with s = b or b + hold <= s <= t - hold, and then have held after the arc
until t + d at no larger costs (:func:`.calm.gains` is false for s and t). Then that earlier arrival makes this one
superfluous. This is checked for s = t - hold and s = b. No label waits longer than until max(L(v) + 1, b + hold), as no
change comes after L(v) (:mod:`.calm`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.slices import (
    CLOSED,
    DONE,
    FRONT,
    HEAP,
    N_CLOSED,
    N_EXPANDED,
    N_FRONT,
    N_GENERATED,
    N_OPEN,
    N_ROWS,
    ROWS,
    SLICE,
)
from hpop.search.timed.calm import RemainingBounds, gains, needs_one_stay, wait_until
from hpop.search.timed.joint import JointTables, row_of
from hpop.search.timed.sets import (
    BEGIN,
    CALM,
    LEAST_ROOM,
    OWNER,
    RIPE,
    ROOM,
    SIZE,
    TICK,
    LabelSets,
    enter_label,
    is_superfluous,
    make_room,
    refresh,
)
from hpop.search.timed.solutions import SolutionSet, insert_solution, is_covered, may_improve
from hpop.search.timed.tables import STAYS, TimedTables, arc_cost, is_open, omega_at

# Indices of the search's state: tick, stage, first label closed at the tick, next label or node, number of nodes with
# waiting labels, first free row of the queue, rows used so far, and solutions found so far.
NOW, STAGE, FIRST, NEXT, WAITING, FREE, USED, SOLVED, STATE = range(9)
ARRIVE, LEAVE, HOLD_ON, STAGES = range(4)


class Queue(NamedTuple):
    """Queue of labels (partial paths) that are on their way along an arc, in linked lists by the tick of their arrival.

    tops   (power of two,)  first row of each tick, -1 for none; a ring of more ticks than the longest arc takes
    below  (o,)             next row of the same tick, or next free row
    values (o,)             labels: 1 + closed parent and 1 + arc (:mod:`.slices`)
    costs  (o, k)           costs of the labels at arrival
    """

    tops: NDArray[np.int32]
    below: NDArray[np.int32]
    values: IntArray
    costs: IntArray


class ClosedLabels(NamedTuple):
    """Labels (partial paths) that have arrived at a node, called closed labels, and those that wait there.

    values  (c,)    closed labels
    ticks   (c,)    tick of arrival of each closed label
    costs   (f, k)  costs of the labels that arrive at this tick
    kept    (f,)    1 for those labels that no other label of this tick makes superfluous
    nodes   (n,)    nodes at which labels wait, in any order
    waits   (n,)    1 for a node at which labels wait
    """

    values: IntArray
    ticks: NDArray[np.int32]
    costs: IntArray
    kept: NDArray[np.uint8]
    nodes: NDArray[np.int32]
    waits: NDArray[np.uint8]


class PruningBounds(NamedTuple):
    """Joint bounds and corners of the uncovered region, by which labels (partial paths) are pruned.

    joint    b tables of joint bounds: lower bounds of weighted remaining costs, for LANES weight vectors each
    corners  (c, k)         corners of the region of costs that solutions leave uncovered
    lanes    (c, b, LANES)  weighted sums of the corners, for the b tables of weights of the joint bounds
    hint     (1,)           index of the corner that let the last label pass; it is tried first
    weighed  (b, LANES)     scratch
    """

    joint: JointTables
    corners: IntArray
    lanes: NDArray[np.int32]
    hint: IntArray
    weighed: NDArray[np.int32]


@lean
def is_pruned(
    tables: TimedTables,
    rest: RemainingBounds,
    goal: SolutionSet,
    bounds: PruningBounds,
    count: int,
    v: int,
    t: int,
    g: IntArray,
    f: IntArray,
) -> bool:
    """Return whether bounds prove that `count` solutions cover all paths that begin with a label (partial path).

    The label has costs g (k,) at node v and tick t; f (k,) is scratch.
    """
    joint = bounds.joint
    row = row_of(joint.offset, joint.calm, v, t)
    for j in range(len(g)):
        h = rest.least[j, v]
        if joint.alone[j] >= 0:
            h = max(h, np.int64(joint.rows[0, row, joint.alone[j]]) << joint.shift[j])
        f[j] = max(g[j], h) if tables.is_max[j] else g[j] + h
    if is_covered(goal, count, f):
        return True
    return not may_improve(joint, bounds.corners, bounds.lanes, row, g, f, bounds.hint, bounds.weighed)


@lean
def send_along(
    tables: TimedTables,
    rest: RemainingBounds,
    goal: SolutionSet,
    bounds: PruningBounds,
    queue: Queue,
    counters: IntArray,
    state: IntArray,
    a: int,
    p: int,
    t: int,
    g: IntArray,
    parent: int,
    scratch: IntArray,
) -> None:
    """Extend a partial path with costs g (k,) by open arc a, from place p at tick t; queue it unless it is pruned.

    At a target, it becomes a solution instead. It is dropped if it cannot arrive in time. `parent` is 1 + the index of
    the extended closed label.
    """
    x = np.int64(tables.heads[a])
    end = t + np.int64(tables.durations[a])
    if rest.ticks[x] > goal.arrive_by - end:
        return
    after, f = scratch[0], scratch[1]
    for j in range(len(g)):
        c = arc_cost(tables, a, p, j, t)
        after[j] = max(g[j], c) if tables.is_max[j] else g[j] + c
    value = (parent << 32) | (a + 1)
    if goal.is_target[x]:
        if not is_covered(goal, counters[N_FRONT], after):
            insert_solution(goal, counters, after, value, t)
            state[SOLVED] += 1
        return
    if is_pruned(tables, rest, goal, bounds, counters[N_FRONT], x, end, after, f):
        return
    row = state[FREE]
    if row >= 0:
        state[FREE] = queue.below[row]
    else:
        row = state[USED]
        state[USED] = row + 1
    bucket = end & (len(queue.tops) - 1)
    queue.below[row] = queue.tops[bucket]
    queue.tops[bucket] = row
    queue.values[row] = value
    for j in range(len(g)):
        queue.costs[row, j] = after[j]
    counters[N_GENERATED] += 1
    counters[N_OPEN] += 1


@lean
def advance(
    counters: IntArray,
    state: IntArray,
    work: int,
    tables: TimedTables,
    rest: RemainingBounds,
    goal: SolutionSet,
    bounds: PruningBounds,
    queue: Queue,
    labels: ClosedLabels,
    sets: LabelSets,
    source: int,
    scratch: IntArray,
) -> int:
    """Run the search for a slice: until it is complete, `work` steps are done or an array is full.

    Returns the code of the reason (:mod:`.machinery.slices`). If an array is full, enlarge it and call again. The
    arrays are those of :class:`.TimedSearch`; all but `tables` and `rest` are changed in place.

    source   node at which paths begin
    scratch  (4, k)  room for intermediate cost vectors
    """
    k = len(tables.is_max)
    hold = np.int64(tables.hold)
    g, vector = scratch[2], scratch[3]
    code = SLICE
    while work > 0:
        t = state[NOW]
        if state[STAGE] == ARRIVE:
            row = np.int64(queue.tops[t & (len(queue.tops) - 1)])
            if row < 0:
                state[STAGE], state[NEXT] = LEAVE, 0
                continue
            done = counters[N_CLOSED]
            value = queue.values[row]
            arc = (value & 0xFFFFFFFF) - 1
            v = np.int64(tables.heads[arc]) if arc >= 0 else source
            if done == len(labels.values) or done - state[FIRST] == len(labels.kept):
                code = CLOSED
                break
            if counters[N_ROWS] + max(LEAST_ROOM, 2 * sets.heads[v, ROOM]) > len(sets.vectors):
                code = ROWS
                break
            queue.tops[t & (len(queue.tops) - 1)] = queue.below[row]
            queue.below[row] = state[FREE]
            state[FREE] = row
            counters[N_OPEN] -= 1
            for j in range(k):
                g[j] = queue.costs[row, j]
            work -= 1 + counters[N_FRONT] // 8
            if is_pruned(tables, rest, goal, bounds, counters[N_FRONT], v, t, g, vector):
                continue
            refresh(tables, rest.calm, sets, v, t)
            work -= sets.heads[v, SIZE] // 8
            p = np.int64(tables.place[v])
            for j in range(k):
                shifted = hold > 0 and t <= rest.calm[v] and not tables.is_max[j]
                vector[j] = g[j] - (omega_at(tables, p, j, t) if shifted else 0)
            if is_superfluous(sets, v, t, vector):
                continue
            counters[N_ROWS] = make_room(sets, v, counters[N_ROWS])
            labels.values[done] = value
            labels.ticks[done] = t
            for j in range(k):
                labels.costs[done - state[FIRST], j] = g[j]
            labels.kept[done - state[FIRST]] = 1
            counters[N_CLOSED] = done + 1
            enter_label(sets, v, t, vector, done, state[FIRST], labels.kept)
        elif state[STAGE] == LEAVE:
            label = state[FIRST] + state[NEXT]
            if label == counters[N_CLOSED]:
                state[STAGE], state[NEXT] = HOLD_ON, 0
                continue
            if labels.kept[state[NEXT]] == 0:
                state[NEXT] += 1
                continue
            arc = (labels.values[label] & 0xFFFFFFFF) - 1
            v = np.int64(tables.heads[arc]) if arc >= 0 else source
            degree = tables.start[v + 1] - tables.start[v]
            code = code_of_full_array(goal, queue, counters, state, degree)
            if code != SLICE:
                break
            counters[N_EXPANDED] += 1
            p = np.int64(tables.place[v])
            stayed = arc >= 0 and tables.row[arc] == STAYS and needs_one_stay(tables, rest, p)
            for j in range(k):
                g[j] = labels.costs[state[NEXT], j]
            for a in range(tables.start[v], tables.start[v + 1]):
                if not (stayed and tables.row[a] == STAYS) and is_open(tables, a, p, t):
                    send_along(tables, rest, goal, bounds, queue, counters, state, a, p, t, g, label + 1, scratch)
            work -= 2 * degree
            if labels.waits[v] == 0 and t < wait_until(tables, rest, v):
                labels.waits[v] = 1
                labels.nodes[state[WAITING]] = v
                state[WAITING] += 1
            state[NEXT] += 1
        else:
            if state[NEXT] == state[WAITING]:
                if counters[N_OPEN] == 0 and state[WAITING] == 0:
                    code = DONE
                    break
                state[NOW] = t + 1
                state[STAGE], state[FIRST] = ARRIVE, counters[N_CLOSED]
                work -= 1
                continue
            v = np.int64(labels.nodes[state[NEXT]])
            refresh(tables, rest.calm, sets, v, t)
            if t > rest.until[v] or sets.heads[v, SIZE] == 0:
                state[WAITING] -= 1
                labels.nodes[state[NEXT]] = labels.nodes[state[WAITING]]
                labels.waits[v] = 0
                continue
            code = code_of_full_array(
                goal, queue, counters, state, (tables.start[v + 1] - tables.start[v]) * sets.heads[v, RIPE]
            )
            if code != SLICE:
                break
            work -= leave_after_hold(tables, rest, goal, bounds, queue, counters, state, labels, sets, v, t, scratch)
            state[NEXT] += 1
    return int(code)


@lean
def under_way(
    tops: NDArray[np.int32],
    below: NDArray[np.int32],
    now: int,
    position: IntArray,
    rows: NDArray[np.int32],
    ticks: IntArray,
) -> int:
    """List labels (partial paths) in the queue: write their rows and ticks of arrival, and return their number.

    As many are written as fit; the next call continues. `position` (2,) is the progress, changed, -1 and -1 at first:
    number of ticks from now, and the next row of that tick.
    """
    count = 0
    while count < len(rows):
        while position[1] < 0:
            position[0] += 1
            if position[0] >= len(tops):
                return count
            position[1] = tops[(now + position[0]) % len(tops)]
        rows[count], ticks[count] = position[1], now + position[0]
        position[1] = below[position[1]]
        count += 1
    return count


@lean
def code_of_full_array(goal: SolutionSet, queue: Queue, counters: IntArray, state: IntArray, more: int) -> int:
    """Return the code of an array without room for ``more`` partial paths, or SLICE if there is room."""
    if counters[N_FRONT] + more > len(goal.values):
        return FRONT
    if state[USED] + more > len(queue.values):
        return HEAP
    return SLICE


@lean
def leave_after_hold(
    tables: TimedTables,
    rest: RemainingBounds,
    goal: SolutionSet,
    bounds: PruningBounds,
    queue: Queue,
    counters: IntArray,
    state: IntArray,
    labels: ClosedLabels,
    sets: LabelSets,
    v: int,
    t: int,
    scratch: IntArray,
) -> int:
    """Extend partial paths that paused at node v by its arcs at tick t, where that is useful; return the work done."""
    k = len(tables.is_max)
    hold = np.int64(tables.hold)
    p = np.int64(tables.place[v])
    begin, ripe, for_good = sets.heads[v, BEGIN], sets.heads[v, RIPE], sets.heads[v, CALM] != 0
    g = scratch[2]
    work = 1
    for a in range(tables.start[v], tables.start[v + 1]):
        work += 1
        if rest.gain[a] == 0 or not is_open(tables, a, p, t):
            continue
        early = t - hold
        used = early < 0 or gains(tables, a, p, early, t)
        for i in range(begin, begin + ripe):
            owner = sets.rows[i, OWNER]
            b = np.int64(labels.ticks[owner])
            if b >= rest.gain[a] or (not used and b + hold <= early):
                continue
            if for_good and sets.rows[i, TICK] + hold != t:
                continue
            arc = (labels.values[owner] & 0xFFFFFFFF) - 1
            stayed = tables.row[a] == STAYS and arc >= 0 and tables.row[arc] == STAYS
            if stayed and needs_one_stay(tables, rest, p):
                continue
            if not gains(tables, a, p, b, t):
                continue
            for j in range(k):
                shifted = not for_good and not tables.is_max[j]
                g[j] = sets.vectors[i, j] + (omega_at(tables, p, j, t) if shifted else 0)
            work += 2
            send_along(tables, rest, goal, bounds, queue, counters, state, a, p, t, g, owner + 1, scratch)
    return work
