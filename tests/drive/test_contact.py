"""People who stand too near, walk against the robot or are reported within walls: the drive goes on, and says so."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive import Execution, Options
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.world import Person, World

ROBOT = hpop.DifferentialDrive(radius=0.3)
HALL = World.from_polygons([shapely.box(6.5, 3.6, 7.3, 4.4)], extent=shapely.box(0, 0, 14, 8))


@cache
def planned() -> tuple[hpop.Problem, hpop.Front]:
    problem = hpop.Problem(HALL, ROBOT, (1.0, 2.0, 0.0), (13.0, 2.0, None), ["duration", "length"])
    return problem, problem.solve("lattice", step=0.5)


def drive() -> Execution:
    problem, front = planned()
    return hpop.follow(problem, front, "knee")


def gaps(way: hpop.Trajectory, begin: float, person: Person) -> np.ndarray:
    """Return the gaps between the surfaces, m, every hundredth of a second, for a person who walks as predicted."""
    times = np.arange(begin, way.duration, 0.01)
    s, (x, y) = way.at(times), person.at(times - begin)
    return np.hypot(s.x - x, s.y - y) - 0.3 - person.radius


def final(following: Execution, now: float) -> Options:
    """Return the options once the timed graph among the people exists."""
    for _ in range(600):
        options = following.options(now, deadline=0.5)
        if options.status.is_final:
            return options
    raise AssertionError("the graph was not made")


@pytest.mark.parametrize("place", [(3.53, 2.0), (2.47, 2.0), (3.0, 2.52)], ids=["ahead", "behind", "beside"])
def test_who_stands_too_near_may_be_left(place: tuple[float, float]) -> None:
    following, person = drive(), Person(*place, name="Ann")  # the robot is at (3, 2) after 2 s
    change = following.world(2.0, people=[person])
    assert any("in contact with standing people: 'Ann'" in note for note in change.notes)
    options = following.options(2.0, deadline=0.5)
    assert len(options)
    following.take(options.knee())
    gap = gaps(following.plan, 2.0, person)
    assert (np.diff(gap[: int(np.argmax(gap >= 0))]) >= -1e-5).all()
    assert gap.min() >= gap[0] - 1e-5


@pytest.mark.cases("-0.02")
@pytest.mark.parametrize("apart", [0.4, 0.05, 0.0, -0.02])
def test_a_slow_walker_against_the_robot_leaves_it_options(apart: float) -> None:
    following = drive()
    following.world(2.0, people=[Person(3.55 + apart, 2.02, velocity=(-0.3, 0.0), until=6.0, name="Bob")])
    options = final(following, 2.0)
    assert len(options)
    assert options.status is Status.COMPLETE
    (bob,) = following.surroundings.people  # taken to stop before the robot
    assert bob.until is None or bob.afterwards == "stays"
    following.take(options.knee())
    ahead = following.plan
    assert ahead.states.x[-1] == pytest.approx(13.0)
    gap = gaps(ahead, 2.0, bob)
    assert gap.min() >= min(0.0, gap[0]) - 1e-3


def about(seed: int) -> list[Person]:
    """Return one or two people about the robot at (3, 2), up to 12 cm in contact with it; they stand or walk."""
    rng, people = np.random.default_rng(seed), []
    for i in range(rng.integers(1, 3)):
        angle, apart = rng.uniform(-np.pi, np.pi), 0.55 + rng.uniform(-0.12, 0.05)
        speed, heading = rng.choice([0, 0.3, 0.8]), rng.uniform(-np.pi, np.pi)
        place, velocity = (length * np.exp(1j * along) for length, along in ((apart, angle), (speed, heading)))
        walks = {"velocity": (velocity.real, velocity.imag), "until": 4.0} if speed else {}
        people.append(Person(3.0 + place.real, 2.0 + place.imag, name=f"person {i}", **walks))
    return people


def check_options_part(people: list[Person]) -> None:
    """Check that there are options, along which the robot's own motion never reduces a gap in contact."""
    following = drive()
    following.at(2.0)
    following.world(2.0, people=people)
    following.ready(2.0)
    options = final(following, 2.0)
    assert len(options)
    following.take(options.knee())
    times = np.arange(options.commit.time, following.plan.duration, 0.01)
    s = following.plan.at(times)
    for person in following.surroundings.people:
        x, y = (np.broadcast_to(column, times.shape) for column in person.at(times - 2.0))
        there = np.broadcast_to(person.there(times - 2.0), times.shape)[:-1] > 0
        gap = np.hypot(s.x - x, s.y - y)[:-1] - 0.3 - person.radius
        then = np.hypot(s.x[1:] - x[:-1], s.y[1:] - y[:-1]) - 0.3 - person.radius
        nearer = there & (then < -1e-3) & (then < gap - 1e-4)
        assert not nearer.any()


