"""Spaces of people and of groups who talk: personal space, Hall's zones, O-spaces, and lines between talkers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise
from math import prod
from typing import Literal, get_args

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import erf, hypot, is_zero
from hpop.base.options import LEAST, MOST, one_of, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import check_one_future, checked_radius, clock, reach
from hpop.errors import CriterionError
from hpop.motions import Curve, Motions
from hpop.world.content.content import Person
from hpop.world.content.futures import named_as
from hpop.world.content.proxemics import HALL, Blurred, any_moves, expected, in_frame, offset, over, position, worst

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

    It takes the distance, m, from the robot's axis to the predicted position of the person, and the standard deviation
    of the position, m. ``radii`` is the sum of the radii of robot and person, m.
    """
    end = HALL["social"] + 0.5 * zones.softness + radii
    return Blurred(lambda distance: zones.weight(distance - radii), end, detail=zones.softness)


@criterion("o_space", group="O", unit="s", aggregate="sum", requires=("base", "groups"))
@dataclass(frozen=True)
class OSpace:
    """Time in the middle of conversations, weighted by nearness to the centre c: ∫ Σ_groups E[exp(-|p - c|²/2σ²)] dt.

    p is the position of the base's axis. The centre is c = mean(p_i + ``stride`` · heading_i) over the people of the
    group, where p_i is a position and heading_i the direction of the body, also of people who walk while they talk. A
    second at the centre costs 1 s. A conversation lasts while all its people are present. Unit s; a sum over motions.

    Source: the centre of an F-formation is found by votes: each person votes for a point ahead (Kendon 1990; a stride
    of 1.5 m). The width σ = ``sigma``, half a stride, is this library's choice.

    E is the mean over the uncertain positions of the people, whose deviations are taken as independent, in closed form.
    People in groups must have one predicted future each, because separate futures of each person do not tell how the
    conversation continues.
    """

    stride: float = 1.5  # m from each person ahead to the centre
    sigma: float = 0.75  # m, width σ of the middle

    def __post_init__(self) -> None:
        set_reals(self, "stride", least=0, most=MOST, kind="a length in m", error=CriterionError)
        set_reals(self, "sigma", least=LEAST, most=MOST, kind="a positive length in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the weighted time (M,) in the middle of conversations, s."""
        content = m.world.content
        groups = [tuple(content.people[i] for i in group) for group in content.groups]
        talking = [person for group in groups for person in group]
        check_one_future("o_space", talking)

        def intrusion(group: tuple[Person, ...], x: Column, y: Column, t: Column | None) -> Column:
            centre_x, centre_y = self.centre(group, t)
            square = (x - centre_x) ** 2 + (y - centre_y) ** 2
            own = self.sigma**2
            wide = own + sum(person.deviation(t) ** 2 for person in group) / len(group) ** 2
            shares = [own / wide, *(person.there(t) for person in group)]  # 1.0 where nothing is uncertain
            return prod(shares) * np.exp(square * (-0.5 / wide))

        return m.integrate(lambda s: over(groups, intrusion, np.add, s.base.x, s.base.y, clock(s, talking)))

    def centre(self, group: tuple[Person, ...], t: Column | None = None) -> tuple[Column, Column]:
        """Return the centre (x, y), m, of a group's conversation at times t (N,), s; t may be None if all stand."""
        positions = [position(person, t) for person in group]
        ahead = self.stride / len(group)
        x = sum(px for px, _ in positions) / len(group) + ahead * sum(math.cos(person.yaw) for person in group)
        y = sum(py for _, py in positions) / len(group) + ahead * sum(math.sin(person.yaw) for person in group)
        return x, y


CHORDS = 8  # number of straight pieces that approximate a curve
STEP = 0.25  # m: in a piece, people on tracks, or at different velocities, walk at most this far
MOST_CHORDS = 512


@criterion(
    "cutting_between", group="O", unit="1", aggregate="sum", requires=("base", "groups"), smooth=False, quantum=1.0
)
@dataclass(frozen=True)
class CuttingBetween:
    """Number of times that the path crosses between two people who talk, summed over all pairs of each conversation.

    A crossing is one of the segment between the positions p_i and p_j of the two people. Unit 1; a sum over motions. A
    pair counts while both people are present. A point exactly on the line through the two counts as left of the
    direction from p_i to p_j. So a path can be cut anywhere, even on the segment, and each crossing still counts once.
    A path that comes from the right, touches the segment and turns back counts twice; one from the left not at all.

    A motion is approximated by straight pieces: one for a straight move, eight for a curve, and the paths of people
    likewise. That is exact for straight moves and for people who walk side by side. If people follow tracks or walk at
    different velocities, so that the segment turns, a person walks at most 0.25 m in a piece, with at most 512 pieces.

    If positions are uncertain or a person has several predicted futures, the expected number of crossings cannot be
    computed from the distribution of positions at each moment, and CriterionError is raised.
    """

    def cost(self, m: Motions) -> Column:
        """Return the number of crossings (M,)."""
        content = m.world.content
        pairs = [(content.people[i], content.people[j]) for group in content.groups for i, j in combinations(group, 2)]
        talking = [person for pair in pairs for person in pair]
        check_one_future("cutting_between", talking)
        _check_sure(talking)
        walks = any_moves(talking)
        if walks and m.t0 is None:
            raise CriterionError(
                "'cutting_between' needs the time at which each motion begins, because people in a group walk, but "
                "this planner plans without time; give the people no velocity, or plan by 'lattice' or 'roadmap'"
            )
        within = m.moments(_pieces(m, talking))
        poses = [m.base.start, *(s.base for s in within), m.base.end]
        times = [m.t0, *(s.t for s in within), m.t0 + m.duration] if walks else [None] * len(poses)
        crossings = 0.0 * m.base.start.x
        for pair in pairs:
            relative = [_relative_to(pair, pose.x, pose.y, t) for pose, t in zip(poses, times, strict=True)]
            pieces = zip(pairwise(relative), pairwise(times), strict=True)
            crossings = crossings + sum(_crosses_pair(*ends, *interval, pair) for ends, interval in pieces)
        return crossings


def _relative_to(pair: tuple[Person, Person], x: Column, y: Column, t: Column | None) -> tuple[Column, Column]:
    """Return a position (x, y) relative to the segment between two people, at times t, as two columns.

    The first is the coordinate along the segment, from 0 at the first person to 1 at the second. The other is the
    distance to its left, also in lengths of the segment.
    """
    ax, ay = position(pair[0], t)
    bx, by = position(pair[1], t)
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    scale = 1.0 / np.where(square > 0, square, np.inf)  # no segment between people at one position
    return ((x - ax) * dx + (y - ay) * dy) * scale, ((y - ay) * dx - (x - ax) * dy) * scale


def _pieces(m: Motions, people: list[Person]) -> int:
    """Return the number of pieces per phase of the motions, in which robot and people count as moving straight."""
    chords = CHORDS if isinstance(m.law, Curve) else 1
    if not any(person.track for person in people) and len({person.velocity for person in people}) < 2:
        return chords  # all stand, or walk side by side: straight motions are straight relative to them
    farthest = float(np.max(m.duration)) * max(person.speed for person in people)
    return int(np.clip(np.ceil(farthest / STEP), chords, MOST_CHORDS))


def _crosses_pair(
    begin: tuple[Column, Column],
    end: tuple[Column, Column],
    t_begin: Column | None,
    t_end: Column | None,
    pair: tuple[Person, Person],
) -> Column:
    """Return whether (1 or 0, (M,)) straight moves cross the segment between two people while both are present.

    begin, end      positions relative to the segment, from :func:`_relative_to`
    t_begin, t_end  s, times at both ends, or None for people who stand
    """
    (along, left), (to_along, to_left) = begin, end
    changes = np.where(np.logical_and(left >= 0, to_left < 0), 1.0, 0.0)
    changes = np.where(np.logical_and(left < 0, to_left >= 0), 1.0, changes)
    share = left / np.where(changes > 0, left - to_left, 1.0)
    crossing = along + share * (to_along - along)
    t = None if t_begin is None else t_begin + share * (t_end - t_begin)
    present = prod(person.there(t) for person in pair)
    return present * np.where(np.logical_and(crossing >= 0, crossing <= 1), changes, 0.0)


def _check_sure(people: list[Person]) -> None:
    """Raise CriterionError if the position of a person is uncertain."""
    for person in people:
        if person.spread or person.growth:
            raise CriterionError(
                f"'cutting_between' needs certain positions, but that of {named_as('person', person.name)} is "
                "uncertain; give this person no spread and no growth, or use 'o_space' instead"
            )
