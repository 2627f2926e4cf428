"""Claims of the roadmap among people who move: as of the lattice, on positions where they happen to be."""

import numpy as np
import pytest
import shapely

from hpop.criteria.costs import trajectory_costs
from hpop.planners.graph_planners import Lattice, Roadmap
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import TimedArcs
from hpop.planners.graphs.timed.presence import reading_time
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import Person, World
from tests.planners.timed.rooms_with_people import ROBOT, gaps, in_the_door, through_the_doors


def test_who_stands_in_the_door_for_a_while_is_waited_for_or_avoided():
    problem = through_the_doors(in_the_door(until=20.0))
    found = Roadmap(samples=25, seed=1).solve(problem)
    assert found.status is Status.COMPLETE
    length, duration = found.planned.T
    waits, detour = found.trajectories[int(np.argmin(length))], found.trajectories[int(np.argmin(duration))]
    assert "hold" in waits.kinds
    assert length.min() == pytest.approx(4.0)
    assert waits.duration > 20.0
    assert detour.states.y.max() > 4.5, "through the other door"
    assert all((gaps(problem, trajectory) >= 0).all() for trajectory in found.trajectories)


def test_plans_cost_what_they_were_planned_to():
    walker = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0)
    problem = through_the_doors(walker, criteria=("hall_zones", "length", "turns"))
    found = Roadmap(samples=40, margin=0.1).solve(problem)
    costs = trajectory_costs(found.objectives, found.trajectories, problem.world)
    assert len(found.trajectories) > 2
    assert (np.abs(costs - found.planned) <= found.tolerance + 1e-9).all()
    assert all((gaps(problem, trajectory) >= 0.1).all() for trajectory in found.trajectories)
    assert found.provenance[0]["margin"] == 0.1


WALKER = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0)


@pytest.mark.seeds(1, of=[0, 2, 3])
def test_positions_that_no_free_link_reaches_leave_no_gap_among_the_places(seed):
    problem = through_the_doors(WALKER, criteria=("hall_zones", "length"))
    planner = Roadmap(samples=30, neighbours=1, seed=seed)
    roadmap = planner.roadmap(problem)
    reached = np.unique(roadmap.places(np.arange(roadmap.size)))
    assert reached.size < len(roadmap.positions), "every sample has a free link, so this asks nothing"
    arcs = TimedArcs.of(roadmap, TickClock(0.05))
    of_node = roadmap.states(np.arange(roadmap.size))
    for name in ("x", "y"):  # each node stands where its place is
        assert np.array_equal(getattr(arcs.states, name)[arcs.place], getattr(of_node, name))
    found = planner.solve(problem)
    assert found.status is Status.COMPLETE
    costs = trajectory_costs(found.objectives, found.trajectories, problem.world)
    assert len(costs)
    assert (np.abs(costs - found.planned) <= found.tolerance + 1e-9).all()
    assert all((gaps(problem, trajectory) >= 0).all() for trajectory in found.trajectories)


BEYOND = 0  # a seed whose first sample is beyond the wall
WALL = World.from_polygons([shapely.box(2.9, 0.0, 3.1, 6.0)], extent=shapely.box(0, 0, 6, 6))


@pytest.mark.parametrize("criteria", [("hall_zones", "length"), ("personal_space",), ("length", "duration")])
@pytest.mark.parametrize("planner", [Roadmap(samples=1, neighbours=1), Lattice(step=4.0)], ids=["roadmap", "lattice"])
def test_a_graph_without_arcs_has_no_path(planner, criteria):
    problem = Problem(WALL.with_content(people=[WALKER]), ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, None), list(criteria))
    found = planner.solve(problem)
    assert (found.status, found.trajectories) == (Status.NO_PATH, ())


def test_a_graph_without_arcs_is_asked_which_criteria_read_the_time_and_one_may_be_at_the_goal_already():
    here = (1.0, 2.0, 0.0)
    problem = Problem(WALL.with_content(people=[WALKER]), ROBOT, here, here, ["length", "hall_zones"])
    planner = Roadmap(samples=1, seed=BEYOND)
    roadmap = planner.roadmap(problem)
    assert (roadmap.arcs.heads.size, reading_time(problem.criteria, roadmap)) == (0, [1])
    found = planner.solve(problem)
    assert (found.status, found.planned.tolist()) == (Status.COMPLETE, [[0.0, 0.0]])
