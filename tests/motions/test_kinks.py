"""Integrals over time beside people who turn at waypoints, come and go, against sums by NumPy alone."""

import numpy as np
import pytest
import shapely

from hpop.criteria import PersonalSpace, make_criterion, motion_costs
from hpop.models import DifferentialDrive
from hpop.motions import HOLD, Motions, States
from hpop.world import Person, Track, World

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
SIZE, MOMENTS = 24, 40_000


def zigzag(rng, step, speed=1.2):
    """Return the track of a person who turns every ``step`` seconds."""
    count = int(14 / step)
    angles = np.cumsum(rng.normal(size=count))
    x, y = (np.cumsum(np.append(rng.uniform(-2, 2), f(angles) * speed * step)) for f in (np.cos, np.sin))
    return Person.along(Track(np.arange(count + 1) * step, x, y))


def people(kind, rng):
    walking, other = Person(-3, 0.3, velocity=(1.2, 0.1)), (2, 2, 0.0, (-0.3, -1.2))
    return {
        "who walk on": [walking, Person(*other)],
        "who run": [Person(-9, 0.3, velocity=(4.0, 0.1)), Person(*other)],
        "who turn every second": [zigzag(rng, 1.0), zigzag(rng, 1.0)],
        "who turn 25 times a second": [zigzag(rng, 0.04)],
        "who leave or stop": [
            Person(-3, 0.3, velocity=(1.2, 0.1), until=4.1),
            Person(*other, until=3.3, afterwards="stays"),
        ],
    }[kind]


def motions(kind, speed, world, rng):
    model = DifferentialDrive(speed=speed)
    x, y = rng.uniform(-2, 2, (2, SIZE))
    yaw, t0 = rng.uniform(-np.pi, np.pi, SIZE), rng.uniform(0, 6, SIZE)
    length = rng.uniform(0.2, 1, SIZE) * (kind == "move")
    turn = rng.uniform(0.3, 3, SIZE) * (kind == "turn")
    clock = rng.uniform(0.5, 6, SIZE) * (kind == "hold")
    start = States(x=x, y=y, yaw=yaw, clock=0 * clock)
    end = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw + turn, clock=clock)
    return Motions(world, model, HOLD if kind == "hold" else model.laws[kind], start, end, t0=t0)


def intrusions(world, x, y, t):
    """Kirby's personal space, written out, of one robot at moments (N,)."""
    total = 0.0
    for person in world.content.people:
        (px, py), (vx, vy), (ux, uy) = person.at(t), person.velocity_at(t), person.ahead_at(t)
        ahead = (x - px) * ux + (y - py) * uy
        left = (y - py) * ux - (x - px) * uy
        front = np.maximum(2 * np.hypot(vx, vy), 0.5)
        width = np.where(ahead > 0, front, front / 2)
        total = total + person.there(t) * np.exp(-((ahead / width) ** 2) / 2 - (left / front * 1.5) ** 2 / 2)
    return total


@pytest.mark.parametrize("speed", [1.0, 0.3])
@pytest.mark.parametrize("kind", ["move", "turn", "hold"])
@pytest.mark.parametrize(
    "who",
    ["who walk on", "who run", "who turn every second", "who turn 25 times a second", "who leave or stop"],
)
@pytest.mark.cases(8)
def test_people_who_turn_come_and_go_are_met_where_they_are(who, kind, speed):
    rng = np.random.default_rng(8)
    world = ROOM.with_content(people=people(who, rng))
    m = motions(kind, speed, world, rng)
    share = (np.arange(MOMENTS) + 0.5) / MOMENTS  # moves go evenly, and the axis stays where it is in turns
    expected = [
        np.mean(
            intrusions(
                world,
                m.start.x[i] + share * (m.end.x[i] - m.start.x[i]),
                m.start.y[i] + share * (m.end.y[i] - m.start.y[i]),
                m.t0[i] + share * m.duration[i],
            )
        )
        * m.duration[i]
        for i in range(SIZE)
    ]
    found = motion_costs(PersonalSpace(), m)
    assert np.max(expected) > 0.1
    assert np.abs(found - expected).max() < 1e-3 * np.max(expected)


@pytest.mark.cases("turn-hall_zones", "move-time_to_collision", "hold-personal_space")
@pytest.mark.parametrize("name", ["personal_space", "time_to_collision", "hall_zones"])
@pytest.mark.parametrize("kind", ["move", "turn", "hold"])
def test_many_motions_cost_the_same_when_they_are_taken_in_parts(kind, name, monkeypatch):
    rng = np.random.default_rng(8)
    world = ROOM.with_content(people=people("who turn every second", rng))
    m = motions(kind, 0.5, world, rng)
    whole = motion_costs(make_criterion(name), m)
    monkeypatch.setattr("hpop.motions.quadrature.AT_ONCE", 40)
    assert (motion_costs(make_criterion(name), motions(kind, 0.5, world, np.random.default_rng(0))) >= 0).all()
    parts = motion_costs(make_criterion(name), Motions(world, m.model, m.law, m.start, m.end, t0=m.t0))
    assert parts == pytest.approx(whole, rel=1e-12)


def test_who_stands_leaves_the_panels_of_moves_as_they_are():
    """Then no rate reads the time, and fronts of today stay what they are, to the last bit."""
    rng = np.random.default_rng(8)
    standing = [Person(0.5, 0.5, 1.0), Person(-1, 1)]
    m = motions("move", 1.0, ROOM.with_content(people=standing), rng)
    also = motions("move", 1.0, ROOM.with_content(people=[*standing, zigzag(rng, 0.1)]), np.random.default_rng(8))
    assert (m.integrate(lambda s: np.exp(-s.base.x)) == also.integrate(lambda s: np.exp(-s.base.x))).all()