BETWEEN = [Person(3.05, 1.57, name="Ann"), Person(2.77, 2.54, name="Bob")]  # a lattice has no free heading between them
PASSING = [Person(3.45, 2.15, velocity=(0.4, -0.69), until=4.0, name="Ann")]


@pytest.mark.cases("between two")
@pytest.mark.parametrize("people", [BETWEEN, PASSING], ids=["between two", "one passes"])
def test_a_robot_that_is_touched_leaves_at_any_angle_and_by_those_who_have_just_passed(people: list[Person]) -> None:
    check_options_part(people)


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(160))
def test_a_drive_is_never_without_options_because_people_touch_the_robot(seed: int) -> None:
    check_options_part(about(seed))


def test_one_walker_within_a_pillar_does_not_hide_the_others() -> None:
    following = drive()
    walks = Person(9, 2, velocity=(-0.9, 0), until=4.0, name="a")
    change = following.world(1.0, people=[walks, Person(6.7, 4.0, velocity=(0.2, 0), until=4.0, name="b")])
    first, second = following.surroundings.people
    assert first == walks
    assert (second.x, second.y) == pytest.approx((6.5, 4.0))  # the nearest border of the pillar
    assert any("within an obstacle, shifted to its border: 'b'" in note for note in change.notes)


@pytest.mark.parametrize(
    "person",
    [
        Person(1.53, 2.0, until=3.0, name="Cem"),  # stands, and leaves later
        Person(1.5, 2.0, velocity=(0.5, 0.0), until=5.0, name="Cem"),  # walks away ahead
        Person(1.2, 1.5, velocity=(0.0, -0.3), until=5.0, name="Cem"),
    ],
    ids=["stands", "walks ahead", "walks aside"],
)
def test_a_plan_in_time_begins_in_contact_and_the_gap_does_not_shrink(person: Person) -> None:
    world = HALL.with_content(people=[person])
    problem = hpop.Problem(world, ROBOT, (1.0, 2.0, 0.0), (13.0, 2.0, None), ["duration", "length"])
    front = problem.solve("lattice", step=0.5)
    assert len(front)
    assert not verify(problem, front)
    assert any("starts in contact with Cem" in note for note in front.notes)
    for way in front.trajectories:
        gap = gaps(way, 0.0, person)
        while_there = gap[: int(100 * person.until)]
        free = int(np.argmax(while_there >= 0)) or while_there.size
        assert gap[0] < 0
        assert (np.diff(gap[:free]) >= -1e-6).all()


@pytest.mark.cases("all stand")
@pytest.mark.parametrize("walks", [False, True], ids=["all stand", "one walks up"])
def test_a_robot_hemmed_in_is_told_who_is_about_it(walks: bool) -> None:
    following = drive()
    ahead = {"velocity": (-0.3, 0.0), "until": 6.0} if walks else {}
    about = [Person(3.58, 2.0, name="Ann", **ahead), Person(2.44, 2.0, name="Bob")]
    about += [Person(3.0, 2.56, name="Cem"), Person(3.0, 1.44, name="Dan")]
    following.world(2.0, people=[*about, Person(12.0, 7.0, name="Eve")])
    options = final(following, 2.0)
    assert options.status is Status.NO_PATH
    (note,) = (note for note in options.front.notes if note.startswith("no path"))
    near, far = note.split("; closed elsewhere: ")
    assert "closed near the robot: " in near
    assert all(f"{name} who stands at" in near for name in ("Ann", "Bob", "Cem", "Dan"))
    assert far == "Eve who stands at (12.00, 7.00)"
