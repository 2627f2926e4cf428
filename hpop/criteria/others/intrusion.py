"""How near people may come: the worst moment, and how many moments of contact are to be expected."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hypot, is_zero
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import checked_radius, clock, reach
from hpop.criteria.others.hall_zones import within
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions
from hpop.motions.bodies import Rate
from hpop.world.content.content import Person
from hpop.world.content.proxemics import HALL, Blurred, expected, offset


@criterion("worst_intrusion", group="O", unit="1", aggregate="max", requires=("base", "people"), quantum=1e-3)
@dataclass(frozen=True)
class WorstIntrusion:
    """max over t of Σ_people E[w(gap)]: how many are expected to be nearer than ``distance`` at the worst moment.

    w is 1 up to the distance between surfaces and falls to 0 over ``softness`` metres beyond it (a polynomial of degree
    5). The mean E is over where each person may be at that moment: the futures by their weights, each blurred by its
    deviation. So where only one person is near it is a bound from above on how likely it is, at the worst moment, that
    the person is nearer; for several, that anyone is. It says nothing of how likely that is at some moment of the whole
    way, which no worst moment does; see ``expected_contacts``. Of people whose places are sure it counts those nearer.

    The worst moment is looked for where the robot and the fastest person together have gone another quarter of the
    softness, or a sixteenth of a field cell if that is more, and just before a person leaves. The mean is a table,
    nearer than 1e-4 to the integral up to distances of .5 m, and than 1e-3 up to 3 m, whatever the softness.
    """

    distance: float = HALL["intimate"]  # m between surfaces, below which it is an intrusion; 0 is a contact
    softness: float = 0.1  # m beyond it, over which it ceases to be one
    robot_radius: float | None = None  # m, None for the model's

    def __post_init__(self) -> None:
        _check_nearness(self, self.robot_radius)

    def cost(self, m: Motions) -> Column:
        """Largest expected number (M,) of people who are nearer."""
        return m.worst(_nearer(m, self.distance, self.softness, self.robot_radius), detail=self.softness)


@criterion("expected_contacts", group="O", unit="1", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class ExpectedContacts:
    """1/every ∫ Σ_people E[w(gap)] dt: how many contacts are expected, of moments ``every`` seconds apart.

    w is 1 up to a gap of ``distance`` between surfaces (0, a contact) and falls to 0 over ``softness`` metres beyond it
    (a polynomial of degree 5); the mean E is that of ``worst_intrusion``. Every moment and every person count, so by
    Boole's inequality the cost is a bound from above on how likely it is that anyone is that near at any of these
    moments (averaged over when the first of them is), however the moments depend on each other. A contact that lasts is
    counted again and again: then the bound is far from being met, and above 1 it says nothing. It is no likelihood.

    The integral is by Gauss-Legendre in pieces in which the robot and the fastest person together go no farther than
    half the softness, or an eighth of a field cell if that is more, cut where a person comes or leaves.
    """

    distance: float = 0.0  # m between surfaces, at and below which it is a contact
    softness: float = 0.1  # m beyond it, over which it ceases to be one
    every: float = 1.0  # s from one moment to the next
    robot_radius: float | None = None  # m, None for the model's

    def __post_init__(self) -> None:
        _check_nearness(self, self.robot_radius)
        set_reals(self, "every", least=LEAST, most=MOST, kind="a positive time in s", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Expected number (M,) of moments of contact."""
        rate = _nearer(m, self.distance, self.softness, self.robot_radius)
        return m.integrate(rate, detail=self.softness) / self.every


def _check_nearness(criterion: WorstIntrusion | ExpectedContacts, robot_radius: float | None) -> None:
    set_reals(criterion, "distance", least=0, most=MOST, kind="a length in m", error=CriterionError)
    set_reals(criterion, "softness", least=LEAST, most=MOST, kind="a positive length in m", error=CriterionError)
    robot_radius = checked_radius(robot_radius)


def _nearer(m: Motions, distance: float, softness: float, robot_radius: float | None) -> Rate:
    """The rate: expected number of people nearer than a distance, m."""
    people, radius = m.world.content.people, reach(m.model, robot_radius)

    def nearness(person: Person, x: Column, y: Column, t: Column | None) -> Column:
        apart, deviation = hypot(*offset(person, x, y, t)), person.deviation(t)
        near = distance + person.radius + radius  # of the axes
        if is_zero(deviation):
            return within(near + 0.5 * softness - apart, softness)
        return _blurred(near, softness)(apart, deviation)

    def rate(s: Instants) -> Column:
        return expected(people, nearness, s.base.x, s.base.y, clock(s, people))

    return rate


@lru_cache(maxsize=128)  # 0.6 MB each: one a radius of a person
def _blurred(near: float, softness: float) -> Blurred:
    """Nearness of an uncertain distance between axes."""
    return Blurred(
        lambda apart: np.asarray(within(near + 0.5 * softness - apart, softness)), near + softness, detail=softness
    )
