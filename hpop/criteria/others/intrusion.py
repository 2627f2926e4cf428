"""Nearness to people whose positions are uncertain: at the worst moment, and as the expected number of contacts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hypot, is_zero
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import checked_radius, clock, reach
from hpop.criteria.others.personal_space import within
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions
from hpop.motions.bodies import Rate
from hpop.world.content.content import Person
from hpop.world.content.proxemics import HALL, Blurred, expected, offset


@criterion("worst_intrusion", group="O", unit="1", aggregate="max", requires=("base", "people"), quantum=1e-3)
@dataclass(frozen=True)
class WorstIntrusion:
    """Expected number of people nearer than ``distance`` at the worst moment: max over t of Σ_people E[w(gap)].

    The gap is measured between the surfaces of robot and person. w is 1 up to ``distance`` and falls to 0 over
    ``softness`` metres beyond it (a polynomial of degree 5). E is the mean over the person's hypotheses (by weight) and
    over the uncertain position. Unit 1; the worst moment. If positions are certain, the cost is the number of people
    nearer than ``distance``.

    The cost is an upper bound on the probability that some person is that near at the worst moment. It is no bound on
    the probability for the whole path; ``expected_contacts`` is.

    The maximum is searched at sampled moments. Between two of them, the robot and the fastest person together move a
    quarter of the softness, or a sixteenth of a cell of the distance grid if that is more. The moment just before a
    person leaves is added. Means come from a table, within 1e-4 of the integral up to distances of 0.5 m, and 1e-3 up
    to 3 m, for any softness.
    """

    distance: float = HALL["intimate"]  # m, gap up to which a person counts as near; 0 for contact
    softness: float = 0.1  # m beyond ``distance``, over which w falls to 0
    robot_radius: float | None = None  # m, None for the model's

    def __post_init__(self) -> None:
        _check_nearness(self, self.robot_radius)

    def cost(self, m: Motions) -> Column:
        """Return the largest expected number (M,) of people nearer than ``distance``."""
        return m.worst(_nearer(m, self.distance, self.softness, self.robot_radius), detail=self.softness)


@criterion("expected_contacts", group="O", unit="1", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class ExpectedContacts:
    """Expected number of contacts, counted at moments ``every`` seconds apart: 1/every ∫ Σ_people E[w(gap)] dt.

    The gap is measured between the surfaces of robot and person. w is 1 up to ``distance`` (0 for contact) and falls to
    0 over ``softness`` metres beyond it (a polynomial of degree 5). E is the mean over the person's hypotheses (by
    weight) and over the uncertain position. Unit 1; a sum over motions.

    By Boole's inequality, the cost is an upper bound on the probability that some person is that near at any of these
    moments (averaged over the time of the first moment), however the moments are correlated. The cost itself is not a
    probability. A long contact counts several times, so the bound is loose, and a cost above 1 tells nothing about the
    probability.

    The integral is computed by Gauss-Legendre quadrature. In an interval, the robot and the fastest person together
    move at most half the softness, or an eighth of a cell of the distance grid if that is more. Intervals end where a
    person comes or leaves.
    """

    distance: float = 0.0  # m, gap up to which a person counts as in contact
    softness: float = 0.1  # m beyond ``distance``, over which w falls to 0
    every: float = 1.0  # s between moments
    robot_radius: float | None = None  # m, None for the model's

    def __post_init__(self) -> None:
        _check_nearness(self, self.robot_radius)
        set_reals(self, "every", least=LEAST, most=MOST, kind="a positive time in s", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the expected number (M,) of contacts in each motion."""
        rate = _nearer(m, self.distance, self.softness, self.robot_radius)
        return m.integrate(rate, detail=self.softness) / self.every


def _check_nearness(criterion: WorstIntrusion | ExpectedContacts, robot_radius: float | None) -> None:
    """Check the options that both criteria have."""
    set_reals(criterion, "distance", least=0, most=MOST, kind="a length in m", error=CriterionError)
    set_reals(criterion, "softness", least=LEAST, most=MOST, kind="a positive length in m", error=CriterionError)
    robot_radius = checked_radius(robot_radius)


def _nearer(m: Motions, distance: float, softness: float, robot_radius: float | None) -> Rate:
    """Return a rate: a function of moments within motions for the expected number (N,) of people who are near."""
    people, radius = m.world.content.people, reach(m.model, robot_radius)

    def nearness(person: Person, x: Column, y: Column, t: Column | None) -> Column:
        gap, deviation = hypot(*offset(person, x, y, t)), person.deviation(t)
        near = distance + person.radius + radius  # between axes
        if is_zero(deviation):
            return within(near + 0.5 * softness - gap, softness)
        return _mean_nearness(near, softness)(gap, deviation)

    def rate(s: Instants) -> Column:
        return expected(people, nearness, s.base.x, s.base.y, clock(s, people))

    return rate


@lru_cache(maxsize=128)  # 0.6 MB each; one per radius of a person
def _mean_nearness(near: float, softness: float) -> Blurred:
    """Return a function for the probability that a person whose position is uncertain is near.

    It takes the predicted distance between the axes of robot and person, m, and the deviation, m. A person counts as
    near at a distance of up to ``near`` m, with a smooth border of width ``softness``, m.
    """
    return Blurred(
        lambda gap: np.asarray(within(near + 0.5 * softness - gap, softness)), near + softness, detail=softness
    )
