"""Orders in which people see the stimuli, so that place and neighbours do not stand for the stimulus itself.

Whoever sees three rides is sicker at the third, whichever it is. Counterbalanced orders spread that evenly:

- ``permutations``  every order there is: everything is balanced, also what follows what at any distance (to 4 stimuli)
- ``williams``      each stimulus equally often at each place, and directly after each other one (Williams 1949,
  Australian Journal of Scientific Research A 2, 149-168): K orders for an even number K of stimuli, 2 K for an odd one
- ``latin``         each stimulus equally often at each place; nearly all orders have the same neighbours
- ``random``        an order at random for each participant: balanced on average only
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, permutations
from math import factorial
from typing import Literal, TypeVar

import numpy as np

from hpop.base.arrays import IntArray
from hpop.base.options import one_of
from hpop.base.text import counted
from hpop.errors import StudyError

Kind = Literal["permutations", "williams", "latin", "random"]
KINDS: tuple[Kind, ...] = ("permutations", "williams", "latin", "random")
MOST_PERMUTED = 4
"""Stimuli of which all orders are taken: 24 of four, 120 of five."""
MOST_STIMULI = 26
T = TypeVar("T")


def sequences(
    kind: str, stimuli: Sequence[T], participants: int, rng: np.random.Generator
) -> tuple[tuple[T, ...], ...]:
    """The different orders of the stimuli among which participants are dealt, each as often as another or once more.

    ``random`` gives one for each participant. Raises StudyError for ``permutations`` of more than four stimuli or with
    participants that are no multiple of their number, and for more than 26 stimuli.

    >>> sequences("williams", "ABCD", 8, np.random.default_rng(1))
    (('A', 'B', 'D', 'C'), ('B', 'C', 'A', 'D'), ('C', 'D', 'B', 'A'), ('D', 'A', 'C', 'B'))
    """
    kind, count = one_of("order", kind, KINDS, error=StudyError), len(stimuli)
    if not 2 <= count <= MOST_STIMULI:
        raise StudyError(f"an order has 2 to {MOST_STIMULI} stimuli, got {count}")
    if kind == "random":
        rows = np.array([rng.permutation(count) for _ in range(participants)]).reshape(participants, count)
    elif kind == "permutations":
        _check_permuted(count, participants)
        rows = np.array(list(permutations(range(count))))
    else:
        rows = williams(count) if kind == "williams" else latin(count)
    return tuple(tuple(stimuli[i] for i in row) for row in rows)


def latin(count: int) -> IntArray:
    """The cyclic Latin square (K, K): row i is i, i + 1, ..., modulo K.

    >>> latin(3).tolist()
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
    """
    return (np.arange(count)[:, None] + np.arange(count)) % count


def williams(count: int) -> IntArray:
    """Williams' design (K, K), of an odd number of stimuli (2 K, K): the square, then its rows backwards.

    The first row is 0, 1, K - 1, 2, K - 2, ...; each of the others adds one, modulo K. Its steps are all different, so
    that each stimulus follows each other one once; of an odd K each step comes twice, and its mirror evens that out.
    """
    first = np.zeros(count, dtype=np.int64)
    first[1::2] = np.arange(1, count // 2 + 1)
    first[2::2] = count - np.arange(1, (count + 1) // 2)
    square = (np.arange(count)[:, None] + first) % count
    return square if count % 2 == 0 else np.vstack([square, square[:, ::-1]])


def places(orders: Sequence[Sequence[T]], stimuli: Sequence[T]) -> IntArray:
    """How often each stimulus stands at each place: (K stimuli, K places).

    >>> places([("A", "B"), ("A", "B"), ("B", "A")], "AB").tolist()
    [[2, 1], [1, 2]]
    """
    seen = np.zeros((len(stimuli), len(stimuli)), dtype=np.int64)
    for order in orders:
        for place, stimulus in enumerate(order):
            seen[stimuli.index(stimulus), place] += 1
    return seen


def neighbours(orders: Sequence[Sequence[T]], stimuli: Sequence[T]) -> IntArray:
    """How often each stimulus directly follows each other one: (K before, K after).

    >>> neighbours([("A", "B"), ("A", "B"), ("B", "A")], "AB").tolist()
    [[0, 2], [1, 0]]
    """
    seen = np.zeros((len(stimuli), len(stimuli)), dtype=np.int64)
    for order in orders:
        for before, after in pairwise(order):
            seen[stimuli.index(before), stimuli.index(after)] += 1
    return seen


def _check_permuted(count: int, participants: int) -> None:
    if count > MOST_PERMUTED:
        raise StudyError(
            f"all orders of {count} stimuli are {factorial(count):,}: expected at most {MOST_PERMUTED} stimuli. Take "
            "order 'williams', which balances places and neighbours with few orders"
        )
    rest = participants % (every := factorial(count))
    if rest or participants < every:
        lower = participants - rest
        near = " or ".join(f"{number:,}" for number in (lower, lower + every) if number)
        raise StudyError(
            f"order 'permutations' of {count} stimuli takes a multiple of {counted(every, 'participant')}, got "
            f"{participants:,}: take {near}, or another order"
        )
