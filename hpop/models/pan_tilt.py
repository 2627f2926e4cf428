"""Robot model "pan_tilt": a camera on a pan-tilt head, carried by a base in the plane."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import hypot, smooth_abs, wrap
from hpop.base.options import MOST, Angle, real, set_reals
from hpop.base.registry import with_optional_members
from hpop.base.text import shown
from hpop.errors import ModelError, OptionError
from hpop.models.base import PlanarModel, model
from hpop.models.collision import Part
from hpop.models.differential_drive import SLOWEST, DifferentialDrive, OnBase
from hpop.models.joints import Stations, grid_of_stations, legs_of_joints, stop_faults, stops_of
from hpop.models.laws import JointMove, Turn, Unwind, cruise_speed
from hpop.models.ramps import doubtful_ramps, ramp_faults, ramps_of
from hpop.models.rigid import FieldOfView, Mount, RigidPose, RigidTwist, RigidTwistRate, checked_field_of_view
from hpop.motions import (
    MODEL_DEFAULTS,
    Body,
    Law,
    Leg,
    Model,
    Motions,
    Pose,
    States,
    StateSpace,
    Twist,
    Vector,
    is_curve,
)
from hpop.motions.laws import CHANGE
from hpop.trajectories.trajectory import Trajectory

ALIKE = 1e-9  # rad: tolerance for equal angles
COARSEST = math.radians(90.0)  # angle between neighbouring pans of a lattice, if all headings are multiples of it
FINER = math.radians(45.0)  # otherwise
ALL_ROUND: Literal["all round"] = "all round"  # a pan without end stops
FARTHEST_TURNED = 4.0 * math.pi  # rad: largest end stop of the pan, set by a cable
CARRIES = frozenset({"plane", "rigid", "base", "camera"})  # capabilities of a base that can carry a head


@dataclass(frozen=True)
class HeadPose(RigidPose):
    """Pose of the camera: at the point where pan and tilt axes meet, turned by the yaw of the base, pan and tilt."""

    @property
    def yaw(self) -> Column:
        return self.states.yaw + self.states.pan

    @property
    def pitch(self) -> Column:
        return self.states.tilt

    @property
    def ahead(self) -> Vector:
        level = np.cos(self.pitch)
        return level * np.cos(self.yaw), level * np.sin(self.yaw), np.sin(self.pitch)

    @property
    def up(self) -> Vector:
        rise = np.sin(self.pitch)
        return -rise * np.cos(self.yaw), -rise * np.sin(self.yaw), np.cos(self.pitch)


@dataclass(frozen=True)
class HeadTwist(RigidTwist):
    """Velocity and angular velocity of the camera: it moves with the base, turns about the vertical, and tilts.

    It tilts up about its axis to the right, (sin ψ, -cos ψ, 0) with ψ = yaw + pan, which is always level.
    """

    @property
    def rotation(self) -> Vector:
        yaw, tilt_rate = self.states.yaw + self.states.pan, self.rates.tilt
        return tilt_rate * np.sin(yaw), -tilt_rate * np.cos(yaw), self.rates.yaw + self.rates.pan


@dataclass(frozen=True)
class HeadTwistRate(RigidTwistRate):
    """Acceleration and angular acceleration of the camera; yaw and pan also turn the axis about which it tilts."""

    @property
    def rotation(self) -> Vector:
        yaw, turn_rate = self.states.yaw + self.states.pan, self.rates.yaw + self.rates.pan
        cos, sin, carried, change = np.cos(yaw), np.sin(yaw), self.rates.tilt * turn_rate, self.changes.tilt
        return change * sin + carried * cos, carried * sin - change * cos, self.changes.yaw + self.changes.pan


def stations(space: StateSpace, yaw: FloatArray) -> Stations:
    """Return all states that a lattice uses at one position, and the motions in place between them.

    The states are all combinations of heading (H,), rad, pan and tilt. The motions are "pan", "tilt", "turn" and
    "unwind". Raises OptionError if the headings are not multiples of 45 degrees apart, or if no pan of the lattice is
    between the end stops.
    """
    pans = _pan_values(space, yaw)
    found, number = grid_of_stations(yaw, {"pan": pans, "tilt": stops_of(space, "tilt")})
    return found._replace(motions={**found.motions, "unwind": _unwind_motions(number, space, yaw, pans)})


def _pan_values(space: StateSpace, yaw: FloatArray) -> FloatArray:
    """Return the pans (P,) of a lattice, rad, ascending: multiples of 90 degrees, or of 45 if the headings need it.

    When the base turns from one heading to another, the head can then turn back by the same angle.
    """
    turns = yaw - yaw[0]
    step = next(
        (step for step in (COARSEST, FINER) if (np.abs(_distance_to_multiple(turns, step)) < ALIKE).all()), None
    )
    if step is None:
        raise OptionError(
            f"the headings of a lattice must be multiples of 45 degrees apart for a pan-tilt head, got {yaw.size} "
            "headings; set headings to 4 or 8"
        )
    column = space.names.index("pan")
    low, high = space.low[column], space.high[column]
    first = math.ceil(low / step - ALIKE) + ("pan" in space.turning)  # all round, half a turn occurs once
    pans = step * np.arange(first, math.floor(high / step + ALIKE) + 1, dtype=np.float64)
    if not pans.size:
        raise OptionError(
            f"a lattice needs a pan that is a multiple of {math.degrees(step):g} degrees, but none is between the end "
            f"stops pan=({low:.6g}, {high:.6g}) rad; set stops that are farther apart"
        )
    return pans


def _distance_to_multiple(angles: FloatArray, step: float) -> FloatArray:
    """Return each of the angles (N,), rad, minus the nearest multiple of ``step``."""
    return np.asarray(angles - step * np.round(angles / step))


def _unwind_motions(
    number: IntArray, space: StateSpace, yaw: FloatArray, pans: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the state numbers at which "unwind" motions begin, and those at which they end.

    number  (H, P, T)  state number of each combination of heading, pan and tilt
    yaw     (H,)       headings, rad
    pans    (P,)       pans, rad

    In such a motion the base turns and the head turns back by the same angle, so both pans must exist in the lattice.
    """
    turn = wrap(yaw[None, :] - yaw[:, None])  # (H, H), half a turn counter-clockwise
    view = turn[:, :, None, None] + pans[None, None, None, :] - pans[None, None, :, None]  # (H, H, P, P)
    stays = np.abs(wrap(view) if "pan" in space.turning else view) < ALIKE
    a, b, p, q = np.nonzero(stays & (turn != 0.0)[:, :, None, None])
    return number[a, p].ravel(), number[b, q].ravel()


