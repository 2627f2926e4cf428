"""Visibility to people: time near people who would have to turn to see the robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import hypot, is_zero
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import clock
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.world.content.content import Person
from hpop.world.content.proxemics import HALL, Blurred, expected, in_frame


@criterion("visibility_to_people", group="O", unit="s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class VisibilityToPeople:
    """Time near people who would have to turn to see the robot: ∫ Σ_people E[½(1 - cos α) (1 - d/range)₊²] dt.

    α is the angle between a person's gaze and the direction to the robot's axis, and d its distance. A walking person
    looks in the direction of motion, a standing person where the body faces. The first factor is 0 if the robot is
    ahead of the person, ½ at the side and 1 behind. The second falls to 0 at the distance ``range``. Unit s; a sum over
    motions.

    Source: the visibility criterion of Sisbot et al. 2007 (IEEE T-RO 23:874), in which the cost grows with the angle
    and near people. Deviations: ½(1 - cos α) in place of α and a quadratic decrease, so that the cost has a gradient.
    Walls between robot and person are ignored; that paper has another criterion for hidden positions.

    E is the mean over the person's hypotheses (by weight) and over the uncertain position. It is read from two tables,
    with an error of at most 1e-4. The gaze is that on the predicted path. The mean of the cost is right whether or not
    a person's deviations at different times are correlated.
    """

    range: float = HALL["social"]  # m, distance beyond which the robot does not matter

    def __post_init__(self) -> None:
        set_reals(self, "range", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the weighted time (M,), s, in which people do not see the robot."""
        people = m.world.content.people
        return m.integrate(lambda s: expected(people, self._unseen, s.base.x, s.base.y, clock(s, people)))

    def _unseen(self, person: Person, x: Column, y: Column, t: Column | None) -> Column:
        """Return the cost per second (N,), 0 to 1, of a robot at (x, y) near a person at times t, s.

        It is 0 straight ahead of the person and beyond ``range``, and largest close behind. For an uncertain position
        of the person it is the mean.
        """
        ahead, left = in_frame(person, x, y, t)
        distance, deviation = hypot(ahead, left), person.deviation(t)
        apart = distance > 0
        cosine = np.where(apart, ahead / np.where(apart, distance, 1.0), 0.0)
        if not is_zero(deviation):
            near, seen = _mean_visibility(self.range)
            return 0.5 * np.maximum(near(distance, deviation) - cosine * seen(distance, deviation), 0.0)
        near = np.maximum(0.0, 1.0 - distance / self.range)
        return 0.5 * (1.0 - np.clip(cosine, -1.0, 1.0)) * near * near


@lru_cache(maxsize=16)
def _mean_visibility(range_: float) -> tuple[Blurred, Blurred]:
    """Return two functions for a person in an uncertain position: mean nearness, and mean nearness times cosine.

    Nearness is (1 - d/range)₊², and the cosine is that of the angle between both directions to the robot: from the
    uncertain and from the predicted position.
    """

    def near(distance: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(0.0, 1.0 - distance / range_) ** 2)

    return Blurred(near, range_, detail=range_), Blurred(near, range_, detail=range_, harmonic=1)
