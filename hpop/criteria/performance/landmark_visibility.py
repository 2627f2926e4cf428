"""Landmark visibility: which share of the world's landmarks the viewer sees, as a mean over time and as an integral."""

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

    near, far  m    a landmark up to ``near`` from the camera counts fully; this falls linearly to nothing at ``far``
    fov        rad  horizontal angle of view, without a vertical limit; 2 pi for all round; None for the model's two
                    angles
    """

    near: float = 3.0
    far: float = 10.0
    fov: float | None = None

    def __post_init__(self) -> None:
        set_reals(self, "near", "far", least=0, most=MOST, kind="a distance in m", error=CriterionError)
        if not self.near < self.far:
            raise CriterionError(f"near must be less than far, in m, got near={self.near!r}, far={self.far!r}")
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

    A second in which no landmark is seen costs 1 s; one in which half of them (by weight) are seen costs 0.5 s. Unit s;
    a sum over motions. Searches minimise it in place of the mean, :class:`LandmarkVisibility`, which defines the
    visibility.
    """


@criterion("landmark_visibility", group="P", unit="1", aggregate="time-mean", requires=("camera", "landmarks"))
@dataclass(frozen=True)
class LandmarkVisibility(_Unseen):
    """Share of landmarks that the viewer does not see, as a mean over time; weighted by importance, distance and angle.

    It is 1 - (1/T) ∫ Σ_i w_i s_i [|β_i| <= h/2] [|ε_i| <= v/2] cos(ν_i)₊ g(d_i) dt / Σ_i w_i, summed over the landmarks
    i. Unit 1; a mean over time. 0 means that all landmarks are seen all the time, from the front and near by.

    w_i  weight of the landmark
    s_i  1 where the line of sight in three dimensions is free, 0 where it is blocked
    β_i  bearing of the landmark from the camera's yaw
    ε_i  elevation of the landmark from the camera's pitch
    ν_i  angle in the plane between the landmark's front and the direction to the camera; cos is 1 if it has no front
    d_i  distance in three dimensions; g is 1 up to ``near`` and falls linearly to 0 at ``far``

    The angles of view (h, v) are the model's ``field_of_view``, or all round if it has none. ``fov`` replaces them by
    one horizontal angle at all elevations, for a viewer of a 360-degree camera who looks in one direction.

    Accuracy: all factors except the two angles of view are stored as one smooth field over the plane, in which the
    border of a shadow is about two grid cells wide. The edges of the view are sharp (on CasADi symbols smoothed). So
    the moment at which a landmark comes into view is accurate to half the distance of quadrature nodes (2.5 degrees, or
    a quarter of a cell).

    If the camera's height changes (on an arm or a lift), lines of sight are rays against solids in space, and β_i and
    ε_i are measured from the camera's own axes, roll included. Programs on CasADi symbols cannot use it then.
    """

    @property
    def integral(self) -> LandmarkBlindness:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return LandmarkBlindness(self.near, self.far, self.fov)
