"""What is known of the way that is left from each node, and for what holds and arcs that stay are of use there.

The latter is found out of a node, or a place, when a label first comes to it: to most of them none ever does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.timed.calm import last_gains
from hpop.search.timed.stays import one_stay_suffices
from hpop.search.timed.tables import Tables

UNKNOWN = -2  # nobody has asked yet
NEVER_OF_USE = -1


class Rest(NamedTuple):
    """What is known of the way that is left from each node.

    least   (k, n)  least costs, at whatever tick
    ticks   (n,)    fewest ticks
    earliest (n,)   the tick at which a node may be reached
    calm    (n,)    L of :mod:`.calm`
    leads, whole, settled   as that takes them
    gain    (m,)    the last tick at which waiting for an arc gains anything, if it is known of its tail
    until   (n,)    the last tick at which waiting at a node may have a use, or UNKNOWN
    one_stay (P,)   whether no use is in arcs that stay one after another (:mod:`.stays`), or UNKNOWN
    nodes, first    nodes that anybody has to come to, by their place: those of place p from first[p] to first[p + 1]
    """

    least: IntArray
    ticks: IntArray
    earliest: IntArray
    calm: NDArray[np.int32]
    leads: NDArray[np.uint8]
    whole: BoolArray
    settled: NDArray[np.int32]
    gain: NDArray[np.int32]
    until: IntArray
    one_stay: NDArray[np.int8]
    nodes: IntArray
    first: IntArray


@lean
def wait_until(tables: Tables, rest: Rest, v: int) -> int:
    """The last tick at which waiting at a node may have a use; NEVER_OF_USE where it never has."""
    if rest.until[v] == UNKNOWN:
        latest = last_gains(tables, rest.leads, rest.calm, rest.earliest, rest.whole, rest.settled, v, rest.gain)
        hold = np.int64(tables.hold)
        rest.until[v] = min(latest + 2 * hold, rest.calm[v] + hold) if latest > 0 else NEVER_OF_USE
    return int(rest.until[v])


@lean
def needs_one_stay(tables: Tables, rest: Rest, p: int) -> bool:
    """Whether at a place no use is in arcs that stay one after another."""
    if rest.one_stay[p] == UNKNOWN:
        rest.one_stay[p] = one_stay_suffices(tables, rest.nodes[rest.first[p] : rest.first[p + 1]])
    return bool(rest.one_stay[p] != 0)
