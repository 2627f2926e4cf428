"""Collisions of an arm with the world and with itself, with proofs; and pairs of links that always touch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, numbered
from hpop.models.serial_arm.chain import ArmPart, Chain, Pair, pair_of
from hpop.models.serial_arm.scene import ArmScene, paired, scene_of, within_reach
from hpop.motions import Law, Motions, Separations, States, is_coupled, slopes
from hpop.world.geometry.solids import Solid

if TYPE_CHECKING:
    from hpop.world import World

NEAR = 1e-3  # m: a motion is blocked only if it comes nearer than this
KEPT = 5e-4  # m: least distance of free states and motions
ROUNDING = 1e-6  # m: subtracted from proved distances, for floating-point errors
AT_ONCE = 256  # motions in one call of a kernel, which Ctrl-C waits for
BEND = 1e-4  # m: largest distance of the pieces of a curve from their chords
MOST_PIECES = 4096  # of a curve; beyond, a larger distance from chords is subtracted from distances
CLOSE = 1e-6  # relative: largest error of clearances, below the distance
MISSED = 1e-5  # m: largest error of least clearances, above the distance
SAMPLES = 10_000
FEW = 100  # samples that decide most pairs
SEED = 1


@dataclass(frozen=True, eq=False, repr=False)
class ArmCollision:
    """Collision test of an arm in a world, for states and whole motions.

    chain
    parts  solids on its links
    apart  pairs of links that may touch
    world

    A state is free if all joints are within their limits and no two solids are nearer than 0.5 mm. A motion that is
    called free is free all along, which is proved and not sampled (:mod:`hpop.models.serial_arm.certificate`); a
    blocked one comes nearer than 1 mm somewhere, and between these it may be either. So each state of a free motion is
    free. Laws with states that do not change evenly are tested in pieces, by the distance of a piece from its chord:
    exact bounds where second derivatives by the share change linearly, as those of cubic splines do. Joints are
    compared with their limits at the ends of pieces.

    Solids that never move, such as the base of the arm, are not tested against standing ones.
    """

    chain: Chain
    parts: tuple[ArmPart, ...]
    apart: frozenset[Pair]
    world: World

    @cached_property
    def _solids(self) -> tuple[Solid, ...]:
        return self.world.bodies

    @cached_property
    def _scene(self) -> ArmScene:
        """All pairs of bodies that must not touch; stored with the world, which outlives the model."""
        return self.world.derived(("arm", self.chain, self.parts, self.apart), self._scene_with_pairs)

    def _scene_with_pairs(self) -> ArmScene:
        scene = scene_of(self.chain, self.parts, self._solids)
        inside = within_reach(scene, self.chain, NEAR)
        own = [
            (a, b)
            for (a, one), (b, other) in combinations(enumerate(self.parts), 2)
            if one.frame != other.frame and pair_of(one.link, other.link) not in self.apart
        ]
        return paired(scene, [*own, *((a, b) for a, b in self._outer_pairs() if inside[a, b])])

    def _outer_pairs(self) -> Iterator[tuple[int, int]]:
        """Yield pairs of a moving part and a solid of the world."""
        size = len(self.parts)
        return ((a, size + b) for a, b in product(range(size), range(len(self._solids))) if self.parts[a].frame)

    @cached_property
    def _outer_scene(self) -> ArmScene:
        """Scene for clearance: also solids out of reach, without pairs of own links."""
        return paired(self._scene, [*self._outer_pairs()])

    @property
    def is_uncompiled(self) -> bool:
        """True if kernels must be compiled first, which takes some 20 s."""
        from hpop.models.serial_arm.certificate import blocked_by  # kernels: importing numba takes half a second
        from hpop.runtime.compiled import is_cached

        return not is_cached(blocked_by)

    def states_free(self, states: States) -> BoolArray:
        """Return whether the arm is free in each state (N,)."""
        rows = self._rows(states)
        free = self._is_within(rows)
        rows = rows[free]
        free[free] = self._blocking_pairs(rows, rows, np.zeros_like(rows), KEPT, KEPT) < 0
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the arm is free all along each motion (M,), ends included."""
        if is_coupled(motions.law):
            return self._curves_free(motions)
        start, end = self._rows(motions.start), self._rows(motions.end)
        free = self._is_within(start) & self._is_within(end)
        start, end = start[free], end[free]
        free[free] = self._blocking_pairs(start, end, np.zeros_like(start), NEAR, KEPT + ROUNDING) < 0
        return free

    def clearance(self, states: States) -> FloatArray:
        """Return the distance (N,), m, of the arm from the world: a lower bound, exact to a millionth and 1e-6 m.

        Its own links do not count; inf in an empty world.
        """
        from hpop.models.serial_arm.certificate import nearest  # numba, on first use

        rows = self._rows(states)
        least = np.empty(len(rows))
        for part in _slices(len(rows)):
            nearest(self._outer_scene, rows[part], np.inf, CLOSE, least[part])
        return np.maximum(0.0, least - ROUNDING)

    def least_clearance(self, motions: Motions, most: float) -> FloatArray:
        """Return the least clearance (M,), m, along each motion, at most ``most``: proved to 0.01 mm.

        For laws that are straight in the space of the joints. A motion and its reverse have equal values.
        """
        from hpop.models.serial_arm.distances import closest  # numba, on first use

        own, which = np.unique(motions.twins, return_inverse=True)
        start, end = self._rows(motions.start.take(own)), self._rows(motions.end.take(own))
        differs = np.argmax(start != end, axis=1)[:, None]
        back = np.take_along_axis(start, differs, 1) > np.take_along_axis(end, differs, 1)
        start, end = np.where(back, end, start), np.where(back, start, end)
        least = np.empty(len(start))
        for part in _slices(len(start)):
            closest(self._outer_scene, start[part], end[part], most, MISSED, least[part])
        return np.asarray(np.maximum(0.0, least - ROUNDING)[which])

    def separations(self, states: States, within: float) -> Separations:
        """Return distances of solids nearer than ``within`` m in states (N,), with gradients by the joints."""
        from hpop.models.serial_arm.distances import near_pairs  # numba, on first use

        rows, room = self._rows(states), 64 * states.size
        while True:
            owner, distance = np.empty(room, np.int64), np.empty(room)
            gradient = np.empty((room, len(self.chain)))
            found = near_pairs(self._scene, rows, within, owner, distance, gradient)
            if found <= room:
                return Separations(owner[:found], distance[:found], gradient[:found])
            room = found

    def why_blocked(self, state: States) -> str:
        """Return what blocks one state and a remedy, without the final full stop; "" if the state is free."""
        row = self._rows(state)
        if not self._is_within(row)[0]:
            return self._limit_reason(row[0])
        (pair,) = self._blocking_pairs(row, row, np.zeros_like(row), KEPT, KEPT).tolist()
        if pair < 0:
            return ""
        names = [self._body_name(b) for b in self._scene.pairs[pair].tolist()]
        return f"{names[1]} touches {names[0]}, or is nearer than {1000 * KEPT:g} mm. Take another posture"

    def _body_name(self, body: int) -> str:
        if body < len(self.parts):
            return f"the link {self.parts[body].link!r}"
        return f"the obstacle {self._solids[body - len(self.parts)].name!r}"

    def _limit_reason(self, row: FloatArray) -> str:
        """Return which joint is beyond its limits, in words."""
        chain = self.chain
        k = int(np.flatnonzero(~self._each_within(row[None])[0])[0])
        unit = "m" if chain.sliding[k] else "rad"
        return (
            f"joint {chain.names[k]!r} is at {row[k]:.4g} {unit}, beyond its limits of {chain.low[k]:.4g} to "
            f"{chain.high[k]:.4g} {unit}. Move it back"
        )

    # Rows of joint values

    def _rows(self, states: States) -> FloatArray:
        """Return the joint values (N, n) of states."""
        return np.stack([np.asarray(getattr(states, name), np.float64) for name in self.chain.names], axis=1)

    def _each_within(self, rows: FloatArray) -> BoolArray:
        """Return whether each joint is within its limits in each row (N, n)."""
        ranged = (rows >= self.chain.low - 1e-9) & (rows <= self.chain.high + 1e-9)
        return np.asarray(ranged | (self.chain.turning & np.isfinite(rows)), np.bool_)

    def _is_within(self, rows: FloatArray) -> BoolArray:
        return np.asarray(self._each_within(rows).all(axis=1))

    def _blocking_pairs(
        self, start: FloatArray, end: FloatArray, deviation: FloatArray, near: float, kept: float
    ) -> IntArray:
        """Return the pair that blocks each segment (M,), -1 where it is free."""
        from hpop.models.serial_arm.certificate import blocked_by  # numba, on first use

        found = np.full(len(start), -1)
        for part in _slices(len(start)):
            blocked_by(self._scene, start[part], end[part], deviation[part], near, kept, found[part])
        return found

    # Curves

    def _curves_free(self, motions: Motions) -> BoolArray:
        """Return which curves are free, by testing chords of pieces that bend little."""
        law, start, end = motions.law, motions.start, motions.end
        most = np.max(
            [self._second_derivatives(law, start, end, np.full(len(motions), share)) for share in (0.0, 0.5, 1.0)],
            axis=0,
        )
        farthest = np.where(self.chain.sliding, 1.0, self._scene.levers.max(axis=0, initial=0.0))
        pieces = np.ceil(np.sqrt(most @ farthest / (8.0 * BEND))).astype(np.int64).clip(1, MOST_PIECES)
        owner, piece = numbered(pieces)
        begin, stop, count = start.take(owner), end.take(owner), pieces[owner]
        knots = [piece / count, (piece + 1) / count]
        first, last = (self._values_on_curve(law, begin, stop, share) for share in knots)
        bends = np.maximum(*(self._second_derivatives(law, begin, stop, share) for share in knots))
        deviation = bends / (8.0 * count[:, None] ** 2)
        free = self._is_within(first) & self._is_within(last)
        first, last, deviation = first[free], last[free], deviation[free]
        free[free] = self._blocking_pairs(first, last, deviation, NEAR, KEPT + ROUNDING) < 0
        return np.asarray(np.bincount(owner, ~free, minlength=len(motions)) == 0)

    def _values_on_curve(self, law: Law, start: States, end: States, share: FloatArray) -> FloatArray:
        """Return joint values (M, n) at a share of each motion."""
        return self._rows(
            States(
                **{
                    name: law.interpolate(name, start, end, share) if name in law.varies else getattr(start, name)
                    for name in self.chain.names
                }
            )
        )

    def _second_derivatives(self, law: Law, start: States, end: States, share: FloatArray) -> FloatArray:
        """Return absolute second derivatives (M, n) of the joints by the share."""
        bends = np.zeros((share.size, len(self.chain)))
        for k, name in enumerate(self.chain.names):
            if name in law.varies:
                bends[:, k] = np.abs(slopes(law, name, start, end, share)[1])
        return bends

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.chain.names)} joints>"


