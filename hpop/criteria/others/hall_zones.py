"""Time spent in people's intimate, personal and social zones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hypot, is_zero
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import checked_radius, clock, reach
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.world.content.content import Person
from hpop.world.content.proxemics import HALL, Blurred, expected, offset


@criterion("hall_zones", group="O", unit="s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class HallZones:
    """Time in people's zones, weighted by zone: ∫ Σ_people E[w(gap)] dt, summed over all people.

    The gap is the distance from the person's body to the robot, which counts as a disc about its axis. The radius of
    the disc is ``robot_radius``, by default the reach of the model. The weight w depends on the zone: up to 0.45 m
    (intimate), 1.2 m (personal) and 3.6 m (social); beyond, it is 0. Unit s; a sum over motions.

    Source: the zones of Hall 1966 (The Hidden Dimension). The weights are this library's choice. Deviation: at the
    border of a zone the weight changes gradually over ``softness`` metres (a polynomial of degree 5), so that the cost
    has a gradient. :func:`hpop.criteria.others.metrics.zone_fractions` has sharp zones.

    E is the mean over the person's hypotheses (by weight) and over the uncertain position. It is read from tables,
    whose error is at most 1e-4 with the default softness, 3e-3 with 0.05 m, and 0.01 with 0.01 m. The mean of the cost
    is right whether or not a person's deviations at different times are correlated.
    """

    intimate: float = 1.0  # weight up to .45 m from a person
    personal: float = 0.5  # weight from .45 m to 1.2 m
    social: float = 0.1  # weight from 1.2 m to 3.6 m
    softness: float = 0.3  # m, width of the border over which the weight changes
    robot_radius: float | None = None  # m, None for the model's

    def __post_init__(self) -> None:
        zones = ("intimate", "personal", "social")
        set_reals(self, *zones, least=0, most=MOST, kind="a weight", error=CriterionError)
        if not (self.intimate >= self.personal >= self.social and self.intimate > 0):
            raise CriterionError(
                "the weights must satisfy intimate >= personal >= social and intimate > 0, got "
                f"intimate={self.intimate!r}, personal={self.personal!r}, social={self.social!r}"
            )
        set_reals(self, "softness", least=LEAST, most=2 * HALL["intimate"], kind="a length in m", error=CriterionError)
        object.__setattr__(self, "robot_radius", checked_radius(self.robot_radius))

    def cost(self, m: Motions) -> Column:
        """Return the weighted time (M,) in zones, s."""
        people, radius = m.world.content.people, reach(m.model, self.robot_radius)

        def intrusion(person: Person, x: Column, y: Column, t: Column | None) -> Column:
            distance, deviation = hypot(*offset(person, x, y, t)), person.deviation(t)
            if is_zero(deviation):
                return self.weight(distance - person.radius - radius)
            return _mean_zone_weight(self, person.radius + radius)(distance, deviation)

        return m.integrate(lambda s: expected(people, intrusion, s.base.x, s.base.y, clock(s, people)))

    def weight(self, gap: Column) -> Column:
        """Return the weight (N,) of gaps, m, between the surfaces of robot and person."""
        weights = (self.intimate, self.personal, self.social, 0.0)
        steps = [(limit, w - beyond) for limit, (w, beyond) in zip(HALL.values(), pairwise(weights), strict=True)]
        return sum(step * within(limit - gap, self.softness) for limit, step in steps if step > 0)


def within(depth: Column, softness: float) -> Column:
    """Return a smooth step (N,) from 0 outside of a border to 1 inside.

    depth     m, distance inside the border, negative outside
    softness  m, width of the step

    It is a polynomial of degree 5, 1/2 at the border, and twice differentiable.
    """
    u = np.clip(depth / softness + 0.5, 0.0, 1.0)
    return u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)


@lru_cache(maxsize=128)  # 0.6 MB each; one per radius of a person
def _mean_zone_weight(zones: HallZones, radii: float) -> Blurred:
    """Return a function for the mean weight when the position of a person is uncertain.

    It takes the predicted distance between the axes of robot and person, m, and the deviation, m. ``radii`` is the sum
    of both radii, m.
    """
    end = HALL["social"] + 0.5 * zones.softness + radii
    return Blurred(lambda distance: zones.weight(distance - radii), end, detail=zones.softness)
