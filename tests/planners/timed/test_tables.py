"""Claims: what the graph on a clock has arcs and standing cost is what the criteria say, at any tick, near and far."""

from functools import cache

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from hpop.criteria.costs import motion_costs
from hpop.models import DifferentialDrive
from hpop.motions import HOLD, Motions, States
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.world import Future, Person, Track
from tests.planners.timed.rooms_with_people import ROBOT, through_the_doors
from tests.planners.timed.seen import SeenFromTheCamera

STAYS = Person(5.0, 1.2, velocity=(-0.3, 0.1), until=9.0, afterwards="stays")
TURNS_ROUND = Person.along(Track.through([(0, 5.0, 4.0), (4, 4.0, 4.0), (7, 4.0, 2.5), (10, 5.0, 2.5)]))
UNDECIDED = Person(
    4.0,
    4.0,
    futures=(Future(0.6, velocity=(0.0, -0.3), until=9.0), Future(0.4, velocity=(0.2, 0.0), until=7.0)),
    spread=0.2,
)
PEOPLE = {"stays": (STAYS,), "turns round": (TURNS_ROUND,), "several": (STAYS, TURNS_ROUND, UNDECIDED)}
CRITERIA = ["hall_zones", "personal_space", "visibility_to_people"]


@cache
def on_a_clock(people, criterion, robot=ROBOT, **options):
    problem = through_the_doors(*people, criteria=(criterion,), robot=robot)
    lattice = Lattice(step=0.5, **options)
    ends = lattice.ends(lattice.lattice(problem), problem)
    return problem, timed_graph(ends.space, problem.criteria, ends.start, ends.goals, lattice.time_options)


def earliest_ticks(timed):
    """Return the first tick at which each node can be reached."""
    graph = timed.graph.graph
    ticks = csr_array((timed.arcs.ticks.astype(float), graph.heads, graph.indptr), shape=(graph.nodes,) * 2)
    return dijkstra(ticks, indices=timed.start)


def some(rng, timed, number):
    """Arcs of the lattice, and ticks at which they can be left for by who comes from the start."""
    earliest = earliest_ticks(timed)
    arcs = rng.integers(0, timed.arcs.inner.arcs.heads.size, number)
    ticks = rng.integers(0, timed.graph.horizon + 5, number)
    reached = ticks >= earliest[timed.arcs.tails[timed.arcs.own[arcs]]]
    return arcs[reached], ticks[reached]


def by_criterion(problem, timed, arcs, ticks):
    """Return the problem's one criterion on arcs of the lattice that are left at some ticks."""
    costs = np.empty(arcs.size)
    for i, (arc, tick) in enumerate(zip(arcs, ticks, strict=True)):
        ((_, m),) = timed.arcs.inner.legs(np.array([arc]))
        then = Motions(problem.world, m.model, m.law, m.start, m.end, t0=np.array([tick * timed.clock.tick]))
        costs[i] = motion_costs(problem.criteria[0], then)[0]
    return costs


def standing(graph, place, begin, end):
    horizon, table, rate = graph.horizon, graph.standing[0][place], graph.rate[place, 0] / 2**20

    def total(tick):
        return table[min(tick, horizon)] + rate * max(0, tick - horizon)

    return total(end) - total(begin)


def on_the_clock(timed, arcs, ticks):
    """Return the costs, in quanta, of the timed graph."""
    graph, costs = timed.graph, np.empty(arcs.size)
    for i, (arc, tick) in enumerate(zip(timed.arcs.own[arcs].tolist(), ticks.tolist(), strict=True)):
        row = int(np.searchsorted(graph.timed, arc))
        costs[i] = graph.graph.costs[arc, 0]
        if graph.stays[arc]:
            node = int(timed.arcs.tails[arc])
            begin = min(tick, graph.horizon)
            costs[i] += standing(graph, int(graph.place[node]), begin, begin + int(graph.durations[arc]))
        elif row < graph.timed.size and graph.timed[row] == arc and 0 in graph.costs:
            costs[i] = graph.costs[0][row, min(tick, graph.horizon)]
    return costs


ASKED = [("hall_zones", "stays"), ("hall_zones", "several"), ("personal_space", "turns round")]
IN_PROOF = [pytest.param(c, p, marks=pytest.mark.proof) for c in CRITERIA for p in PEOPLE if (c, p) not in ASKED]


@pytest.mark.parametrize(("criterion", "people"), [*ASKED, *IN_PROOF])
def test_arcs_cost_what_the_criterion_says(criterion, people):
    problem, timed = on_a_clock(PEOPLE[people], criterion)
    rng = np.random.default_rng(0)
    arcs, ticks = some(rng, timed, 250)
    said, held = by_criterion(problem, timed, arcs, ticks), on_the_clock(timed, arcs, ticks) * timed.quanta[0]
    real, lasts = timed.arcs.durations[timed.arcs.own[arcs]], timed.arcs.ticks[timed.arcs.own[arcs]]
    share = lasts * timed.clock.tick / real  # a turn stands for whole ticks
    off = np.abs(said * share - held)
    assert arcs.size > 30
    assert (off <= timed.quanta[0] * 1.5 + timed.overlooked[0] * real + 0.05 * said).all()
    assert said.max() > 10 * timed.quanta[0]


@pytest.mark.parametrize("people", PEOPLE)
def test_standing_costs_what_a_hold_does(people):
    problem, timed = on_a_clock(PEOPLE[people], "hall_zones")
    rng = np.random.default_rng(1)
    graph, states = timed.graph, timed.arcs.states
    for node in rng.integers(0, graph.place.size, 40).tolist():
        place, begin = int(graph.place[node]), int(rng.integers(0, graph.horizon + 20))
        if begin < earliest_ticks(timed)[node]:
            continue
        end = begin + int(rng.integers(20, 80))
        where = {name: column[[place]] for name, column in states.__dict__.items()}
        start, stop = (States(**where, clock=np.array([tick * timed.clock.tick])) for tick in (begin, end))
        hold = Motions(problem.world, problem.model, HOLD, start, stop, t0=start.clock)
        said = float(motion_costs(problem.criteria[0], hold)[0])
        assert standing(graph, place, begin, end) * timed.quanta[0] == pytest.approx(
            said, abs=timed.quanta[0] * 2 + timed.overlooked[0] * (end - begin) * timed.clock.tick, rel=0.01
        )


def test_turns_have_tables_of_their_own_where_the_heading_matters():
    """A camera ahead of the axis is nearer to a person at some headings."""
    robot = DifferentialDrive(radius=0.25, camera_offset=(0.2, 0.0))
    problem = through_the_doors(STAYS, criteria=(SeenFromTheCamera(),), robot=robot)
    lattice = Lattice(step=1.0)
    ends = lattice.ends(lattice.lattice(problem), problem)
    timed = timed_graph(ends.space, problem.criteria, ends.start, ends.goals, lattice.time_options)
    assert not timed.graph.stays.any()
    rng = np.random.default_rng(0)
    arcs, ticks = some(rng, timed, 80)
    said, held = by_criterion(problem, timed, arcs, ticks), on_the_clock(timed, arcs, ticks) * timed.quanta[0]
    assert (np.abs(said - held) <= timed.quanta[0] + 2 * timed.overlooked[0] * 4).all()
    assert said.max() > 0
