"""Orientation that an arm keeps along all motions: the angle between an axis of tool or camera and a fixed direction.

An upright cup keeps the tool's up axis within some degrees of the vertical; a level view keeps the camera's left axis
at 90 degrees to it, plus or minus some degrees. Let s be the share of a motion that is done. As s grows, the angle
changes at most by Λ ds, where Λ is the sum of the changes per share of all joints that can turn the axis. So if the
angle is a distance d within its bounds at s, it is within them at all s' with |s' - s| Λ < d. Intervals of s are tested
as in the collision test (:mod:`hpop.models.serial_arm.certificate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, cast

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import cross, dot, norm, not_radians
from hpop.base.options import Degrees, real
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.goals.region import InverseKinematics, Region
from hpop.models.serial_arm.chain import Chain
from hpop.models.serial_arm.collision import ArmCollision
from hpop.models.serial_arm.judge import ArmJudge
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import JointLaw, Reach
from hpop.motions import Law, Model, Motions, Pose, States, Twist, Vector

SLACK = 1e-3  # rad: a motion is refused only if its angle comes nearer than this to a bound
INSIDE = 0.1  # share of the range between the bounds by which states that are moved into it end inside
ALIGNED = 1e-9  # largest sine of the angle between parallel axes
LEAST_RANGE = 0.01  # rad
KEYS = ("body", "axis", "direction", "angle")


@dataclass(frozen=True)
class KeptAxis(Region):
    """Axis of a body whose angle to a direction stays within bounds; as a region, the states where it does.

    of         body: "tool" or "camera"
    axis       unit vector in the body's frame (x ahead, y left, z up)
    direction  unit vector in the world
    angle      rad  (least, greatest) angle between the two
    """

    name: ClassVar[str] = "keep"

    of: str
    axis: Vector
    direction: Vector
    angle: tuple[float, float]

    @classmethod
    def from_spec(cls, given: Any) -> KeptAxis:
        """Check the option ``keep``, a mapping with body, axis, direction (up by default) and angle, and return it."""
        if not isinstance(given, Mapping) or not {"body", "axis", "angle"} <= set(given) <= set(KEYS):
            raise ModelError(
                "keep must be a mapping with body, axis, angle and optionally direction (default: up), such as "
                "{'body': 'tool', 'axis': (0, 0, 1), 'angle': (0, 0.3)}, where angle is the least and greatest angle, "
                f"rad, between axis and direction; got {shown(given)}"
            )
        if given["body"] not in ("tool", "camera"):
            raise ModelError(f"body of keep must be tool or camera, got {shown(given['body'])}")
        axis, direction = (_unit(key, given.get(key, (0, 0, 1))) for key in ("axis", "direction"))
        least, most = _numbers("angle", given["angle"], 2, math.pi, "(least, greatest) angle in rad, from 0 to pi")
        if least < 0 or most - least < LEAST_RANGE:
            raise ModelError(
                f"angle of keep must be (least, greatest), at least {LEAST_RANGE} apart, from 0 to pi rad, got "
                f"{shown(given['angle'])}"
            )
        return cls(given["body"], axis, direction, (least, most))

    def described(self) -> dict[str, Any]:
        """Return the mapping that :meth:`from_spec` takes."""
        values = (self.of, list(self.axis), list(self.direction), list(self.angle))
        return dict(zip(KEYS, values, strict=True))

    def __str__(self) -> str:
        axis, direction = ("({:.4g}, {:.4g}, {:.4g})".format(*each) for each in (self.axis, self.direction))
        least, most = (f"{math.degrees(angle):.4g}" for angle in self.angle)
        return f"the axis {axis} of the {self.of} keeps {least} to {most} degrees to {direction}"

    # Region

    @property
    def body(self) -> str:
        """Return the name of the body."""
        return self.of

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bound of the angle, rad, each (1,), between which states are drawn.

        Each is moved inwards by a tenth of the range between them, except a bound of 0 or pi.
        """
        least, most = self.angle
        inside = INSIDE * (most - least)
        return np.array([least + inside if least else 0.0]), np.array([most - inside if most < math.pi else math.pi])

    @property
    def lengths(self) -> BoolArray:
        """Mask (1,) of the coordinates in m: none."""
        return np.array([False])

    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Return the angle (M,), rad, between the axis and the direction, as the only coordinate."""
        axis = self._turned(pose)
        return (np.arctan2(norm(cross(axis, self.direction)), dot(axis, self.direction)),)

    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """Return the rate (M,) of the angle, rad/s; arbitrary where it is 0 or pi."""
        axis = self._turned(pose)
        sine = np.maximum(norm(cross(axis, self.direction)), 1e-9)
        return (-dot(cross(twist.rotation, axis), self.direction) / sine,)

    def _turned(self, pose: Pose) -> Vector:
        """Return the axis in the world."""
        parts = zip(pose.ahead, pose.left, pose.up, strict=True)
        x, y, z = (sum(a * b for a, b in zip(self.axis, part, strict=True)) for part in parts)
        return x, y, z

    # Along motions

    def margin(self, kinematics: Kinematics, states: States) -> FloatArray:
        """Return how far (N,), rad, the angle is within its bounds; negative outside. Bounds 0 and pi do not count."""
        (angle,) = self.coordinates(kinematics.pose(self.of, states))
        least, most = self.angle
        low = angle - least if least > 0 else np.full(states.size, np.inf)
        return np.broadcast_to(np.minimum(low, most - angle if most < math.pi else np.inf), (states.size,))

    def turning(self, chain: Chain) -> BoolArray:
        """Return which joints (n,) can change the angle.

        Sliding joints cannot. Nor can the first turning joints if their axes are along the direction, nor the last one
        if its axis is along the axis that is kept.
        """
        mount = chain.mounts[self.of]
        counts = ~chain.sliding & (np.arange(len(chain)) < mount.frame)
        places = np.flatnonzero(counts)
        if places.size:
            last, frame = int(places[-1]), np.eye(3)
            for k in range(last + 1):
                frame = frame @ chain.origins[k][:3, :3]
                if not chain.sliding[k]:
                    if np.linalg.norm(np.cross(frame @ chain.axes[k], self.direction)) >= ALIGNED:
                        break
                    counts[k] = False
            frame = np.eye(3)
            for k in range(last + 1, mount.frame):
                frame = frame @ chain.origins[k][:3, :3]
            kept = frame @ mount.pose[:3, :3] @ np.array(self.axis)
            if np.linalg.norm(np.cross(chain.axes[last], kept)) < ALIGNED:
                counts[last] = False
        return counts

    def kept_along(self, kinematics: Kinematics, law: Law, start: States, end: States) -> BoolArray:
        """Return which motions (M,) are proved to keep the angle within its bounds, ends included."""
        chain, size = kinematics.chain, start.size
        fastest = np.zeros(size)  # rad per unit of the share
        for name, counts in zip(chain.names, self.turning(chain), strict=True):
            if counts:
                fastest += _fastest(law, name, start, end)

        def around(motions: IntArray, share: FloatArray) -> FloatArray:
            begin, stop = start.take(motions), end.take(motions)
            at = States(**{
                n: law.interpolate(n, begin, stop, share) if n in law.varies else getattr(begin, n) for n in chain.names
            })  # fmt: skip
            margin = self.margin(kinematics, at)
            with np.errstate(divide="ignore", invalid="ignore"):
                proved = np.where(fastest[motions] > 0, margin / fastest[motions], np.inf)
            return np.where(margin < SLACK, 0.0, proved)

        return proved_along(size, around)


def proved_along(size: int, around: Callable[[IntArray, FloatArray], FloatArray]) -> BoolArray:
    """Return which motions (M,) are proved to keep a condition all along, ends included.

    size    number M of motions
    around  function of motions, as indices (N,), and a share (N,) of each. It returns by how much this share may grow
            or shrink while the condition is sure to hold; 0 or less where it is not proved at the share itself
    """
    kept = np.ones(size, dtype=bool)
    owner, low, high = np.arange(size), np.zeros(size), np.ones(size)
    while owner.size:
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        proved = around(owner, middle)
        kept[owner[proved <= 0.0]] = False
        open_ = kept[owner] & (proved < half)
        owner, middle, proved = owner[open_], middle[open_], proved[open_]
        low, high = low[open_], high[open_]
        owner = np.concatenate([owner, owner])
        low, high = np.concatenate([low, middle + proved]), np.concatenate([middle - proved, high])
    return kept


def _fastest(law: Law, name: str, start: States, end: States) -> FloatArray:
    """Return the largest derivative (M,) of a joint by the share of the motion done, rad."""
    if name not in law.varies:
        return np.zeros(start.size)
    if isinstance(law, Reach):
        return np.asarray(np.abs(getattr(end, name) - getattr(start, name)))
    lasts = sum(phase.duration for phase in law.phases(start, end))
    return np.asarray(cast(JointLaw, law).extremes(name, start, end).speed * lasts)


@dataclass(frozen=True, eq=False, repr=False)
class KeepingCollision(ArmCollision):
    """Collision test that also refuses states and motions in which the arm does not keep an orientation."""

    kept: KeptAxis
    model: Model

    @property
    def constraint(self) -> str:
        """Return the orientation that is kept, and how this is checked, as text for certificates."""
        return f"{self.kept}, proved all along each motion that was checked"

    def states_free(self, states: States) -> BoolArray:
        """Return whether the arm is free and keeps the orientation in each state (N,)."""
        return np.asarray(super().states_free(states) & (self.kept.margin(self._kinematics, states) >= 0.0))

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the arm is free and keeps the orientation all along each motion (M,)."""
        free = self.kept.kept_along(self._kinematics, motions.law, motions.start, motions.end)
        some = np.flatnonzero(free)
        if some.size:
            start, end = motions.start.take(some), motions.end.take(some)
            free[some] = super().motions_free(Motions(motions.world, motions.model, motions.law, start, end))
        return free

    def why_blocked(self, state: States) -> str:
        """Return a text: what blocks one state (1,) and a remedy; "" if the state is free."""
        return super().why_blocked(state) or _why_turned(self.kept, float(self._angle(state)[0]))

    def projected(self, states: States) -> States:
        """Return states (N,), with those that do not keep the orientation moved until they do, as far as this works."""
        sought = InverseKinematics(self.model, self.model.space, self.kept)
        rows = sought.rows(states)
        off = np.flatnonzero(self.kept.margin(self._kinematics, states) < SLACK)
        rows[off] = sought.descend(rows[off], *sought.bounds(off.size))
        return sought.states(rows)

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.chain)

    def _angle(self, states: States) -> FloatArray:
        return np.asarray(self.kept.coordinates(self._kinematics.pose(self.kept.of, states))[0])


