"""Landmarks and stops: the share of landmarks in view, those never seen, and optional stops that are missed."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from hpop.base.arrays import BoolArray, Column
from hpop.base.options import LEAST, MOST, set_reals, whole
from hpop.base.text import shown
from hpop.criteria.base import criterion
from hpop.criteria.visits import all_visits, landmark_seen
from hpop.errors import CriterionError, did_you_mean
from hpop.goals.tour import Tour
from hpop.models.rigid import checked_fov, height_varies, view_angles
from hpop.motions import Instants, Motions
from hpop.trajectories.history import History, SampledTrajectory
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

        def limits(s: Instants) -> dict[str, Column]:
            horizontal, vertical = view_angles(s, m.model, self.fov)
            return {"near": self.near, "far": self.far, "fov": horizontal, "vertical": vertical}

        if height_varies(m.model):
            unseen = sight_in_space.landmarks_unseen
            return m.integrate(lambda s: unseen(m.world, s.camera, s.state.size, **limits(s)), jumps=True)
        return m.integrate(lambda s: landmarks_unseen(m.world, s.camera, **limits(s)))


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
    one horizontal angle at all elevations, for a viewer of a 360-degree camera who looks in one direction. Without
    ``fov``, the model's ``restrictor`` narrows h and v by the camera's speed and angular speed.

    Accuracy: all factors except the two angles of view are stored as one smooth field over the plane, in which the
    border of a shadow is about two grid cells wide. The edges of the view are sharp (on CasADi symbols smoothed). So
    the moment at which a landmark comes into view is accurate to half the distance of quadrature nodes (2.5 degrees, or
    a quarter of a cell).

    If the camera's height changes (on an arm or a lift), lines of sight are rays against solids in space, and β_i and
    ε_i are measured from the camera's own axes, roll included. Programs on CasADi symbols cannot use it then.
    """

    quantity: ClassVar[str] = "unseen share"

    @property
    def integral(self) -> LandmarkBlindness:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return LandmarkBlindness(self.near, self.far, self.fov)


STEP = 0.05  # s between samples of the view


@criterion(
    "unseen_landmarks", group="P", unit="1", aggregate="trajectory", requires=("camera", "landmarks"), smooth=False
)
@dataclass(frozen=True)
class UnseenLandmarks:
    """Share of landmarks that were never seen, by weight: Σ_i w_i [landmark i was never seen] / Σ_i w_i.

    A landmark is in view while nothing hides it, the camera is in front of it and at most ``far`` away, and it is in
    the field of view: its bearing is within half the horizontal angle of view from the camera's yaw and, unless
    ``fov`` is given, its elevation within half the vertical angle from the pitch. It counts as seen once it has been in
    view for ``least`` seconds in all; with least 0 one moment is enough.

    least  s    time in view, summed over all glances
    far    m    largest distance, in three dimensions
    fov    rad  horizontal angle of view, without a vertical limit; 2 pi for all round; None for the model's two angles

    Unit 1; a criterion of the whole trajectory. Two paths to one state with equal costs may have seen different
    landmarks, so the cost does not add up, and a search would have to remember which landmarks were seen. The executed
    motion is sampled every 0.05 s, so shorter glances may be missed. If the camera's height changes, lines of sight and
    angles are computed in space, as in :class:`~hpop.criteria.performance.landmarks.LandmarkVisibility`.
    """

    least: float = 0.0
    far: float = 10.0
    fov: float | None = None

    def __post_init__(self) -> None:
        set_reals(self, "least", least=0, most=MOST, kind="a time in s", error=CriterionError)
        set_reals(self, "far", least=LEAST, most=MOST, kind="a distance in m", error=CriterionError)
        object.__setattr__(self, "fov", checked_fov(self.fov))

    def cost(self, m: History) -> Column:
        """Return the weighted share (M,) of the landmarks not seen by the end of each motion."""
        track = m.track(STEP)
        unseen = np.zeros(len(m))
        total = 0.0
        for landmark in m.world.content.landmarks:
            view = view_angles(track, m.model, self.fov)
            seen = landmark_seen(m.world, m.model, track.camera, track.times.size, landmark, far=self.far, view=view)
            seen_at = self._seen_at(track, seen)
            unseen = unseen + landmark.weight * (m.passed[1:] < seen_at)
            total += landmark.weight
        return unseen / total

    def _seen_at(self, track: SampledTrajectory, seen: BoolArray) -> float:
        """Return the time, s, at which a landmark has been in view for ``least`` s in all; inf if it never is.

        track  sampled trajectory
        seen   whether the landmark is in view at each sample
        """
        share = 0.5 * (1.0 * seen[1:] + seen[:-1])  # of each step
        lasted = np.concatenate([[0.0], np.cumsum(share * np.diff(track.times))])
        enough = np.flatnonzero((np.cumsum(seen) > 0) & (lasted >= self.least - 1e-9))
        return float(track.times[enough[0]]) if enough.size else np.inf


