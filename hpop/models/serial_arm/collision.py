"""Collision test of an arm with the world and itself, which proves whole motions free.

Also here: the search for pairs of links that touch in all of many random states.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np

from hpop import runtime
from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray, numbered
from hpop.models import serial_arm
from hpop.models.serial_arm.chain import ArmPart, Chain, Pair, enlarged_parts, pair_of
from hpop.models.serial_arm.scene import ArmScene, paired, scene_of, within_reach
from hpop.motions import Law, Motions, Separations, States, is_coupled, slopes
from hpop.world.geometry.solids import Solid

if TYPE_CHECKING:
    from hpop.world import World

NEAR = 1e-3  # m: a motion is blocked only if it comes nearer than this
KEPT = 5e-4  # m: smallest distance in free states and motions
ROUNDING = 1e-6  # m: subtracted from proved distances, for floating-point errors
AT_ONCE = 256  # motions in one call of a kernel; Ctrl-C has to wait for the end of the call
BEND = 1e-4  # m: a curve is cut into pieces that are at most this far from their chords
MOST_PIECES = 4096  # most pieces of a curve; a longer curve has pieces farther from their chords
CLOSE = 1e-6  # relative: by how much a clearance may be too small
MISSED = 1e-5  # m: by how much the smallest clearance along a motion may be too large
SAMPLES = 10_000  # random states in which links that always touch are looked for
FEW = 100  # first random states, which decide most pairs
SEED = 1


@dataclass(frozen=True, eq=False, repr=False)
class ArmCollision:
    """Collision test of an arm in a world, for states and whole motions.

    chain  joints of the arm
    parts  solids on its links
    apart  pairs of links that may touch each other
    world  obstacles

    A state is free if all joints are within their limits and no two solids are closer than 0.5 mm. A motion that is
    called free keeps that distance all along. This is proved, not sampled (:mod:`hpop.models.serial_arm.certificate`),
    so each state of a free motion is free. A blocked motion comes closer than 1 mm somewhere. A motion with a smallest
    distance between 0.5 and 1 mm may be called free or blocked.

    Links that the arm or the scene pads or scales are tested with obstacles as enlarged links
    (:mod:`hpop.models.serial_arm.chain`), and with each other as they are.

    A curved motion, such as a spline, is cut into pieces. The chord of each piece is tested, and its largest distance
    from the piece is subtracted. This is exact if second derivatives change linearly, as those of cubic splines do.
    Joints are compared with their limits at the ends of pieces.

    Solids that never move, such as the base of the arm, are not tested with obstacles.
    """

    chain: Chain
    parts: tuple[ArmPart, ...]
    apart: frozenset[Pair]
    world: World

    @cached_property
    def _solids(self) -> tuple[Solid, ...]:
        return self.world.bodies

    @cached_property
    def scene(self) -> ArmScene:
        """Arrays of all bodies, with the pairs that must not touch; cached in the world, which outlives the model."""
        return self.world.derived(("arm", self.chain, self.parts, self.apart), self._scene_with_pairs)

    @cached_property
    def enlarged_bodies(self) -> dict[int, int]:
        """Number of the body that replaces a part in tests with obstacles, by number of each enlarged part."""
        first = len(self.parts) + len(self._solids)
        return {part: first + i for i, part in enumerate(enlarged_parts(self.parts, self.world.link_rules))}

    def _scene_with_pairs(self) -> ArmScene:
        """Return the arrays of all bodies; pairs are links that may not touch, and links with obstacles in reach."""
        larger, body = enlarged_parts(self.parts, self.world.link_rules), self.enlarged_bodies
        scene = scene_of(self.chain, self.parts, self._solids, [*larger.values()])
        inside = within_reach(scene, self.chain, NEAR)
        outer = ((body.get(a, a), b) for a, b in self._outer_pairs())
        own = [
            (a, b)
            for (a, one), (b, other) in combinations(enumerate(self.parts), 2)
            if one.frame != other.frame and pair_of(one.link, other.link) not in self.apart
        ]
        return paired(scene, [*own, *((a, b) for a, b in outer if inside[a, b])])

    def _outer_pairs(self) -> Iterator[tuple[int, int]]:
        """Yield all pairs of a moving part of the arm and a solid that it must not touch, as numbers of bodies."""
        size, may_touch = len(self.parts), self.world.link_rules.may_touch
        return (
            (a, size + b)
            for (a, part), (b, solid) in product(enumerate(self.parts), enumerate(self._solids))
            if part.frame and solid.name not in part.touches and not may_touch(part.link, solid.name)
        )

    @cached_property
    def _outer_scene(self) -> ArmScene:
        """Arrays for clearances: pairs of a moving part, not enlarged, and a solid that it must not touch."""
        return paired(self.scene, [*self._outer_pairs()])

    @property
    def is_uncompiled(self) -> bool:
        """True if kernels must be compiled first, which takes some 20 s."""
        return not runtime.compiled.is_cached(serial_arm.certificate.blocked_by)

    @checked_arguments
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
        """Return the distance (N,), m, between the arm and the solids of the world; inf if there are none.

        It is a lower bound, too small by at most a millionth plus 1e-6 m. Distances between links do not count, nor
        those to solids that a link may touch; links are not enlarged.
        """
        rows = self._rows(states)
        least = np.empty(len(rows))
        for part in _slices(len(rows)):
            serial_arm.certificate.nearest(self._outer_scene, rows[part], np.inf, CLOSE, least[part])
        return np.maximum(0.0, least - ROUNDING)

    def least_clearance(self, motions: Motions, most: float) -> FloatArray:
        """Return the smallest clearance (M,), m, along each motion; ``most`` if it is larger, 0 in a collision.

        A value may be too large or too small by about 0.01 mm. The motions must be straight in joint space. A motion
        and its reverse have exactly equal values.
        """
        own, which = np.unique(motions.twins, return_inverse=True)
        start, end = self._rows(motions.start.take(own)), self._rows(motions.end.take(own))
        differs = np.argmax(start != end, axis=1)[:, None]
        back = np.take_along_axis(start, differs, 1) > np.take_along_axis(end, differs, 1)
        start, end = np.where(back, end, start), np.where(back, start, end)
        least = np.empty(len(start))
        for part in _slices(len(start)):
            serial_arm.distances.closest(self._outer_scene, start[part], end[part], most, MISSED, least[part])
        return np.asarray(np.maximum(0.0, least - ROUNDING)[which])

    def separations(self, states: States, within: float) -> Separations:
        """Return the distance of each pair of solids closer than ``within`` m, in states (N,).

        Each distance comes with its gradient with respect to the joint values.
        """
        rows, room = self._rows(states), 64 * states.size
        while True:
            owner, distance = np.empty(room, np.int64), np.empty(room)
            gradient = np.empty((room, len(self.chain)))
            found = serial_arm.distances.near_pairs(self.scene, rows, within, owner, distance, gradient)
            if found <= room:
                return Separations(owner[:found], distance[:found], gradient[:found])
            room = found

    @checked_arguments
    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        row = self._rows(state)
        if not self._is_within(row)[0]:
            return self._limit_reason(row[0])
        (pair,) = self._blocking_pairs(row, row, np.zeros_like(row), KEPT, KEPT).tolist()
        if pair < 0:
            return ""
        names = [self._body_name(b) for b in self.scene.pairs[pair].tolist()]
        return f"{names[1]} touches {names[0]}, or is closer than {1000 * KEPT:g} mm. Choose other joint values"

    def _body_name(self, body: int) -> str:
        """Return the name of a body for messages, such as "the link 'hand'", with a remark if the link is enlarged."""
        size, solids = len(self.parts), len(self._solids)
        if body < size:
            return f"the link {self.parts[body].link!r}"
        if body < size + solids:
            return f"the obstacle {self._solids[body - size].name!r}"
        larger = [*enlarged_parts(self.parts, self.world.link_rules).values()]
        return f"the link {larger[body - size - solids].link!r}, enlarged by its padding or scale,"

    def _limit_reason(self, row: FloatArray) -> str:
        """Return a text on the first joint that is beyond its limits in a row of joint values (n,)."""
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
        """Return whether each joint is within its limits in each row of joint values (N, n)."""
        ranged = (rows >= self.chain.low - 1e-9) & (rows <= self.chain.high + 1e-9)
        return np.asarray(ranged | (self.chain.turning & np.isfinite(rows)), np.bool_)

    def _is_within(self, rows: FloatArray) -> BoolArray:
        """Return whether all joints are within their limits in each row of joint values (N,)."""
        return np.asarray(self._each_within(rows).all(axis=1))

    def _blocking_pairs(
        self, start: FloatArray, end: FloatArray, deviation: FloatArray, near: float, kept: float
    ) -> IntArray:
        """Return the index of a pair of bodies that blocks each motion (M,), or -1 if the motion is free.

        The arguments are those of :func:`certificate.blocked_by`.
        """
        found = np.full(len(start), -1)
        for part in _slices(len(start)):
            serial_arm.certificate.blocked_by(
                self.scene, start[part], end[part], deviation[part], near, kept, found[part]
            )
        return found

    # Curves

    def _curves_free(self, motions: Motions) -> BoolArray:
        """Return which curved motions (M,) are free, by testing the chords of pieces that are close to their chords."""
        law, start, end = motions.law, motions.start, motions.end
        most = np.max(
            [self._second_derivatives(law, start, end, np.full(len(motions), share)) for share in (0.0, 0.5, 1.0)],
            axis=0,
        )
        farthest = np.where(self.chain.sliding, 1.0, self.scene.levers.max(axis=0, initial=0.0))
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
        """Return the joint values (M, n) when a share (M,) of each motion is done."""
        return self._rows(
            States(
                **{
                    name: law.interpolate(name, start, end, share) if name in law.varies else getattr(start, name)
                    for name in self.chain.names
                }
            )
        )

    def _second_derivatives(self, law: Law, start: States, end: States, share: FloatArray) -> FloatArray:
        """Return the absolute second derivatives (M, n) of the joints with respect to the share of the motion done."""
        bends = np.zeros((share.size, len(self.chain)))
        for k, name in enumerate(self.chain.names):
            if name in law.varies:
                bends[:, k] = np.abs(slopes(law, name, start, end, share)[1])
        return bends

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.chain.names)} joints>"


def _slices(size: int) -> Iterator[slice]:
    """Return slices that divide ``size`` motions into blocks, one for each call of a kernel."""
    return (slice(i, i + AT_ONCE) for i in range(0, size, AT_ONCE))


def always_touching(chain: Chain, parts: Sequence[ArmPart], apart: frozenset[Pair]) -> frozenset[Pair]:
    """Return the pairs of links, not in ``apart``, that touch in each of 10,000 random states within the joint limits.

    Such pairs would block the arm everywhere, so callers do not test them. Pairs that touch in some states are real
    collisions. Pairs that touch in none are tested as well, because samples prove nothing about other states.
    """
    scene = scene_of(chain, parts, ())
    states = np.random.default_rng(SEED).uniform(chain.low, chain.high, (SAMPLES, len(chain)))
    links: dict[str, list[int]] = {}
    for place, part in enumerate(parts):
        links.setdefault(part.link, []).append(place)

    def touch(one: str, other: str) -> bool:
        both = paired(scene, [(a, b) for a in links[one] for b in links[other]])
        for some in (states[:FEW], states):
            found = np.empty(len(some), np.int64)
            serial_arm.certificate.blocked_by(both, some, some, np.zeros_like(some), KEPT, KEPT, found)
            if (found < 0).any():
                return False
        return True

    pairs = [pair_of(*pair) for pair in combinations(links, 2)]
    return frozenset(pair for pair in pairs if pair not in apart and touch(*pair))
