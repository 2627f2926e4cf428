"""Personal space: a region about each person that reaches farther ahead than behind, and farther at higher speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import erf, hypot, is_zero
from hpop.base.options import one_of
from hpop.criteria.base import criterion
from hpop.criteria.others import clock
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.world.content.content import Person
from hpop.world.content.proxemics import expected, in_frame, worst

Combination = Literal["sum", "max"]
LEAST_AHEAD = 0.5  # m
TINY = 1e-6  # m: smallest deviation, where deviations grow with time


def spreads(person: Person, t: Column | None = None) -> tuple[Column, Column, Column]:
    """Return the widths, m, of a person's personal space ahead, to the side and behind, at times t (N,), s.

    They are the standard deviations of the Gaussian: σ_h = max(2v, 1/2), 2/3 σ_h and 1/2 σ_h at the speed v, m/s.
    """
    vx, vy = person.velocity_at(t)
    steady = isinstance(vx, float)
    ahead = max(2.0 * math.hypot(vx, vy), LEAST_AHEAD) if steady else np.maximum(2.0 * hypot(vx, vy), LEAST_AHEAD)
    return ahead, ahead * 2.0 / 3.0, ahead / 2.0


@criterion("personal_space", group="O", unit="s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class PersonalSpace:
    """Time in people's personal space, weighted by nearness: ∫ Σ_people E[exp(-x²/2σ² - y²/2σ_s²)] dt.

    x is the distance of the base's axis ahead of the person, y its distance to the side. Ahead is the direction in
    which the person walks, or faces while standing. The widths are σ = σ_h = max(2v, ½) ahead, σ = ½ σ_h behind, and
    σ_s = ⅔ σ_h to the side, where v is the person's speed in m/s. A second at the person's position costs 1 s. Unit s;
    a sum over motions.

    Source: the asymmetric Gaussian of Kirby, Social Robot Navigation, 2010.

    E is the mean over the person's hypotheses (by weight) and over the uncertain position, in closed form. The mean of
    the cost is right whether or not a person's deviations at different times are correlated.

    With ``people="sum"`` the intrusions of all people are added. With "max" only the person who is disturbed most
    counts, as in costmaps, and of several hypotheses the worst one, however small its weight is.
    """

    people: Combination = "sum"  # over all people, or "max": only the person who is disturbed most

    def __post_init__(self) -> None:
        one_of("people", self.people, get_args(Combination), error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the weighted time (M,) in people's personal space, s."""
        people = m.world.content.people
        combined = expected if self.people == "sum" else worst
        return m.integrate(lambda s: combined(people, _intrusion, s.base.x, s.base.y, clock(s, people)))


def _intrusion(person: Person, x: Column, y: Column, t: Column | None) -> Column:
    """Return the intrusion (N,), 0 to 1, of a robot at positions (x, y) into a person's space at times t, s."""
    ahead, left = in_frame(person, x, y, t)
    front, side, rear = spreads(person, t)
    deviation = person.deviation(t)
    if not is_zero(deviation):
        return _mean_intrusion(ahead, left, (front, side, rear), deviation)
    u = np.maximum(ahead, 0.0) / front + np.minimum(ahead, 0.0) / rear  # one of the two is 0: no jump in the slope
    v = left / side
    return np.exp(-0.5 * (u * u + v * v))


def _mean_intrusion(ahead: Column, left: Column, widths: tuple[Column, Column, Column], deviation: Column) -> Column:
    """Return the mean (N,) of the intrusion if a person's position is uncertain.

    ahead, left  m, predicted position of the robot relative to the person
    widths       m, of the personal space ahead, to the side and behind
    deviation    (N,)  m, standard deviation of the position along each axis

    The mean of a Gaussian over a normal distribution is a Gaussian whose variance is the sum of both. Each half of the
    space, ahead and behind, contributes in proportion to the probability that the robot is in this half.
    """
    front, side, rear = widths
    deviation = np.maximum(deviation, TINY)
    aside = np.sqrt(side * side + deviation * deviation)
    halves = 0.0
    for width, sign in ((front, 1.0), (rear, -1.0)):
        wide = np.sqrt(width * width + deviation * deviation)
        share = 0.5 * (1.0 + sign * erf(ahead * width / (math.sqrt(2.0) * deviation * wide)))
        halves = halves + width / wide * np.exp(-0.5 * (ahead / wide) ** 2) * share
    return halves * side / aside * np.exp(-0.5 * (left / aside) ** 2)
