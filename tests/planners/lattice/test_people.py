"""People in a lattice: who stands is planned around; a search without a clock on it refuses who moves by name."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria.costs import trajectory_cost
from hpop.errors import QueryError
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice, WeightedSum
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(0, 0, 6, 4))
ROBOT = DifferentialDrive(radius=0.25)
ANN = Person(3.0, 2.0, math.pi, name="Ann")


def problem(*people, criteria=("personal_space", "length")):
    return Problem(ROOM.with_content(people=people), ROBOT, (1, 2, 0), (5, 2, 0), list(criteria))


def test_people_who_move_are_named_and_the_way_out_is_told():
    walking = Person(1.0, 3.0, velocity=(0.5, 0.0), name="Bob")
    nameless = Person(2.0, 3.0, velocity=(0.0, -0.5))
    with pytest.raises(QueryError, match=r"weighted-sum does not consider time.*: Bob, number 2[.]") as raised:
        WeightedSum(on={"lattice": {"step": 0.5}}).solve(problem(ANN, walking, nameless))
    assert "no velocity" in str(raised.value)
    assert "Ann" not in str(raised.value)


def test_people_who_move_are_refused_whatever_the_criteria_are():
    with pytest.raises(QueryError, match="Bob"):
        WeightedSum().solve(problem(Person(1.0, 3.0, velocity=(0.5, 0.0), name="Bob"), criteria=["length"]))


def test_the_lattice_trades_length_for_the_space_of_a_person_who_stands():
    found = Lattice(step=0.5).solve(problem(ANN))
    assert found.status is Status.COMPLETE
    assert len(found.trajectories) > 1
    passing = []
    for trajectory in found.trajectories:
        t = np.linspace(0, trajectory.duration, 4000)
        s = trajectory.at(t)
        passing.append(np.hypot(s.x - ANN.x, s.y - ANN.y).min())
    assert min(passing) >= ROBOT.radius + ANN.radius - 1e-9
    order = np.argsort(found.planned[:, 1])
    assert (np.diff(found.planned[order, 0]) < 0).all()
    assert passing[order[-1]] > passing[order[0]]


def test_the_lattice_plans_what_a_trajectory_costs():
    setting = problem(ANN, Person(4.0, 3.2, 1.0))
    found = Lattice(step=0.5).solve(setting)
    for trajectory, planned, tolerance in zip(found.trajectories, found.planned, found.tolerance, strict=True):
        costs = [trajectory_cost(criterion, trajectory, setting.world) for criterion in setting.criteria]
        assert (np.abs(planned - costs) <= tolerance).all()
