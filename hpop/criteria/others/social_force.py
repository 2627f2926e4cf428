"""Social force: how hard people are pushed to evade the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.others.robot import base_velocity, clock
from hpop.errors import CriterionError
from hpop.math import hypot
from hpop.motions import Motions
from hpop.options import LEAST, MOST, set_reals
from hpop.world.blurred import averaged
from hpop.world.content import Person
from hpop.world.proxemics import expected, offset

STANDSTILL = 1e-9  # a length of D below which the force is 0: its range γ|D| is


@criterion("social_force", group="O", unit="m/s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class SocialForce:
    """∫ Σ_people E[|f|] dt: the social force, per unit of mass, that the robot exerts on people, over time.

    Moussaïd et al. 2009 (Proc. R. Soc. B 276): f = -A exp(-d/B) [exp(-(n′Bθ)²) t + K exp(-(nBθ)²) n], with e the
    direction and d the distance from person to robot (centres), Δv the velocity of the person less that of the
    robot, D = λΔv + e, t = D/|D|, n its left normal, θ the angle from t to e, B = γ|D|; measured on people: A 4.5
    m/s², γ .35, λ 2, n 2, n′ 3.

    Choices: the integral is over time and not along the path, so that a robot that stands beside people costs as
    well (the "social work" of human-aware navigation sums the force over time steps in the same way). K, the sign
    of θ, counts as ±1 at θ = 0 too, where the paper has 0 at that one angle: on a straight way to a person θ is 0
    up to rounding.

    The mean E is over what people may do: their futures by their weights, and the places where each may be by a
    cubature of 72 places: where the deviation is half a metre or less it is within 2 % of the strongest push, rms over
    places within three metres, and within .2 % of it on average. It is the mean of the whole cost, whether a person's
    deviations at different times have to do with each other or not.
    """

    strength: float = 4.5  # A, m/s²
    stretch: float = 0.35  # γ, m
    anticipation: float = 2.0  # λ, s/m
    turning: float = 2.0  # n, 1/m
    slowing: float = 3.0  # n′, 1/m

    def __post_init__(self) -> None:
        set_reals(self, "strength", "stretch", least=LEAST, most=MOST, kind="a positive number", error=CriterionError)
        others = ("anticipation", "turning", "slowing")
        set_reals(self, *others, least=0, most=MOST, kind="a number", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the force per unit of mass, m/s."""
        people, force = m.world.content.people, averaged(self._force)
        return m.integrate(
            lambda s: expected(people, force, s.base.x, s.base.y, *base_velocity(m, s), clock(s, people))
        )

    def _force(self, person: Person, x: Column, y: Column, vx: Column, vy: Column, t: Column | None) -> Column:
        """|f| (N,), m/s²."""
        dx, dy = offset(person, x, y, t)
        walks_x, walks_y = person.velocity_at(t)
        distance = hypot(dx, dy)
        apart = distance > 0
        inverse = np.where(apart, 1.0 / np.where(apart, distance, 1.0), 0.0)
        ex, ey = dx * inverse, dy * inverse
        Dx = self.anticipation * (walks_x - vx) + ex
        Dy = self.anticipation * (walks_y - vy) + ey
        length = hypot(Dx, Dy)
        pushes = length > STANDSTILL
        reach = self.stretch * np.where(pushes, length, 1.0)  # B
        forward, aside = ex * Dx + ey * Dy, Dx * ey - Dy * ex
        defined = np.logical_and(pushes, apart)
        bend = reach * np.arctan2(np.where(defined, aside, 0.0), np.where(defined, forward, 1.0))  # B θ
        square = -2.0 * bend * bend
        squared = np.exp(square * self.slowing**2) + np.exp(square * self.turning**2)  # |f|² is the sum of two squares
        return np.where(pushes, self.strength * np.exp(-distance / reach) * np.sqrt(squared + 1e-300), 0.0)
