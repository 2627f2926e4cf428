"""Unseen landmarks: which share of the world's landmarks the viewer never saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.visits import landmark_seen
from hpop.errors import CriterionError
from hpop.models.camera import checked_fov
from hpop.trajectories.history import History, SampledTrajectory

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
    angles are computed in space, as in :class:`~hpop.criteria.performance.landmark_visibility.LandmarkVisibility`.
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
            seen_at = self._seen_at(
                track,
                landmark_seen(m.world, m.model, track.camera, track.times.size, landmark, far=self.far, fov=self.fov),
            )
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
