"""Contact with people who stand: it may be left where the gap does not shrink, and never made."""

import math
import tracemalloc

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.models.collision.leaving import Leaving, touched, world_of_area
from hpop.models.collision.planar import PlanarCollision
from hpop.motions import Motions, States
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

HALL = World.from_polygons([], extent=shapely.box(0, 0, 8, 6))
ROUND = hpop.DifferentialDrive(radius=0.3)
LONG = hpop.DifferentialDrive(footprint=((0.5, 0.25), (-0.5, 0.25), (-0.5, -0.25), (0.5, -0.25)))


def gaps(trajectory, person, robot):
    """Between the surfaces, m, every 5 ms: the person is put where the robot's frame has it, by shapely."""
    outline = shapely.Point(0, 0).buffer(0.3, quad_segs=720) if robot is ROUND else shapely.Polygon(robot.footprint)
    shapely.prepare(outline)
    s = trajectory.at(np.arange(0.0, trajectory.duration, 0.005))
    dx, dy, cos, sin = person.x - s.x, person.y - s.y, np.cos(s.yaw), np.sin(s.yaw)
    return shapely.distance(outline, shapely.points(cos * dx + sin * dy, cos * dy - sin * dx)) - person.radius


PROGRAMS = ["smoothing", "epsilon-constraint", "weighted-sum-corridor"]
ROADMAP = {"roadmap": {"samples": 120}}
PLANNERS = [
    {"lattice": {"step": 0.5}},
    ROADMAP,
    "any-angle",
    *({p: {"step": 0.5}} for p in PROGRAMS),
]


# A long robot beside somebody can only go straight ahead, where a random roadmap has no sample.
LEAVING = [(robot, planner) for robot in (ROUND, LONG) for planner in PLANNERS if robot is ROUND or planner != ROADMAP]


@pytest.mark.parametrize(
    ("robot", "planner"), LEAVING, ids=[f"{'round' if r is ROUND else 'long'}-{p}" for r, p in LEAVING]
)
@pytest.mark.cases("long-{'lattice': {'step': 0.5}}", "round-any-angle")
def test_a_robot_plans_out_of_contact_and_the_gap_never_shrinks(robot, planner):
    person = Person(2.0, 3.53 if robot is ROUND else 3.48, name="Ann")  # beside it, 2 cm too near
    problem = hpop.Problem(HALL.with_content(people=[person]), robot, (2, 3, 0), (7, 4, None), ["length", "turns"])
    front = problem.solve(planner)
    assert len(front)
    assert not verify(problem, front)
    assert any("in contact with standing people: 'Ann'" in note for note in front.notes)
    for trajectory in front.trajectories:
        gap = gaps(trajectory, person, robot)
        assert gap[0] == pytest.approx(-0.02, abs=1e-4)
        free = int(np.argmax(gap >= -1e-6))
        assert free > 0
        assert (np.diff(gap[:free]) >= -1e-6).all()
        assert gap[free:].min() >= -1e-6


@pytest.mark.parametrize("planner", PROGRAMS)
@pytest.mark.cases("weighted-sum-corridor")
def test_programs_say_that_what_touches_somebody_again_is_dropped(planner):
    ahead = Person(2.0 + 0.53 * math.cos(0.35), 3.0 + 0.53 * math.sin(0.35), name="Ann")  # of the straight way
    problem = hpop.Problem(HALL.with_content(people=[ahead]), ROUND, (2, 3, 0), (7, 4, None), ["length", "turns"])
    front = problem.solve({planner: {"step": 0.5}})
    assert any("nonlinear programs ignore Ann" in note for note in front.notes)
    assert not verify(problem, front)
    assert len(front) or any("collides" in note for note in front.notes)


def test_rrt_refuses_a_start_in_contact_and_says_which_planners_do_not():
    person = Person(2.0, 3.53, name="Ann")
    problem = hpop.Problem(HALL.with_content(people=[person]), ROUND, (2, 3, 0), (7, 4, None), ["length"])
    with pytest.raises(QueryError, match=r"touches Ann there.*lattice, roadmap, any-angle"):
        problem.solve({"rrt": {"time_limit": 1.0}})