def _slices(size: int) -> Iterator[slice]:
    return (slice(i, i + AT_ONCE) for i in range(0, size, AT_ONCE))


def always_touching(chain: Chain, parts: Sequence[ArmPart], apart: frozenset[Pair]) -> frozenset[Pair]:
    """Return pairs of links, not in ``apart``, that touch in each of 10,000 states drawn within the joints' limits.

    They would block the arm everywhere. Pairs that touch now and then are real collisions. Pairs that never touched are
    tested nonetheless, since samples prove nothing about other states.
    """
    from hpop.models.serial_arm.certificate import blocked_by  # numba, on first use

    scene = scene_of(chain, parts, ())
    states = np.random.default_rng(SEED).uniform(chain.low, chain.high, (SAMPLES, len(chain)))
    links: dict[str, list[int]] = {}
    for place, part in enumerate(parts):
        links.setdefault(part.link, []).append(place)

    def touch(one: str, other: str) -> bool:
        both = paired(scene, [(a, b) for a in links[one] for b in links[other]])
        for some in (states[:FEW], states):
            found = np.empty(len(some), np.int64)
            blocked_by(both, some, some, np.zeros_like(some), KEPT, KEPT, found)
            if (found < 0).any():
                return False
        return True

    pairs = [pair_of(*pair) for pair in combinations(links, 2)]
    return frozenset(pair for pair in pairs if pair not in apart and touch(*pair))
