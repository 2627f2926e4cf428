"""Landmark visibility: the share of the world's landmarks that the viewer sees."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.camera import checked_fov, field_of_view, height_varies
from hpop.motions import Motions
from hpop.world.sight import sight_in_space
from hpop.world.sight.visibility import landmarks_unseen


@dataclass(frozen=True)
class _Unseen:
    """Share of landmarks that the camera does not see.

    near, far  m    a landmark counts fully up to ``near`` from the camera, falling linearly to nothing at ``far``
    fov        rad  angle of view, centred on the camera's yaw, at all elevations; 2 pi is all round, None the model's
    """

    near: float = 3.0
    far: float = 10.0
    fov: float | None = None

    def __post_init__(self) -> None:
        set_reals(self, "near", "far", least=0, most=MOST, kind="a distance in m", error=CriterionError)
        if not self.near < self.far:
            raise CriterionError(
                f"distances must satisfy 0 <= near < far, in m; got near={self.near!r}, far={self.far!r}"
            )
        object.__setattr__(self, "fov", checked_fov(self.fov))

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the unseen share (M,), s."""
        horizontal, vertical = field_of_view(m.model, self.fov)
        limits = {"near": self.near, "far": self.far, "fov": horizontal, "vertical": vertical}
        if height_varies(m.model):
            unseen = sight_in_space.landmarks_unseen
            return m.integrate(lambda s: unseen(m.world, s.camera, s.state.size, **limits), jumps=True)
        return m.integrate(lambda s: landmarks_unseen(m.world, s.camera, **limits))


@criterion("landmark_blindness", group="P", unit="s", aggregate="sum", requires=("camera", "landmarks"))
@dataclass(frozen=True)
class LandmarkBlindness(_Unseen):
    """Time for which landmarks are unseen: ∫ (1 - visibility(t)) dt.

    Seeing no landmark for a second costs 1 s, seeing half of them (by weight) 0.5 s. Unit s; a sum over motions.
    Searches minimise it in place of :class:`LandmarkVisibility`, the mean, which defines the visibility.
    """


@criterion("landmark_visibility", group="P", unit="1", aggregate="time-mean", requires=("camera", "landmarks"))
@dataclass(frozen=True)
class LandmarkVisibility(_Unseen):
    """Share of landmarks that the viewer does not see, as a mean over time; by weight, distance and angle.

    1 - (1/T) ∫ Σ_i w_i s_i [|β_i| <= h/2] [|ε_i| <= v/2] cos(ν_i)₊ g(d_i) dt / Σ_i w_i, over the landmarks i. Unit 1; a
    mean over time. 0 means that all landmarks are seen from the front and near by, all the time.

    w_i  weight of the landmark
    s_i  1 where the line of sight in three dimensions is free, 0 where it is blocked
    β_i  bearing of the landmark from the camera's yaw
    ε_i  elevation of the landmark from the camera's pitch
    ν_i  angle in the plane between the landmark's front and the direction to the camera; cos is 1 if it has no front
    d_i  distance in three dimensions; g is 1 up to ``near`` and falls linearly to 0 at ``far``

    The angles of view (h, v) are the model's ``field_of_view``, or all round if it has none. ``fov`` replaces them by
    one horizontal angle at all elevations, for a viewer of a 360-degree camera who looks in one direction.

    Accuracy: all factors except the two angles of view are one smooth field of the plane, in which the border of a
    shadow is about two cells wide. The edges of the view are sharp (on symbols smoothed), so the moment at which a
    landmark comes into view is right to half a quadrature node (2.5 degrees, a quarter of a cell).

    Where the camera's height changes (in the hand of an arm, on a lift), lines of sight are rays against solids in
    space, and β_i and ε_i are measured from the camera's own axes, roll included. No symbolic form exists then.
    """

    @property
    def integral(self) -> LandmarkBlindness:
        """Time integral, which searches minimise in place of the mean."""
        return LandmarkBlindness(self.near, self.far, self.fov)