def test_a_move_towards_somebody_in_contact_is_not_free_and_one_along_the_tangent_is():
    person = Person(0.53, 0.0)
    body = shapely.Point(0.53, 0).buffer(0.25)
    leaving = Leaving.of(ROUND.parts, (0.53, 0.0), body, PlanarCollision(ROUND.parts, world_of_area(body)))
    world = HALL.with_content(people=[person])
    angles = np.radians([0.0, 45.0, 89.0, 90.0, 91.0, 135.0, 180.0])
    zero = 0.0 * angles
    for length in (0.1, 2.0):
        start = States(x=zero, y=zero, yaw=angles)
        end = States(x=length * np.cos(angles), y=length * np.sin(angles), yaw=angles)
        free = leaving.motions_free(Motions(world, ROUND, ROUND.laws["move"], start, end))
        assert free.tolist() == [False, False, False, True, True, True, True]
        back = leaving.motions_free(Motions(world, ROUND, ROUND.laws["move"], end, start))
        assert not back[free].any()  # nothing leads deeper into contact
    turn = Motions(world, ROUND, ROUND.laws["turn"], start, States(x=zero, y=zero, yaw=angles + 1.0))
    assert leaving.motions_free(turn).all()


def test_a_wall_is_not_left():
    walled = World.from_polygons([shapely.box(0, 3.28, 8, 6)], extent=shapely.box(0, 0, 8, 6))
    problem = hpop.Problem(walled, ROUND, (2, 3, 0), (7, 1, None), ["length"])
    with pytest.raises(hpop.errors.QueryError, match="not usable"):
        problem.solve({"lattice": {"step": 0.5}})


def test_verify_names_a_trajectory_that_goes_on_through_somebody():
    person = Person(2.53, 3.0, name="Ann")
    problem = hpop.Problem(HALL.with_content(people=[person]), ROUND, (2, 3, 0), (7, 3, None), ["length"])
    through = Trajectory.from_poses(ROUND, [(2, 3, 0), (7, 3, 0)])
    front = hpop.Front.of([[5.0]], [through], names=["length"], units=["m"], quanta=[1e-6], groups=["C"])
    assert any("touches Ann at 0.0" in fault for fault in verify(problem, front))


def test_who_is_touched():
    world = HALL.with_content(people=[Person(2.53, 3.0), Person(2.56, 3.0), Person(2, 3, velocity=(1, 0), until=1.0)])
    assert touched(ROUND.parts, world, States(x=np.array([2.0]), y=np.array([3.0]), yaw=np.zeros(1))) == (0,)


@pytest.mark.parametrize("planner", ["lattice", "roadmap"])
@pytest.mark.cases("lattice")
def test_a_margin_is_kept_from_people_who_stand(planner):
    person = Person(4.0, 3.0)
    problem = hpop.Problem(HALL.with_content(people=[person]), ROUND, (1, 3, 0), (7, 3, None), ["length", "turns"])
    options = {"step": 1.0} if planner == "lattice" else {"samples": 150}
    for margin in (0.0, 0.5):
        front = problem.solve({planner: {**options, "margin": margin}})
        assert not any("margin had no effect" in note for note in front.notes)
        assert min(gaps(t, person, ROUND).min() for t in front.trajectories) >= margin - 1e-3
    near = hpop.Problem(HALL.with_content(people=[person]), ROUND, (3.2, 3, math.pi), (1, 3, None), ["length"])
    assert len(near.solve({planner: {**options, "margin": 0.5}}))  # who starts within a margin may leave


@pytest.mark.proof
def test_many_motions_out_of_contact_are_tested_in_little_memory():
    """A roadmap of 60 samples had taken 560 MB, ten times what its planner was allowed, for its turns in contact."""
    body = shapely.Point(0.53, 0).buffer(0.25)
    leaving = Leaving.of(ROUND.parts, (0.53, 0.0), body, PlanarCollision(ROUND.parts, world_of_area(body)))
    angles = np.linspace(0.0, 6.0, 2_000)
    start, end = (States(x=0.0 * angles, y=0.0 * angles, yaw=yaw) for yaw in (angles, angles + 1.0))
    turns = Motions(HALL, ROUND, ROUND.laws["turn"], start, end)
    tracemalloc.start()
    try:
        free = leaving.motions_free(turns)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert free.all()
    assert most < 10e6
