"""Costs about people with several hypotheses: the mean over sampled hypotheses, and the worst of them."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.stats import ncx2

import hpop
from hpop.criteria import (
    CuttingBetween,
    ExpectedContacts,
    OSpace,
    PersonalSpace,
    SocialForce,
    TimeToCollision,
    WorstIntrusion,
    make_criterion,
    trajectory_cost,
)
from hpop.criteria.others.metrics import social_metrics
from hpop.errors import CriterionError
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Future, Person, Track, World

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = hpop.DifferentialDrive(speed=0.8, radius=0.3)
DRIVE = Trajectory.from_poses(ROBOT, [(-2, 0, 0), (2, 0, 0), (2, 1, np.pi / 2)]).with_hold(at=1, seconds=2.0)
WAY = Track.through([(0, 1.5, 2), (2, 0.5, 1), (6, 0.5, -3)])
PERSON = Person(
    1.5,
    2.0,
    0.3,
    spread=0.2,
    growth=0.15,
    futures=(Future(2, velocity=(-0.4, -0.5), until=4.0, afterwards="stays"), Future(1, track=WAY, spread=0.5)),
)
NAMES = ["hall_zones", "personal_space", "visibility_to_people", "expected_contacts", "social_force"]
MOMENTS = 300


def cost(criterion, *people, groups=(), drive=DRIVE):
    return trajectory_cost(criterion, drive, ROOM.with_content(people=people, groups=groups))


def smooth(u):
    u = np.clip(u, 0, 1)
    return u**3 * (10 - 15 * u + 6 * u * u)


def rate(name, dx, dy, robot, walk, gaze):
    """Return the cost rate of a person for a robot at (dx, dy) from that person, by the docstring's formula."""
    d = np.hypot(dx, dy)
    ahead, left = dx * gaze[0] + dy * gaze[1], dy * gaze[0] - dx * gaze[1]
    if name == "hall_zones":
        steps = ((0.45, 0.5), (1.2, 0.4), (3.6, 0.1))
        return sum(step * smooth((limit - d + 0.55) / 0.3 + 0.5) for limit, step in steps)
    if name == "expected_contacts":
        return smooth((0.55 + 0.1 - d) / 0.1)
    if name == "visibility_to_people":
        return 0.5 * (1 - ahead / d) * np.clip(1 - d / 3.6, 0, 1) ** 2
    if name == "personal_space":
        front = np.maximum(2 * np.hypot(*walk), 0.5)
        return np.exp(-((ahead / np.where(ahead > 0, front, front / 2)) ** 2) / 2 - (left / front / 2 * 3) ** 2 / 2)
    e, D = (dx + 1j * dy) / d, 2 * (walk[0] - robot[0] + 1j * (walk[1] - robot[1])) + (dx + 1j * dy) / d
    B = 0.35 * np.abs(D)
    theta = np.angle(e / D)
    return 4.5 * np.exp(-d / B) * np.hypot(np.exp(-((3 * B * theta) ** 2)), np.exp(-((2 * B * theta) ** 2)))


def moments():
    """Return times, and the robot's states and velocities at them."""
    t = (np.arange(MOMENTS) + 0.5) * DRIVE.duration / MOMENTS
    s, h = DRIVE.at(t), 1e-6
    before, after = DRIVE.at(t - h), DRIVE.at(t + h)
    return t, s, ((after.x - before.x) / (2 * h), (after.y - before.y) / (2 * h))


@pytest.mark.parametrize("together", [True, False], ids=["fully correlated in time", "independent in time"])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.cases(
    "expected_contacts-fully correlated in time",
    "personal_space-fully correlated in time",
    "visibility_to_people-independent in time",
)
def test_the_cost_is_the_mean_over_sampled_futures(name, together):
    rng = np.random.default_rng(3)
    t, s, robot = moments()
    size, mean, variance = 1500, 0.0, 0.0
    for weight, one in PERSON.hypotheses:
        x, y, vx, vy, ux, uy, there, sigma = (
            np.broadcast_to(column, t.shape)
            for column in (*one.at(t), *one.velocity_at(t), *one.ahead_at(t), one.there(t), one.deviation(t))
        )
        off = sigma * rng.normal(size=(2, size, 1 if together else t.size))
        found = there * rate(name, s.x - x - off[0], s.y - y - off[1], robot, (vx, vy), (ux, uy))
        sampled = found.mean(axis=1) * DRIVE.duration
        mean, variance = mean + weight * sampled.mean(), variance + weight**2 * sampled.var() / size
    found = cost(make_criterion(name), PERSON)
    assert mean > 0.1
    assert found == pytest.approx(mean, abs=4 * np.sqrt(variance) + 1e-3 * mean)