@model("pan_tilt")
@dataclass(frozen=True)
class PanTilt(OnBase, PlanarModel):
    """Base in the plane with a camera on a pan-tilt head; states x, y (m), yaw, pan and tilt (rad).

    base               model in the plane without joints, by default a differential drive. The head replaces its camera;
                       the head's volume is taken to be within the base's mast
    pan                rad     (low, high) end stops relative to the base, 0 ahead, positive counter-clockwise, or "all
                               round" for a head without stops. Between stops a pan of -pi differs from one of pi
    tilt               rad     (low, high) end stops, positive upwards; equal if the head does not tilt
    pan_rate           rad/s   largest rate of the pan
    pan_acceleration   rad/s²  largest acceleration of the pan
    tilt_rate          rad/s   largest rate of the tilt
    tilt_acceleration  rad/s²  largest acceleration of the tilt
    field_of_view      rad     (horizontal, vertical) angles of view, or None for all round

    The head moves while the base stands (laws "pan" and "tilt"). While the base turns in place, the head either turns
    with it ("turn"), or turns back by the same angle so that the view does not change ("unwind"). A motion of the head
    lasts its rest-to-rest time plus v/a, the time that the base loses by stopping and starting again (v and a are the
    base's speed and acceleration). A base with several speeds has planned changes of speed instead, so v/a is not
    added. During "unwind", base and head keep the limits of both.
    """

    joints: ClassVar[tuple[str, ...]] = ("pan", "tilt")

    base: PlanarModel = field(default_factory=DifferentialDrive)
    pan: tuple[Angle, Angle] | Literal["all round"] = (-math.radians(170), math.radians(170))
    tilt: tuple[Angle, Angle] = (-math.radians(30), math.radians(30))
    pan_rate: float = 1.5
    pan_acceleration: float = 3.0
    tilt_rate: float = 1.0
    tilt_acceleration: float = 2.0
    field_of_view: FieldOfView | None = None

    def __post_init__(self) -> None:
        _check_base(self.base)
        if not (isinstance(self.pan, str) and self.pan == ALL_ROUND):
            object.__setattr__(self, "pan", _checked_stops("pan", self.pan, FARTHEST_TURNED, f", or {ALL_ROUND!r}"))
        object.__setattr__(self, "tilt", _checked_stops("tilt", self.tilt, 0.5 * math.pi))
        rates = ("pan_rate", "pan_acceleration", "tilt_rate", "tilt_acceleration")
        set_reals(self, *rates, least=SLOWEST, most=MOST, kind="a positive number", error=ModelError)
        object.__setattr__(self, "field_of_view", checked_field_of_view(self.field_of_view))

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: those of the base except "rigid", plus "joints"."""
        return super().provides | {"joints"} | (self.base.provides & {"heading", "wheels"})

    @cached_property
    def _turn(self) -> Turn | None:
        """Law of the base's turns in place; None if the base has no such law."""
        law = self.base.laws.get("turn")
        return law if isinstance(law, Turn) else None

    @property
    def speed_classes(self) -> tuple[float, ...]:  # type: ignore[override]  # of its base
        """Speeds of the base, m/s, among which straight moves choose; () for one speed."""
        return self.base.speed_classes

    @property
    def reverses(self) -> bool:  # type: ignore[override]  # of its base
        """Return whether the base may drive backwards to get clear of people who touch it."""
        return self.base.reverses

    @property
    def paces(self) -> tuple[Mapping[str, str], ...]:
        """Kinds of turns of the base, and of "unwind", among which a plan chooses, from slow to fast; () for one."""
        return tuple({**pace, "unwind": f"unwind{_ending(pace)}"} for pace in self.base.paces)

    @property
    def executed(self) -> Mapping[str, str]:  # type: ignore[override]  # of its base
        """The kind of law by which the robot executes motions of each planned kind, of base and head."""
        unwound = {f"unwind{rate}": f"counterspin{rate}" for rate in ("", *map(_ending, self.base.paces))}
        return {**self.base.executed, "pan": "swivel", "tilt": "nod", **unwound}

    @cached_property
    def space(self) -> StateSpace:
        """States of base and head; in distances a pan or tilt counts as the distance the base drives in its time."""
        plane, turns, speed = self.base.space, self.pan == ALL_ROUND, cruise_speed(self.base)
        pan = (-math.pi, math.pi) if self.pan == ALL_ROUND else self.pan
        return StateSpace(
            (*plane.names, "pan", "tilt"),
            (*plane.units, "rad", "rad"),
            (*plane.low, pan[0], self.tilt[0]),
            (*plane.high, pan[1], self.tilt[1]),
            (*plane.weights, speed / self.pan_rate, speed / self.tilt_rate),
            plane.turning | {"pan"} if turns else plane.turning,
        )

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws of the base, except its curves, and of the head."""
        loss = self._turn.loss if self._turn else 0.0
        pan, tilt = (self.pan_rate, self.pan_acceleration), (self.tilt_rate, self.tilt_acceleration)
        unwind, counterspin = dict[str, Law](), dict[str, Law]()
        for rate in dict.fromkeys(("", *map(_ending, self.base.paces))):
            turn = self.base.laws.get(f"turn{rate}")
            if isinstance(turn, Turn):
                both = min(turn.turn_rate, self.pan_rate), min(turn.turn_acceleration, self.pan_acceleration)
                unwind[f"unwind{rate}"] = Unwind(*both, loss, kind=f"unwind{rate}")
                counterspin[f"counterspin{rate}"] = Unwind(*both, kind=f"counterspin{rate}")
        given: dict[str, Law] = {kind: law for kind, law in self.base.laws.items() if not is_curve(law)}
        given |= {
            "pan": JointMove("pan", "pan", *pan, loss),
            "tilt": JointMove("tilt", "tilt", *tilt, loss),
            **unwind,
            "swivel": JointMove("swivel", "pan", *pan),
            "nod": JointMove("nod", "tilt", *tilt),
            **counterspin,
        }
        executed = {kind: law for kind, law in given.items() if kind in self.executed.values()}
        return given | ramps_of(executed, given.get(CHANGE), self.speed_classes)

    @property
    def mounts(self) -> Mapping[str, Mount]:
        """Positions of the bodies: the base, and the camera at the point where pan and tilt axes meet."""
        return self.base.mounts

    @property
    def parts(self) -> tuple[Part, ...]:
        """Collision geometry of the base: the head is within its mast."""
        return self.base.parts

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of the base or of the camera."""
        return HeadPose(self._mount(body), states) if body == "camera" else super().pose(body, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the velocity, m/s, and angular velocity, rad/s, of the body "base" or "camera", in the world's frame.

        ``rates`` are the time derivatives of the states.
        """
        if body != "camera":
            return super().twist(body, states, rates)
        return HeadTwist(self._mount(body), states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return acceleration and angular acceleration of the base or the camera."""
        if body != "camera":
            return super().twist_rate(body, states, rates, changes)
        return HeadTwistRate(self._mount(body), states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return how base or camera moves in each motion, in closed form; a tilt does not count among ``turns``."""
        body, law = super().body(name, motions), motions.law
        if name != "camera" or not isinstance(law, JointMove | Unwind):
            return body
        pan, tilt = _view_change(motions)
        return replace(
            body,
            turned=smooth_abs(pan) + smooth_abs(tilt),  # one of them is zero
            rotation=pan,
            turns=(pan,),
            steady=isinstance(law, Unwind),
            upright=isinstance(law, Unwind) or law.joint == "pan",
        )

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far base and camera move and turn in each motion."""
        farthest, turned = super().extent(motions)
        return farthest, np.maximum(turned, hypot(*_view_change(motions)))

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motions from states a to b: those of the base with the head at rest, then a pan, then a tilt."""
        return legs_of_joints(self.space, self.base.connect(a, b), a, b, self.joints)

    def stations(self, yaw: FloatArray) -> Stations:
        """Return all states that a lattice uses at one position, and the motions in place between them.

        Each heading (H,), rad, is combined with all pans within the end stops that are multiples of 90 degrees, or of
        45 if the headings are 45 degrees apart, and with three tilts.
        """
        return stations(self.space, yaw)

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for each fault: of the base, of ramps beyond limits, of a pan or tilt beyond a stop."""
        yield from self.base.faults(trajectory)
        yield from ramp_faults(trajectory)
        yield from stop_faults(self.space, self.joints, trajectory.states)

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of motions with a possible fault of base or speed, or with a head beyond a stop."""
        wrong = self.base.doubtful(law, start, end) | super().doubtful(law, start, end)
        return wrong | doubtful_ramps(law, start, end)


def _ending(pace: Mapping[str, str]) -> str:
    """Return the ending by which a pace's kind of turns differs from "turn", such as "_0.5"; "" for the fastest."""
    return pace.get("turn", "turn").removeprefix("turn")


def _view_change(motions: Motions) -> tuple[Column, Column]:
    """Return the signed angles (M,), rad, by which the camera turns about the vertical, and by which it tilts up."""
    law, start, end = motions.law, motions.start, motions.end
    still = 0.0 * start.yaw
    if isinstance(law, JointMove):
        change = law.change(start, end)
        return (change, still) if law.joint == "pan" else (still, change)
    return (still if isinstance(law, Unwind) else end.yaw - start.yaw), still


def _check_base(base: Any) -> None:
    """Raise ModelError for a base that cannot carry a pan-tilt head."""
    what = "base must be a model in the plane with a camera and without joints, such as base=DifferentialDrive(...)"
    if (
        isinstance(base, type)
        or not isinstance(base, Model)
        or not base.provides >= CARRIES
        or "camera" not in with_optional_members(base, MODEL_DEFAULTS).mounts
    ):
        raise ModelError(f"{what}, got {shown(base)}")
    if base.carrier is not base:
        raise ModelError("the base of a pan_tilt must be a robot without a view; give the pan_tilt to the view instead")
    if base.field_of_view is not None:
        raise ModelError(
            "field_of_view must be set for the pan_tilt, whose head carries the camera, but it is set for the base; "
            "move it to the pan_tilt"
        )


def _checked_stops(name: str, given: Any, most: float, otherwise: str = "") -> tuple[float, float]:
    """Check the option ``name``, end stops (low, high) in rad within ±``most``, and return it as two floats.

    ``otherwise`` names, for messages, a further value that the option may have.
    """
    try:
        low, high = given
    except (TypeError, ValueError):
        raise ModelError(f"{name} must be (low, high) in rad{otherwise}, got {shown(given)}") from None
    kind = f"(low, high) in rad{otherwise}, each"
    low, high = (float(real(name, stop, -most, most, kind, error=ModelError)) for stop in (low, high))
    if low > high:
        raise ModelError(f"{name} must be (low, high) with low not above high, got ({low:.6g}, {high:.6g})")
    return low, high
