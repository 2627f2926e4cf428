"""Properties of every graph of states, of a lattice as well as of a roadmap."""

import math

import numpy as np
import pytest
import shapely

from hpop.base.math import wrap
from hpop.criteria import Exposure, Length, Turns, make_criterion
from hpop.criteria.costs import motion_costs, trajectory_costs
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import AnyAngle, Lattice, Roadmap
from hpop.problems.problem import Problem
from hpop.problems.verify import collision_free
from hpop.world import World

WORLD = World.from_polygons(
    [shapely.box(2.2, 1.2, 2.9, 2.6), shapely.Polygon([(3.6, 0.0), (4.4, 0.0), (4.1, 1.3)])],
    extent=shapely.box(0, 0, 5, 4),
)
ROUND = DifferentialDrive(radius=0.2, camera_height=0.6, camera_offset=(0.1, 0.0))
LONG = DifferentialDrive(footprint=((0.5, 0.15), (-0.3, 0.15), (-0.3, -0.15), (0.5, -0.15)), camera_height=0.6)
CRITERIA = (Exposure(0.8), Turns(), Length(), make_criterion("clearance"), make_criterion("rotation"))


def made(kind, model):
    problem = Problem(WORLD, model, (0.8, 1.8, 0.0), (4.3, 2.3, None), CRITERIA)
    if kind == "lattice":
        return problem, Lattice(step=0.5).lattice(problem)
    if kind == "roadmap":
        return problem, Roadmap(samples=25, seed=2, neighbours=6).roadmap(problem)
    return problem, AnyAngle(step=0.5).roadmap(problem, Lattice(step=0.5).solve(problem))[0]


@pytest.fixture(params=["lattice", "roadmap", "any-angle"])
def kind(request):
    return request.param


@pytest.fixture(params=[ROUND, LONG], ids=["round", "long"])
def model(request):
    return request.param


@pytest.fixture
def asked(kind, model):
    return made(kind, model)


@pytest.mark.cases("lattice-round", "roadmap-round", "any-angle-long")
def test_turns_stay_at_a_place_and_moves_go_where_the_robot_looks(asked):
    _, graph = asked
    assert min(graph.edges("turn")[0].size, graph.edges("move")[0].size) > 20
    tails, heads = (graph.states(ids) for ids in graph.edges("turn"))
    assert (graph.places(graph.edges("turn")[0]) == graph.places(graph.edges("turn")[1])).all()
    assert ((tails.x == heads.x) & (tails.y == heads.y)).all()
    assert (np.abs(wrap(heads.yaw - tails.yaw)) > math.radians(1.0)).mean() > 0.9
    tails, heads = (graph.states(ids) for ids in graph.edges("move"))
    assert (graph.places(graph.edges("move")[0]) != graph.places(graph.edges("move")[1])).all()
    ahead = np.arctan2(heads.y - tails.y, heads.x - tails.x)
    for yaw in (tails.yaw, heads.yaw):
        assert np.abs(wrap(yaw - ahead)).max() < 1e-8


def test_no_two_states_are_one(asked):
    _, graph = asked
    s = graph.states(np.arange(graph.size))
    assert len({(x, y, round(yaw, 8)) for x, y, yaw in zip(s.x, s.y, s.yaw, strict=True)}) == graph.size
    assert ((s.yaw >= 0) & (s.yaw < 2 * math.pi)).all()


@pytest.mark.cases("lattice-round", "roadmap-round", "any-angle-long")
def test_every_edge_is_free_and_is_the_trajectory_of_its_ends(asked):
    problem, graph = asked
    for law, (tails, heads) in (("turn", graph.edges("turn")), ("move", graph.edges("move"))):
        some = np.random.default_rng(0).choice(tails.size, min(60, tails.size), replace=False)
        edges = [graph.trajectory(np.array(pair)) for pair in zip(tails[some], heads[some], strict=True)]
        assert {edge.kinds for edge in edges} == {(law,)}
        assert collision_free(problem, edges).all()  # by fcl
        costs = np.stack([motion_costs(c, graph.motions(law, tails[some], heads[some])) for c in CRITERIA], axis=1)
        assert trajectory_costs(CRITERIA, edges, WORLD) == pytest.approx(costs, abs=1e-9)


@pytest.mark.cases("lattice-long", "any-angle-long", "roadmap-round")
def test_a_turn_is_missing_only_where_the_robot_would_hit_something(asked, kind, model):
    """All pairs of headings at a place; a round robot turns everywhere, and a roadmap makes no turn below a degree."""
    _, graph = asked
    place = graph.places(np.arange(graph.size))
    states = graph.states(np.arange(graph.size))
    pairs = {
        (a, b)
        for at in np.unique(place)
        for a in np.flatnonzero(place == at)
        for b in np.flatnonzero(place == at)
        if a != b and (kind == "lattice" or abs(wrap(states.yaw[a] - states.yaw[b])) > math.radians(1.0))
    }
    turns = set(zip(*(ids.tolist() for ids in graph.edges("turn")), strict=True))
    small = {(a, b) for a, b in turns - pairs if kind != "lattice" and a == graph.start}
    assert turns - small <= pairs
    if model is ROUND:
        assert turns - small == pairs
        return
    # A turn that is left out comes within the hulls' 4.5 % of the reach: the robot grown by that does collide.
    grown = DifferentialDrive(
        footprint=tuple((x + math.copysign(0.05, x), y + math.copysign(0.05, y)) for x, y in LONG.footprint),
        camera_height=0.6,
    )
    problem = Problem(WORLD, grown, (0.8, 1.8, 0.0), (4.3, 2.3, None), CRITERIA)
    left_out = [graph.trajectory(np.array(pair)) for pair in sorted(pairs - turns)[:200]]
    assert left_out
    assert not collision_free(problem, left_out).any()


@pytest.mark.cases("lattice-round", "roadmap-round", "any-angle-long")
def test_what_edges_cost_makes_what_the_trajectory_costs(asked):
    problem, graph = asked
    rng = np.random.default_rng(1)
    search = graph.graph(CRITERIA)
    quanta = np.array([c.quantum for c in CRITERIA])
    leaves = np.diff(search.indptr) > 0  # a long robot may get stuck
    node = int(rng.choice(graph.edges("turn")[0]))
    walk, paid = [node], []
    for _ in range(60):
        arcs = np.arange(search.indptr[node], search.indptr[node + 1])
        arc = int(rng.choice(arcs[leaves[search.heads[arcs]]]))
        node = int(search.heads[arc])
        walk.append(node)
        paid.append(search.costs[arc] * quanta)
    again = trajectory_costs(CRITERIA, [graph.trajectory(np.array(walk))], problem.world)[0]
    worst = np.array([c.aggregate == "max" for c in CRITERIA])
    assert worst.tolist() == [False, False, False, True, False]
    added = np.where(worst, np.max(paid, axis=0), np.sum(paid, axis=0))
    assert (np.abs(added - again) <= np.where(worst, 1, len(paid)) * quanta).all()
