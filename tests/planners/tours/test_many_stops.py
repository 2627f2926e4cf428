"""Tours whose stops are fixed to few states: exact through these states, by enumerations that share no code with hpop.

Fronts between stops come from the label setting of `test_enumerated`; orders, sums and dominance are computed here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.visits import visits_of
from hpop.errors import HpopError, OptionError, QueryError
from hpop.planners.base import Candidates, PlannerSpec
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.searches import fixed_stops, many_stops
from hpop.planners.searches.fixed_stops import FixedStops, stages_of
from hpop.planners.searches.many_stops import cover, in_order_of_shortest
from hpop.planners.spending import Limits
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Progress, Status
from hpop.trajectories.trajectory import Trajectory
from tests.planners.tours.test_enumerated import CRITERIA, SIZE, add, drawn, kept, label_setting, of_hold, orders
from tests.planners.tours.test_tours import EAST, LATTICE, NORTH, ROBOT, SEEN, WORLD, problem, sampled_visits

SMALL = hpop.DifferentialDrive(radius=0.3)
PLAIN = {"step": 1.0, "headings": 4}


def sites_drawn(seed: int, count: int) -> tuple[hpop.World, list[tuple[float, ...]], list[dict[str, Any]], Any]:
    """Return a small world, start and goal, stops of one state each, and the order of a tour."""
    rng = np.random.default_rng(2000 + seed)
    boxes = [shapely.box(x, y, x + 0.5, y + 0.5) for x, y in rng.uniform(0, 3, (rng.integers(0, 3), 2))]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-0.5, -0.5, SIZE[0] - 0.5, SIZE[1] - 0.5))
    places = [(float(x), float(y), k * np.pi / 2) for x, y, k in rng.integers(0, (4, 3, 4), (count + 2, 3))]
    stops = [{"goal": place, "dwell": float(rng.choice([0.0, 1.5]))} for place in places[2:]]
    for stop in stops:
        stop["optional"] = bool(rng.random() < 0.3)
    pair = rng.permutation(count)[:2].tolist()
    return world, places[:2], stops, ["any", [(pair[0], pair[1])], "given", "any"][seed % 4]


def joined_fronts(plain: Problem, stops: Sequence[Mapping[str, Any]], order: Any) -> set[tuple[int, ...]]:
    """Return the front of tours over all orders: sums of the fronts between stops of one state each, filtered."""
    query = Lattice(**PLAIN).query(plain)
    states = query.space.states(np.arange(query.space.size))
    rows = np.stack([states.x, states.y, np.cos(states.yaw), np.sin(states.yaw)], axis=1)
    nodes, holds = [], []
    for stop in stops:
        x, y, yaw = stop["goal"]
        nodes.append(int(np.flatnonzero(np.abs(rows - (x, y, np.cos(yaw), np.sin(yaw))).max(axis=1) < 1e-6)[0]))
        holds.append(of_hold(plain, stop["goal"], stop["dwell"]) if stop["dwell"] else (0,) * len(plain.criteria))
    nothing = {(0,) * len(plain.criteria)}
    labels = {node: label_setting(query.graph, {node: nothing}) for node in {query.start, *nodes}}
    optional = [i for i, stop in enumerate(stops) if stop["optional"]]
    found = set()
    for sequence in orders(len(stops), optional, order):
        total = nothing
        for begin, end in pairwise([query.start, *(nodes[i] for i in sequence)]):
            total = kept({add(a, b) for a in total for b in labels[begin].get(end, ())})
        last = nodes[sequence[-1]] if sequence else query.start
        dwells = [sum(column) for column in zip(*(holds[i] for i in sequence), strict=True)] if sequence else [0] * 3
        missed = (len(stops) - len(sequence),) if optional else ()
        ends = {
            add(add(a, b), tuple(dwells)) for a in total for goal in query.goals for b in labels[last].get(goal, ())
        }
        found |= {cost + missed for cost in ends}
    return kept(found)


def whole(found: Candidates) -> set[tuple[int, ...]]:
    """Return the planned costs in quanta."""
    quanta = [criterion.quantum for criterion in found.objectives]
    return set(map(tuple, np.rint(found.planned / quanta).astype(int).tolist()))


@pytest.mark.seeds(5, of=120)
def test_stops_of_one_state_have_the_front_of_all_orders_and_of_the_layered_search(seed: int) -> None:
    world, ends, stops, order = sites_drawn(seed, 2 + seed % 3)
    criteria = [*CRITERIA, *(["stops_missed"] if any(stop["optional"] for stop in stops) else [])]
    try:
        plain = Problem(world, SMALL, *ends, CRITERIA)
        asked = Problem(world, SMALL, *ends, criteria, tour=hpop.Tour(stops, order))
        layered = Lattice(**PLAIN).query(asked).paths(Limits())
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    planner = Lattice(**PLAIN, stop_states=1)
    found = planner.solve(asked)
    wanted = joined_fronts(plain, stops, order)
    assert whole(found) == wanted == set(map(tuple, layered.costs.tolist()))
    front = asked.solve(planner)
    assert len(front) >= (1 if wanted else 0)
    assert verify(asked, front) == []


@pytest.mark.seeds(4, of=60)
def test_stops_of_regions_are_never_better_and_more_states_are_never_worse(seed: int) -> None:
    world, (start, goal), stops, order = drawn(seed)
    criteria = [*CRITERIA, *(["stops_missed"] if any(stop["optional"] for stop in stops) else [])]
    try:
        asked = Problem(world, hpop.DifferentialDrive(radius=0.3), start, goal, criteria, tour=hpop.Tour(stops, order))
        fronts = [Lattice(**PLAIN, stop_states=number).solve(asked).planned for number in (1, 2, None)]
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    for fewer, more in pairwise(fronts):
        assert all((more <= point + 1e-9).all(axis=1).any() for point in fewer)


@pytest.mark.seeds(3, of=60)
def test_with_all_states_as_sites_the_fronts_between_them_make_the_front_of_the_layered_search(seed: int) -> None:
    world, (start, goal), stops, order = drawn(3000 + seed)
    criteria = [*CRITERIA, *(["stops_missed"] if any(stop["optional"] for stop in stops) else [])]
    try:
        query = Lattice(**PLAIN).query(Problem(world, SMALL, start, goal, criteria, tour=hpop.Tour(stops, order)))
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    layered = query.space
    assert isinstance(layered, TourGraph)
    plain = replace(query, space=layered.inner, graph=layered.inner.graph(query.objectives.optimised))
    fixed = FixedStops(replace(plain, goals=list(layered.goals)), layered, stages_of(layered.tour))
    fronts = {pair: fixed.front_between(*pair, Limits(), 0.0) for pair in fixed.pairs(fixed.parts)}
    tours = fixed.tours(fronts, fixed.parts, Limits(), 0.0, np.zeros(len(criteria), np.int64))
    assert tours.costs.tolist() == query.paths(Limits()).costs.tolist()


# Options


def three_sites(**more: Any) -> Problem:
    """Return a tour with three stops of one state each, in any order, with a dwell."""
    places = [(6.0, 1.0, 0.0), (1.0, 5.0, np.pi / 2), (5.0, 4.5, np.pi)]
    return problem([{"goal": place, "dwell": 2} for place in places], "any", ["turns", "length", "duration"], **more)


def test_options_of_the_search_hold_for_whole_tours() -> None:
    asked = three_sites()
    exact = Lattice(step=0.5).solve(asked).planned
    turns = int(exact[:, 0].min()) + 1
    bounded = Lattice(step=0.5, max_turns=turns)
    assert whole(Lattice(step=0.5, max_turns=turns, stop_states=1).solve(asked)) == whole(bounded.solve(asked))
    none = Lattice(step=0.5, max_turns=1, stop_states=1).solve(asked)
    assert none.status is Status.NO_PATH
    assert any("no path visits the stops with at most 1 turns" in note for note in none.notes)
    near = Lattice(step=0.5, eps=0.2, tolerance={"length": 1.0}, stop_states=1).solve(asked)
    assert len(near.planned) < len(exact)
    assert "every optimal cost vector is covered within a factor 1.2 and 1 in length; " in near.certificate
    assert all((near.planned <= 1.2 * point + (0, 1.0, 0) + 1e-9).all(axis=1).any() for point in exact)


def test_worst_values_and_means_join_like_sums() -> None:
    places = [(6.0, 1.0, 0.0), (1.0, 5.0, np.pi / 2), (5.0, 4.5, np.pi)]
    asked = problem([{"goal": p, "dwell": 2} for p in places], "any", ["peak_optic_flow", "obstruction", "turns"])
    few = Lattice(step=1.0, stop_states=1).solve(asked)
    assert whole(few) == whole(Lattice(step=1.0).solve(asked))
    assert "obstruction reported, not optimised" in few.certificate


def test_a_checkpoint_continues_the_search_of_tours(tmp_path: Path) -> None:
    asked, options = three_sites(), {"step": 0.5, "stop_states": 1, "checkpoint": str(tmp_path / "search")}
    whole_front = asked.solve("lattice", step=0.5, stop_states=1)
    for _ in range(2):
        assert asked.solve("lattice", **options).costs.tolist() == whole_front.costs.tolist()


def test_a_stopped_search_keeps_the_tours_in_the_order_of_the_shortest_one() -> None:
    asked = three_sites()
    stages = list(Lattice(step=0.5, stop_states=1).stages(asked))
    assert [stage.status for stage in stages] == [Status.UNFINISHED, Status.COMPLETE]
    assert all(origin["stage"] == "tours in the order of the shortest one" for origin in stages[0].provenance)
    assert all((stages[1].planned <= point).all(axis=1).any() for point in stages[0].planned)
    stopped = Lattice(step=0.5, stop_states=1, max_labels=1).solve(asked)
    assert stopped.status is Status.LABEL_LIMIT
    assert (
        "lattice: incomplete (label limit): the search found none for tours that stop at these states ("
        in stopped.certificate
    )


@pytest.mark.seeds(3, of=40)
def test_an_early_stage_has_the_whole_front_of_one_order(seed: int) -> None:
    world, ends, stops, _ = sites_drawn(seed, 3)
    criteria = [*CRITERIA, *(["stops_missed"] if any(stop["optional"] for stop in stops) else [])]
    order: Any = [(0, 1)] if seed % 2 else "any"
    planner = Lattice(**PLAIN)
    try:
        query = planner.query(Problem(world, SMALL, *ends, criteria, tour=hpop.Tour(stops, order)))
    except QueryError:
        pytest.skip("start, goal or a stop is blocked")
    stage = in_order_of_shortest(planner, query, Limits())
    if stage is None:
        assert len(query.paths(Limits())) == 0
        return
    assert stage.status is Status.UNFINISHED
    assert all(origin["stage"] == many_stops.ORDER for origin in stage.provenance)
    chains = [
        list(pairwise(each)) for each in permutations(range(3)) if order == "any" or each.index(0) < each.index(1)
    ]
    tours = [Problem(world, SMALL, *ends, criteria, tour=hpop.Tour(stops, chain)) for chain in chains]
    assert whole(stage) in [whole(planner.solve(tour)) for tour in tours]
    given = planner.query(tours[0])
    assert in_order_of_shortest(planner, given, Limits()) is None


def test_after_ctrl_c_the_tours_found_before_are_the_result() -> None:
    def interrupting(progress: Progress) -> None:
        if progress.detail == "2 of 8":  # between searches for other orders than the first one
            raise KeyboardInterrupt

    asked = three_sites()
    *_, stage, last = Lattice(step=0.5, stop_states=1).stages(asked, interrupting)
    assert last.status is Status.INTERRUPTED
    assert last.planned.tolist() == stage.planned.tolist() != []


def test_fronts_that_make_too_many_arcs_are_thinned_and_the_claim_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = three_sites()
    exact = Lattice(step=0.5).solve(asked).planned
    monkeypatch.setattr(many_stops, "MOST_ARCS", 25)
    found = Lattice(step=0.5, stop_states=1).solve(asked)
    said = re.search(r"every optimal cost vector is covered within a factor ([\d.]+);", found.certificate)
    assert said is not None
    assert any(f"thinned within a factor {said[1]}" in note for note in found.notes)
    assert all((found.planned <= float(said[1]) * point + 1e-9).all(axis=1).any() for point in exact)


@pytest.mark.seeds(5, of=50)
def test_a_cover_covers_and_is_no_larger_than_needed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = np.unique(rng.integers(0, 60, (40, 3)), axis=0)
    rows = cover(costs, 0.3)
    assert all((costs[rows] <= 1.3 * point).all(axis=1).any() for point in costs)
    for i, row in enumerate(rows):
        assert not (costs[rows[:i]] <= 1.3 * costs[row]).all(axis=1).any()


# Many stops


EIGHT = [
    EAST, {**NORTH, "dwell": 1}, SEEN,
    *({"at": at, "within": 0.6, "dwell": 1.0} for at in [(2, 2), (5, 2), (7, 5), (3, 5), (6, 3)]),
]  # fmt: skip


@pytest.mark.cases("lattice")
@pytest.mark.parametrize(
    "planner",
    [
        {"lattice": {"step": 0.5, "headings": 4}},
        {"roadmap": {"samples": 80}},
        {"exact": {"on": {"corners": {"step": 1.0, "headings": 4}}, "eps": 0.1}},
    ],
    ids=lambda planner: next(iter(planner)),
)
def test_eight_stops_in_any_order_are_all_visited_and_the_claim_names_their_states(planner: PlannerSpec) -> None:
    asked = problem(EIGHT)
    front = asked.solve(planner)
    assert len(front)
    assert asked.tour is not None
    sampled_visits(front, asked.tour)
    assert verify(asked, front) == []
    assert "for tours that stop at these states (east (" in front.certificate
    assert "; other states within a stop's region may be better; " in front.certificate
    assert any("each stop was fixed to one of its states, since the order leaves 256 sets" in n for n in front.notes)


def test_robots_with_several_speeds_visit_many_stops() -> None:
    asked = problem(
        EIGHT[:7],
        "any",
        ["duration", "speed_changes"],
        model=hpop.DifferentialDrive(radius=0.3, speeds=(0.5, 1.0), camera_height=1.2),
    )
    front = asked.solve("lattice", step=1.0, headings=4)
    assert len(front)
    assert verify(asked, front) == []


def test_optional_stops_among_many_are_skipped_at_their_weight() -> None:
    stops = [{**stop, "optional": i % 2 == 0} for i, stop in enumerate(EIGHT)]
    asked = problem(stops, "any", ["length", "stops_missed"])
    front = asked.solve("lattice", step=0.5, headings=4)
    assert asked.tour is not None
    sampled_visits(front, asked.tour)
    assert set(front.costs[:, 1].tolist()) == {0.0, 1.0, 2.0, 3.0, 4.0}
    assert verify(asked, front) == []


@pytest.mark.seeds(8, of=100)
def test_visits_of_many_optional_stops_miss_as_few_as_possible(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tour = hpop.Tour([{"at": (i, 0), "within": 1, "optional": True} for i in range(8)], [(0, 1)] if seed % 2 else "any")
    poses = [(float(x), float(y), 0.0) for x, y in rng.uniform(0, 5, (6, 2))]
    path = Trajectory.from_poses(SMALL, poses)
    inside = rng.random((8, len(path) + 1)) < 0.15
    first, last = inside.argmax(axis=1), inside.shape[1] - 1 - inside[:, ::-1].argmax(axis=1)
    missed = int((~inside.any(axis=1)).sum())
    if seed % 2 and inside[0].any() and inside[1].any() and first[0] > last[1]:
        missed += 1  # one of the two stops only, as stop 0 must come first
    visits = visits_of(tour, path, inside, {})
    assert (visits.missed, len(visits.visits)) == (missed, 8 - missed)


@pytest.mark.parametrize(
    ("count", "planner", "said"),
    [
        (8, {"weighted-sum": {"step": 1.0}}, "at most 64 sets of visited stops, which are six stops in any order"),
        (8, {"lattice": {"step": 1.0, "stop_states": 0}}, "stop_states must be a whole number"),
        (8, {"lattice": {"step": 1.0, "max_detour": 1.2}}, "max_detour needs a tour with at most 64 sets"),
        (13, LATTICE, "at most 4,096 sets of visited stops, which are twelve stops in any order; these 13 stops"),
    ],
)
def test_many_stops_are_refused_with_the_remedy(count: int, planner: PlannerSpec, said: str) -> None:
    stops = [{**stop, "name": f"s{i}"} for i, stop in enumerate((EIGHT * 2)[:count])]
    with pytest.raises(HpopError, match=re.escape(said)):
        problem(stops, "any", ["obstruction"]).solve(planner)


def test_a_drive_refuses_more_sets_of_stops_than_it_can_search() -> None:
    asked = problem(EIGHT[:7])
    front = asked.solve("lattice", step=1.0, headings=4)
    with pytest.raises(QueryError, match="a drive takes at most 64 sets of visited stops, which are six stops"):
        hpop.follow(asked, front, 0)


def test_stop_states_needs_a_tour_and_few_states_for_many_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OptionError, match="stop_states needs a problem with a tour; leave it out, or add stops"):
        Problem(WORLD, ROBOT, (1, 1, 0), (7, 3, None), ["length"]).solve("lattice", step=1.0, stop_states=1)
    monkeypatch.setattr(fixed_stops, "MOST_PARTS", 300)
    with pytest.raises(OptionError, match="stop_states must be smaller for a tour with 64 sets of visited stops"):
        problem(EIGHT[:6]).solve("lattice", step=1.0, stop_states=2)


@pytest.mark.parametrize("max_turns", [None, 8])
def test_stops_that_no_tour_can_join_leave_no_path_and_the_reason(max_turns: int | None) -> None:
    closed = shapely.box(5.0, 0.0, 8.0, 2.4).boundary.buffer(0.1)
    world = hpop.World.from_polygons([closed], extent=shapely.box(0, 0, 8, 6))
    front = problem([{"at": (6.5, 1.2), "within": 0.5, "name": "cell"}], world=world).solve(
        "lattice", step=0.5, stop_states=1, max_turns=max_turns
    )
    assert not len(front)
    assert any("; tours were searched through these states only: cell (" in note for note in front.notes)
    assert any("stop 'cell' cannot be reached from the start" in note for note in front.notes)


def test_states_behind_a_wall_are_never_chosen_whatever_cost_comes_first() -> None:
    wall, stops = shapely.box(-0.5, 1.45, 5.5, 1.55), [{"at": (x, 1.5), "within": 1.2} for x in (1, 2, 3, 4)]
    world = hpop.World.from_polygons([wall], extent=shapely.box(-0.5, -0.5, 5.5, 4.5))
    for criteria in (["length", "peak_optic_flow"], ["peak_optic_flow", "length"]):
        asked = Problem(world, SMALL, (0, 3, 0), (5, 3, None), criteria, tour=hpop.Tour(stops))
        front = asked.solve("lattice", **PLAIN, stop_states=1)
        assert front.costs[:, front.names.index("length")].min() == 7.0
