"""Unseen landmarks: the share of landmarks that the viewer never saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.camera import checked_fov, field_of_view, height_varies
from hpop.trajectories.history import History, SampledTrajectory
from hpop.world.content.content import Landmark
from hpop.world.sight import sight_in_space
from hpop.world.sight.bearings import in_view
from hpop.world.sight.visibility import sees

STEP = 0.05  # s between samples of the view


@criterion(
    "unseen_landmarks", group="P", unit="1", aggregate="trajectory", requires=("camera", "landmarks"), smooth=False
)
@dataclass(frozen=True)
class UnseenLandmarks:
    """Share of landmarks that were never seen, by weight: Σ_i w_i [landmark i was never seen] / Σ_i w_i.

    A landmark is seen while the line of sight to it is free, the camera is in front of it and at most ``far`` away, and
    it is in view: its bearing within half the angle of view of the camera's yaw, its elevation within that of the
    pitch. It counts as seen once that has lasted ``least`` seconds in all; with least 0 one moment is enough.

    least  s    time in view, summed over all glances
    far    m    range of sight in three dimensions
    fov    rad  angle of view, centred on the camera's yaw, at all elevations; 2 pi is all round, None the model's

    Unit 1; a criterion of the whole trajectory. Two paths to one state with equal shares may have seen different
    landmarks, so the share does not add up: a search would need the set of seen landmarks in its labels. The executed
    motion is sampled every 0.05 s, so shorter glances may be missed. Where the camera's height changes, sight and view
    are computed in space, as in :class:`~hpop.criteria.performance.landmark_visibility.LandmarkVisibility`.
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
            seen_at = self._seen_at(track, self._sees(m, track, landmark))
            unseen = unseen + landmark.weight * (m.passed[1:] < seen_at)
            total += landmark.weight
        return unseen / total

    def _sees(self, m: History, track: SampledTrajectory, landmark: Landmark) -> BoolArray:
        camera, size, view = track.camera, track.times.size, field_of_view(m.model, self.fov)
        if height_varies(m.model):
            visible = sight_in_space.sees(m.world, camera, landmark, size, far=self.far)
            return np.asarray(visible * sight_in_space.in_view(camera, landmark, size, *view) > 0.0)
        seen = sees(m.world, camera, landmark, far=self.far)
        viewed = in_view(camera, landmark, *view)
        return np.asarray(seen & (viewed > 0.0), dtype=bool)

    def _seen_at(self, track: SampledTrajectory, seen: BoolArray) -> float:
        """Return the time, s, by which a landmark has been in view for long enough; inf if it never is."""
        share = 0.5 * (1.0 * seen[1:] + seen[:-1])  # of each step
        lasted = np.concatenate([[0.0], np.cumsum(share * np.diff(track.times))])
        enough = np.flatnonzero((np.cumsum(seen) > 0) & (lasted >= self.least - 1e-9))
        return float(track.times[enough[0]]) if enough.size else np.inf
