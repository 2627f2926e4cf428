"""Time to collision with people, as a cost: how soon robot and person would touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import base_velocity, checked_radius, clock, reach
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.world.content.content import Person
from hpop.world.content.proxemics import offset, worst


@criterion("time_to_collision", group="O", unit="1", aggregate="max", requires=("base", "people"), smooth=False)
@dataclass(frozen=True)
class TimeToCollision:
    """Urgency of the most imminent collision with a person: max over t and people of max(0, 1 - TTC/τ).

    τ is the ``horizon``. TTC = [-p·v - sqrt((p·v)² - |v|²(|p|² - R²))]/|v|² is the time until robot and person touch if
    both keep their velocities. p and v are the position and velocity of the robot relative to the person, and R is the
    sum of their radii. TTC is ∞ if the two move apart or will miss each other, and 0 if they touch. So the cost is 1 at
    contact, and 0 if no collision is due within τ. Standing people count too. The robot counts as a circle around its
    axis, so turning in place does not matter. Unit 1; the worst moment.

    Source: Karamouzas et al. 2014.

    Of several hypotheses of a person, the most urgent one counts, however small its weight is. Positions and velocities
    are the predicted ones, and their deviation is ignored; ``worst_intrusion`` takes it into account. The cost has no
    gradient, because it jumps where the robot would just graze a person. A person who leaves counts up to that moment.
    """

    horizon: float = 3.0  # s, beyond which collisions cost nothing
    robot_radius: float | None = None  # m, None for the model's

    def __post_init__(self) -> None:
        set_reals(self, "horizon", least=LEAST, most=MOST, kind="a positive time in s", error=CriterionError)
        object.__setattr__(self, "robot_radius", checked_radius(self.robot_radius))

    def cost(self, m: Motions) -> Column:
        """Return the worst urgency (M,), 0 to 1."""
        people, radius = m.world.content.people, reach(m.model, self.robot_radius)

        def urgency(person: Person, x: Column, y: Column, vx: Column, vy: Column, t: Column | None) -> Column:
            px, py = offset(person, x, y, t)
            walks_x, walks_y = person.velocity_at(t)
            left = time_to_collision(px, py, vx - walks_x, vy - walks_y, radius + person.radius, never=self.horizon)
            return np.maximum(0.0, 1.0 - left / self.horizon)

        return m.worst(lambda s: worst(people, urgency, s.base.x, s.base.y, *base_velocity(m, s), clock(s, people)))


def time_to_collision(px: Column, py: Column, vx: Column, vy: Column, reach: float, *, never: float = np.inf) -> Column:
    """Return the time (N,), s, until two round bodies touch; 0 if they already do, ``never`` if they will not.

    p and v are the position and the constant velocity of one body relative to the other, m and m/s; ``reach`` is the
    sum of the radii, m. Bodies that would only graze each other count as never touching. The time is computed as
    (|p|² - R²)/(-p·v + sqrt(...)), which equals the formula in :class:`TimeToCollision` but has no difference of nearly
    equal numbers.

    >>> time_to_collision(np.array([3.0, 3.0]), np.zeros(2), np.array([-1.0, 1.0]), np.zeros(2), 0.5)
    array([2.5, inf])
    """
    along = px * vx + py * vy
    gap = px * px + py * py - reach * reach
    inside = along * along - (vx * vx + vy * vy) * gap
    meets = np.logical_and(np.logical_and(along < 0, inside > 0), gap > 0)
    time = gap / np.where(meets, np.sqrt(np.where(meets, inside, 1.0)) - along, 1.0)
    return np.where(gap <= 0, 0.0, np.where(meets, time, never))
