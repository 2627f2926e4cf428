"""Whether people can see the robot without turning round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.others.robot import clock
from hpop.errors import CriterionError
from hpop.math import hypot
from hpop.motions import Motions
from hpop.options import LEAST, MOST, set_reals
from hpop.world.content import Person
from hpop.world.proxemics import HALL, in_frame, over


@criterion("visibility_to_people", group="O", unit="s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class VisibilityToPeople:
    """∫ Σ_people ½(1 - cos α) (1 - d/range)₊² dt: time near people who would have to turn to see the robot.

    α is the angle between a person's gaze and the direction to the robot's axis, d its distance: the factor is 0
    straight ahead, ½ at the side and 1 in the back, and matters less the farther off the robot is, nothing beyond
    ``range`` metres. The gaze is the direction of walking, and the body's heading of those who stand. After the
    visibility criterion of Sisbot et al. 2007 (IEEE T-RO 23:874), who let the cost grow with the angle and near
    people.

    Deviations: ½(1 - cos α) in place of α and a quadratic decrease, so that the cost has a gradient; the third
    criterion of that paper, places hidden behind obstacles, is not part of this one: walls between the two are not
    seen.
    """

    range: float = HALL["social"]  # m, beyond which nobody minds

    def __post_init__(self) -> None:
        set_reals(self, "range", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,), s."""
        people = m.world.content.people
        return m.integrate(lambda s: over(people, self._unseen, np.add, s.base.x, s.base.y, clock(s, people)))

    def _unseen(self, person: Person, x: Column, y: Column, t: Column | None) -> Column:
        ahead, left = in_frame(person, x, y, t)
        distance = hypot(ahead, left)
        apart = distance > 0
        cosine = np.where(apart, ahead / np.where(apart, distance, 1.0), 0.0)
        near = np.maximum(0.0, 1.0 - distance / self.range)
        return 0.5 * (1.0 - np.clip(cosine, -1.0, 1.0)) * near * near