@dataclass(frozen=True, eq=False, repr=False)
class KeepingJudge(ArmJudge):
    """Collision test for verification that also refuses steps at which the arm does not keep the orientation.

    The orientation is measured by the frames of this test, not by those of the planner.
    """

    kept: KeptAxis

    def _contact_reason(self, steps: Any) -> str:
        mount = self.chain.mounts[self.kept.of]
        turned = self._frames(steps.rows)[mount.frame][:, :3, :3] @ mount.pose[:3, :3] @ np.array(self.kept.axis)
        angle = np.arccos(np.clip(turned @ np.array(self.kept.direction), -1.0, 1.0))
        least, most = self.kept.angle
        worst = int(np.argmax(np.maximum(least - angle, angle - most)))
        return _why_turned(self.kept, float(angle[worst])).partition(".")[0] or super()._contact_reason(steps)


def _why_turned(kept: KeptAxis, angle: float) -> str:
    """Return a text if an angle, rad, is not kept; "" if it is."""
    if kept.angle[0] - 1e-6 <= angle <= kept.angle[1] + 1e-6:
        return ""
    return (
        f"keep asks that {kept}, but here it has {math.degrees(angle):.4g} degrees. Turn it, or widen the angle of keep"
    )


def _numbers(key: str, given: Any, count: int, most: float, form: str) -> tuple[float, ...]:
    try:
        given = [Degrees.in_radians(each) for each in given]
        numbers = tuple(float(real(f"{key} of keep", each, -most, most, form, error=ModelError)) for each in given)
    except TypeError:
        numbers = ()
    if len(numbers) != count:
        raise ModelError(f"{key} of keep must be {form}, got {shown(given)}")
    if key == "angle" and (advice := next(filter(None, map(not_radians, numbers)), "")):
        raise ModelError(f"angle of keep {advice}")
    return numbers


def _unit(key: str, given: Any) -> Vector:
    x, y, z = _numbers(key, given, 3, 1e6, "(x, y, z), a vector of any length")
    length = math.hypot(x, y, z)
    if length < 1e-9:
        raise ModelError(f"{key} of keep must be (x, y, z), a vector of any length but 0, got {shown(given)}")
    return x / length, y / length, z / length
