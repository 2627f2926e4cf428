"""Explanations: the best paths through a place are those of an enumeration, and sentences say what the numbers say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString

import hpop
from hpop.errors import OptionError, QueryError, UnknownName
from hpop.planners.graphs.family import make_family
from hpop.problems.conditions import passage_of
from hpop.problems.verify import verify
from hpop.search import Graph
from hpop.world import Ground, Person, World
from hpop.world.content.content import Content, Landmark, Zone
from hpop.world.geometry.shapes import Obstacle
from tests.search.conftest import front_by_closure

Walk = tuple[tuple[int, int], ...]
ROBOT = hpop.DifferentialDrive(radius=0.2)
LONGEST = 9  # moves of an enumerated walk
SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1))


@cache
def drawn(seed: int) -> tuple[hpop.Problem, set[tuple[int, int]], tuple[int, int]]:
    """Return a problem on a grid of 4 x 3 positions, of which some are blocked; its free positions, and its goal."""
    rng = np.random.default_rng(seed)
    cells = [(x, y) for x in range(4) for y in range(3)]
    blocked = {cells[i] for i in rng.choice(len(cells), 2, replace=False).tolist()} - {(0, 1), (3, 1)}
    boxes = [shapely.box(x - 0.4, y - 0.4, x + 0.4, y + 0.4) for x, y in sorted(blocked)]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-0.5, -0.5, 3.5, 2.5))
    problem = hpop.Problem(world, ROBOT, (0, 1, 0), (3, 1, None), ["turns", "length", "rotation"])
    return problem, set(cells) - blocked, (3, 1)


def walks(free: set[tuple[int, int]], goal: tuple[int, int]) -> Iterator[Walk]:
    """Yield all walks of at most `LONGEST` moves from (0, 1) to the goal, also those that come back to a position."""
    stack: list[Walk] = [((0, 1),)]
    while stack:
        walk = stack.pop()
        if walk[-1] == goal:
            yield walk
        if len(walk) <= LONGEST:
            x, y = walk[-1]
            stack += [(*walk, (x + dx, y + dy)) for dx, dy in SIDES if (x + dx, y + dy) in free]


def paid(walk: Walk) -> tuple[float, float, float]:
    """Return turns, length and rotation of a walk that begins with heading 0."""
    headings = [0, *(SIDES.index((b[0] - a[0], b[1] - a[1])) for a, b in pairwise(walk))]
    quarters = [min((b - a) % 4, (a - b) % 4) for a, b in pairwise(headings)]
    return float(np.count_nonzero(quarters)), float(len(walk) - 1), sum(quarters) * np.pi / 2


def undominated(costs: set[tuple[float, ...]]) -> set[tuple[float, ...]]:
    return {c for c in costs if not any(o != c and all(a <= b for a, b in zip(o, c, strict=True)) for o in costs)}


def rounded(costs: Any) -> set[tuple[float, ...]]:
    return {tuple(row) for row in np.round(costs, 6).tolist()}


def passing(every: list[Walk], place: shapely.Geometry) -> list[Walk]:
    """Return the walks that come to a region, or cross a line an odd number of times."""
    there = {pair for pair in {p for walk in every for p in pairwise(walk)} if LineString(pair).intersects(place)}
    counts = [sum(pair in there for pair in pairwise(walk)) for walk in every]
    is_line = isinstance(place, LineString)
    return [walk for walk, count in zip(every, counts, strict=True) if (count % 2 if is_line else count)]


def place_of(seed: int) -> shapely.Geometry:
    """Return a line between positions of the grid, or a region of less than a cell."""
    rng = np.random.default_rng(seed + 100)
    if seed % 2:
        x, (low, high) = (
            rng.integers(0, 3) + rng.choice([0.3, 0.6]),
            sorted(rng.choice([-0.45, 0.45, 1.45, 2.45], 2, replace=False)),
        )
        return LineString([(x, low), (x + 0.05, high)])
    x, y = rng.uniform(0.0, 3.0), rng.uniform(0.0, 2.0)
    return shapely.box(x - 0.3, y - 0.3, x + 0.3, y + 0.3)


@pytest.mark.seeds(8, of=24)
def test_the_best_paths_through_a_place_are_those_of_all_walks(seed: int) -> None:
    problem, free, goal = drawn(seed // 2)
    place = place_of(seed)
    front = problem.solve("lattice", step=1.0, headings=4)
    every = list(walks(free, goal))
    if not every:
        assert not len(front)
        return
    assert rounded(front.costs) == rounded(list(undominated(set(map(paid, every)))))
    able = undominated(set(map(paid, passing(every, place))))
    solid = shapely.union_all([obstacle.polygon for obstacle in problem.world.obstacles])
    if problem.world.extent.difference(solid).intersection(place).is_empty:
        with pytest.raises(QueryError, match="wholly blocked"):
            front.why_not(place, problem=problem)
        return
    answer = front.why_not(place, problem=problem)
    assert answer.exact
    assert rounded(answer.front.costs) == rounded([*able]) if able else answer.best is None
    assert verify(problem, answer.front) == []
    if answer.best is None:
        assert answer.sentence.startswith(f"No path passes {answer.through}: ")
        return
    assert {i for i, row in enumerate(front.costs) if rounded([row]) <= rounded([*able])} == set(answer.rows)
    assert answer.row is not None
    told, compared = (problem.evaluate(t) for t in (answer.best.trajectory, front[answer.row].trajectory))
    assert answer.numbers == pytest.approx({name: told[name] - compared[name] for name in front.names})
    if answer.rows:
        assert "on the front" in answer.sentence
    else:
        assert min(answer.numbers.values()) >= -1e-9
        assert answer.sentence.endswith(f"than row {answer.row}; it is never better.")


# On other graphs, and among people who move

BOX = Obstacle(shapely.box(3.2, 1.2, 4.0, 2.2), name="the vase")
ZONE = Zone("speed", shapely.box(2.0, 2.4, 5.0, 3.4), limit=0.5, name="north aisle")
CONTENT = Content(zones=(ZONE,), landmarks=(Landmark(6.1, 0.4, name="sign"),))
GROUND = Ground((BOX, Obstacle(shapely.box(6.0, 2.6, 6.4, 3.4), name="post")), extent=shapely.box(0, 0, 7.2, 3.4))
CRITERIA = ["exposure", "turns", "length"]
LEFT, RIGHT = "left of the vase", "Right of VASE"
PLANNERS: dict[str, tuple[Any, dict[str, Any], Any]] = {
    "lattice": ({"lattice": {"step": 0.8, "headings": 8}}, {}, ROBOT),
    "ends off the lattice": ({"lattice": {"step": 0.9, "anchor": "world"}}, {}, ROBOT),
    "roadmap": ({"roadmap": {"samples": 30, "seed": 3}}, {}, ROBOT),
    "tour": ({"lattice": {"step": 0.8}}, {"tour": {"stops": [{"at": (5.4, 1.0), "within": 0.5, "dwell": 2}]}}, ROBOT),
    "speeds": ({"lattice": {"step": 0.8, "headings": 4}}, {}, hpop.DifferentialDrive(radius=0.2, speeds=(0.4, 0.8))),
}


def hall(model: Any = ROBOT, criteria: Any = CRITERIA, people: Any = (), **more: Any) -> hpop.Problem:
    world = World(GROUND, content=Content(people, zones=CONTENT.zones, landmarks=CONTENT.landmarks))
    return hpop.Problem(world, model, (0.9, 1.7, 0.0), (6.5, 1.8, None), criteria, **more)


@pytest.mark.parametrize("name", PLANNERS)
def test_each_path_passes_on_one_side(name: str) -> None:
    planner, more, model = PLANNERS[name]
    problem = hall(model, **more)
    front = problem.solve(planner)
    sides = [front.why_not(through=side, problem=problem, than=0) for side in (LEFT, RIGHT)]
    for side, sign in zip(sides, (1, -1), strict=True):
        assert side.exact
        assert verify(problem, side.front) == []
        assert all(crosses(trajectory, sign) for trajectory in side.front.trajectories)
        assert f"passing {side.through}, for (" in side.front.certificate
        own = {i for i, trajectory in enumerate(front.trajectories) if crosses(trajectory, sign)}
        assert own <= set(side.rows)
    costs = np.concatenate([side.front.costs for side in sides])
    assert undominated(rounded(costs)) == rounded(front.costs)


def crosses(trajectory: Any, sign: int) -> bool:
    """Return whether a trajectory crosses the line from the vase up (1), or down (-1), an odd number of times."""
    places = list(zip(trajectory.states.x.tolist(), trajectory.states.y.tolist(), strict=True))
    line = LineString([(3.6 - 1e-9, 1.7 + 0.5 * sign), (3.6 - 1e-9, 1.7 + 9.0 * sign)])
    return sum(LineString(pair).intersects(line) for pair in pairwise(places) if pair[0] != pair[1]) % 2 == 1


@pytest.mark.parametrize(
    "planner", [{"lattice": {"step": 0.9, "anchor": "world"}}, {"roadmap": {"samples": 12}}], ids=["lattice", "roadmap"]
)
def test_paths_through_a_zone_are_those_of_a_closure_over_two_copies_of_the_graph(planner: Any) -> None:
    problem = hall(criteria=["turns", "length"])
    query = make_family(planner).query(problem)
    graph, count = query.graph, query.space.size
    states = query.space.states(np.arange(count))
    tails, heads = np.repeat(np.arange(count), np.diff(graph.indptr)), graph.heads.astype(np.int64)
    ends = [[(states.x[a], states.y[a]), (states.x[b], states.y[b])] for a, b in zip(tails, heads, strict=True)]
    there = np.array([LineString(pair).intersects(ZONE.area) if pair[0] != pair[1] else False for pair in ends])
    arcs = [(tails, heads), (tails[there], heads[there] + count), (tails + count, heads + count)]
    costs = np.concatenate([graph.costs, graph.costs[there], graph.costs])
    both = Graph.from_arcs(2 * count, *map(np.concatenate, zip(*arcs, strict=True)), costs)
    expected = front_by_closure(both, query.start, {goal + count for goal in query.goals})
    answer = hpop.why_not(problem, problem.solve(planner), through="north aisle")
    assert expected
    assert np.allclose(answer.front.costs, np.array(expected) * query.quanta, atol=1e-4)


ANN = Person(6.0, 2.6, velocity=(-0.5, 0.0), name="Ann")
BEN = Person(6.7, 3.2, velocity=(0.0, -0.12), name="Ben")  # he comes to the goal when the robot may stand there


@pytest.mark.parametrize(
    ("people", "at"),
    [((), (2.5, 0.9)), ((), (4.9, 2.5)), ((), (0.9, 1.7)), ((ANN,), (2.5, 0.9)), ((BEN,), (4.9, 2.5))],
    ids=["alone", "left", "start", "Ann", "Ben"],
)
def test_passing_a_position_is_a_tour_with_one_stop_there(people: Any, at: tuple[float, float]) -> None:
    planner, criteria = {"lattice": {"step": 0.8, "headings": 4}}, ["turns", "duration", "length"]
    problem = hall(criteria=criteria, people=people)
    front = problem.solve(planner)
    answer = front.why_not(shapely.Point(at).buffer(0.05), problem=problem)
    tour = hall(criteria=criteria, people=people, tour={"stops": [{"at": at, "within": 0.05}]})
    toured = tour.solve(planner)
    assert answer.exact
    assert len(toured)
    assert np.allclose(answer.front.costs, toured.costs, atol=1e-6)
    assert verify(problem, answer.front) == []
    assert passage_of(problem, shapely.Point(at).buffer(0.05)).holds(answer.front.trajectories).all()


def test_among_people_each_path_passes_on_one_side() -> None:
    problem = hall(criteria=["turns", "duration", "length"], people=(ANN,))
    front = problem.solve("lattice", step=0.8)
    sides = [front.why_not(through=side, problem=problem) for side in (LEFT, RIGHT)]
    assert all(side.exact and "1 person who moves" in side.front.certificate for side in sides)
    assert all(crosses(t, s) for side, s in zip(sides, (1, -1), strict=True) for t in side.front.trajectories)
    costs = np.concatenate([side.front.costs for side in sides])
    assert undominated(rounded(costs)) == rounded(front.costs)


@pytest.mark.parametrize("people", [(), (ANN,)], ids=["alone", "Ann"])
def test_a_robot_that_only_turns_passes_where_it_stands(people: Any) -> None:
    world = World(GROUND, content=Content(people))
    problem = hpop.Problem(world, ROBOT, (0.9, 0.7, 0.0), (0.9, 0.7, np.pi / 2), ["turns", "length"])
    answer = problem.solve("lattice", step=0.8).why_not((0.9, 0.8), problem=problem)
    assert answer.front.costs.tolist() == [[1.0, 0.0]]
    assert answer.sentence == "Passing within 0.5 m of (0.9, 0.8) is on the front: row 0 passes there."


# Left and right, and names


def test_a_path_that_comes_back_across_the_line_does_not_pass_there() -> None:
    walls = [shapely.box(3.0, 1.2, 3.6, 2.0), shapely.box(3.8, 3.0, 4.0, 4.0), shapely.box(3.0, 2.8, 4.0, 3.0)]
    world = hpop.World.from_polygons(walls, extent=shapely.box(0, 0, 7, 4))
    problem = hpop.Problem(world, ROBOT, (0.5, 1.5, 0), (6.5, 1.5, None), ["turns", "length"])
    front = problem.solve("lattice", step=0.5)
    beyond = front.why_not([(3.3, 3.0), (3.3, 4.0)], problem=problem)  # the alcove behind the wall has no way out
    assert beyond.best is None
    assert beyond.sentence == (
        "No path passes between (3.3, 3) and (3.3, 4): each path that crosses the line there comes back across it."
    )
    inside = front.why_not([(3.3, 3.2), (3.5, 3.2), (3.5, 3.8), (3.3, 3.8)], problem=problem)
    assert inside.best is not None  # a region may be left as it was entered
    assert "it is never better" in inside.sentence


@pytest.mark.parametrize(
    ("start", "goal", "left"),
    [((0.9, 1.7), (6.5, 1.7), 1), ((6.5, 1.7), (0.9, 1.7), -1)],
    ids=["eastwards", "westwards"],
)
def test_left_is_that_of_a_traveller_to_the_goal(start: Any, goal: Any, left: int) -> None:
    problem = hpop.Problem(World(GROUND), ROBOT, (*start, 0.0), (*goal, None), ["length"])
    for side, sign in (("left", left), ("right", -left)):
        passage = passage_of(problem, f"{side} of vase")
        assert passage.words == f"{side} of the vase"
        (_, y), (_, end) = passage.shape.coords
        assert np.sign([y - 1.7, end - 1.7]).tolist() == [sign, sign]
        assert end > 3.4 if sign > 0 else end < 0.0


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("between VASE and the post", "between the vase and the post"),
        ("North Aisle", "through the north aisle"),
        (" 1, 1.5 ", "within 0.5 m of (1, 1.5)"),
        ("1,1 2,1 2,2 1,2", "through the region about (1.5, 1.5)"),
        ("1,0; 1,3", "between (1, 0) and (1, 3)"),
        ("left of 3.5,1.5", "left of (3.5, 1.5)"),
        ("right of sign", "right of sign"),
        ((1.0, 1.0), "within 0.5 m of (1, 1)"),
        (np.array([[1, 1], [2, 1], [2, 2]]), "through the region about (1.667, 1.333)"),
    ],
    ids=str,
)
def test_places_are_understood(place: Any, words: str) -> None:
    assert passage_of(hall(), place).words.removeprefix("right of the sign") == words.removeprefix("right of sign")


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (
            "left of moon",
            "zone or landmark of the map is called 'moon'. Known: 'sign', 'north aisle', 'the vase'",
        ),
        ("left of vse", "Did you mean 'vase'"),
        ("between vase", "between needs two things of the map"),
        ("between vase and moon", "is called 'moon'"),
        ("between vase and vase", "the vase and the vase touch"),
        ("vase", "'the vase' is no zone: ask for left of it or right of it"),
        ("north isle", "Did you mean 'north aisle'"),
        ("", "a place where a path passes must be"),
        ((9.0, 1.0), "off the map, which spans x 0.00 to 7.20 m"),
        ("9,1 9,2 10,2", "the region where a path shall pass is off the map"),
        (shapely.box(3.3, 1.3, 3.9, 2.1), "the region where a path shall pass is wholly blocked"),
        ([(3.3, 1.3), (3.9, 2.1)], "the line where a path shall pass is wholly blocked"),
        ([(1, 1), (1, 1)], "must be a valid shape"),
        ([(1, 1), (2, 2), (1, 2), (2, 1)], "must be a valid shape (Self-intersection"),
        ([(1, 1), (np.nan, 2)], "a place where a path passes must be"),
        ([1, 2, 3], "a place where a path passes must be"),
        (shapely.Point(), "must be a point, a line of two points, or a polygon"),
        ({"x": 1}, "a place where a path passes must be"),
    ],
    ids=str,
)
def test_places_that_cannot_be_used_are_refused(place: Any, message: str) -> None:
    with pytest.raises(QueryError, match=re.escape(message)):
        passage_of(hall(), place)


def test_what_lies_beyond_the_goal_has_no_left() -> None:
    problem = hpop.Problem(World(GROUND), ROBOT, (0.9, 1.7, 0.0), (2.0, 1.8, None), ["length"])
    with pytest.raises(QueryError, match="the vase does not lie between start and goal"):
        passage_of(problem, LEFT)


def test_two_things_of_one_name_are_told_apart_by_positions() -> None:
    twins = tuple(Obstacle(shapely.box(x, 1, x + 0.5, 2), name="column") for x in (2.0, 4.0))
    ground = Ground(twins, extent=shapely.box(0, 0, 7, 4))
    problem = hpop.Problem(World(ground), ROBOT, (0.5, 1.5, 0.0), (6.5, 1.5, None), ["length"])
    with pytest.raises(QueryError, match=r"2 things of the map are called 'column', at (2|4).25,1.5; (2|4).25,1.5:"):
        passage_of(problem, "left of column")
    assert passage_of(problem, "left of 4.25,1.5").shape.coords[0][1] == 2.0


# Wishes, rows, and what is not exact


def test_a_wish_alone_is_answered_from_the_front() -> None:
    problem = hall()
    front = problem.solve("lattice", step=0.8)
    least = front.best("turns").index
    none = front.why_not(wish="fewer turns", than=least, problem=problem)
    assert (none.best, none.sentence, none.exact) == (None, f"No path has fewer turns than row {least}.", True)
    shorter = front.why_not(wish="Less length", than=0, problem=problem)
    assert shorter.best is not None
    assert shorter.rows == tuple(np.flatnonzero(front.costs[:, 2] < front.costs[0, 2]).tolist())
    assert shorter.sentence.startswith("A path with less length takes ")
    assert shorter.numbers["length"] < 0.0 < shorter.numbers["exposure"]
    bound = front.why_not(wish={"turns": front.costs[least, 1]}, problem=problem)
    assert set(bound.rows) == set(np.flatnonzero(front.costs[:, 1] == front.costs[least, 1]).tolist())


def test_a_wish_bounds_the_paths_that_pass() -> None:
    problem = hall()
    front = problem.solve("lattice", step=0.8)
    every = front.why_not(through=LEFT, problem=problem)
    most = float(np.sort(every.front.costs[:, 1])[0])
    some = front.why_not(through=LEFT, wish={"turns": most}, problem=problem)
    assert rounded(some.front.costs) == {row for row in rounded(every.front.costs) if row[1] <= most}
    assert some.sentence.startswith(f"Passing left of the vase with at most {most:g} turns ")
    none = front.why_not(through=LEFT, wish={"turns": most - 1}, problem=problem)
    assert none.sentence == f"No path passes left of the vase with at most {most - 1:g} turns."


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ({}, "give region, through or wish"),
        ({"region": (1, 1), "through": LEFT}, "give region or through, not both"),
        ({"wish": "fewer pauses"}, "there is no cost 'pauses' to wish for. The front has the costs exposure, turns"),
        ({"wish": "hurry"}, "there is no cost 'duration'"),
        ({"wish": "more turns"}, "Did you mean 'fewer turns'"),
        ({"wish": {}}, "a wish must bound a cost"),
        ({"wish": {"turns": -1}}, "the wish for turns must be"),
        ({"wish": {"turns": 2}, "than": 99}, "no row 99: the front has rows 0 to"),
        ({"wish": {"turns": 2}, "than": "kneee"}, "no row is called 'kneee'"),
    ],
    ids=str,
)
def test_other_mistakes_are_refused(condition: dict[str, Any], message: str) -> None:
    problem = hall()
    with pytest.raises((OptionError, UnknownName), match=re.escape(message)):
        problem.solve("lattice", step=0.8).why_not(**condition, problem=problem)


def test_a_front_without_paths_has_nothing_to_compare() -> None:
    problem = hall()
    with pytest.raises(OptionError, match="the front has no path to compare with"):
        hpop.why_not(problem, problem.solve("lattice", step=0.8)[np.zeros(5, bool)], region=(1, 1))


def test_without_a_graph_to_search_the_rows_that_pass_are_told_and_nothing_is_claimed() -> None:
    problem = hall()
    front = problem.solve("lattice", step=0.8)
    other = replace(front, provenance=tuple({"planner": "rrt"} for _ in front))
    answer = hpop.why_not(problem, other, through=LEFT)
    assert not answer.exact
    assert set(answer.rows) == {i for i, t in enumerate(front.trajectories) if crosses(t, 1)}
    assert answer.sentence.endswith("Not all paths were searched: other paths may be better.")
    nowhere = hpop.why_not(problem, other, region=(6.8, 3.2))
    assert nowhere.sentence == (
        "No path that was found passes within 0.5 m of (6.8, 3.2). Not all paths were searched: another one may."
    )
    given = hpop.why_not(problem, other, through=LEFT, planner={"lattice": {"step": 0.8}})
    assert given.exact


@pytest.mark.proof
def test_curves_are_followed() -> None:
    problem = hall(criteria=["turns", "length"])
    front = problem.solve({"smoothing": {"warm_start": {"lattice": {"step": 0.8}}}})
    places = [trajectory.at(np.linspace(0.0, trajectory.duration, 2000)) for trajectory in front.trajectories]
    above = [bool((states.y[np.abs(states.x - 3.6) < 0.1] > 1.7).all()) for states in places]
    left, right = (front.why_not(through=side, problem=problem) for side in (LEFT, RIGHT))
    assert (left.rows, right.rows) == tuple(
        tuple(np.flatnonzero(np.array(above) == up).tolist()) for up in (True, False)
    )
    assert not left.exact


def test_a_mean_over_time_is_not_searched() -> None:
    problem = hall(criteria=["obstruction", "turns", "length"])
    front = problem.solve("lattice", step=0.8, max_detour=1.3)
    answer = front.why_not(through=LEFT, problem=problem)
    assert (answer.exact, answer.front.names) == (False, front.names)
    assert set(answer.rows) == {i for i, t in enumerate(front.trajectories) if crosses(t, 1)}


def test_a_search_that_ends_early_says_so() -> None:
    problem = hall()
    front = problem.solve("lattice", step=0.8)
    answer = hpop.why_not(problem, front, through=LEFT, planner={"lattice": {"step": 0.8, "max_labels": 30}})
    assert not answer.exact
    assert "Not all paths were searched" in answer.sentence


def test_a_saved_front_explains_itself(tmp_path: Path) -> None:
    problem = hall()
    front = problem.solve("lattice", step=0.8)
    front.save(tmp_path / "front.json")
    saved = hpop.Front.load(tmp_path / "front.json").why_not(through=LEFT)
    assert str(saved) == front.why_not(through=LEFT, problem=problem).sentence


def test_a_planning_answers_on_the_graph_that_it_has_built() -> None:
    planning = hpop.Planning(World(GROUND), ROBOT, CRITERIA, {"lattice": {"step": 0.8}})
    problem = planning.problem((0.9, 1.7, 0.0), (6.5, 1.8, None))
    front = planning.front(problem)
    answer = hpop.why_not(problem, front, through=LEFT)
    assert "anchored at the corner of the map" in answer.front.certificate
    assert answer.exact
