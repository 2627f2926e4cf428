"""Claims of the lattice among people who move: it waits, keeps clear, and its plans cost what it says."""

import numpy as np
import pytest
import shapely

from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, QueryError
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.world import Person, World
from tests.planners.timed.rooms_with_people import (
    EVEN,
    gaps,
    in_the_door,
    nondominated,
    plans_in_a_grid,
    through_the_doors,
)

WALKER = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0, name="Bob")


def within_tolerance(problem, found):
    costs = trajectory_costs(found.objectives, found.trajectories, problem.world)
    return (np.abs(costs - found.planned) <= found.tolerance + 1e-9).all()


def test_who_stands_in_the_door_for_a_while_is_waited_for_or_avoided():
    problem = through_the_doors(in_the_door(until=16.0))
    found = Lattice(step=0.25).solve(problem)
    assert found.status is Status.COMPLETE
    length, duration = found.planned.T
    waits = int(np.argmin(length))
    assert "hold" in found.trajectories[waits].kinds
    assert length[waits] == pytest.approx(4.0)
    assert duration[waits] > 16.0
    detour = int(np.argmin(duration))
    assert "hold" not in found.trajectories[detour].kinds
    assert found.trajectories[detour].states.y.max() > 4.5, "through the other door"
    assert all((gaps(problem, trajectory) >= 0).all() for trajectory in found.trajectories)
    assert within_tolerance(problem, found)


def test_one_that_never_holds_dawdles_or_goes_the_other_way():
    found = Lattice(step=0.25, hold=None).solve(through_the_doors(in_the_door(until=16.0)))
    assert not any("hold" in trajectory.kinds[1:] for trajectory in found.trajectories)
    for trajectory in found.trajectories:
        if trajectory.kinds[0] == "hold":
            assert trajectory.times[1] == pytest.approx(0.5), "v/2a before a run"


def test_who_stays_in_the_door_when_the_prediction_ends_is_always_in_the_way():
    there, stays = (Person(2.0, 2.0, velocity=(0.5, 0.0), until=2.0, afterwards=then) for then in ("gone", "stays"))
    open_later, closed = (Lattice(step=0.25).solve(through_the_doors(one)) for one in (there, stays))
    assert open_later.planned[:, 0].min() == pytest.approx(4.0)
    assert closed.planned[:, 0].min() > 6.0


@pytest.mark.parametrize(
    "criterion",
    [
        "hall_zones",
        *(
            pytest.param(one, marks=pytest.mark.proof)
            for one in ("personal_space", "social_force", "time_to_collision", "visibility_to_people")
        ),
    ],
)
def test_plans_cost_what_they_were_planned_to(criterion):
    problem = through_the_doors(WALKER, criteria=(criterion, "length", "turns"))
    found = Lattice(step=0.5, eps=0.2).solve(problem)
    assert len(found.trajectories)
    assert within_tolerance(problem, found)
    assert all((gaps(problem, trajectory) >= 0).all() for trajectory in found.trajectories)


def test_what_many_people_cost_who_are_each_too_far_away_to_be_noticed_is_in_the_tolerance():
    angles = np.linspace(0.1, 2 * np.pi + 0.1, 13, endpoint=False).tolist()
    ring = [
        Person(4 + 1.8 * np.cos(a), 4 + 1.8 * np.sin(a), velocity=(-0.02 * np.cos(a), -0.02 * np.sin(a)), until=6.0)
        for a in angles
    ]
    world = World.from_polygons([], extent=shapely.box(0, 0, 8, 8)).with_content(people=ring)
    robot = DifferentialDrive(radius=0.1)
    problem = Problem(world, robot, (3.5, 4, 0), (4.5, 4, None), ["personal_space", "length"])
    found = Lattice(step=0.5, headings=4, eps=1.0).solve(problem)
    assert within_tolerance(problem, found)


def test_the_front_of_a_small_grid_is_that_of_all_plans():
    world = World.from_polygons([], extent=shapely.box(-0.3, -0.3, 2.3, 0.8))
    walks = Person(1.6, 0.85, velocity=(-0.6, 0.0), radius=0.1, until=3.0)
    crowded = world.with_content(people=[walks])
    problem = Problem(crowded, EVEN.model, (0, 0, 0), (1.5, 0, None), ["personal_space", "duration", "turns"])
    lattice = Lattice(step=EVEN.step, headings=4, clock=EVEN.tick, hold=1.0, arrive_by=8.0)
    found = lattice.solve(problem)
    plans = list(plans_in_a_grid(EVEN, (0, 0, 0), (3, 0), (5, 2), 16, 2))
    clear = [plan for plan in plans if (gaps(problem, plan, 0.02) > 0.2).all()]
    assert len(clear) == len(plans) > 50
    costs = trajectory_costs(found.objectives, plans, problem.world)
    for row in nondominated(costs):
        assert (np.abs(found.planned - row) <= found.tolerance + 1e-4).all(axis=1).any(), row
    assert within_tolerance(problem, found)
    best = costs[:, None] <= found.planned - found.tolerance - 1e-4
    assert not best.all(axis=2).any(), "a plan is better than the front"


def test_where_nobody_moves_there_is_no_clock():
    stands = Person(3.0, 4.0)
    plain, with_options = (
        Lattice(step=0.5, **options).solve(through_the_doors(stands))
        for options in ({}, {"clock": 0.1, "hold": None, "margin": 0.3})
    )
    assert (plain.planned == with_options.planned).all()
    assert plain.certificate == with_options.certificate
    assert with_options.notes == (
        *plain.notes,
        # the margin is kept from who stands
        "no person moves, so the search does not consider time: clock, hold had no effect",
    )
    with pytest.raises(OptionError, match="arrive_by needs people who move"):
        Lattice(step=0.5, arrive_by=20.0).solve(through_the_doors(stands))


