"""Visibility of landmarks: how much the viewer sees of what is worth seeing, as a mean and as its integral."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.camera import checked_fov, field_of_view, rises
from hpop.motions import Motions
from hpop.world.sight import sight_in_space
from hpop.world.sight.visibility import landmarks_unseen


@dataclass(frozen=True)
class _Unseen:
    """A viewer who looks for the world's landmarks.

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
        """Time integral (M,) of the unseen share, s."""
        horizontal, vertical = field_of_view(m.model, self.fov)
        limits = {"near": self.near, "far": self.far, "fov": horizontal, "vertical": vertical}
        if rises(m.model):
            unseen = sight_in_space.landmarks_unseen
            return m.integrate(lambda s: unseen(m.world, s.camera, s.state.size, **limits), jumps=True)
        return m.integrate(lambda s: landmarks_unseen(m.world, s.camera, **limits))


@criterion("landmark_blindness", group="P", unit="s", aggregate="sum", requires=("camera", "landmarks"))
@dataclass(frozen=True)
class LandmarkBlindness(_Unseen):
    """∫ (1 - visibility(t)) dt: the time for which seeing no landmark at all would be as bad.

    The additive part of :class:`LandmarkVisibility`, so exact searches can minimise it.
    """


@criterion("landmark_visibility", group="P", unit="1", aggregate="time-mean", requires=("camera", "landmarks"))
@dataclass(frozen=True)
class LandmarkVisibility(_Unseen):
    """1 - (1/T) ∫ Σ_i w_i s_i [|β_i| <= h/2] [|ε_i| <= v/2] cos(ν_i)₊ g(d_i) dt / Σ_i w_i, over the landmarks i.

    s_i is the line of sight in three dimensions (`hpop.world.sight.visibility`), β_i the bearing off the camera's yaw,
    ε_i the elevation off its pitch, ν_i the angle in the plane between the landmark's front and the direction to the
    camera (cos 1 if it has no front), d_i the distance in three dimensions, g = 1 up to ``near``, falling linearly to 0
    at ``far``. (h, v) is the model's ``field_of_view``, all round if it has none; or ``fov`` at all elevations: a
    viewer of a 360-degree camera looks somewhere.

    All factors but the view's are one smooth field of the plane: the border of a shadow is about two cells wide. The
    edges of the view are sharp, and smoothed on symbols only, so a landmark that comes into view within a motion is
    timed to half a quadrature node (2.5 degrees, a quarter of a cell). Weights are the landmarks'.

    Of a camera whose height changes (in the hand of an arm, on a lift) the lines of sight are rays against solids in
    space, and β_i and ε_i are the angles off its own axes, rolled as it is; there are no symbols for that.
    """

    @property
    def integral(self) -> LandmarkBlindness:
        """What adds up in its place."""
        return LandmarkBlindness(self.near, self.far, self.fov)