MOST_WEIGHT = 1000


@criterion("stops_missed", group="P", unit="1", aggregate="trajectory", smooth=False, quantum=1.0, role="stops_missed")
@dataclass(frozen=True)
class StopsMissed:
    """Number of optional stops of the problem's tour that the trajectory does not visit, or the sum of their weights.

    weights  weights of optional stops by name, whole numbers from 1; a stop without an entry has weight 1

    Unit 1, a count; a criterion of the whole trajectory. Searches on graphs can minimise it exactly nevertheless: each
    state of the graph is combined with the set of stops visited so far, and skipping a stop costs its weight.
    """

    tour: ClassVar[Tour | None] = None

    weights: Mapping[str, int] | None = None

    def __post_init__(self) -> None:
        if self.weights is None:
            return
        if not isinstance(self.weights, Mapping):
            raise CriterionError(
                f"weights must map names of optional stops to whole numbers, such as {{'the vase': 2}}, got "
                f"{shown(self.weights)}"
            )
        checked = {
            name: whole(f"the weight of {name}", weight, 1, MOST_WEIGHT, error=CriterionError)
            for name, weight in self.weights.items()
        }
        object.__setattr__(self, "weights", checked)

    def of_tour(self, tour: Tour | None) -> Self:
        """Return a copy of the criterion for the tour of a problem.

        Raises CriterionError if the tour has no optional stops, or if ``weights`` names a stop that is not among them.
        """
        names = [] if tour is None else [tour.names[i] for i in tour.optional]
        if not names:
            lack = "the problem has no tour" if tour is None else "no stop of this tour is optional"
            raise CriterionError(
                f"stops_missed needs a tour with optional stops, but {lack}; set optional: true for a stop, or leave "
                "the criterion out"
            )
        for name in self.weights or {}:
            if name not in names:
                raise CriterionError(
                    f"weights of stops_missed must name optional stops, got {shown(name)}.{did_you_mean(name, names)} "
                    f"The optional stops are {', '.join(names)}"
                )
        made = copy(self)
        object.__setattr__(made, "tour", tour)
        return made

    def cost(self, m: History) -> Column:
        """Return the sum of the weights (M,) of the optional stops that are not visited by the end of each motion.

        It is 0 for a batch of motions, which have no history: searches add the weights.
        """
        if self.tour is None or isinstance(m, Motions):  # a motion by itself has no cost: searches add the weights
            return np.zeros(len(m))
        weights = self.weights or {}
        (found,) = all_visits(self.tour, m.world, [m.trajectory], weights)
        missed = np.full(len(m), found.missed)
        for visit in found.visits:
            if visit.stop in self.tour.optional:
                missed += weights.get(self.tour.names[visit.stop], 1.0) * (m.t0 + m.duration < visit.end - 1e-9)
        return missed

    def without_motions(self, m: History) -> float:
        """Return the cost of a trajectory without motions, which visits stops without dwell at its only state."""
        return 0.0 if self.tour is None else all_visits(self.tour, m.world, [m.trajectory], self.weights)[0].missed
