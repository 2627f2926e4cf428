"""Tours through files, graphs and searches: visits, certificates, round trips, and refusals that say what to do."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.cli.report import print_front
from hpop.criteria.performance.landmarks import StopsMissed
from hpop.errors import CriterionError, HpopError, OptionError, QueryError
from hpop.goals import Tour, TourStop
from hpop.planners.base import PlannerSpec
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.trajectories.trajectory import Trajectory
from hpop.view import draw_map
from hpop.world.content.content import Landmark

ROOM = shapely.box(0, 0, 8, 6)
WALL = shapely.box(3, 0, 4, 3)
VASE = Landmark(6.5, 4.5, 1.2, name="vase")
WORLD = hpop.World.from_polygons([WALL], extent=ROOM).with_content(landmarks=(VASE,))
ROBOT = hpop.DifferentialDrive(radius=0.3, camera_height=1.2, field_of_view=(np.pi / 2, np.pi / 3))
LATTICE = {"lattice": {"step": 0.5}}
EAST = {"at": (6, 1), "within": 0.8, "dwell": 3, "name": "east"}
NORTH = {"at": (1, 5), "within": 0.6, "name": "north"}
SEEN = {"landmark": "vase", "dwell": 2}
LOOK = {"look_at": {"target": (5.0, 5.0, 1.2), "distance": (0.5, 1.5)}, "dwell": 1.5, "name": "panel"}


def problem(stops: list[Any], order: Any = "any", criteria: Any = ("turns", "length"), **more: Any) -> Problem:
    given = {"world": WORLD, "model": ROBOT, "start": (1, 1, 0), "goal": (7, 3, None), **more}
    return Problem(criteria=list(criteria), tour=Tour(stops, order), **given)


def sampled_visits(front: Front, tour: Tour) -> None:
    """Check each recorded visit on samples of its trajectory, for positions, landmarks and targets, by own geometry."""
    for trajectory, origin in zip(front.trajectories, front.provenance, strict=True):
        visits = {visit["stop"]: (visit["begin"], visit["end"]) for visit in origin["visits"]}
        for stop in tour.stops:
            if stop.name not in visits:
                assert stop.optional
                continue
            begin, end = visits[stop.name]
            assert end - begin >= stop.dwell - 1e-6
            states = trajectory.at(np.linspace(begin, end, 20))
            x, y, yaw = (float(getattr(states, name)[0]) for name in ("x", "y", "yaw"))
            assert np.ptp(states.x) == np.ptp(states.y) == np.ptp(states.yaw) == 0.0
            if stop.at is not None:
                assert np.hypot(x - stop.at[0], y - stop.at[1]) <= float(stop.within or 0) + 1e-6
                continue
            aim = (VASE.x, VASE.y) if stop.landmark else (5.0, 5.0)
            off = np.arctan2(aim[1] - y, aim[0] - x) - yaw
            assert abs((off + np.pi) % (2 * np.pi) - np.pi) <= (np.pi / 4 if stop.landmark else np.radians(1.01))
            assert np.hypot(aim[0] - x, aim[1] - y) <= (3.0 if stop.landmark else 1.5) + 1e-6
            assert not WALL.crosses(shapely.LineString([(x, y), aim]))


@pytest.mark.parametrize(
    "planner",
    [
        LATTICE,
        {"roadmap": {"samples": 60}},
        {"any-angle": {"step": 1.0}},
        {"weighted-sum": {"step": 1.0}},
        {"exact": {"on": {"lattice": {"step": 1.0, "anchor": "world"}}, "eps": 0.1}},
        {"lattice": {"step": 1.0, "max_turns": 9, "time_limit": 60, "max_memory": 2_000_000_000}},
    ],
    ids=lambda planner: next(iter(planner)),
)
def test_each_graph_and_search_visits_all_stops_for_their_dwells(planner: PlannerSpec) -> None:
    asked = problem([EAST, NORTH, SEEN, LOOK])
    front = asked.solve(planner)
    assert len(front)
    assert "visiting east, north, vase and panel in any order" in front.certificate
    assert "NOT VALID" not in front.certificate
    assert asked.tour is not None
    sampled_visits(front, asked.tour)
    assert verify(asked, front) == []


def test_a_roadmap_of_configurations_visits_stops() -> None:
    goal = {"look_at": {"target": (7.0, 1.0, 1.2), "distance": (0.5, 1.5)}}
    asked = problem([EAST, LOOK], goal=goal)
    front = asked.solve("roadmap", samples=80)
    assert asked.tour is not None
    sampled_visits(front, asked.tour)
    assert len(front)
    assert verify(asked, front) == []


def test_a_skipped_stop_costs_its_weight() -> None:
    criteria = ["length", {"stops_missed": {"weights": {"north": 3}}}]
    asked = problem([EAST, {**NORTH, "optional": True}, {**SEEN, "optional": True}], "any", criteria)
    front = asked.solve(LATTICE)
    assert "north (optional)" in front.certificate
    assert {0.0} < set(front.costs[:, 1].tolist()) <= {0.0, 1.0, 3.0, 4.0}
    for point, origin in zip(front, front.provenance, strict=True):
        missed = {"north": 3, "vase": 1}.items() - {
            (v["stop"], {"north": 3, "vase": 1}.get(v["stop"])) for v in origin["visits"]
        }
        assert point.costs["stops_missed"] == sum(weight for _, weight in missed)
    assert verify(asked, front) == []


def test_a_given_order_skips_what_it_leaves_out() -> None:
    asked = problem([{**NORTH, "optional": True}, EAST], "given", ["length", "stops_missed"])
    front = asked.solve(LATTICE)
    assert [[v["stop"] for v in origin["visits"]] for origin in front.provenance] == [["east"], ["north", "east"]]


def test_a_front_with_a_tour_is_saved_loaded_verified_and_shown(tmp_path: Path, capsys: Any) -> None:
    asked = problem([EAST, NORTH], [("north", "east")], ["turns", "length", "duration"])
    front = asked.solve(LATTICE)
    front.save(tmp_path / "front.json")
    loaded = Front.load(tmp_path / "front.json")
    assert loaded.problem is not None
    again = Problem.from_description(loaded.problem)
    assert again.tour == asked.tour
    assert verify(again, loaded) == []
    print_front(again, loaded)
    printed = capsys.readouterr().out
    assert "stops, in the order of visits: 1 east, 2 north" in printed
    assert re.search(r"^ *0 .* 2 1 ", printed, re.MULTILINE)
    numbers = [text.get_text() for text in draw_map(again, loaded).axes[0].texts if text.get_gid() == "stop"]
    assert numbers == ["1", "2"]


def test_verify_finds_visits_that_are_missing_short_or_elsewhere() -> None:
    asked = problem([EAST, NORTH], [(1, 0)])
    front = asked.solve(LATTICE)
    first, *others = front.provenance

    def faults(visits: Any) -> str:
        return " ".join(verify(asked, replace(front, provenance=({**first, "visits": visits}, *others))))

    north, east = first["visits"]
    assert "has no record of its visits" in faults(None)
    assert "does not visit stop 'east'" in faults([north])
    assert "for 1 s only" in faults([north, {**east, "end": east["begin"] + 1}])
    assert "is not at stop 'north'" in faults([{**north, "begin": 0.0, "end": 0.0}, east])
    assert "moves while it visits" in faults([{**north, "begin": 0.0}, east])
    assert "against the order" in faults([east, north])


def test_a_dwell_costs_what_the_hold_costs_and_a_visit_without_dwell_costs_nothing() -> None:
    lasting, passing = (
        problem([{**EAST, "dwell": dwell}], "any", ["duration"]).solve(LATTICE).costs.min() for dwell in (3.0, 0.0)
    )
    assert lasting == pytest.approx(passing + 3.0)


def test_a_tour_that_ends_where_it_begins_misses_its_optional_stops_if_it_never_leaves() -> None:
    asked = problem([{**EAST, "optional": True}], "any", ["length", "stops_missed"], goal=(1, 1, 0))
    front = asked.solve(LATTICE)
    assert front.costs[0].tolist() == [0.0, 1.0]
    assert front.costs[1:, 1].tolist() == [0.0]
    assert verify(asked, front) == []
    here = problem([{"at": (1, 1), "within": 0.5, "optional": True}], "any", ["length", "stops_missed"], goal=(1, 1, 0))
    assert here.solve(LATTICE).costs.tolist() == [[0.0, 0.0]]


def test_a_checkpoint_of_a_tour_resumes(tmp_path: Path) -> None:
    asked = problem([EAST, NORTH], "any", ["turns", "length", "duration"])
    options = {"step": 0.5, "checkpoint": str(tmp_path / "search")}
    asked.solve("lattice", max_labels=50, **options)
    resumed = asked.solve("lattice", **options)
    assert resumed.costs.tolist() == asked.solve(LATTICE).costs.tolist()


def test_closed_arcs_are_closed_in_every_layer() -> None:
    from hpop.planners.graph_planners import Lattice
    from hpop.planners.spending import Limits

    query = Lattice(step=0.5).query(problem([EAST]))
    closed = np.zeros(query.graph.arcs, dtype=bool)
    closed[query.graph.indptr[query.start] : query.graph.indptr[query.start + 1]] = True
    part = query.graph.without(closed)
    assert not len(replace(query, graph=part).paths(Limits()))


# Scenario files


SCENARIO = """
world:
  polygons: {{extent: [[0, 0], [8, 0], [8, 6], [0, 6]], obstacles: [{{corners: [[3, 0], [4, 0], [4, 3], [3, 3]]}}]}}
