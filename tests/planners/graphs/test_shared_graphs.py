"""A world keeps what was built of graphs: what an earlier planning run has costed, another one does not cost again."""

import gc
import weakref
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely

import hpop
from hpop.planners.graph_planners import Lattice
from hpop.world import Person, World
from tests.watched import watched

CRITERIA = ({"watched": {"weight": 1.0}}, "length", "turns")


@pytest.fixture(autouse=True)
def asked_for():
    with watched() as costed:
        yield costed


def weights(asked_for):
    """Weights with which graphs were costed since it was asked last."""
    found = {weight for weight, motions in asked_for if motions > 200}  # trajectories are shorter
    asked_for.clear()
    return found


def world():
    return hpop.World.from_polygons([shapely.box(3, 0, 3.5, 3)], extent=shapely.box(0, 0, 8, 6))


def asked(world, goal=(7.0, 1.0, 0.0), names=CRITERIA, radius=0.3, start=(1.0, 1.0, 0.0)):
    return hpop.Problem(world, hpop.DifferentialDrive(radius=radius), start, goal, names)


def built(problem):
    return Lattice(step=0.5).lattice(problem).graph(problem.criteria)


def test_another_goal_and_another_planner_cost_nothing_again(asked_for):
    room = world()
    first = asked(room).solve("lattice", step=0.5)
    assert weights(asked_for) == {1.0}
    again = asked(room).solve("lattice", step=0.5)
    asked(room, goal=(6.0, 4.0, None)).solve("lattice", step=0.5, eps=0.1)
    asked(room).solve("weighted-sum", step=0.5)
    list(asked(room).fronts(["lattice"], step=0.5, stage=lambda front: None))
    assert weights(asked_for) == set()
    assert again.costs.tolist() == first.costs.tolist()


def test_another_criterion_costs_itself_alone(asked_for):
    room = world()
    built(asked(room))
    assert weights(asked_for) == {1.0}
    built(asked(room, names=({"watched": {"weight": 2.0}}, "length")))
    assert weights(asked_for) == {2.0}
    built(asked(room, names=("turns", {"watched": {"weight": 1.0}}, "exposure")))
    assert weights(asked_for) == set()


@pytest.mark.parametrize(
    "changed",
    [{}, {"radius": 0.45}, {"start": (1.1, 1.0, 0.0)}],
    ids=["world", "model", "anchor"],
)
def test_another_world_model_or_anchor_costs_anew(changed, asked_for):
    room = world()
    asked(room).solve("lattice", step=0.5)
    assert weights(asked_for) == {1.0}
    found = asked(room if changed else world(), **changed).solve("lattice", step=0.5)
    assert weights(asked_for) == {1.0}
    assert found.costs.tolist() == asked(world(), **changed).solve("lattice", step=0.5).costs.tolist()


def test_a_criterion_that_may_change_is_costed_each_time():
    @dataclass
    class Changing:
        name = "changing"
        group, unit, aggregate, requires, smooth, quantum = "C", "m", "sum", (), True, 1e-3
        weight: float = 1.0

        def cost(self, m):
            return self.weight * m.base.length

    room, changing = world(), Changing()
    problem = asked(room, names=(changing, "turns"))
    before = built(problem).largest.tolist()
    changing.weight = 3.0
    after = built(problem).largest.tolist()
    assert after[0] == pytest.approx(3 * before[0], rel=0.01)


@dataclass(frozen=True)
class Weighted:
    name = "weighted"
    group, unit, aggregate, requires, smooth, quantum = "C", "m", "sum", (), True, 1e-3
    weight: float = field(default=1.0, compare=False)

    def cost(self, m):
        return self.weight * m.base.length


class Doubled(Weighted):
    factor = 2.0

    def __init__(self, factor):
        object.__setattr__(self, "factor", factor)

    def cost(self, m):
        return self.factor * m.base.length


@pytest.mark.parametrize("kind", [Weighted, Doubled], ids=["a field that is not compared", "more than fields"])
def test_criteria_that_compare_equal_and_cost_otherwise_share_no_costs(kind):
    room = world()
    once, thrice = (built(asked(room, names=(kind(weight), "turns"))).largest for weight in (1.0, 3.0))
    assert thrice[0] == pytest.approx(3 * once[0], rel=0.01)


def test_what_is_kept_goes_with_the_world():
    room = world()
    built(asked(room))
    kept = weakref.ref(room.cache)
    del room
    gc.collect()
    assert kept() is None


def test_what_is_kept_is_bounded_in_bytes(monkeypatch):
    room = world()
    room.cache._budget.limit = 400_000
    for x in (1.0, 1.1, 1.2, 1.3):
        problem = asked(room, start=(x, 1.0, 0.0), goal=(7.0, 1.0, None))
        problem.solve("lattice", step=0.25)
        assert room.cache.size + room.ground.cache.size <= 400_000


def test_states_costed_in_another_world_stay_the_same_states() -> None:
    """Also of a lattice whose arcs another one has laid out: who stands in the other world takes none of them away."""
    world = World.from_polygons([], extent=shapely.box(0, 0, 4, 3))
    robot = hpop.DifferentialDrive(radius=0.3)
    problem = hpop.Problem(world, robot, (1, 1, 0), (3, 1, None), ["length", "turns"])
    size = Lattice(step=0.5).lattice(problem).arcs.start.size - 1
    among = world.with_content(people=[Person(2.0, 1.5)])
    other = Lattice(step=0.5).lattice(problem).costed_in(among)
    assert other.size == size
    assert other.states(np.arange(size)).x.size == size
