"""Distinct motions of many trajectories, so that a large front stores, evaluates and checks shared motions once.

Trajectories of one front share most of their motions: of five million motions on a lattice, some ten thousand are
different. States count as equal if their numbers are equal bit for bit.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, count
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.errors import ModelError
from hpop.frontier.strict_json import Kinds, numbers, parts, row_numbers
from hpop.motions import Law, Model, Motions, States, is_curve, laws_of
from hpop.motions.by_law import extras, refuse_impossible
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World

BLOCK = 2**16  # motions in a batch, so that evaluations take bounded memory


@dataclass(frozen=True, eq=False, repr=False)
class MotionTable:
    """Table of the distinct states and motions of n trajectories of one model.

    model    the model that moves
    states   (S,) columns: distinct states, NaN in a column that no motion at the state needs
    laws     names of the motion laws
    law      (M,) law of each distinct motion, as index into ``laws``
    start    (M,) index into ``states`` of the state in which each motion begins
    end      (M,) index of the state in which each motion ends
    first    (n,) index of the state in which each trajectory begins
    counts   (n,) number of motions of each trajectory
    motions  (N,) index of the distinct motion, for all motions of one trajectory after another, in time order
    punctual (n,) whether the execution of each trajectory keeps to its times
    """

    model: Model
    states: States
    laws: tuple[str, ...]
    law: IntArray
    start: IntArray
    end: IntArray
    first: IntArray
    counts: IntArray
    motions: IntArray
    punctual: BoolArray

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory]) -> MotionTable:
        """Build the table of one or more trajectories."""
        several = [t.states for t in trajectories]
        names = dict.fromkeys(name for states in several for name in states.names)
        counts = np.array([len(t.kinds) for t in trajectories], dtype=np.int64)
        columns = {name: np.concatenate([_column(states, name) for states in several]) for name in names}
        rows, place = _distinct(list(columns.values()))
        begins = np.cumsum(counts) - counts + np.arange(counts.size)  # each has a state more than motions
        tails = np.delete(np.arange(place.size), begins + counts)
        vocabulary: dict[str, int] = defaultdict(count().__next__)
        codes = map(vocabulary.__getitem__, chain.from_iterable(t.kinds for t in trajectories))
        law = np.fromiter(codes, np.int64, tails.size)
        own, motions = _distinct([law, place[tails], place[tails + 1]])
        return cls(
            model=trajectories[0].model,
            states=States(**{name: column[rows] for name, column in columns.items()}),
            laws=tuple(vocabulary),
            law=law[own],
            start=place[tails][own],
            end=place[tails + 1][own],
            first=place[begins],
            counts=counts,
            motions=motions,
            punctual=np.array([t.punctual for t in trajectories], dtype=bool),
        )

    def __len__(self) -> int:
        return self.law.size

    def __repr__(self) -> str:
        return (
            f"<MotionTable: {self.counts.size} trajectories of {len(self)} motions between {self.states.size} states>"
        )

    @cached_property
    def owner(self) -> IntArray:
        """Index (N,) of the trajectory to which each motion belongs."""
        return np.repeat(np.arange(self.counts.size), self.counts)

    @cached_property
    def last(self) -> IntArray:
        """Index (n,) of the state in which each trajectory ends."""
        ends = np.cumsum(self.counts) - 1
        moves = self.counts > 0
        last = self.first.copy()
        last[moves] = self.end[self.motions[ends[moves]]]
        return last

    @cached_property
    def curved(self) -> BoolArray:
        """Mask (M,) of motions along curves, whose costs depend on the motions before and after."""
        laws = laws_of(self.model)
        return np.array([is_curve(laws[name]) for name in self.laws], dtype=bool)[self.law]

    @cached_property
    def timed(self) -> BoolArray:
        """Mask (M,) of motions that need more state variables than the model has, as holds and curves do."""
        return np.array([bool(extras(self.model, (name,))) for name in self.laws], dtype=bool)[self.law]

    @cached_property
    def lasts(self) -> FloatArray:
        """Duration (M,) of each distinct motion, s."""
        lasts = np.zeros(len(self))
        for index, law, start, end in self.by_law():
            lasts[index] = sum(phase.duration for phase in law.phases(start, end))
        return lasts

    @cached_property
    def durations(self) -> FloatArray:
        """Duration (n,) of each trajectory, s; equal to :attr:`.Trajectory.duration`, added in time order."""
        begins = np.cumsum(self.counts) - self.counts
        each = np.split(self.lasts[self.motions], begins[1:])
        return np.array([np.cumsum(lasts)[-1] if lasts.size else 0.0 for lasts in each])

    def having(self, motions: BoolArray) -> BoolArray:
        """Return which trajectories (n,) contain any of the motions marked in a mask (M,)."""
        return np.bincount(self.owner[motions[self.motions]], minlength=self.counts.size) > 0

    def through(self, states: BoolArray) -> BoolArray:
        """Return which trajectories (n,) pass any of the states marked in a mask (S,)."""
        return states[self.first] | self.having(states[self.end])

    def sums(self, each: FloatArray) -> FloatArray:
        """Return the sum (n,) over each trajectory of ``each`` (M,), a value per distinct motion; added law by law."""
        total = np.zeros(self.counts.size)
        for i in range(len(self.laws)):
            of_law = self._of_law(i)
            total += np.bincount(self.owner[of_law], each[self.motions[of_law]], minlength=total.size)
        return total

    def maxima(self, each: FloatArray) -> FloatArray:
        """Return the maximum (n,) over each trajectory of ``each`` (M,), a value per distinct motion.

        It is at least 0, 0 for a trajectory without motions, and NaN if a value is NaN.
        """
        most = np.zeros(self.counts.size)
        with np.errstate(invalid="ignore"):
            np.maximum.at(most, self.owner, each[self.motions])
        return most

    def batches(self, world: World) -> Iterator[tuple[IntArray, Motions]]:
        """Yield the distinct motions (M,) in batches of bounded size, each under one law, with their indices.

        The batches have no start times, and motions have no neighbours.
        """
        for index, law, start, end in self.by_law():
            yield index, Motions(world, self.model, law, start, end)

    def by_law(self) -> Iterator[tuple[IntArray, Law, States, States]]:
        """Yield the distinct motions of each law in blocks: indices, law, and the states where they begin and end."""
        for i, kind in enumerate(self.laws):
            of_law, names = np.flatnonzero(self.law == i), (*self.model.space.names, *extras(self.model, (kind,)))
            for block in (of_law[begin : begin + BLOCK] for begin in range(0, of_law.size, BLOCK)):
                start, end = (
                    States(**{name: getattr(self.states, name)[at[block]] for name in names})
                    for at in (self.start, self.end)
                )
                yield block, laws_of(self.model)[kind], start, end

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Return the trajectories; trajectories without curves and holds share the memory of their states.

        Raises ModelError for a motion that does not follow its law.
        """
        for index, law, start, end in self.by_law():
            if not is_curve(law):
                refuse_impossible(self.model, law, start, end, index)
        begins = self._begins
        place = np.empty(self.motions.size + self.counts.size, dtype=np.int64)
        place[begins] = self.first
        place[np.delete(np.arange(place.size), begins)] = self.end[self.motions]
        columns = {name: getattr(self.states, name)[place] for name in self.states.names}
        for column in columns.values():
            column.setflags(write=False)
        kinds = tuple(np.array(self.laws, dtype=object)[self.law[self.motions]].tolist())
        plain, timed, several = self.model.space.names, self.having(self.timed).tolist(), []
        punctual = self.punctual.tolist()
        for i, (begin, number) in enumerate(zip(begins.tolist(), self.counts.tolist(), strict=True)):
            own = kinds[begin - i : begin - i + number]
            names = (*plain, *extras(self.model, own)) if timed[i] else plain
            states = States(**{name: columns[name][begin : begin + number + 1] for name in names})
            several.append((Trajectory if timed[i] else Trajectory.of_checked)(self.model, states, own, punctual[i]))
        return tuple(several)

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able, exact description for a saved front.

        States and motions are tables of columns by name. ``start`` and ``end`` are row numbers in the table of states,
        ``kind`` is an index into ``kinds``, and each trajectory has the row numbers of its motions. ``punctual`` has
        the numbers of the punctual trajectories, if there are any.
        """
        ends = np.cumsum(self.counts)
        motions = self.motions.tolist()
        return {
            "kinds": list(self.laws),
            "states": {name: _with_gaps(getattr(self.states, name)) for name in self.states.names},
            "motions": {"kind": self.law.tolist(), "start": self.start.tolist(), "end": self.end.tolist()},
            "trajectories": {
                "start": self.first.tolist(),
                "motions": [motions[b:e] for b, e in zip((ends - self.counts).tolist(), ends.tolist(), strict=True)],
                **({"punctual": np.flatnonzero(self.punctual).tolist()} if self.punctual.any() else {}),
            },
        }

    @classmethod
    def from_description(cls, model: Model, description: Mapping[str, Any]) -> MotionTable:
        """Build the table from its description; raise ModelError or ValueError for an invalid one."""
        kinds, states, motions, several = parts(
            description, "the items", {"kinds": list, "states": dict, "motions": dict, "trajectories": dict}
        )
        laws = laws_of(model)
        if not all(isinstance(kind, str) and kind in laws for kind in kinds) or len(set(kinds)) != len(kinds):
            raise ModelError(f"expected distinct motion laws of {sorted(laws)}, found {kinds!r:.80}")
        names = (*model.space.names, *extras(model, kinds))
        columns = dict(zip(names, parts(states, "states", dict.fromkeys(names, list)), strict=True))
        law, start, end = parts(motions, "motions", {"kind": list, "start": list, "end": list})
        keys: Kinds = {"start": list, "motions": list}
        if "punctual" in several:
            keys["punctual"] = list
        first, own, *others = parts(several, "trajectories", keys)
        if not set(map(type, own)) <= {list} or len(own) != len(first):
            raise ModelError("expected one start and one list of motions for each trajectory, found something else")
        size, moves = len(columns[names[0]]), list(chain.from_iterable(own))
        made = cls(
            model=model,
            states=States(
                **{n: numbers(c, f"states.{n}", size, gaps=n not in model.space.names) for n, c in columns.items()}
            ),
            laws=tuple(kinds),
            law=row_numbers(law, "motions.kind", len(law), len(kinds)),
            start=row_numbers(start, "motions.start", len(law), size),
            end=row_numbers(end, "motions.end", len(law), size),
            first=row_numbers(first, "trajectories.start", len(first), size),
            counts=np.array([len(each) for each in own], dtype=np.int64),
            motions=row_numbers(moves, "trajectories.motions", len(moves), len(law)),
            punctual=np.zeros(len(own), dtype=bool),
        )
        for column in others:
            made.punctual[row_numbers(column, "trajectories.punctual", len(column), len(own))] = True
        made._check_meeting()
        return made

    @cached_property
    def _begins(self) -> IntArray:
        """Index (n,) of each trajectory's first state in the states of all trajectories, one after another."""
        return np.cumsum(self.counts) - self.counts + np.arange(self.counts.size)

    def _of_law(self, i: int) -> BoolArray:
        """Return which of all motions (N,) follow law number ``i``."""
        of_law: BoolArray = self.law[self.motions] == i
        return of_law

    def _check_meeting(self) -> None:
        """Raise ModelError unless each motion of a trajectory begins where its predecessor ends."""
        before = np.empty(self.motions.size, dtype=np.int64)
        before[1:] = self.end[self.motions[:-1]]
        moves = self.counts > 0
        before[(np.cumsum(self.counts) - self.counts)[moves]] = self.first[moves]
        apart = np.flatnonzero(before != self.start[self.motions])
        if apart.size:
            raise ModelError(
                f"trajectory {self.owner[apart[0]]} jumps: its motion {self.motions[apart[0]]} does not begin in the "
                "state in which the one before it ends"
            )


