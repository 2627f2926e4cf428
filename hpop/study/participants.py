"""Participants of a study: anonymous ids, strata, and balanced orders of the stimuli.

Participants become sicker with each ride, whichever it is. Counterbalanced orders spread this effect
evenly over the stimuli:

- ``permutations``  all orders, for up to 4 stimuli: everything is balanced, also sequences at any distance
- ``williams``      each stimulus equally often at each place, and directly after each other one (Williams 1949,
  Australian Journal of Scientific Research A 2, 149-168): K orders for an even number K of stimuli, 2 K for an odd one
- ``latin``         each stimulus equally often at each place; almost all orders have equal neighbours
- ``random``        an order at random for each participant: balanced on average only
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, permutations, product
from math import factorial
from typing import Literal, TypeVar

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import IntArray
from hpop.base.options import one_of
from hpop.base.text import counted, printable, shown
from hpop.errors import StudyError

ID = re.compile(r"p[0-9]{2,4}")
MOST = 1000
"""Largest number of participants in a study."""
MOST_CELLS = 64
"""Largest number of combinations of levels of the strata."""
WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9_+.-]{0,19}")


@checked_arguments
@dataclass(frozen=True)
class Participant:
    """Participant of a study, known only by an id, with the order of stimuli.

    id      "p01", "p02", ...
    order   letters of the stimuli, in the order of the session
    strata  level by stratum, such as {"sex": "f"}
    """

    id: str
    order: tuple[str, ...]
    strata: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Departure:
    """Record of a participant who left, with the successor.

    Answers of a drop-out are kept; those of a withdrawn participant are deleted.
    """

    participant: str
    successor: str
    withdrawn: bool


def checked_id(identifier: object) -> str:
    """Return a participant's id such as "p07"; raise StudyError for anything else, such as a name.

    >>> checked_id("p07")
    'p07'
    """
    if not isinstance(identifier, str) or not ID.fullmatch(identifier):
        raise StudyError(
            f"a participant's id must be p and two to four digits, such as p07, got {shown(identifier)}; names and "
            "initials are refused, because nothing here may reveal a person"
        )
    return identifier


def participant_id(number: int) -> str:
    """Return the id of the participant with a number, counted from 1.

    >>> participant_id(7), participant_id(120)
    ('p07', 'p120')
    """
    return f"p{number:02d}"


def enrolled(
    orders: Sequence[tuple[str, ...]], count: int, strata: Mapping[str, Sequence[str]], rng: np.random.Generator
) -> tuple[Participant, ...]:
    """Assign orders and strata to participants, so that all combinations are as equally frequent as possible.

    Frequencies of orders, of combinations of levels, and of combinations within each order differ by at most one.
    Participants are in random sequence, in blocks of all combinations.

    Raises StudyError for strata that are not words, or that leave a single person in a combination.
    """
    levels = checked_strata(strata)
    cells = [dict(zip(levels, combination, strict=True)) for combination in product(*levels.values())]
    if levels and count < 2 * len(cells):
        raise StudyError(
            f"strata {_levels_text(levels)} have {counted(len(cells), 'combination')}, and {count:,} participants: "
            f"expected at least {2 * len(cells)}, since a person who is alone in a combination can be identified by "
            "it; take more people, or fewer strata"
        )
    pairs = list(_pairs(len(orders), len(cells), count, rng))
    return tuple(Participant(participant_id(i), orders[o], cells[c]) for i, (o, c) in enumerate(pairs, 1))


def checked_strata(strata: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """Return the strata with their levels; raise StudyError unless all are short words."""
    levels: dict[str, tuple[str, ...]] = {}
    for name, several in strata.items():
        words = [several] if isinstance(several, str) else list(several)
        for word in (name, *words):
            if not isinstance(word, str) or not WORD.fullmatch(word):
                raise StudyError(
                    "strata and levels must be words of at most 20 letters and digits, such as sex=f,m, got "
                    f"{shown(word)}"
                )
        if len(words) < 2 or len(set(words)) < len(words):
            raise StudyError(f"stratum {name} must have two or more levels, each once, such as f,m, got {shown(words)}")
        levels[name] = tuple(words)
    if math.prod(map(len, levels.values())) > MOST_CELLS:
        raise StudyError(f"strata must have at most {MOST_CELLS} combinations, got {_levels_text(levels)}; take fewer")
    return levels


def checked_departures(people: Sequence[Participant], left: Sequence[Departure]) -> None:
    """Raise StudyError if a participant who left is unknown, or a successor does not have the next free id."""
    for i, departure in enumerate(left):
        known = {participant_id(number) for number in range(1, len(people) + i + 1)}
        known -= {earlier.participant for earlier in left[:i]}
        if departure.participant not in known:
            raise StudyError(
                f"{departure.participant} cannot leave the study: expected a participant of the study who has not left"
            )
        if departure.successor != (following := participant_id(len(people) + i + 1)):
            raise StudyError(
                f"the successor of {departure.participant} must have the next free id, {following}; got "
                f"{departure.successor}"
            )


def unequal(orders: Iterable[tuple[str, ...]], known: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Describe the orders that are less frequent than others; () if all are equally frequent.

    >>> unequal([("A", "B"), ("A", "B"), ("B", "A")], [("A", "B"), ("B", "A")])
    ('order B A: 1 of 2',)
    """
    seen = Counter(orders)
    most = max((seen[order] for order in known), default=0)
    return tuple(f"order {' '.join(order)}: {seen[order]} of {most}" for order in known if seen[order] < most)


