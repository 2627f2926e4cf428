"""Encounters with people: time to collision, social force, visibility, and nearness at uncertain positions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import erf, erfcx, hypot, is_zero
from hpop.base.options import LEAST, MOST, set_reals
from hpop.base.symbols import sum_over_rows
from hpop.criteria.base import criterion
from hpop.criteria.others import base_velocity, checked_radius, clock, reach
from hpop.criteria.others.personal_space import within
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions
from hpop.motions.bodies import Rate
from hpop.world.content.content import Person
from hpop.world.content.proxemics import HALL, Blurred, expected, in_frame, offset, worst


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


STANDSTILL = 1e-9  # for |D| below this the force is 0, because its range γ|D| is
TINY = 1e-6  # m: smallest deviation, where deviations grow with time
ROOT_PI = float(np.sqrt(np.pi))


@criterion("social_force", group="O", unit="m/s", aggregate="sum", requires=("base", "people"))
@dataclass(frozen=True)
class SocialForce:
    """Social force that the robot exerts on people, per unit of mass, over time: ∫ Σ_people E[|f|] dt.

    f = -A exp(-d/B) [exp(-(n′Bθ)²) t + K exp(-(nBθ)²) n], where n is a constant in (nBθ) and a vector at the end. Unit
    m/s; a sum over motions.

    e    unit vector from the person to the robot, d their distance (centres)
    D    λΔv + e, where Δv is the person's velocity minus the robot's
    t    D/|D|; the vector n is its left normal
    θ    angle from t to e; K is its sign
    B    γ|D|

    Source: Moussaïd et al. 2009 (Proc. R. Soc. B 276), who measured A = 4.5 m/s², γ = 0.35, λ = 2, n = 2 and n′ = 3 on
    people.

    Choices: the integral is over time, not along the path, so that a robot that stands beside people has a cost too.
    The "social work" of human-aware navigation also sums the force over time. At θ = 0, K counts as ±1, and not as 0 as
    in the paper, because on a straight path to a person θ is 0 only up to rounding.

    E is the mean over the person's hypotheses (by weight) and over the uncertain position, at the predicted velocity.
    It is an integral over directions of e, with the integral over distances in closed form. Its error is at most 1e-4
    m/s² for the default constants, velocities that differ by up to 4 m/s, and any deviation. The mean of the cost is
    right whether or not a person's deviations at different times are correlated.
    """

    strength: float = 4.5  # A, m/s²
    stretch: float = 0.35  # γ, m
    anticipation: float = 2.0  # λ, s/m
    turning: float = 2.0  # n, 1/m
    slowing: float = 3.0  # n′, 1/m

    def __post_init__(self) -> None:
        set_reals(self, "strength", "stretch", least=LEAST, most=MOST, kind="a positive number", error=CriterionError)
        constants = ("anticipation", "turning", "slowing")
        set_reals(self, *constants, least=0, most=MOST, kind="a number", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), m/s, of the expected social force on all people, per unit of mass."""
        people = m.world.content.people
        return m.integrate(
            lambda s: expected(people, self._force, s.base.x, s.base.y, *base_velocity(m, s), clock(s, people))
        )

    def _force(self, person: Person, x: Column, y: Column, vx: Column, vy: Column, t: Column | None) -> Column:
        """Return the mean (N,) of |f|, m/s², on a person at times t; the robot is at (x, y) with velocity (vx, vy)."""
        dx, dy = offset(person, x, y, t)
        walks_x, walks_y = person.velocity_at(t)
        distance, deviation = hypot(dx, dy), person.deviation(t)
        apart = distance > 0
        inverse = np.where(apart, 1.0 / np.where(apart, distance, 1.0), 0.0)
        ex, ey = dx * inverse, dy * inverse
        if not is_zero(deviation):
            ahead = np.where(apart, ex, 1.0)  # any direction serves where none is defined
            columns = (distance, ahead, ey, walks_x - vx, walks_y - vy, np.maximum(deviation, TINY))
            return sum_over_rows(self._towards, DIRECTIONS, *columns)
        reach, strongest = self._range_and_strength(ex, ey, walks_x - vx, walks_y - vy)
        return strongest * np.exp(-distance / reach)

    def _range_and_strength(self, ex: Column, ey: Column, wx: Column, wy: Column) -> tuple[Column, Column]:
        """Return the range B (N,) of the force, m, and its strength |f| (N,) at distance 0, m/s².

        ex, ey  unit vector e from the person to the robot
        wx, wy  velocity of the person minus that of the robot, m/s
        """
        Dx, Dy = self.anticipation * wx + ex, self.anticipation * wy + ey
        length = hypot(Dx, Dy)
        pushes = length > STANDSTILL
        reach = self.stretch * np.where(pushes, length, 1.0)
        forward, aside = ex * Dx + ey * Dy, Dx * ey - Dy * ex
        defined = np.logical_and(pushes, ex * ex + ey * ey > 0)
        bend = reach * np.arctan2(np.where(defined, aside, 0.0), np.where(defined, forward, 1.0))  # B θ
        square = -2.0 * bend * bend
        squared = np.exp(square * self.slowing**2) + np.exp(square * self.turning**2)  # |f|² is the sum of two squares
        return reach, np.where(pushes, self.strength * np.sqrt(squared + 1e-300), 0.0)

    def _towards(
        self,
        tangent: Column,
        share: Column,
        distance: Column,
        ex: Column,
        ey: Column,
        wx: Column,
        wy: Column,
        deviation: Column,
    ) -> Column:
        """Return the contribution (N,), m/s², of one direction to the mean of |f| over a person's uncertain position.

        tangent, share  node of the quadrature over directions, from ``_directions``
        distance        d, m, to the predicted position; ex, ey is the unit vector and wx, wy the relative velocity
        deviation       σ, m, standard deviation of the person's position

        Let r, φ be polar coordinates about the robot, with φ = 0 towards the predicted position. A position has the
        density exp(-(r² - 2 r d cos φ + d²)/2σ²)/2πσ², and |f| is exp(-r/B) times a function of φ. With
        a = d cos φ - σ²/B the integral over r is exp(-d²/2σ²) (1 + a/σ sqrt(π/2) exp(a²/2σ²) (1 + erf(a/σ sqrt 2)))/2π.
        The directions φ follow from tan(φ/2) = k tan(ψ/2), with evenly spaced ψ and k = 2σ/sqrt(d² + 4σ²). They are
        dense where the person is likely to be.
        """
        narrow = 2.0 * deviation / np.sqrt(distance * distance + 4.0 * deviation * deviation) * tangent
        scale = 1.0 + narrow * narrow
        versine = 2.0 * narrow * narrow / scale  # 1 - cos φ
        cos, sin = 1.0 - versine, 2.0 * narrow / scale
        reach, strongest = self._range_and_strength(ex * cos - ey * sin, ex * sin + ey * cos, wx, wy)
        shortening = distance * versine + deviation * deviation / reach
        nearest = distance - shortening  # a
        z = nearest / (np.sqrt(2.0) * deviation)
        off = distance / deviation
        behind = np.exp(-0.5 * off * off)
        towards = np.exp(np.minimum(-0.5 * shortening * (distance + nearest) / (deviation * deviation), 0.0))
        beyond = behind * (1.0 - ROOT_PI * np.maximum(-z, 0.0) * erfcx(np.maximum(-z, 0.0)))
        before = behind + ROOT_PI * z * towards * (1.0 + erf(np.maximum(z, 0.0)))
        # dφ/dψ; its factor that depends on the node alone is in ``share``
        weight = share * narrow / tangent / scale
        return weight * strongest * np.where(z > 0, before, np.maximum(beyond, 0.0))


def _directions(count: int) -> tuple[tuple[float, float], ...]:
    """Return the nodes of the quadrature over ``count`` evenly spaced directions ψ.

    Each is a pair of tan(ψ/2) and (1 + tan²(ψ/2)) / count.
    """
    tangents = np.tan(np.pi * ((np.arange(count) + 0.5) / count - 0.5))
    return tuple(zip(tangents.tolist(), ((1.0 + tangents**2) / count).tolist(), strict=True))


DIRECTIONS = _directions(48)


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

    It takes the distance, m, from the robot's axis to the predicted position of the person, and the standard deviation
    of the position, m. A person counts as near at a distance of up to ``near`` m, with a smooth border of width
    ``softness``, m.
    """
    return Blurred(
        lambda gap: np.asarray(within(near + 0.5 * softness - gap, softness)), near + softness, detail=softness
    )
