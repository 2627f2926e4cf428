"""Optic flow: how fast what the user sees streams past."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.math import is_symbolic
from hpop.models.field_of_view import field_of_view
from hpop.motions import Instants, Motions, Rate
from hpop.options import set_reals, set_wholes
from hpop.world.bearings import Bearings, Seen, bearings
from hpop.world.in_view import ALL_ROUND

Flow = Callable[..., Column]


@dataclass(frozen=True)
class _Flow:
    """Flow along horizontal bearings round the camera."""

    nearest: float = 0.3
    bearings: int = 16

    def __post_init__(self) -> None:
        set_reals(self, "nearest", least=0.01, most=19.99, kind="a distance in m", error=CriterionError)
        set_wholes(self, "bearings", least=4, most=360, kind="a number of directions", error=CriterionError)

    def _around(self, m: Motions, flow: Flow) -> Rate:
        """Rate of a flow: what the camera sees round it, as it moves and turns."""
        around = bearings(m.world, camera_height(m), self.bearings)
        horizontal, _ = field_of_view(m.model)

        def rate(s: Instants) -> Column:
            twist = s.twist("camera")
            rotation = (0.0, 0.0, 0.0) if m.camera.steady else twist.rotation
            seen = None if horizontal >= ALL_ROUND else Seen(s.camera.yaw, horizontal)
            return flow(around, s.camera.x, s.camera.y, twist.velocity, rotation, self.nearest, seen)

        return rate


@criterion("optic_flow", group="C", unit="rad", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class OpticFlow(_Flow):
    """∫ mean over bearings |flow(β)| dt, rad: all that streams past a user, translation and rotation.

    nearest   m  nearer surfaces count as this near: up to the wall itself the flow would grow without bound
    bearings  horizontal directions, evenly spaced in the world

    The flow on a sphere of a camera that translates with v is v sin β / d at the bearing β from its direction of
    motion, d the distance to what is seen there; that of a rotation is ω at any depth: v sin β / d(β) - ω along the
    horizon. A camera that tilts or rises has a flow across it as well, ω_t sin β' + v_z / d with β' the bearing from
    the axis about which it tilts; |flow| is the length of both. d is the distance to the nearest obstacle at the
    camera's height, 20 m where there is none, so floor and ceiling are left out. A turn about the camera costs its
    angle, a tilt 2/π of it; a move costs the same at any speed, since slow flow lasts longer. In the middle of a
    corridor of half-width w a metre costs 1/(2 w) rad. Among obstacles a move is within 3 % of exact rays, and .3 to
    .6 % too large on average (`hpop.world.bearings`).

    The mean is over the bearings that the model's ``field_of_view`` holds, those within h/2 of the camera's yaw, each
    of the ``bearings`` weighted by how much of the sector about it is in view; all, if the model has none.
    """

    def cost(self, m: Motions) -> Column:
        """Flow (M,), rad."""
        if m.camera.stays and m.camera.upright:
            return m.camera.turned
        return m.integrate(self._around(m, Bearings.mean_flow))


@criterion("peak_optic_flow", group="C", unit="rad/s", aggregate="max", requires=("camera",))
@dataclass(frozen=True)
class PeakOpticFlow(_Flow):
    """max over time and bearings in view of |flow(β)|, rad/s: the fastest streaming; see `OpticFlow` for the terms.

    In the middle of a corridor of half-width w it is v / w, at a right angle to the motion. Between two of 16 bearings
    lie 22.5 degrees: a wall in any other direction than theirs is missed by up to 4 % of its flow. Where a bearing
    leaves one surface for another the change is blurred over four steps of the field, so a peak as short as that is
    blunted: by 5 % on average among boxes, by 30 % for the worst of 60 moves.
    """

    def cost(self, m: Motions) -> Column:
        """Fastest flow (M,), rad/s."""
        if m.camera.stays and m.camera.upright:
            return fastest_turn(m)
        return m.worst(self._around(m, Bearings.peak_flow))


def fastest_turn(m: Motions) -> Column:
    """Largest turn rate (M,), rad/s, about the vertical: a phase's share grows fastest at one of its ends."""
    fastest: Column = 0.0
    for phase in m.phases:
        for u in (0.0, 1.0):
            fastest = np.maximum(fastest, m.camera.turned * phase.share_rates(u)[0])
    return fastest


def camera_height(m: Motions) -> float:
    """Height of the camera above the floor, m: the same for all motions of a batch.

    Raises CriterionError where it is not.
    """
    ends = m.camera.start.z, m.camera.end.z
    if any(map(is_symbolic, ends)) or np.ptp(np.concatenate(ends)) > 1e-6:
        raise CriterionError(
            "surfaces round the camera are found at one camera height, but this camera goes up and down"
        )
    return float(np.round(ends[0][0], 6))