def test_a_margin_is_kept_and_one_that_leaves_no_way_says_so():
    problem = through_the_doors(WALKER, criteria=("length", "duration"))
    found = Lattice(step=0.25, margin=0.5).solve(problem)
    assert all((gaps(problem, trajectory) >= 0.5).all() for trajectory in found.trajectories)
    blocked = [Person(3.0, y, velocity=(0.0, 0.05), until=2.0, afterwards="stays") for y in (2.0, 5.0)]
    none = Lattice(step=0.25, margin=0.5).solve(through_the_doors(*blocked))
    assert none.status is Status.NO_PATH
    assert "moving people block them" in none.notes[-1]


def test_one_who_starts_in_a_margin_may_leave_but_not_stay():
    comes = Person(1.0, 1.2, velocity=(0.0, 0.05), until=6.0)
    problem = through_the_doors(comes)
    found = Lattice(step=0.25, margin=0.6).solve(problem)
    assert len(found.trajectories)
    for trajectory in found.trajectories:
        times = np.arange(0.0, trajectory.duration, 0.02)
        states = trajectory.at(times)
        apart = np.hypot(states.x - comes.at(times)[0], states.y - comes.at(times)[1]) - 0.5
        inside = times[(apart < 0.6 - 1e-3) & (times < 6.0)]
        assert inside.max() < 5.5, "it has left"
        assert apart[times < 6.0].min() > 0
        assert trajectory.kinds[0] != "hold" or trajectory.times[1] == pytest.approx(0.5), "v/2a before a run"


def test_somebody_who_walks_up_to_the_start_may_be_left_and_who_comes_too_fast_is_taken_to_stop():
    """0.5 m/s and 0.55 m away: within the margin after 0.1 s, when the robot has hardly begun to move."""
    up, fast = (
        Person(0.5 - gap, 2.0, velocity=(v, 0.0), until=6.0, name="Ada") for gap, v in ((0.55, 0.5), (0.1, 1.0))
    )
    problem = through_the_doors(up)
    front = problem.solve(Lattice(step=0.25, margin=0.5, eps=0.05))
    assert len(front)
    assert not verify(problem, front)
    for trajectory in front.trajectories:
        assert 0.0 < gaps(problem, trajectory).min() < 0.5, "it comes nearer, and the robot leaves"
    stops = Lattice(step=0.25).solve(through_the_doors(fast))
    assert len(stops.trajectories)
    assert "taken to stop before it: 'Ada'" in " ".join(stops.notes)


def test_somebody_slow_who_is_outside_the_margin_and_leaves_no_time_to_go_is_named_with_when():
    """The only way out of a dead end is closed by a person at 0.3 m/s, whose margin is 0.9 m away."""
    comes = Person(2.6, 2.0, velocity=(-0.3, 0.0), until=8.0, name="Ada")
    room = World.from_polygons([], extent=shapely.box(0.6, 1.6, 8.0, 2.4)).with_content(people=[comes])
    problem = Problem(room, DifferentialDrive(radius=0.25), (1.0, 2.0, 0.0), (7.0, 2.0, 0.0), ["duration"])
    none = Lattice(step=0.25, margin=0.2).solve(problem)
    assert none.status is Status.NO_PATH
    # 1.6 m between their middles, 0.7 m in which they may not be and 0.125 m of ramps: 0.775 m at 0.3 m/s.
    assert "Ada may come too near to the start, after 2.6 s, so that the robot cannot leave" in none.notes[-1]
    assert "give a smaller margin, or choose another start or goal, or plan again later" in none.notes[-1]


def test_a_start_in_contact_with_somebody_is_refused_to_a_robot_that_is_not_round():
    robot = DifferentialDrive(footprint=((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)))
    room = World.from_polygons([], extent=shapely.box(0, 0, 8, 4))
    world = room.with_content(people=[Person(1.2, 2.0, velocity=(1, 0), until=3.0, name="Ann")])
    with pytest.raises(QueryError, match=r"the start .* Ann is there at 0 s"):
        Lattice(step=0.5).solve(Problem(world, robot, (1.0, 2.0, 0.0), (7.0, 2.0, 0.0), ["duration"]))


def test_time_is_kept():
    found = Lattice(step=0.25, arrive_by=18.0).solve(through_the_doors(in_the_door(until=16.0)))
    assert len(found.trajectories)
    assert max(t.duration for t in found.trajectories) < 18.0 + 0.2
    assert found.planned[:, 0].min() > 4.0, "who waits is too late"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"clock": 0.001}, "clock must be a time step in s"),
        ({"hold": 0.0}, "hold must be the shortest wait in s"),
        ({"hold": True}, "hold must be the shortest wait in s"),
        ({"arrive_by": -1.0}, "arrive_by must be a time in s"),
        ({"hold": 4000.0}, "hold must be .* to 3,600, got 4000.0; with None"),
        ({"arrive_by": 1e6}, "arrive_by must be a time in s .* to 52428.8, got 1000000.0; leave it out"),
        ({"margin": -0.1}, "margin must be a distance in m"),
    ],
)
def test_wrong_options_are_told(options, says):
    with pytest.raises(OptionError, match=says):
        Lattice(**options)