def test_a_conversation_whose_place_is_uncertain_is_the_mean_over_sampled_ones():
    talking = [Person(0, 1.5, -1.5, spread=0.4), Person(1, 1, 2.0, growth=0.2), Person(0.6, 0.2, velocity=(0.1, 0.1))]
    rng, (t, s, _), criterion = np.random.default_rng(5), moments(), OSpace()
    rates = np.zeros((4000, MOMENTS))
    x, y = (np.zeros_like(rates) for _ in range(2))
    for person in talking:
        px, py = np.broadcast_to(np.stack(np.broadcast_arrays(*person.at(t))), (2, MOMENTS))
        x += (px + 1.5 * np.cos(person.yaw) + person.deviation(t) * rng.normal(size=(4000, 1))) / 3
        y += (py + 1.5 * np.sin(person.yaw) + person.deviation(t) * rng.normal(size=(4000, 1))) / 3
    rates = np.exp(-((s.x - x) ** 2 + (s.y - y) ** 2) / 2 / 0.75**2)
    sampled = rates.mean(axis=1) * DRIVE.duration
    found = cost(criterion, *talking, groups=[(0, 1, 2)])
    assert found == pytest.approx(sampled.mean(), abs=4 * sampled.std() / np.sqrt(4000) + 1e-3)


@pytest.mark.parametrize("name", [*NAMES, "time_to_collision", "worst_intrusion"])
def test_one_future_that_is_sure_costs_the_same_to_the_last_bit(name):
    walking = Person(1.5, 2.0, velocity=(-0.4, -0.5))
    sole = Person(1.5, 2.0, futures=(Future(3.0, velocity=(-0.4, -0.5)),))
    assert cost(make_criterion(name), sole) == cost(make_criterion(name), walking)


@pytest.mark.parametrize("name", NAMES)
def test_a_deviation_that_vanishes_changes_nothing(name):
    sure, nearly = (Person(1.5, 2.0, velocity=(-0.4, -0.5), spread=spread) for spread in (0.0, 1e-5))
    assert cost(make_criterion(name), nearly) == pytest.approx(cost(make_criterion(name), sure), rel=2e-3)


@pytest.mark.parametrize("criterion", [TimeToCollision(), PersonalSpace("max")], ids=["time_to_collision", "max"])
def test_of_the_worst_moment_the_worst_future_counts_however_unlikely(criterion):
    futures = (Future(0.999, velocity=(0.5, 0.5)), Future(0.001, velocity=(-0.5, -0.7)))
    person = Person(1.5, 2.0, futures=futures)
    alone = [cost(criterion, one) for _, one in person.hypotheses]
    assert alone[0] != alone[1]
    assert cost(criterion, person) == pytest.approx(max(alone), rel=1e-6)


def test_the_worst_intrusion_against_the_distribution_of_the_distance():
    """A sharp border lies between two soft ones, and the worst of many moments is found in the end."""
    t = np.linspace(0, DRIVE.duration, 4001)
    s, inside = DRIVE.at(t), 0.0
    for weight, one in PERSON.hypotheses:
        (x, y), sigma = one.at(t), one.deviation(t)
        apart = np.hypot(s.x - x, s.y - y)
        inside = inside + weight * np.array(
            [ncx2.cdf((near / sigma) ** 2, 2, (apart / sigma) ** 2) for near in (1.0, 1.02)]
        ) * one.there(t)
    least, most = inside.max(axis=1)
    assert 0.2 < least <= cost(WorstIntrusion(distance=0.45, softness=0.02), PERSON) + 2e-3
    assert cost(WorstIntrusion(distance=0.45, softness=0.02), PERSON) <= most + 2e-3


def test_boole_bounds_how_many_sampled_futures_touch_at_moments_a_second_apart():
    rng, person = np.random.default_rng(2), Person(0.5, 1.5, spread=0.3, growth=0.2, velocity=(0.0, -0.3))
    bound = cost(ExpectedContacts(every=1.0), person)
    t = np.arange(rng.uniform(0, 1), DRIVE.duration, 1.0)
    s, (x, y) = DRIVE.at(t), person.at(t)
    for shape in ((4000, 1), (4000, t.size)):
        off = person.deviation(t) * rng.normal(size=(2, *shape))
        touched = np.hypot(s.x - x - off[0], s.y - y - off[1]) <= 0.55
        assert 0 < touched.any(axis=1).mean() <= bound
    assert cost(ExpectedContacts(every=0.25), person) == pytest.approx(4 * bound)


@pytest.mark.parametrize("name", [*NAMES, "time_to_collision", "worst_intrusion"])
def test_who_is_gone_costs_nothing_from_then_on_and_who_stays_stands_there(name):
    criterion, walking = make_criterion(name), Person(0.0, 2.0, velocity=(0.0, -0.7))
    assert cost(criterion, walking) > 0
    assert cost(criterion, replace(walking, until=0.0)) == 0
    stays = replace(walking, until=2.5, afterwards="stays")
    through = Track.through([(0, 0, 2), (2.5, 0, 0.25), (60, 0, 0.25)])
    assert cost(criterion, stays) == pytest.approx(cost(criterion, Person.along(through)), rel=1e-9)