model: {{differential_drive: {{radius: 0.3, camera_height: 1.2}}}}
start: [1, 1, 0]
goal: [7, 3, any]
landmarks: [{{x: 6.5, y: 4.5, z: 1.2, name: vase}}]
criteria: [turns, length, stops_missed]
planner: {{lattice: {{step: 1.0}}}}
tour:
  {order}
  stops:
    - {{at: [6, 1], within: 0.8, dwell: 3, name: east}}
    - {{look_at: {{target: [5, 5, 1.2], distance: [0.5, 1.5], angle_tolerance: 20 deg}}, dwell: 1.5}}
    - {stop}
"""
OPTIONAL = "{landmark: vase, dwell: 2, optional: true}"


def scenario(folder: Path, order: str = "order: any", stop: str = OPTIONAL) -> Path:
    file = folder / "tour.yaml"
    file.write_text(SCENARIO.format(order=order, stop=stop))
    return file


def test_a_scenario_has_the_tour_that_python_has(tmp_path: Path) -> None:
    loaded = load_scenario(scenario(tmp_path, "some: [[0, vase]]"))
    tour = loaded.problem.tour
    assert tour is not None
    assert tour.names == ("east", "stop 2", "vase")
    assert tour.order == ((0, 2),)
    assert tour.stops[0] == TourStop(at=(6, 1), within=0.8, dwell=3, name="east")
    assert tour.stops[1].goal.angle_tolerance == pytest.approx(np.radians(20))
    assert Problem.from_description(loaded.problem.describe()).tour == tour
    front = loaded.problem.solve(loaded.planners)
    assert verify(loaded.problem, front) == []


@pytest.mark.parametrize(
    ("order", "stop", "said"),
    [
        ("order: sometimes", OPTIONAL, "tour.order: expected 'given' or 'any' or a list, got 'sometimes'"),
        ("order: [[0, 1], [1, 0]]", OPTIONAL, "tour.order: pairs of the order must not contradict each other, but"),
        ("some: [[0, 1], [1, 0]]", OPTIONAL, "tour.some: pairs of the order must not contradict each other, but"),
        (
            "order: any",
            "{at: [6, 1], within: 1, dwell: -2}",
            "dwell of a stop must be a time in s from 0 to 3,600, got -2",
        ),
        ("order: any", "{at: [6, 1], name: x}", "stop 'x' at a position needs within"),
        ("order: any", "{landmark: vaze}", "no landmark is called 'vaze'. Did you mean 'vase'?"),
        ("order: any", "{at: [6, 1], within: 1, name: east}", "got 'east' more than once"),
        ("order: any", "{look_up: {}}", "look_up"),
        ("order: any", "{landmark: vase, optinal: true}", "tour.stops.2.optinal (stop 'vase'): no such key; did you"),
        ("order: any", "{at: [6, 1], within: 1, dwell: yes}", "tour.stops.2.dwell (stop 3): expected a number"),
    ],
)
def test_a_wrong_tour_is_refused_with_its_place(tmp_path: Path, order: str, stop: str, said: str) -> None:
    with pytest.raises(HpopError, match=re.escape(said)) as refused:
        load_scenario(scenario(tmp_path, order, stop))
    assert "tour.yaml" in str(refused.value)


# Refusals


@pytest.mark.parametrize(
    ("stops", "order", "said"),
    [
        ([], "given", "must have 1 to 60 stops, got 0; without any, leave it out"),
        ([{**EAST, "dwell": -1}], "given", "dwell of stop 'east' must be a time in s from 0"),
        ([EAST, EAST], "given", "got 'east' more than once; give these stops different names"),
        ([{"at": (1, 1), "landmark": "vase"}], "given", "exactly one of at with within"),
        ([{"at": (1, 1)}], "given", "needs within, the radius in m"),
        ([{"landmark": "urn"}], "given", "no landmark is called 'urn'. Landmarks with a name are vase"),
        ([EAST, NORTH], [(0, 1), (1, 0)], "but east before north before east; leave one of these pairs out"),
        ([EAST, NORTH], [("east", "south")], "got 'south'"),
        ([{**EAST, "name": str(i)} for i in range(13)], "any", "twelve stops in any order"),
        ([{**EAST, "name": str(i)} for i in range(14)], "any", "these 14 stops have more. Keep some of them in order"),
        ([{**EAST, "name": str(i)} for i in range(61)], "given", "must have 1 to 60 stops, got 61"),
        (
            [{**EAST, "dwell": float("nan")}],
            "given",
            "dwell of stop 'east' must be a time in s from 0 to 3,600, got nan",
        ),
        ([{**EAST, "within": 0}], "given", "within of stop 'east' must be a length in m from 1e-06"),
        ([EAST, NORTH, SEEN], [(0, 1), (1, 2), (2, 0)], "but east before north before vase before east; leave one"),
        ([EAST], [(0, 0)], "but east before east; leave one of these pairs out"),
        ([EAST], "sometimes", "order must be given, any, or a list of pairs"),
        ([{"look_up": 3}], "given", "'look_up' is not a key of a stop. Did you mean 'look_at'?"),
        ([{**EAST, "dwell": 3000}, {**NORTH, "dwell": 3000}], "given", "3,600 s at most in all"),
    ],
)
def test_a_wrong_tour_says_what_was_expected_and_what_to_do(stops: Any, order: Any, said: str) -> None:
    with pytest.raises(QueryError, match=re.escape(said)):
        problem(stops, order)


@pytest.mark.parametrize(
    ("stop", "said"),
    [
        (
            {"at": (3.5, 1.5), "within": 0.4, "name": "in the wall"},
            "no free robot state was found within 0.4 m of its position",
        ),
        ({"landmark": "walled in", "within": 0.2, "name": "too near"}, "or give a larger within"),
        ({"landmark": "in a niche", "name": "unseen"}, "The landmark may be behind obstacles"),
        ({"landmark": "ceiling", "name": "too high"}, "or outside the camera's field of view"),
        ({"at": (20.0, 1.0), "within": 0.5, "name": "outside"}, "at (20, 1) it is outside the map, which spans x 0.00"),
        (
            {"look_at": {"target": (3.5, 1.5, 1.2), "distance": (0.5, 1.0)}, "name": "hidden"},
            "with its target in view. The target may be inside or behind",
        ),
    ],
)
def test_a_stop_that_cannot_be_visited_is_named(stop: Any, said: str) -> None:
    landmarks = (
        Landmark(3.5, 1.5, 1.2, name="walled in"),
        Landmark(1.0, 4.0, 1.2, name="in a niche"),  # its walls are 0.2 m away on all sides
        Landmark(6.5, 4.5, 9.0, name="ceiling"),
    )
    niche = shapely.box(0.8, 3.8, 1.2, 4.2).exterior.buffer(0.05)
    world = hpop.World.from_polygons([WALL, niche], extent=ROOM).with_content(landmarks=landmarks)
    with pytest.raises(QueryError, match=re.escape(said)) as refused:
        problem([stop], world=world).solve(LATTICE)
    assert f"stop {stop['name']!r} cannot be visited" in str(refused.value)


def test_a_stop_behind_walls_is_out_of_reach() -> None:
    closed = shapely.box(5.0, 0.0, 8.0, 2.4).boundary.buffer(0.1)
    world = hpop.World.from_polygons([*closed.geoms] if hasattr(closed, "geoms") else [closed], extent=ROOM)
    front = problem([{"at": (6.5, 1.2), "within": 0.5, "name": "cell"}], world=world).solve(LATTICE)
    assert not len(front)
    said = "stop 'cell' cannot be reached from the start; with this stop as the goal: no path: obstacles separate"
    assert any(said in note for note in front.notes)


def test_an_optional_stop_out_of_reach_is_skipped_and_a_blocked_one_refused() -> None:
    closed = shapely.box(5.0, 0.0, 8.0, 2.4).boundary.buffer(0.1)
    world = hpop.World.from_polygons([WALL, closed], extent=ROOM)
    cell = {"at": (6.5, 1.2), "within": 0.5, "name": "cell", "optional": True}
    front = problem([cell], "any", ["length", "stops_missed"], world=world).solve(LATTICE)
    assert front.costs[:, 1].tolist() == [1.0]
    with pytest.raises(QueryError) as caught:
        problem([{**cell, "at": (3.5, 1.5), "within": 0.5}], "any", ["length", "stops_missed"]).solve(LATTICE)
    assert str(caught.value).startswith(
        "stop 'cell' cannot be visited: no free robot state was found within 0.5 m of its position (3.5, 1.5): it is "
        "inside an obstacle. Move it, or give a larger within. The nearest place where the robot is free is ("
    )
    assert str(caught.value).lower().count("move ") == 1


def test_planners_without_tours_refuse_them() -> None:
    for planner in ("rrt", "weighted-sum-corridor"):
        with pytest.raises(QueryError, match="cannot plan a tour, so the stops east"):
            problem([EAST]).solve(planner)
    with pytest.raises(OptionError, match="max_detour cannot be combined with optional stops"):
        problem([{**EAST, "optional": True}], "any", ["obstruction", "stops_missed"]).solve("lattice", max_detour=1.2)


@pytest.mark.parametrize(
    ("stops", "order", "done"),
    [
        ([EAST, NORTH, SEEN], "any", ["north"]),
        ([{**NORTH, "optional": True}, EAST, SEEN], "given", ["vase"]),
        ([EAST, NORTH, SEEN], [("east", "north"), ("north", "vase")], [0]),
        ([EAST, NORTH, SEEN], [("east", "north"), ("north", "vase")], [1]),
    ],
)
def test_stops_that_are_done_are_left_out(stops: list[Any], order: Any, done: list[Any]) -> None:
    criteria = ["length", "turns", *["stops_missed"] * any(stop.get("optional", False) for stop in stops)]
    tour = Tour(stops, order, done=done)
    names = {name if isinstance(name, str) else tour.names[name] for name in done}
    left = [stop for stop, name in zip(stops, tour.names, strict=True) if name not in names]
    kept = order if isinstance(order, str) else [pair for pair in order if not {*pair} & names]
    kept = [("east", "vase")] if done == [1] else kept  # pairs hold also over a stop that is done
    asked = Problem(WORLD, ROBOT, (1, 1, 0), (7, 3, None), criteria, tour=tour)
    front, fresh = asked.solve(LATTICE), problem(left, kept, criteria).solve(LATTICE)
    np.testing.assert_array_equal(front.costs, fresh.costs)
    assert [o["visits"] for o in front.provenance] == [o["visits"] for o in fresh.provenance]
    assert verify(asked, front) == []
    assert front.problem is not None
    again = Problem.from_description(front.problem)
    assert again.tour == asked.tour
    assert tour.words == Tour(left, kept).words
    first, *others = front.provenance
    wrong = {**first, "visits": [*first["visits"], {"stop": next(iter(names)), "begin": 0.0, "end": 9.0}]}
    assert "done before" in " ".join(verify(asked, replace(front, provenance=(wrong, *others))))


def test_a_tour_of_which_all_stops_are_done_has_the_front_without_a_tour() -> None:
    asked = Problem(WORLD, ROBOT, (1, 1, 0), (7, 3, None), ["length", "turns"], tour=Tour([EAST], done=[0]))
    plain = Problem(WORLD, ROBOT, (1, 1, 0), (7, 3, None), ["length", "turns"])
    np.testing.assert_array_equal(asked.solve(LATTICE).costs, plain.solve(LATTICE).costs)
    with pytest.raises(QueryError, match=r"done must name stops: east.*got 'west'"):
        Tour([EAST], done=["west"])


def test_stops_missed_needs_optional_stops_and_they_need_it() -> None:
    with pytest.raises(CriterionError, match="the problem has no tour"):
        Problem(WORLD, ROBOT, (1, 1, 0), (7, 3, None), ["length", "stops_missed"])
    with pytest.raises(CriterionError, match="set optional: true for a stop"):
        problem([EAST], criteria=["length", "stops_missed"])
    with pytest.raises(QueryError, match="needs the criterion stops_missed"):
        problem([{**EAST, "optional": True}])
    with pytest.raises(CriterionError, match="Did you mean 'east'"):
        problem([{**EAST, "optional": True}], criteria=["length", StopsMissed({"eest": 2})])


def test_missed_stops_of_any_trajectory_are_counted() -> None:
    asked = problem([{**EAST, "optional": True}, {**NORTH, "optional": True}], "any", ["length", "stops_missed"])
    way = Trajectory.from_poses(ROBOT, [(1, 1, 0), (1, 5, 0), (6, 5, 0), (6, 1, 0), (7, 3, 0)])
    assert asked.evaluate(way)["stops_missed"] == 1.0  # it passes both, and holds at none
    place = int(np.flatnonzero((way.states.x == 6) & (way.states.y == 1))[0])
    assert asked.evaluate(way.with_hold(at=place, seconds=3.0))["stops_missed"] == 0.0
    assert asked.evaluate(way.with_hold(at=place, seconds=2.9))["stops_missed"] == 1.0


def test_the_example_has_two_exhibits_and_an_optional_stop() -> None:
    loaded = load_scenario(Path(__file__).parents[3] / "examples" / "museum_tour.yaml")
    assert loaded.problem.tour is not None
    assert loaded.problem.tour.words == "visiting dinosaur, vitrine and east room (optional) in any order"
