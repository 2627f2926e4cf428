"""Surroundings that move past the user: optic flow, as an integral and at its fastest moment, and passing distance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.options import LEAST, MOST, set_reals, set_wholes
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError
from hpop.models.rigid import FieldOfView, camera_height, field_of_view, height_varies, view_angles
from hpop.motions import Instants, Motions, Rate
from hpop.world.geometry.rays_in_space import Surfaces, over_sphere, rows, surfaces_of
from hpop.world.sight.bearings import ALL_ROUND, MARGIN, REACH, ViewAngles, as_seen, bearings, is_faint


def rays_of_view(view: FieldOfView, bearings: int) -> FloatArray:
    """Return directions spread evenly over a field of view, as unit vectors (K, 3) in the camera's frame.

    bearings  number of directions along the whole horizon that would be as dense; K is at least this number
    """
    width, height = view
    spacing = 2.0 * math.pi / bearings
    return over_sphere(max(bearings, round(width * 2.0 * math.sin(0.5 * height) / spacing**2)), width, height)


def flow_in_space(surfaces: Surfaces, view: FloatArray, nearest: float, *, largest: bool) -> Rate:
    """Return a rate: a function of moments within motions that returns the optic flow, rad/s, found by rays in space.

    view     (K, 3)  directions in the camera's frame
    nearest  m, surfaces that are nearer count as this near
    largest  True for the largest flow of all directions, False for the mean
    """

    def rate(s: Instants) -> FloatArray:
        pose, twist, size = s.camera, s.twist("camera"), s.state.size
        position, velocity, rotation, *axes = (
            rows(vector, size)
            for vector in ((pose.x, pose.y, pose.z), twist.velocity, twist.rotation, pose.ahead, pose.left, pose.up)
        )
        limits = None if s.model.restrictor is None else rows((*view_angles(s, s.model), 0.0), size)[:, :2]
        return surfaces.flow(
            position, np.stack(axes, axis=1), velocity, rotation, view, REACH, nearest, limits, largest=largest
        )

    return rate


@dataclass(frozen=True)
class _Flow:
    """Optic flow round the camera: in horizontal directions, or in space if the height of the camera changes."""

    nearest: float = 0.3  # m, surfaces that are nearer count as this near
    bearings: int = 16  # number of horizontal directions

    def __post_init__(self) -> None:
        set_reals(self, "nearest", least=0.01, most=19.99, kind="a distance in m", error=CriterionError)
        set_wholes(self, "bearings", least=4, most=360, kind="a number of directions", error=CriterionError)

    def _rate(self, m: Motions, *, largest: bool) -> Rate:
        """Return a rate: a function of moments within motions that returns the mean or the largest flow, rad/s."""
        if height_varies(m.model):
            view = rays_of_view(field_of_view(m.model), self.bearings)
            return flow_in_space(surfaces_of(m.world), view, self.nearest, largest=largest)
        around = bearings(m.world, camera_height(m), self.bearings)
        flow = around.peak_flow if largest else around.mean_flow
        limited = field_of_view(m.model)[0] < ALL_ROUND or m.model.restrictor is not None

        def rate(s: Instants) -> Column:
            twist = s.twist("camera")
            rotation = (0.0, 0.0, 0.0) if m.camera.steady else twist.rotation
            seen = ViewAngles(s.camera.yaw, view_angles(s, m.model)[0]) if limited else None
            return flow(s.camera.x, s.camera.y, twist.velocity, rotation, self.nearest, seen)

        return rate

    @staticmethod
    def _turns_alone(m: Motions) -> bool:
        """Return whether the camera only turns in place about the vertical; the flow is then equal to its turn rate."""
        return m.camera.stays and m.camera.upright and not height_varies(m.model)


@criterion("optic_flow", group="C", unit="rad", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class OpticFlow(_Flow):
    """Optic flow past the user, as a mean over directions: ∫ mean over bearings β of |flow(β)| dt.

    nearest   m  surfaces that are nearer count as this near; otherwise the flow would be infinite at a wall
    bearings  number of horizontal directions, evenly spaced in the world

    Unit rad; a sum over motions. A turn about the camera costs its angle, a tilt 2/π of it. A straight move has one
    cost at all speeds, since slower flow lasts longer. In the middle of a corridor of half-width w it is 1/(2 w) rad a
    metre.

    A camera that moves with velocity v and turns at the rate ω has the flow v sin β / d(β) - ω along the horizon. β is
    the bearing from the direction of motion. d is the distance to the nearest obstacle at the camera's height, or 20 m
    if there is none; floor and ceiling are left out. A camera that tilts or rises also has a flow across the horizon,
    ω_t sin β' + v_z / d, where ω_t is the tilt rate, v_z the velocity upwards, and β' the bearing from the axis of the
    tilt. |flow| is the length of both components. Among obstacles the cost of a move is within 3 % of that of exact
    rays, and 0.3 to 0.6 % too large on average (`hpop.world.sight.bearings`).

    Obstacles may have a ``contrast`` c(β), 0 to 1, in the map: the mean is then over c(β) |flow(β)|, also in turns.
    High contrast near the camera is worse (LaValle, Virtual Reality, section 4.6.3). For a camera whose height changes,
    and in :class:`PeakOpticFlow`, all contrasts count as 1.

    The mean is over the bearings within the model's ``field_of_view`` (h/2 to either side of the camera's yaw), each
    weighted by the part of its sector that is in view. It is over all bearings if the model has no field of view. If
    the model has a ``restrictor``, h and v change with the camera's speed and angular speed.

    If the camera's height changes (on an arm or a lift), the mean is over directions d in the camera's field of view,
    as far apart as two bearings. The flow is |ω × d + (v - (v·d) d) / r(d)|, where r is the distance to the nearest
    solid in direction d, without floor and ceiling. A rotation then costs π/4 of its angle if the camera sees all
    round, because directions near the axis of the rotation hardly move. Programs on CasADi symbols cannot use it then.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the flow (M,), rad."""
        if self._turns_alone(m) and not is_faint(m.world.ground):
            return m.camera.turned
        return m.integrate(self._rate(m, largest=False))


@criterion("peak_optic_flow", group="C", unit="rad/s", aggregate="max", requires=("camera",))
@dataclass(frozen=True)
class PeakOpticFlow(_Flow):
    """Fastest optic flow: max over time and over the bearings β in view of |flow(β)|, as in :class:`OpticFlow`.

    Unit rad/s; the worst moment. In the middle of a corridor of half-width w it is v / w, in the direction at a right
    angle to the motion.

    Accuracy: neighbours among 16 bearings are 22.5 degrees apart, so a flow between two of them is found up to 4 % too
    small. Where a bearing moves from one surface to another, the change is blurred over four cells of the distance
    grid. Such a short peak is found 5 % too small on average among boxes, and 30 % in the worst of 60 moves. If the
    camera's height changes, the maximum is over the directions that :class:`OpticFlow` then uses.
    """

    def cost(self, m: Motions) -> Column:
        """Return the fastest flow (M,), rad/s."""
        if self._turns_alone(m):
            return fastest_turn(m)
        return m.worst(self._rate(m, largest=True))


def fastest_turn(m: Motions) -> Column:
    """Return the largest turn rate (M,) of the camera, rad/s, in turns in place about the vertical.

    Each phase of the timing reaches its largest rate at one of its ends.
    """
    fastest: Column = 0.0
    for phase in m.phases:
        for u in (0.0, 1.0):
            fastest = np.maximum(fastest, m.camera.turned * phase.share_rates(u)[0])
    return fastest


@criterion("passing_distance", group="C", unit="m", aggregate="max", requires=("camera",), quantum=1e-3)
@dataclass(frozen=True)
class PassingDistance:
    """Shortfall of the distance at which the moving camera passes objects: max over time of (enough - d(camera))₊.

    enough  m  distance from which on passing feels natural, at most 5
    band    m  obstacles count if they overlap the heights from camera - band to camera + band

    d is the distance from the camera to the nearest visible obstacle. Unit m; the worst moment. Unlike ``clearance`` it
    is measured from the camera, not from the base. Obstacles away from eye level (a kerb, a lintel) do not count, nor
    do keep-out zones, which are invisible, nor turns in place. Speed does not matter; it does in ``peak_optic_flow``.

    Source: the naturalness of a ride depends on the distance at which walls and objects pass (user studies of immersive
    telepresence, 2020-2022).
    """

    quantity: ClassVar[str] = "shortfall"
    enough: float = 1.0  # m from visible obstacles, beyond which it costs nothing
    band: float = 0.5

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MARGIN, kind="a distance in m", error=CriterionError)
        set_reals(self, "band", least=0, most=MOST, kind="a height in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the largest shortfall of the distance (M,), m."""
        z = camera_height(m)
        heights = (z - self.band, z + self.band)
        seen = as_seen(m.world, heights)
        worst = m.worst(lambda s: np.maximum(self.enough - seen.clearance(s.camera.x, s.camera.y, z=heights), 0.0))
        return np.where(m.camera.length > 0.0, worst, 0.0)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return a convex upper bound on the cost of a polyline.

        Distances are measured to half-planes that contain the visible obstacles.
        """
        z = float(np.round(path.model.pose("camera", path.start).z[0], 6))
        heights = (z - self.band, z + self.band)
        seen = as_seen(path.world, heights).free_space(heights)
        return ConvexCost(path.shortfall(self.enough, seen, "camera"), exact=False)
