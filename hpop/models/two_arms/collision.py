"""Collision tests of an arm with another arm that moves at the same time: proofs for planning, samples for judgement.

For the proofs, both arms form one chain of joints: from the tip of the working arm back to its base, and on from the
base of the viewing arm to its tip. Its joints turn as those of the arms do, so the proof for motions of one arm
(:mod:`hpop.models.serial_arm.certificate`) serves for two. A motion is cut into pieces of time. In each piece both arms
differ little from straight lines in joint space, and the proof allows for these differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray, numbered
from hpop.models import serial_arm
from hpop.models.serial_arm.chain import ArmPart, Chain
from hpop.models.serial_arm.collision import AT_ONCE, KEPT, NEAR, ROUNDING
from hpop.models.serial_arm.judge import LIBRARIES, ArmJudge, joint_frames
from hpop.models.serial_arm.scene import ArmScene, paired, scene_of
from hpop.models.two_arms.motion import TIME, ReachInTime
from hpop.motions import Motions, States, collision_of
from hpop.world import World
from hpop.world.geometry.solids import Solid

if TYPE_CHECKING:
    from hpop.models.two_arms import TwoArms

BEND = 5e-4  # m: pieces are so short that the viewing arm is at most this far from a straight line in joint space
PIECE = 0.05  # s, longest piece
WORK = "work/"  # prefix of the names of the working arm's links and joints in the chain of both arms


class BothArms(NamedTuple):
    """Chain of joints that leads through both arms, and their solids in its frames.

    chain  joints of the working arm in reverse order, then those of the viewing arm
    parts  solids of both arms
    pairs  (P, 2)  indices in ``parts`` of a solid of the working arm and one of the viewing arm
    """

    chain: Chain
    parts: tuple[ArmPart, ...]
    pairs: list[tuple[int, int]]

    @classmethod
    def of(cls, work: Chain, solids: tuple[ArmPart, ...], view: Chain, others: tuple[ArmPart, ...]) -> BothArms:
        """Return the chain through a working and a viewing arm with their solids; both chains begin in the world."""
        count, back = len(work), slice(None, None, -1)
        inverse = np.linalg.inv(work.origins)
        first = np.concatenate([np.eye(4)[None], inverse[:0:-1]])  # frame of each joint in the one before it
        origins = np.concatenate([first, view.origins])
        origins[count] = inverse[0] @ view.origins[0]
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(work, name)[back], getattr(view, name)])
            for name in ("sliding", "turning", "low", "high", "speed", "acceleration")
        }
        chain = Chain(
            names=(*(f"{WORK}{name}" for name in work.names[back]), *view.names),
            axes=np.concatenate([-work.axes[back], view.axes]),
            origins=origins,
            **columns,
        )
        offsets = [*inverse, np.eye(4)]  # from the frame of the chain to that of the arm
        moved = [
            replace(
                part,
                link=f"{WORK}{part.link}",
                frame=count - part.frame,
                solid=replace(part.solid, pose=offsets[part.frame] @ part.solid.pose),
            )
            for part in solids
        ]
        based = [
            replace(part, frame=count + part.frame, solid=replace(part.solid, pose=inverse[0] @ part.solid.pose))
            if part.frame == 0
            else replace(part, frame=count + part.frame)
            for part in others
        ]
        pairs = [(a, len(moved) + b) for a in range(len(moved)) for b in range(len(based))]
        return cls(chain, (*moved, *based), pairs)

    @property
    def scene(self) -> ArmScene:
        """Arrays of all solids for the kernels, with the pairs that must not touch."""
        return paired(scene_of(self.chain, self.parts, ()), self.pairs)


@dataclass(frozen=True, eq=False, repr=False)
class TwoArmsCollision:
    """Collision test of a viewing arm with the world, itself and a working arm that moves.

    arms   both arms
    world  obstacles

    The viewing arm alone is tested as :class:`hpop.models.serial_arm.collision.ArmCollision` does. States and motions
    that are free keep 0.5 mm from the working arm as well, all along; this is proved. A motion that the working arm
    blocks comes closer than some 2 mm to it. Contacts of the working arm with obstacles and with itself are not tested.
    """

    arms: TwoArms
    world: World

    @cached_property
    def _alone(self) -> Any:
        """Collision test of the viewing arm alone."""
        return collision_of(self.arms.view, self.world)

    @cached_property
    def _scene(self) -> ArmScene:
        return self.arms.both.scene

    @property
    def is_uncompiled(self) -> bool:
        """True if kernels must be compiled first, which takes some 20 s."""
        return bool(self._alone.is_uncompiled)

    @property
    def constraint(self) -> str:
        """Orientation of the viewing arm that motions must keep besides being free, for certificates; "" for none."""
        return str(self._alone.constraint)

    @checked_arguments
    def states_free(self, states: States) -> BoolArray:
        """Return whether the viewing arm is free in each state (N,), and keeps 0.5 mm from the working arm."""
        free: BoolArray = self._alone.states_free(self.arms.alone(states))
        rows = self._rows(states.take(free))
        free[free] = self._contacts(rows, rows, np.zeros_like(rows), KEPT, KEPT) < 0
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the viewing arm is free all along each motion (M,), also of the working arm."""
        free: BoolArray = self._alone.motions_free(self.arms.motions_alone(motions))
        some = np.flatnonzero(free)
        pieces = self._pieces(self.arms.law, motions.start.take(some), motions.end.take(some))
        blocked = self._contacts(*pieces[1:], NEAR, KEPT + ROUNDING) >= 0
        free[some] = np.bincount(pieces[0], blocked, minlength=some.size) == 0
        return free

    def clearance(self, states: States) -> FloatArray:
        """Return the distance (N,), m, from the viewing arm to the nearest obstacle or part of the working arm."""
        rows, least = self._rows(states), np.empty(states.size)
        serial_arm.certificate.nearest(self._scene, rows, np.inf, 1e-6, least)
        return np.asarray(np.minimum(self._alone.clearance(self.arms.alone(states)), np.maximum(0.0, least - ROUNDING)))

    @checked_arguments
    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        if reason := self._alone.why_blocked(self.arms.alone(state)):
            return str(reason)
        rows = self._rows(state)
        (pair,) = self._contacts(rows, rows, np.zeros_like(rows), KEPT, KEPT).tolist()
        if pair < 0:
            return ""
        links = [self.arms.both.parts[b].link for b in self._scene.pairs[pair].tolist()]
        mine, other = sorted(links, key=lambda link: link.startswith(WORK))
        return (
            f"the link {mine!r} touches the link {other.removeprefix(WORK)!r} of the working arm at "
            f"{float(state.time[0]):.3g} s, or is closer than {1000 * KEPT:g} mm. Choose other joint values"
        )

    def _rows(self, states: States) -> FloatArray:
        """Return the joint values (N, n) of the chain through both arms."""
        view = np.stack([np.asarray(getattr(states, name), float) for name in self.arms.view.joints], axis=1)
        return np.hstack([self.arms.motion.at(states.time)[:, ::-1], view.reshape(-1, len(self.arms.view.joints))])

    def _pieces(
        self, law: ReachInTime, start: States, end: States
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Cut motions (M,) into P pieces; return arrays with a row for each piece.

        The arrays are the index of its motion (P,), and the joint values of both arms at its begin and at its end, each
        (P, n). The last one (P, n) says how far each joint strays from an even change in between.
        """
        lasts, joints = end.time - start.time, self.arms.view.joints
        ends = [[law.slopes(name, start, end, np.full(lasts.size, u))[1] for name in joints] for u in (0.0, 1.0)]
        bends = np.abs(ends).max(axis=0).T  # second derivatives are largest at the ends
        levers = self._scene.levers.max(axis=0)[-len(joints) :]
        farthest = np.where(self.arms.view.chain.sliding, 1.0, levers)
        counts = np.maximum(np.sqrt(bends @ farthest / (8.0 * BEND)), lasts / PIECE)
        owner, number = numbered(np.maximum(1, np.ceil(counts)).astype(np.int64))
        each = np.bincount(owner, minlength=lasts.size)[owner]
        begin, stop = start.take(owner), end.take(owner)
        low, high = (
            States(**{name: law.interpolate(name, begin, stop, share) for name in (*joints, TIME)})
            for share in (number / each, (number + 1) / each)
        )
        moved = self.arms.motion.bends(low.time, high.time)[:, ::-1]
        return owner, self._rows(low), self._rows(high), np.hstack([moved, bends[owner] / (8.0 * each[:, None] ** 2)])

    def _contacts(
        self, start: FloatArray, end: FloatArray, deviation: FloatArray, near: float, kept: float
    ) -> IntArray:
        """Return for each piece (M,) the index of a pair of solids that come too near, or -1 if none do.

        ``deviation`` (M, n) is how far each joint strays from an even change; ``near`` and ``kept``, m, are as for
        :func:`hpop.models.serial_arm.certificate.blocked_by`.
        """
        found = np.full(len(start), -1)
        for part in (slice(i, i + AT_ONCE) for i in range(0, len(start), AT_ONCE)):
            serial_arm.certificate.blocked_by(
                self._scene, start[part], end[part], deviation[part], near, kept, found[part]
            )
        return found

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.arms.both.pairs)} pairs of solids>"


@dataclass(frozen=True, eq=False, repr=False)
class TwoArmsJudge:
    """Collision test for verification: of the viewing arm alone, and of both arms in small steps.

    arms     both arms
    world    obstacles
    library  that computes distances: "fcl" or "coal"
    """

    arms: TwoArms
    world: World
    library: str = LIBRARIES[0]

    @cached_property
    def _alone(self) -> Any:
        return self.arms.view.judge_by(self.library, self.world)

    @cached_property
    def _between(self) -> _BetweenArms:
        work, view = self.arms.work, self.arms.view
        moved = [replace(p, link=f"{WORK}{p.link}", frame=p.frame and len(view.chain) + p.frame) for p in work.parts]
        return _BetweenArms(view.chain, (*view.parts, *moved), frozenset(), self.world, self.arms, library=self.library)

    def states_free(self, states: States) -> BoolArray:
        """Return whether the viewing arm touches nothing, nor the working arm, in each state (N,)."""
        free: BoolArray = self._alone.states_free(self.arms.alone(states))
        return free & self._between.states_free(states)

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the viewing arm is free at all sampled steps of each motion (M,), both ends included."""
        free: BoolArray = self._alone.motions_free(self.arms.motions_alone(motions))
        return free & self._between.motions_free(motions)

    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        return str(self._alone.why_blocked(self.arms.alone(state)) or self._between.why_blocked(state))


@dataclass(frozen=True, eq=False, repr=False)
class _BetweenArms(ArmJudge):
    """Collision test of a viewing arm with a working arm that moves at the same time, for verification.

    Obstacles, and contacts of an arm with itself, are not tested here. A state has the viewing arm's joints and a time,
    from which the working arm's joints follow.

    arms  both arms; ``chain`` is the viewing arm's; ``parts`` are first the viewing arm's, then the working arm's
    """

    arms: TwoArms

    @property
    def columns(self) -> tuple[str, ...]:
        return (*self.chain.names, TIME)

    def _rows(self, states: States) -> FloatArray:
        return np.hstack([super()._rows(states), self.arms.motion.at(states.time)])

    def _frames(self, rows: FloatArray) -> list[FloatArray]:
        count = len(self.chain)
        _, *work = joint_frames(self.arms.work.chain, rows[:, count:])
        return [*joint_frames(self.chain, rows[:, :count]), *work]

    def _beyond_limits(self, rows: FloatArray) -> BoolArray:
        return super()._beyond_limits(rows[:, : len(self.chain)])

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        count = len(self.arms.view.parts)
        both = ((a, b) for a in range(count) for b in range(count, len(self.parts)))
        return [(a, b) for a, b in both if self.parts[a].frame or self.parts[b].frame]

    @cached_property
    def _enlarged(self) -> dict[int, ArmPart]:
        return {}

    @cached_property
    def _solids(self) -> tuple[Solid, ...]:
        return ()