def test_a_conversation_ends_when_one_of_it_leaves():
    leaving, other = Person(0, 1, -1.5, until=0.0), Person(0, -1, 1.5)
    assert (
        cost(OSpace(), leaving, other, groups=[(0, 1)]) == cost(CuttingBetween(), leaving, other, groups=[(0, 1)]) == 0
    )
    stay = replace(leaving, until=60.0)
    assert cost(OSpace(), stay, other, groups=[(0, 1)]) > 1
    assert cost(CuttingBetween(), stay, other, groups=[(0, 1)]) == 1


def test_crossings_are_counted_along_tracks_with_many_waypoints():
    """One walks to and fro beside a robot that stands: the line between the two sweeps over it each time."""
    drive = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0.5, 0, 0)]).with_hold(at=0, seconds=20.0)
    to_and_fro = Track.through([(2 * i, 2.0 * (-1) ** i, 2.0) for i in range(12)])
    people = Person(-0.05, -2.0), Person.along(to_and_fro)
    assert cost(CuttingBetween(), *people, groups=[(0, 1)], drive=drive) == pytest.approx(10, abs=1)


@pytest.mark.parametrize("criterion", [OSpace(), CuttingBetween()], ids=lambda c: c.name)
def test_who_talks_has_one_future(criterion):
    with pytest.raises(
        CriterionError, match="needs one predicted future of each person in a group, but person 'Ann' has 2"
    ):
        cost(criterion, replace(PERSON, name="Ann"), Person(0, 1), groups=[(0, 1)])


@pytest.mark.parametrize("uncertain", [{"spread": 0.1}, {"growth": 0.1}])
def test_crossings_between_uncertain_places_are_refused(uncertain):
    with pytest.raises(CriterionError, match="no spread and no growth, or use 'o_space'"):
        cost(CuttingBetween(), Person(0, 2, **uncertain), Person(0, 1), groups=[(0, 1)])


def test_metrics_tell_the_worst_of_the_futures_while_somebody_is_there():
    futures = (Future(1, velocity=(0.5, 0.5)), Future(1, velocity=(-0.4, -0.5), until=3.0))
    person = Person(1.5, 2.0, futures=futures)
    alone = [social_metrics(DRIVE, ROOM.with_content(people=[one])) for _, one in person.hypotheses]
    found = social_metrics(DRIVE, ROOM.with_content(people=[person]))
    assert found.min_human_distance == min(one.min_human_distance for one in alone)
    assert found.least_time_to_collision == min(one.least_time_to_collision for one in alone)
    gone = social_metrics(DRIVE, ROOM.with_content(people=[replace(PERSON, futures=(), until=0.0)]))
    assert gone.min_human_distance == np.inf


def test_social_force_of_an_uncertain_place_against_a_fine_grid():
    z = np.linspace(-5, 5, 161)
    grid, person = np.stack(np.meshgrid(z, z)).reshape(2, -1), Person(0, 0, velocity=(-0.6, 0.2))
    weights = np.exp(-(grid**2).sum(axis=0) / 2)
    drive = Trajectory.from_poses(ROBOT, [(1.5, -0.6, 2.0), (1.5, -0.6, 3.0)])
    stands = (0.0, 0.0)
    gaze = np.array([-0.6, 0.2]) / np.hypot(0.6, 0.2)
    dx, dy = 1.5 - 0.4 * grid[0], -0.6 - 0.4 * grid[1]
    expected = weights @ rate("social_force", dx, dy, stands, person.velocity, gaze) / weights.sum()
    still = replace(person, until=0.0, afterwards="stays", spread=0.4, velocity=(0.0, 0.0))
    standing = weights @ rate("social_force", dx, dy, stands, (0.0, 0.0), gaze) / weights.sum()
    assert expected != standing
    assert cost(SocialForce(), still, drive=drive) / drive.duration == pytest.approx(standing, rel=0.03)


@pytest.mark.parametrize(
    ("spread", "place", "walk"),
    [(1.8, (1.0, 0.5), (-0.8, 0.3)), (0.6, (0.0, 0.0), (1.2, 0.0)), (3.0, (2.5, -1.0), (0.0, 0.0))],
)
def test_the_social_force_on_somebody_of_whom_little_is_known_is_the_integral_over_the_plane(spread, place, walk):
    """In polar coordinates about the robot, where the force has its cusp."""
    nodes, weights = np.polynomial.legendre.leggauss(120)
    farthest = np.hypot(*place) + 8 * spread
    r, angle = 0.5 * farthest * (nodes[:, None] + 1), np.arange(720) * np.pi / 360
    dx, dy = r * np.cos(angle), r * np.sin(angle)
    density = np.exp(-((dx + place[0]) ** 2 + (dy + place[1]) ** 2) / 2 / spread**2) / 2 / np.pi / spread**2
    pushed = rate("social_force", dx, dy, (0.0, 0.0), walk, (1.0, 0.0)) * density * r
    mean = 0.5 * farthest * np.pi / 360 * (pushed * weights[:, None]).sum()
    moment = Trajectory.from_poses(ROBOT, [(0, 0, 0)]).with_hold(at=0, seconds=1e-6)
    found = cost(SocialForce(), Person(*place, velocity=walk, spread=spread), drive=moment) / 1e-6
    assert found == pytest.approx(mean, abs=1e-4)
