"""Personal space: a region about each person that reaches farther ahead than behind, the more the faster they walk."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.others.robot import clock
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.options import one_of
from hpop.world.content import Person
from hpop.world.proxemics import in_frame, over

Combination = Literal["sum", "max"]
LEAST_AHEAD = 0.5  # m


def spreads(person: Person) -> tuple[float, float, float]:
    """Standard deviations ahead, to the side and behind, m: max(2v, 1/2), two thirds and half of it."""
    ahead = max(2.0 * math.hypot(*person.velocity), LEAST_AHEAD)
    return ahead, ahead * 2.0 / 3.0, ahead / 2.0


@criterion("personal_space", group="O", unit="s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class PersonalSpace:
    """∫ Σ_people exp(-x²/2σ² - y²/2σ_s²) dt: time in people's personal space, 1 where the person is.

    x ahead and y beside the person, ahead being where somebody who walks goes and somebody who stands faces;
    σ = σ_h = max(2v, ½) ahead and σ_r = ½ σ_h behind, σ_s = ⅔ σ_h, v the person's speed in m/s: the asymmetric
    Gaussian of Kirby, Social Robot Navigation, 2010. The place of the robot is its axis.

    ``people="sum"`` adds up the people; "max" takes the one who is disturbed most, as costmaps do.
    """

    people: Combination = "sum"  # all people, or "max", the one who is disturbed most

    def __post_init__(self) -> None:
        one_of("people", self.people, get_args(Combination), error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the intrusion, s."""
        people = m.world.content.people
        combine = np.add if self.people == "sum" else np.maximum
        return m.integrate(lambda s: over(people, _intrusion, combine, s.base.x, s.base.y, clock(s, people)))


def _intrusion(person: Person, x: Column, y: Column, t: Column | None) -> Column:
    ahead, left = in_frame(person, x, y, t)
    front, side, rear = spreads(person)
    u = np.maximum(ahead, 0.0) / front + np.minimum(ahead, 0.0) / rear  # one of the two is 0: no jump in the slope
    v = left / side
    return np.exp(-0.5 * (u * u + v * v))
