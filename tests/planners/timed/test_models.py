"""Claims: planners with a clock keep what they promise with other robots, and among people who are not sure."""

import numpy as np
import pytest
import shapely

from hpop.base.registry import make_model
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.world import Future, Person, World
from tests.planners.timed.rooms_with_people import through_the_doors

WALKER = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0, name="Bob")
LONG = DifferentialDrive(footprint=((0.5, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.5, -0.2)))
ROBOTS = {
    "pan_tilt": make_model("pan_tilt"),
    "long": LONG,
    "mast": DifferentialDrive(radius=0.3, camera_offset=(0.1, 0)),
}


@pytest.mark.parametrize("robot", ["long", "mast", pytest.param("pan_tilt", marks=pytest.mark.proof)])
def test_plans_of_any_robot_in_the_plane_are_what_they_claim(robot):
    problem = through_the_doors(WALKER, criteria=("hall_zones", "duration", "turns"), robot=ROBOTS[robot])
    front = problem.solve(Lattice(step=0.5, margin=0.1, eps=0.2))
    assert len(front)
    assert "NOT VALID" not in front.certificate
    assert verify(problem, front) == []


@pytest.mark.cases("two futures")
@pytest.mark.parametrize(
    "person",
    [
        pytest.param(
            Person(5.0, 1.4, velocity=(-0.6, 0.2), until=5.0, spread=0.15, growth=0.1), marks=pytest.mark.proof
        ),
        Person(5.0, 2.0, futures=(Future(0.5, velocity=(-0.7, 0.0)), Future(0.5, velocity=(0.0, 0.6))), until=4.0),
        Person(5.0, 2.0, futures=(Future(1, velocity=(-0.7, 0.0), until=2.0, afterwards="stays"),), spread=0.1),
    ],
    ids=["grows unsure", "two futures", "stays somewhere there"],
)
def test_plans_among_people_who_are_not_sure_are_what_they_claim(person):
    problem = through_the_doors(person, criteria=("hall_zones", "duration", "turns"))
    front = problem.solve(Lattice(step=0.5, eps=0.2))
    assert len(front)
    assert "NOT VALID" not in front.certificate
    assert verify(problem, front) == []


def test_who_may_be_anywhere_blocks_nothing_but_who_is_here_does():
    """With a deviation of 2 m no position is taken with 5 %; with one of 1 cm one position is."""
    hall = World.from_polygons([], extent=shapely.box(0, 0, 8, 1.2))

    def lengths(spread):
        stands = Person(4.0, 0.6, spread=spread, growth=1e-3, until=60.0, afterwards="stays")
        problem = Problem(
            hall.with_content(people=[stands]), DifferentialDrive(radius=0.25), (1, 0.6, 0), (7, 0.6, None), ["length"]
        )
        return Lattice(step=0.5).solve(problem).planned

    assert lengths(2.0) == pytest.approx(np.array([[6.0]]))
    assert not lengths(0.01).size


def test_fronts_are_the_same_again():
    problem = through_the_doors(WALKER, criteria=("hall_zones", "duration"))
    first, again = (problem.solve(Lattice(step=0.5)) for _ in range(2))
    assert (first.costs == again.costs).all()
    assert [t.describe() for t in first.trajectories] == [t.describe() for t in again.trajectories]