def _distinct(columns: Sequence[Any]) -> tuple[IntArray, IntArray]:
    """Return the indices of the distinct rows, in order of first appearance, and for each row its place among these.

    Rows are equal if all bits are. Each row looks up the slot of its hash, which holds the first row with that hash. If
    the two are equal, the row is done; otherwise it gets another hash. Few rows are distinct, so this takes a tenth of
    the time of sorting. Hash keys are random, so that no input can be prepared to collide.
    """
    bits = [np.ascontiguousarray(column).view(np.uint64) for column in columns]
    size = bits[0].size
    width = max(1, int(size).bit_length())
    first = np.empty(size, dtype=np.int64)  # first equal row of each
    slots = np.empty(2**width, dtype=np.int64)
    left = np.arange(size)
    while left.size:
        slot = _hashes(bits, width)
        slots[slot[::-1]] = np.arange(left.size)[::-1]  # the last assignment to a slot counts
        same = slots[slot]
        agrees = np.logical_and.reduce([column[same] == column for column in bits])
        first[left[agrees]] = left[same[agrees]]
        bits, left = [column[~agrees] for column in bits], left[~agrees]
    rows = np.flatnonzero(first == np.arange(size))
    rank = np.empty(size, dtype=np.int64)
    rank[rows] = np.arange(rows.size)
    return rows, rank[first]


def _hashes(bits: Sequence[NDArray[np.uint64]], width: int) -> IntArray:
    """Return a hash (N,) of ``width`` bits for each row of the columns ``bits``, with a new random key in each call."""
    key = np.uint64(int.from_bytes(os.urandom(8)) | 1)
    mixed = np.zeros(bits[0].size, dtype=np.uint64)
    for column in bits:
        mixed ^= column
        mixed *= key
        mixed ^= mixed >> np.uint64(32)
    mixed *= key
    return (mixed >> np.uint64(64 - width)).astype(np.int64)


def _column(states: States, name: str) -> FloatArray:
    """Return the column of this name of states (N,); NaN if they have no such column."""
    column: FloatArray | None = states.__dict__.get(name)
    return np.full(states.size, np.nan) if column is None else column


def _with_gaps(column: FloatArray) -> list[float | None]:
    """Return a column for JSON, with None (null) for NaN."""
    values: list[float | None] = column.tolist()
    for i in np.flatnonzero(np.isnan(column)).tolist():
        values[i] = None
    return values
