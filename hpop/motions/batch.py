"""Batches of motions under one law: integrals and largest values of rates (costs per second) along each motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from itertools import chain, islice
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.base.math import is_symbolic
from hpop.base.options import whole
from hpop.motions.bodies import Body, Instants, Rate, first_derivative, second_derivative, standing
from hpop.motions.flags import FlagsOf, flag_integrals, flags_within, share_of
from hpop.motions.laws import Law, Phase, is_curve, slopes, stands
from hpop.motions.model import Model
from hpop.motions.quadrature import (
    Nodes,
    ValuesAt,
    adaptive_integrals,
    before_kinks,
    elapsed_before,
    elapsed_time,
    evenly,
    panel_counts,
    pieces_of,
    quadrature_nodes,
    timed,
)
from hpop.motions.states import States, picked_states, reverse_indices

if TYPE_CHECKING:
    from hpop.world import World

MOST_PIECES = 100_000  # most pieces into which `moments` cuts a phase
SYMBOLIC_PANELS = 3  # panels (quadrature intervals) of a phase on CasADi symbols, unless the batch sets another number

GAUSS_NODES = np.array([0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)])  # two nodes on [0, 1]


class _Probe(NamedTuple):
    """Result of one trial evaluation of a rate.

    read   names of the quantities that the rate has read, as recorded by :class:`Instants`
    value  on CasADi symbols, the rate (M,) at the trial moment; else None
    """

    read: frozenset[str]
    value: Column | None


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Motions:
    """Batch of M motions of one robot that all follow one motion law.

    world   the world, which criteria ask for distances and obstacles
    model   the robot
    law     the motion law, common to all motions
    start   states (M,) in which the motions begin
    end     states (M,) in which they end; yaw is continuous, so that ``end.yaw - start.yaw`` is the rotation
    t0      (M,)  s, time at which each motion begins; None for edges of a graph without time
    panels  number of quadrature intervals in each phase of the timing; None to choose it by the lengths of the motions,
            or 3 on CasADi symbols
    turns   two columns (M,), rad, for motions along curves: signed rotations of the turns that end in each motion; a
            turn may begin in an earlier motion. None if the motions before and after each one are unknown
    """

    world: World
    model: Model
    law: Law
    start: States
    end: States
    t0: Column | None = None
    panels: int | None = None
    turns: tuple[Column, Column] | None = None

    whole: ClassVar[bool] = True  # motions are whole and keep their law's timing: equal ends mean equal motions

    def __len__(self) -> int:
        return self.start.size

    @property
    def kind(self) -> str:
        """Kind of the motions, such as "move" or "turn": the name of their law."""
        return self.law.kind

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """Phases of the motions' timing, such as speed-up, cruise and slow-down, in order."""
        return self.law.phases(self.start, self.end)

    @cached_property
    def duration(self) -> Column:
        """Duration (M,) of each motion, s."""
        return sum(phase.duration for phase in self.phases)

    @cached_property
    def twins(self) -> IntArray:
        """Index (M,) that is equal for a motion and its reverse in the batch, so that their costs are computed once.

        It is the index of the first of the two. A motion without a reverse in the batch has its own index, and so have
        all motions of a law that is not ``reversible``.
        """
        if self._symbolic or not self.law.reversible:
            return np.arange(len(self))
        return reverse_indices(self.start, self.end)

    @cached_property
    def base(self) -> Body:
        """Motion of the robot's base in each motion."""
        return self.body("base")

    @cached_property
    def camera(self) -> Body:
        """Motion of the camera in each motion."""
        return self.body("camera")

    def body(self, name: str) -> Body:
        """Return how a body ("camera", "base") moves in each motion of the batch: poses, path length and rotation."""
        return standing(name, self) if self.stands else self.model.body(name, self)

    @property
    def stands(self) -> bool:
        """True if the motions are holds: the robot stands still."""
        return stands(self.law)

    def integrate(self, rate: Rate, *, jumps: bool = False, detail: float | None = None) -> Column:
        """Return the time integral (M,) of a rate along each motion.

        rate    function from :class:`Instants` (moments within motions) to a cost per second
        jumps   True if the rate jumps, as a count does; adaptive quadrature (arms) is then finer, other rules ignore it
        detail  m, length within which the rate changes, if that is less than two field cells (cells of the world's
                distance grid). The robot and the fastest person together then move at most half of it in a panel, down
                to an eighth of a cell

        The rule is Gauss-Legendre with two nodes in each panel (quadrature interval). In a panel the robot moves no
        farther than a field cell, and no body turns by more than 10 degrees. If the rate reads the time, no person
        walks farther than a field cell in a panel, and panels end where a person turns at a waypoint, comes or goes.
        During a hold only such a rate changes, and a panel lasts at most a second.

        Laws whose ``quadrature`` is "adaptive" use the rule of :mod:`hpop.motions.quadrature` instead, once for a
        motion and its reverse (:attr:`twins`) if the rate reads states only.

        The integral is exact if all that the rate reads is constant within each phase, such as accelerations.
        """
        probe = self._probe(rate, self._symbolic_nodes[0] if self._symbolic else 0.0)
        constant = self._constant(rate, probe)
        if constant is not None:
            return constant * self.duration
        timed = "t" in probe.read
        if self._adaptive and probe.read <= set(self.start.names):
            return self._integral_over_states(rate, jumps)
        total: Column = 0.0
        for phase in self.phases:
            mean = self._at_once(rate, phase, probe)
            mean = self._phase_mean(rate, phase, probe, jumps, timed, detail) if mean is None else mean
            total = total + phase.duration * mean
        return total

    def integrate_flags(self, flags: FlagsOf, count: int) -> Column:
        """Return the time integral (M,) of the share of ``count`` flags that are set along each motion.

        Laws whose ``quadrature`` is "adaptive" use the rule of :mod:`hpop.motions.flags`, which computes a flag again
        only near its changes, once for a motion and its reverse (:attr:`twins`). Others use :meth:`integrate`.
        """
        if not self._adaptive:
            return self.integrate(share_of(flags, count), jumps=True)
        whole, some = self._whole
        flags_at = flags_within(flags, partial(self._instants, whole))
        found = flag_integrals(flags_at, elapsed_time(self.phases), some, self._turned, count)
        return found[self.twins]

    def worst(self, rate: Rate, *, detail: float | None = None) -> Column:
        """Return the largest value (M,) of a rate along each motion, sampled at the ends and middles of panels.

        rate, detail  as in :meth:`integrate`

        For a rate that changes by at most c per metre, the error is at most c/4 times the length of a field cell, and
        twice as much where people walk. If the rate reads the time, it is also sampled just before a person turns,
        comes or goes. If it reads states only, it is computed once for a motion and its reverse (:attr:`twins`).
        """
        probe = self._probe(rate)
        constant = self._constant(rate, probe)
        if constant is not None:
            return constant
        timed = "t" in probe.read
        if self.whole and probe.read <= set(self.start.names) and (self.twins != np.arange(len(self))).any():
            own, which = np.unique(self.twins, return_inverse=True)
            start, end = self.start.take(own), self.end.take(own)
            return replace(self, start=start, end=end, t0=None, turns=None).worst(rate, detail=detail)[which]
        largest: Column = None
        for phase in self.phases:
            value = self._at_once(rate, phase, probe)
            value = self._phase_worst(rate, phase, probe, timed, detail) if value is None else value
            largest = value if largest is None else np.maximum(largest, value)
        return largest

    def moments(self, pieces: int) -> list[Instants]:
        """Return the moments that cut each phase into ``pieces`` equal times, without start and end of the motions.

        Each entry of the list has one moment of every motion (M,). Moments at which two phases meet are included.
        """
        pieces = whole("pieces", pieces, 1, MOST_PIECES)
        shares = [(phase, i / pieces) for phase in self.phases for i in range(pieces)]
        return [self._instants(phase, share, None) for phase, share in shares[1:]]

    def _probe(self, rate: Rate, u: float = 0.0) -> _Probe:
        """Evaluate a rate at fraction ``u`` of the first phase, and return the names of the quantities that it reads.

        Of numeric motions only the first is evaluated. On CasADi symbols all are, and the value is returned too.
        """
        owner = None if self._symbolic else np.zeros(min(1, len(self)), dtype=np.int64)
        instants = self._instants(self.phases[0], u, owner)
        value = rate(instants)
        return _Probe(frozenset(instants.read), value if self._symbolic else None)

    def _constant(self, rate: Rate, probe: _Probe) -> Column | None:
        """Return the rate (M,) if all that it reads is constant within each motion; else None."""
        kept = self._constant_states
        still = {second_derivative(name) for name in kept}
        if self.stands:
            still |= {first_derivative(name) for name in kept}
        if not probe.read <= kept | still:
            return None
        if self._symbolic:
            return probe.value
        new = np.zeros(len(self), dtype=bool)  # False where these states equal those of the motion before
        new[:1] = True
        for name in probe.read & kept:
            column = getattr(self.start, name)
            new[1:] |= column[1:] != column[:-1]
        first = np.flatnonzero(new)
        instants = self._instants(self.phases[0], 0.0, first)
        values = np.broadcast_to(rate(instants), first.shape)
        if instants.read - probe.read:  # for these motions the rate reads more than in the trial: take no shortcut
            return None
        return np.repeat(values, np.diff(np.append(first, len(self))))

    def _at_once(self, rate: Rate, phase: Phase, probe: _Probe) -> Column | None:
        """Return the rate (M,) in a phase if all that it reads, such as accelerations, is constant there; else None."""
        even = self.law.even if is_curve(self.law) else self.start.names
        if not probe.read <= self._constant_states | {second_derivative(name) for name in even}:
            return None
        if probe.value is not None and phase is self.phases[0]:
            return probe.value
        instants = self._instants(phase, 0.5, None)
        value = rate(instants)
        return value if instants.read <= probe.read else None  # it reads more than in the trial: take no shortcut

    @property
    def _constant_states(self) -> frozenset[str]:
        """Names of the states that the law keeps constant within each motion."""
        return frozenset(self.start.names) - self.law.varies

    @property
    def _symbolic(self) -> bool:
        names = self.start.names
        return any(is_symbolic(getattr(states, name)) for states in (self.start, self.end) for name in names)

    @cached_property
    def _symbolic_nodes(self) -> list[float]:
        """Quadrature nodes on CasADi symbols, as fractions of a phase's time."""
        count = self.panels or SYMBOLIC_PANELS
        return [(i + g) / count for i in range(count) for g in GAUSS_NODES]

    def _at_nodes(self, rate: Rate, phase: Phase, probe: _Probe, nodes: list[float]) -> list[Column]:
        """Return a rate on CasADi symbols at fractions (``nodes``) of a phase's time; the probe has the first value."""
        known = [probe.value] if phase is self.phases[0] else []
        return known + [rate(self._instants(phase, u, None)) for u in nodes[len(known) :]]

    def _phase_mean(
        self, rate: Rate, phase: Phase, probe: _Probe, jumps: bool, timed: bool, detail: float | None
    ) -> Column:
        if self._symbolic:
            nodes = self._symbolic_nodes
            return sum(self._at_nodes(rate, phase, probe, nodes)) / len(nodes)
        if self._adaptive:
            pieces = pieces_of(self._turned * (phase.end - phase.begin), jumps=jumps)
            if timed:
                pieces = np.maximum(pieces, panel_counts(self, phase, timed, detail))
            some = np.flatnonzero(phase.duration)
            return adaptive_integrals(self._at(rate, phase), evenly, some, pieces, jumps=jumps)
        mean = np.zeros(len(self))
        for part, columns in self._quadrature(phase, timed, detail):
            values = rate(self._instants(phase, part.u, part.owner, columns))
            mean[part.run] += part.sums(part.weight * values)
        return mean

    @property
    def _adaptive(self) -> bool:
        """True if the law has adaptive quadrature and the number of panels is not fixed."""
        return self.panels is None and not self._symbolic and self.law.quadrature == "adaptive"

    @cached_property
    def _turned(self) -> Column:
        """Upper bound (M,), rad, on the rotation of any body in each motion."""
        return self.model.extent(self)[1]

    def _integral_over_states(self, rate: Rate, jumps: bool) -> FloatArray:
        """Return the time integral (M,), by adaptive quadrature, of a rate that reads states only, not the time."""
        whole, some = self._whole
        pieces = pieces_of(self._turned, jumps=jumps)
        return adaptive_integrals(self._at(rate, whole), timed(self.phases), some, pieces, jumps=jumps)[self.twins]

    @property
    def _whole(self) -> tuple[Phase, IntArray]:
        """Each motion as one even phase, whose times are shares of the motion; indices of those to be integrated."""
        nothing = 0.0 * self.duration
        some = np.flatnonzero((self.duration > 0) & (self.twins == np.arange(len(self))))
        return Phase(self.duration, nothing, 1.0 + nothing, "cruise"), some

    def _at(self, rate: Rate, phase: Phase) -> ValuesAt:
        """Return a function that takes fractions of a phase's time and motion indices, and evaluates the rate there."""
        return lambda u, owner: rate(self._instants(phase, u, owner))

    def _quadrature(self, phase: Phase, timed: bool, detail: float | None) -> Iterable[tuple[Nodes, dict[str, Column]]]:
        """Yield the quadrature nodes of a phase, each block with a cache of the states at its nodes.

        If one block holds all motions, block and cache are kept with the batch, so that all criteria share them. The
        cache has arrays only: :class:`Instants` refer to their motions, and such a cycle would stay in memory.
        """
        kept: dict[tuple[int, bool, float | None], tuple[Nodes, dict[str, Column]]]
        kept = self.__dict__.setdefault("_quadratures", {})
        key = next(i for i, other in enumerate(self.phases) if other is phase), timed, detail
        if key in kept:
            return [kept[key]]
        blocks = quadrature_nodes(self, phase, GAUSS_NODES, timed, detail)
        together = list(islice(blocks, 2))
        if len(together) == 1:
            kept[key] = together[0], {}
            return [kept[key]]
        return ((nodes, {}) for nodes in chain(together, blocks))

    def _phase_worst(self, rate: Rate, phase: Phase, probe: _Probe, timed: bool, detail: float | None) -> Column:
        ends_and_middles = np.array([0.0, 0.5, 1.0])
        if self._symbolic:
            count = self.panels or SYMBOLIC_PANELS
            nodes = sorted({(i + e) / count for i in range(count) for e in ends_and_middles})
            return reduce(np.maximum, self._at_nodes(rate, phase, probe, nodes))
        largest = np.empty(len(self))
        largest[:] = rate(self._instants(phase, np.ones(len(self)), np.arange(len(self))))
        whose, before = before_kinks(self, phase) if timed else (np.empty(0, np.int64), np.empty(0))
        if whose.size:
            np.maximum.at(largest, whose, rate(self._instants(phase, before, whose)))
        # Without the end of each panel: it is the start of the next panel.
        for _, owner, u, _ in quadrature_nodes(self, phase, ends_and_middles[:-1], timed, detail):
            inside = np.broadcast_to(rate(self._instants(phase, u, owner)), owner.shape)
            first = np.flatnonzero(np.diff(owner, prepend=-1))
            own = owner[first]
            largest[own] = np.maximum(np.maximum.reduceat(inside, first), largest[own])
        return largest

    def _instants(
        self, phase: Phase, u: Column, owner: IntArray | None, known: dict[str, Column] | None = None
    ) -> Instants:
        """Return states and speeds at one moment of each motion: when the fraction ``u`` of the phase's time is over.

        ``owner`` has the indices of the motions; None means all. ``known`` is a cache of state columns at these
        moments, to which computed columns are added.
        """
        columns = {} if known is None else known

        def pick(column: Column) -> Column:
            return column if owner is None else column[owner]

        change = pick(phase.change) if phase.shape == "ramp" else 0.0
        picked = Phase(pick(phase.duration), pick(phase.begin), pick(phase.end), phase.shape, change)
        start, end = picked_states(self.start, pick), picked_states(self.end, pick)
        share = picked.share(u)

        def column(name: str) -> Column:
            if name not in columns:
                varies = name in self.law.varies
                columns[name] = self.law.interpolate(name, start, end, share) if varies else getattr(start, name)
            return columns[name]

        @cache
        def share_rates() -> tuple[Column, Column]:
            return picked.share_rates(u)

        def derivatives(name: str) -> tuple[Column, Column]:
            if name not in self.law.varies:
                return 0.0 * picked.duration, 0.0 * picked.duration
            first, second = share_rates()
            slope, bend = slopes(self.law, name, start, end, share)
            return slope * first, bend * first * first + slope * second

        t = None
        if self.t0 is not None:
            t = pick(self.t0 + elapsed_before(self, phase)) + u * picked.duration
        size = len(self) if owner is None else owner.size
        return Instants(self.model, self.start.names, size, t, column, derivatives)

    def __repr__(self) -> str:
        return f"<Motions: {len(self):,} of {self.kind}, {type(self.model).__name__} in {self.world!r}>"