def _pairs(orders: int, cells: int, count: int, rng: np.random.Generator) -> Iterator[tuple[int, int]]:
    """Yield ``count`` pairs of numbers (order, combination of levels), in shuffled blocks that hold each pair once.

    The i-th pair of a block is order i mod m in combination (i + i div lcm(m, s)) mod s, relabelled at random, with m
    orders and s combinations. In any prefix of a block, before it is shuffled, the frequencies of orders, and of
    combinations, differ by at most one.
    """
    block, step = orders * cells, math.lcm(orders, cells)
    for begin in range(0, count, block):
        size = min(block, count - begin)
        order_of, cell_of = rng.permutation(orders), rng.permutation(cells)
        pairs = [(int(order_of[i % orders]), int(cell_of[(i + i // step) % cells])) for i in range(size)]
        yield from (pairs[i] for i in rng.permutation(size))


def _levels_text(levels: Mapping[str, Sequence[str]]) -> str:
    """Return strata with their levels as text, such as "sex=f,m"."""
    return printable(", ".join(f"{name}={','.join(several)}" for name, several in levels.items()))


def uneven(people: Sequence[Participant], orders: Sequence[tuple[str, ...]], kind: str) -> tuple[str, ...]:
    """Return notes for the researcher if orders are assigned unequally often, in all or within a stratum."""
    said, size, several = list[str](), len(people), len(orders)
    if size % several:
        less = size // several * several
        near = " or ".join(f"{number:,}" for number in (less, less + several) if number)
        said.append(
            f"{counted(size, 'participant')} for {several} orders: some orders are seen once more than others, or not "
            f"at all; with {near} each is seen equally often"
        )
    within = Counter((tuple(person.strata.values()), person.order) for person in people)
    strata = {strata for strata, _ in within}
    if len(strata) > 1 and any(len({within[one, order] for order in orders}) > 1 for one in strata):
        several *= len(strata)
        more = (size // several + 1) * several
        fewer = ", or with fewer orders, such as williams" if kind == "permutations" else ""
        said.append(
            f"orders are not seen equally often within {' or '.join('/'.join(one) for one in sorted(strata))}; with a "
            f"multiple of {several:,} participants they are, {more:,} for instance{fewer}"
        )
    return tuple(said)


Kind = Literal["permutations", "williams", "latin", "random"]
KINDS: tuple[Kind, ...] = ("permutations", "williams", "latin", "random")
MOST_PERMUTED = 4
"""Largest number of stimuli for which all orders are used: 24 of four, 120 of five."""
MOST_STIMULI = 26
T = TypeVar("T")


def sequences(
    kind: str, stimuli: Sequence[T], participants: int, rng: np.random.Generator
) -> tuple[tuple[T, ...], ...]:
    """Return the distinct orders of the stimuli to which participants are assigned, by the kind of balancing.

    ``random`` has one for each participant.

    Raises StudyError for ``permutations`` of more than four stimuli or with a number of participants that is not a
    multiple of the number of permutations, and for more than 26 stimuli.

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
    """Return the cyclic Latin square (K, K): row i is i, i + 1, ..., modulo K.

    >>> latin(3).tolist()
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
    """
    return (np.arange(count)[:, None] + np.arange(count)) % count


def williams(count: int) -> IntArray:
    """Return Williams' design, balanced for neighbours: (K, K), or (2 K, K) for an odd number K of stimuli.

    The first row is 0, 1, K - 1, 2, K - 2, ...; each further row adds one, modulo K. For even K all steps of the row
    differ, so that each stimulus follows each other once. For odd K each step occurs twice, and the rows reversed,
    which are added, balance that.
    """
    first = np.zeros(count, dtype=np.int64)
    first[1::2] = np.arange(1, count // 2 + 1)
    first[2::2] = count - np.arange(1, (count + 1) // 2)
    square = (np.arange(count)[:, None] + first) % count
    return square if count % 2 == 0 else np.vstack([square, square[:, ::-1]])


def places(orders: Sequence[Sequence[T]], stimuli: Sequence[T]) -> IntArray:
    """Count how often each stimulus is at each position of the orders: (K stimuli, K positions).

    >>> places([("A", "B"), ("A", "B"), ("B", "A")], "AB").tolist()
    [[2, 1], [1, 2]]
    """
    seen = np.zeros((len(stimuli), len(stimuli)), dtype=np.int64)
    for order in orders:
        for place, stimulus in enumerate(order):
            seen[stimuli.index(stimulus), place] += 1
    return seen


def neighbours(orders: Sequence[Sequence[T]], stimuli: Sequence[T]) -> IntArray:
    """Count how often each stimulus is directly followed by each other: (K before, K after).

    >>> neighbours([("A", "B"), ("A", "B"), ("B", "A")], "AB").tolist()
    [[0, 2], [1, 0]]
    """
    seen = np.zeros((len(stimuli), len(stimuli)), dtype=np.int64)
    for order in orders:
        for before, after in pairwise(order):
            seen[stimuli.index(before), stimuli.index(after)] += 1
    return seen


def _check_permuted(count: int, participants: int) -> None:
    """Raise StudyError unless all orders of the stimuli can be equally frequent."""
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
            f"order 'permutations' of {count} stimuli needs a multiple of {counted(every, 'participant')}, got "
            f"{participants:,}: take {near}, or another order"
        )


def schedule_csv(people: Sequence[Participant], left: Sequence[Departure]) -> str:
    """Return schedule.csv: each participant's order, as letters only, so that the experimenter is blind too."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    places = [f"place {i}" for i in range(1, len(people[0].order) + 1)]
    table.writerow(["participant", *people[0].strata, *places, "left", "takes the place of"])
    gone = {one.participant: "withdrew" if one.withdrawn else "dropped out" for one in left}
    before = {one.successor: one.participant for one in left}
    for person in people:
        row = [person.strata[level] for level in people[0].strata]
        table.writerow([person.id, *row, *person.order, gone.get(person.id, ""), before.get(person.id, "")])
    return text.getvalue()
