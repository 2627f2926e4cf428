"""Claims of the roadmap among people who move: as of the lattice, on positions where they happen to be."""

import numpy as np
import pytest

from hpop.criteria.base import trajectory_costs
from hpop.planners.roadmap import Roadmap
from hpop.status import Status
from hpop.world import Person
from tests.planners.timed.rooms_with_people import gaps, in_the_door, through_the_doors


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
